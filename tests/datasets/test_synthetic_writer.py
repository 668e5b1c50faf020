"""The writer of the shipped set: it repeats its own work and overwrites nobody else's."""

from dataclasses import replace
from pathlib import Path

import pytest
from toy_cloths import surface, wavy_profile, write_toy
from typer.testing import CliRunner

from cusick_bench.cli.data.data import app
from cusick_bench.datasets import DataError
from cusick_bench.datasets.errors import DataNotFound
from cusick_bench.datasets.registry import REGISTRY
from cusick_bench.datasets.synthetic_set import recipe
from cusick_bench.datasets.synthetic_set.files import write_synthetic


@pytest.fixture(autouse=True)
def _toy_drapes(monkeypatch):
    """One drape of one cloth, which nobody simulates."""
    vertices, faces = surface(wavy_profile(7))
    cloths = recipe.cloths()[:1]
    monkeypatch.setattr(recipe, "cloths", lambda: cloths)
    monkeypatch.setattr(
        recipe, "drapes", lambda cloth, *, samples: iter([recipe.TrueDrape(cloth, 1, 1, "up", vertices, faces)])
    )


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("root", [".", "data", "data/Fabric 1"])
def test_a_laboratorys_folder_keeps_every_byte(tmp_path, root):
    write_toy(tmp_path, fabrics=(1,), samples=1)
    for name in ("fabrics.csv", "protocol.json", "truth.json"):
        (tmp_path / root / name).write_text("{}")
    before = contents(tmp_path)
    with pytest.raises(DataError, match=r"holds other files, .*; give a new folder with --out"):
        write_synthetic(tmp_path / root)
    assert contents(tmp_path) == before


def test_a_description_of_another_set_is_no_mark(tmp_path):
    (tmp_path / "croissant.json").write_text('{"name": "drapes-of-a-laboratory"}')
    with pytest.raises(DataError, match="holds other files"):
        write_synthetic(tmp_path)


def test_a_folder_of_this_writer_is_written_again(tmp_path):
    written = write_synthetic(tmp_path / "set")
    before = contents(tmp_path / "set")
    assert set(before) == {*written, "sha256.json"}
    assert write_synthetic(tmp_path / "set") == written
    assert contents(tmp_path / "set") == before


def test_the_set_has_the_same_bytes_where_lines_of_text_end_otherwise(tmp_path, monkeypatch):
    """As on Windows, where `data synthetic` said that every text differed from the shipped one."""
    here = write_synthetic(tmp_path / "here")

    def write_text(path: Path, text: str, encoding: str = "cp1252", newline: str | None = None) -> int:
        return path.write_bytes(text.replace("\n", "\r\n" if newline is None else newline).encode(encoding))

    monkeypatch.setattr(Path, "write_text", write_text)
    assert write_synthetic(tmp_path / "there") == here


def test_an_interrupted_run_is_repeated(tmp_path):
    def interrupt(name: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_synthetic(tmp_path, step=interrupt)
    assert "data/Fabric 1/silhouettes/Fabric_1_Sample_1_Capture_1.png" in write_synthetic(tmp_path)


def test_what_is_written_over_the_shipped_set_is_compared_with_what_was_there(tmp_path, monkeypatch):
    """It was compared with itself, and every file was said to equal the shipped one."""
    write_synthetic(tmp_path)
    monkeypatch.setitem(REGISTRY, "synthetic", replace(REGISTRY["synthetic"], folder=lambda: tmp_path))
    vertices, faces = surface(wavy_profile(9))
    monkeypatch.setattr(
        recipe, "drapes", lambda cloth, *, samples: iter([recipe.TrueDrape(cloth, 1, 1, "up", vertices, faces)])
    )
    result = CliRunner().invoke(app, ["synthetic", "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert "3 of 5 equal the shipped ones" in " ".join(result.stdout.split())
    again = CliRunner().invoke(app, ["synthetic", "--out", str(tmp_path)])
    assert again.exit_code == 0


def test_the_set_can_be_made_again_where_the_shipped_one_is_missing(tmp_path, monkeypatch):
    """Every command of `data` ended in a traceback, this one too."""

    def missing() -> Path:
        raise DataNotFound("the shipped set is missing")

    monkeypatch.setitem(REGISTRY, "synthetic", replace(REGISTRY["synthetic"], folder=missing))
    result = CliRunner().invoke(app, ["synthetic", "--out", str(tmp_path / "set")])
    assert result.exit_code == 0
    assert "no shipped ones to compare them with" in " ".join(result.stdout.split())
