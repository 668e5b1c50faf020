"""A data set in the form of Hugging Face's `datasets`: read back by pyarrow, and by that library where it is."""

import errno
import importlib.util
import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from toy_cloths import write_toy
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.export.errors import ExportError
from cusick_bench.export.huggingface import COLUMNS, write_huggingface
from cusick_bench.files.table_file import MissingLibrary

parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture(scope="module")
def written(toy_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("huggingface") / "toy"
    assert write_huggingface(load(toy_data), folder) == len(load(toy_data))
    return folder


def _table(folder: Path):
    return parquet.read_table(folder / "data" / "train-00000-of-00001.parquet")


def test_pictures_and_columns_are_those_of_the_data_set(written: Path, toy_data: Path):
    dataset, rows = load(toy_data), _table(written).to_pylist()
    index = dataset.index
    assert [row["cloth"] for row in rows] == index["cloth"].tolist()
    assert [(row["sample"], row["capture"]) for row in rows] == list(
        zip(index["sample"], index["capture"], strict=True)
    )
    for number in (0, len(rows) - 1):
        picture = np.asarray(Image.open(io.BytesIO(rows[number]["image"]["bytes"])))
        assert np.abs(picture / 255 - dataset.image(number).numpy()).max() <= 0.5 / 255 + 1e-9
    splits = dataset.split("paper")
    for name in ("train", "test"):
        expected = {number for split in splits for number in getattr(split, name)}
        assert {number for number, row in enumerate(rows) if row["paper_split"] == name} == expected


def test_what_is_unknown_is_null(make_lab, tmp_path: Path):
    write_huggingface(load(make_lab((2.0, 4.0), samples=2, weighed=1)), tmp_path / "lab")
    densities = {row["cloth"]: row["areal_density"] for row in _table(tmp_path / "lab").to_pylist()}
    assert densities == {"fabric_1": 0.2, "fabric_2": None}


def test_the_card_holds_the_name_as_it_is(tmp_path: Path):
    """YAML reads JSON's escapes of an emoji as two characters, which are none."""
    lab = write_toy(tmp_path / "lab \U0001f9f5", fabrics=(1,), samples=2, captures=1)
    write_huggingface(load(lab), tmp_path / "out")
    head = (tmp_path / "out" / "README.md").read_text(encoding="utf-8").splitlines()[1]
    assert head == 'pretty_name: "Cusick drape silhouettes: lab \U0001f9f5"'


def test_a_cloth_of_one_sample_is_written_without_a_part(tmp_path: Path):
    write_toy(tmp_path / "lab", fabrics=(1,), samples=3, captures=1)
    write_toy(tmp_path / "lab", fabrics=(2,), samples=1, captures=1)
    write_huggingface(load(tmp_path / "lab"), tmp_path / "out")
    assert [row["paper_split"] for row in _table(tmp_path / "out").to_pylist()] == ["train", "test", "test", ""]


def test_the_table_says_that_images_are_images(written: Path):
    features = json.loads(_table(written).schema.metadata[b"huggingface"])["info"]["features"]
    assert features["image"] == {"_type": "Image"}
    assert set(features) == {"image", *COLUMNS} == set(_table(written).column_names)


def test_the_card_says_how_pictures_are_read(written: Path, toy_data: Path, tmp_path: Path):
    """Areas of pictures from .8 m give 8 points too small a drape coefficient."""
    card = (written / "README.md").read_text(encoding="utf-8")
    assert "column 127.5, row 127.5" in card
    assert "y axis points to the first row" in card
    assert "parallel" in card
    near = Path(shutil.copytree(toy_data, tmp_path / "near"))
    protocol = {"projection": "pinhole", "camera_height_m": 0.8, "image_y": "down", "centre_px": [127, 128.25]}
    (near / "protocol.json").write_text(json.dumps(protocol))
    write_huggingface(load(near), tmp_path / "out")
    card = (tmp_path / "out" / "README.md").read_text(encoding="utf-8")
    assert "column 127, row 128.25" in card
    assert "y axis points to the last row" in card
    assert "0.8 m above the plate" in card


def test_pictures_of_a_series_have_numbers_of_their_own(toy_data: Path, tmp_path: Path):
    picture = next(toy_data.rglob("*.png"), None) or next(toy_data.rglob("*.jpg"))
    folder = tmp_path / "lab" / "data" / "Fabric 1 Observations" / "Sample 2"
    folder.mkdir(parents=True)
    for number in (1, 2, 3):
        shutil.copy(picture, folder / f"Obs_{number}{picture.suffix}")
    write_huggingface(load(tmp_path / "lab"), tmp_path / "out")
    rows = _table(tmp_path / "out").to_pylist()
    assert [(row["sample"], row["capture"], row["observation"]) for row in rows] == [(2, 1, 1), (2, 1, 2), (2, 1, 3)]


def test_the_card_says_that_data_without_a_licence_are_not_to_be_published(written: Path):
    card = (written / "README.md").read_text(encoding="utf-8")
    assert "\nlicense: unknown\n" in card
    assert "Do not publish" in card


@pytest.mark.parametrize("name", ["synthetic", "cusick"])
def test_the_card_does_not_take_a_folder_for_the_registered_set_of_its_name(tmp_path: Path, name: str):
    write_toy(tmp_path / name, samples=1, captures=1)
    write_huggingface(load(tmp_path / name), tmp_path / "out")
    card = (tmp_path / "out" / "README.md").read_text(encoding="utf-8")
    assert "Licence: none is known. Do not publish" in card
    assert "Source:" not in card


def test_the_card_knows_a_registered_set_by_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_toy(tmp_path / "release", samples=1, captures=1)
    monkeypatch.setenv("CUSICK_DATA", str(tmp_path / "release"))
    write_huggingface(load(tmp_path / "release"), tmp_path / "out")
    card = (tmp_path / "out" / "README.md").read_text(encoding="utf-8")
    assert "Licence: none stated, all rights reserved" in card
    assert "CVPR 2024" in card


def test_the_command_writes_the_shipped_set_under_its_licence(tmp_path: Path):
    result = CliRunner().invoke(app, ["export", "huggingface", str(tmp_path / "new"), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["rows"] == len(load("synthetic"))
    card = (tmp_path / "new" / "README.md").read_text(encoding="utf-8")
    assert "\nlicense: apache-2.0\n" in card
    assert "Do not publish" not in card


def test_the_card_holds_a_command_that_is_no_text(tmp_path: Path, toy_data: Path):
    """The folder's name may be of bytes that are no UTF-8."""
    write_huggingface(load(toy_data), tmp_path / "out", command=os.fsdecode(b"export huggingface caf\xe9"))
    assert "`export huggingface caf\\udce9`" in (tmp_path / "out" / "README.md").read_text(encoding="utf-8")


def test_a_disk_that_is_full_leaves_nothing_in_the_way(tmp_path: Path, toy_data: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", _half)
        with pytest.raises(OSError, match="No space left"):
            write_huggingface(load(toy_data), tmp_path / "new" / "out")
    assert not (tmp_path / "new").exists()
    write_huggingface(load(toy_data), tmp_path / "new" / "out")


def _half(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
    raise OSError(errno.ENOSPC, "No space left on device")


def test_without_the_library_nothing_else_is_advised(tmp_path: Path, toy_data: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingLibrary, match=r"cusick-bench\[parquet\]'`$"):
        write_huggingface(load(toy_data), tmp_path / "out")


def test_a_folder_with_files_is_left_alone(tmp_path: Path, toy_data: Path):
    (tmp_path / "README.md").write_text("mine", encoding="utf-8")
    with pytest.raises(ExportError, match="give another one"):
        write_huggingface(load(toy_data), tmp_path)
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == "mine"


READING = """
import sys
from datasets import load_dataset
drapes = load_dataset(sys.argv[1], split="train", cache_dir=sys.argv[2])
print(len(drapes), drapes[0]["image"].size, type(drapes.features["image"]).__name__)
"""


@pytest.mark.skipif(importlib.util.find_spec("datasets") is None, reason="Hugging Face's datasets is not installed")
def test_the_library_reads_it(written: Path, tmp_path: Path, toy_data: Path):
    command = [sys.executable, "-c", READING, str(written), str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[-2] == f"{len(load(toy_data))} (256, 256) Image"
