"""Identification from photographs: when they are prepared, which are refused, and what else a folder may hold."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from identify_command import CHEAP, identify, said
from PIL import Image

from cusick_bench.files.digest import digests_below
from cusick_bench.identify import data as data_of_folder
from cusick_bench.identify.data import as_data_set, holds_photographs
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.identify.workspace import Workspace
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.setting_text import SettingText
from cusick_bench.sim.errors import CusickError

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


def test_one_photograph_gets_its_stiffness_and_the_reason_why_no_diagnosis(photographs, tmp_path):
    result = identify(photographs, "--out", tmp_path / "out", "--weight", "180 g/m2", *CHEAP, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    (fabric,) = document["fabrics"]
    assert document["preparation"]["photographs"] == 1
    assert document["preparation"]["calibration"] == "the bare plate"
    assert fabric["areal_density"] == pytest.approx(0.18)
    assert 0 < fabric["drapes"]["drape_coefficient"]["value"] < 1
    assert fabric["fit"]["stiffness"]["warp"]["ci90"] is not None
    assert fabric["diagnosis"] is None
    assert "one sample" in fabric["diagnosis_missing"]
    assert any("board" in step for step in document["next"])


def test_photographs_are_prepared_again_only_where_they_options_or_the_code_changed(photographs, tmp_path, monkeypatch):
    workspace = Workspace(tmp_path / "out")
    workspace.prepare()
    read: list[str] = []

    def prepared(weight: str) -> str:
        data, preparation = as_data_set(
            str(photographs), workspace, SettingText(weight=(weight,)), 256, done=read.append
        )
        assert preparation is not None
        return (Path(data) / "fabrics.csv").read_text()

    assert "0.18" in prepared("180 g/m2")
    assert len(read) == 1
    prepared("180 g/m2")
    assert len(read) == 1
    assert "0.2," in prepared("200 g/m2")
    assert len(read) == 2
    monkeypatch.setattr(data_of_folder, "NUMERICS_VERSION", data_of_folder.NUMERICS_VERSION + 1)
    prepared("200 g/m2")
    assert len(read) == 3


def test_photographs_whose_folder_is_renamed_become_another_fabric(photographs, tmp_path):
    folder, workspace = tmp_path / "photos", Workspace(tmp_path / "out")
    workspace.prepare()
    (folder / "Fabric 1").mkdir(parents=True)
    shutil.copy(photographs / "plate.jpg", folder)
    shutil.copy(photographs / "Fabric_1_Sample_1_Capture_1.jpg", folder / "Fabric 1" / "Sample_1.jpg")
    as_data_set(str(folder), workspace, SettingText(), 256)
    (folder / "Fabric 1").rename(folder / "Fabric 3")
    data, _ = as_data_set(str(folder), workspace, SettingText(), 256)
    assert [path.name for path in Path(data).rglob("*.png")] == ["Fabric_3_Sample_1_Capture_1.png"]


@pytest.mark.parametrize("edit", ["change", "add", "remove"])
def test_edits_in_a_data_set_that_was_prepared_are_not_lost(photographs, tmp_path, edit):
    """It was made again over them, without a word, as soon as an option changed."""
    workspace = Workspace(tmp_path / "out")
    workspace.prepare()

    def prepared(weight: str) -> None:
        as_data_set(str(photographs), workspace, SettingText(weight=(weight,)), 256)

    prepared("180 g/m2")
    (workspace.data / ".hidden").write_text("of a file manager")
    prepared("190 g/m2")
    path = workspace.data / ("notes.txt" if edit == "add" else "fabrics.csv")
    path.unlink(missing_ok=True) if edit == "remove" else path.write_text("fabric,areal_density_kg_m2\n1,0.21\n")
    before = digests_below(workspace.data)
    prepared("190 g/m2")  # nothing else has changed: used as it is
    with pytest.raises(IdentifyError, match=rf"edited after it had been made \({path.name}\); move it away"):
        prepared("200 g/m2")
    assert digests_below(workspace.data) == before
    workspace.data.rename(tmp_path / "mine")
    prepared("200 g/m2")
    assert "0.2," in (workspace.data / "fabrics.csv").read_text()


def test_a_data_set_that_is_put_back_after_an_interruption_is_not_lost(photographs, tmp_path, monkeypatch):
    """It was moved away as the message says, and put back: the interrupted command had taken it for its own."""
    workspace = Workspace(tmp_path / "out")

    def prepared(weight: str) -> None:
        as_data_set(str(photographs), workspace, SettingText(weight=(weight,)), 256)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    for earlier in (True, False):
        if earlier:
            prepared("180 g/m2")
        else:
            (workspace.out / "data.json").unlink()
        edited = workspace.data / "fabrics.csv"
        edited.write_text("fabric,areal_density_kg_m2,thickness_m\n1,0.21,0.0004\n")
        before = digests_below(workspace.data)
        workspace.data.rename(tmp_path / "mine")
        with monkeypatch.context() as patched:
            patched.setattr(data_of_folder, "prepare", interrupted)
            with pytest.raises(KeyboardInterrupt):
                prepared("200 g/m2")
        (tmp_path / "mine").rename(workspace.data)
        with pytest.raises(CusickError, match="was edited after it had been made" if earlier else "is not empty"):
            prepared("200 g/m2")
        assert digests_below(workspace.data) == before


def test_a_table_of_weights_where_the_data_set_goes_is_not_removed(photographs, tmp_path):
    """`data prepare --out OUT/data --template` leaves one there."""
    table = tmp_path / "out/data/weights.csv"
    table.parent.mkdir(parents=True)
    table.write_text("fabric,weight,thickness\n1,5.3 oz/yd2,\n")
    with pytest.raises(IdentifyError, match=r"data holds weights\.csv, and the data set .* move it away"):
        as_data_set(str(photographs), Workspace(tmp_path / "out"), SettingText(weights=table), 256)
    assert "5.3 oz/yd2" in table.read_text()


def test_a_photograph_that_cannot_be_used_takes_no_data_set_away(photographs, tmp_path):
    """That of the other photographs was removed before the new one could be made."""
    folder, workspace, read = tmp_path / "photos", Workspace(tmp_path / "out"), []
    shutil.copytree(photographs, folder)
    as_data_set(str(folder), workspace, SettingText(), 256)
    before, other = digests_below(workspace.data), folder / "Fabric_1_Sample_2_Capture_1.jpg"
    with Image.open(folder / "Fabric_1_Sample_1_Capture_1.jpg") as image:
        image.crop((0, 0, image.width, image.height - 60)).save(other)
    with pytest.raises(BadPhotograph, match="the calibration's pictures"):
        as_data_set(str(folder), workspace, SettingText(), 256)
    assert digests_below(workspace.data) == before
    other.unlink()
    as_data_set(str(folder), workspace, SettingText(), 256, done=read.append)
    assert not read


@pytest.mark.parametrize("name", [b"Fabric_1_Sample_2_\xe9.jpg", b"\xe9t\xe9/Fabric_1_Sample_2.jpg"])
def test_names_of_photographs_that_are_no_text_are_refused(photographs, tmp_path, name):
    """They ended in a traceback, some of them after all outlines had been found."""
    folder = tmp_path / "photos"
    shutil.copytree(photographs, folder)
    odd = folder / os.fsdecode(name)
    odd.parent.mkdir(exist_ok=True)
    odd.write_bytes(b"no picture")
    with pytest.raises(IdentifyError, match="must be UTF-8; rename it"):
        as_data_set(str(folder), Workspace(tmp_path / "out"), SettingText(), 256)


def test_a_data_set_of_somebody_else_in_the_workspace_is_left_alone(photographs, lab, tmp_path):
    """However often the command is repeated: a record of its own would make the data set its own to remove."""
    out = tmp_path / "out"
    shutil.copytree(lab, out)
    before = sorted(out.rglob("*"))
    for _ in range(2):
        result = identify(photographs, "--out", out, *CHEAP)
        assert result.exit_code == 2, result.output
        assert "data: is not empty; give a new folder, or remove it" in said(result)
        assert sorted(out.rglob("*")) == before
    (out / "data.json").write_text("{}")
    result = identify(photographs, "--out", out, *CHEAP)
    assert result.exit_code == 2, result.output
    assert "data.json was not written by an identification; choose another --out" in said(result)
    assert sorted(out.rglob("*")) == sorted([*before, out / "data.json"])


def test_a_photograph_that_is_refused_is_named(photographs, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for path in photographs.glob("*.jpg"):
        (folder / path.name).write_bytes(path.read_bytes())
    for name in ("Fabric_1_Sample_2_Capture_1.jpg", "Fabric_7_Sample_1_Capture_1.jpg"):
        (folder / name).write_bytes(b"no picture")
    result = identify(folder, "--out", tmp_path / "out", *CHEAP, "--json")
    assert result.exit_code == 1, result.output
    document = json.loads(result.stdout)
    refused = document["preparation"]["refused"]
    assert [(Path(one["path"]).name, one["fabric"]) for one in refused] == [
        ("Fabric_1_Sample_2_Capture_1.jpg", 1),
        ("Fabric_7_Sample_1_Capture_1.jpg", 7),
    ]
    assert any(step.startswith("Take 1 photograph again") for step in document["fabrics"][0]["next"])
    assert any(step.startswith("Take all photographs of fabric 7 again") for step in document["next"])


def test_photographs_without_a_sure_outline_are_refused_together(photographs, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "plate.jpg").write_bytes((photographs / "plate.jpg").read_bytes())
    (folder / "Fabric_1_Sample_1_Capture_1.jpg").write_bytes(b"no picture")
    result = identify(folder, "--out", tmp_path / "out", *CHEAP)
    assert result.exit_code == 2
    assert "none of 1 photographs has a sure outline" in said(result)


def test_a_folder_of_nothing_says_what_was_expected(tmp_path):
    (tmp_path / "empty").mkdir()
    result = identify(tmp_path / "empty", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "holds no pictures; give photographs such as Fabric_1_Sample_2_Capture_1.jpg" in said(result)


def test_photographs_without_a_ruler_are_told_so(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    Image.fromarray(np.zeros((30, 40), dtype=np.uint8)).save(folder / "Fabric_1_Sample_1_Capture_1.jpg")
    result = identify(folder, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "holds no ruler" in said(result)
    assert "silhouettes, which need none, must be square pictures" in said(result)


def test_square_pictures_without_a_ruler_are_silhouettes(lab, photographs, tmp_path):
    source = lab / "data/Fabric 2/silhouettes/Fabric_2_Sample_1_Capture_1.jpg"
    (tmp_path / source.name).write_bytes(source.read_bytes())
    assert not holds_photographs(tmp_path)
    assert not holds_photographs(lab)
    assert holds_photographs(photographs)


@pytest.mark.parametrize("hidden", ["._{}", "@eaDir/{}", ".thumbnails/{}"])
def test_hidden_files_do_not_make_photographs_of_silhouettes(lab, tmp_path, hidden):
    """macOS puts ._NAME before NAME: the data set was refused for want of a ruler."""
    name = "Fabric_2_Sample_1_Capture_1.jpg"
    (tmp_path / name).write_bytes((lab / "data/Fabric 2/silhouettes" / name).read_bytes())
    other = tmp_path / hidden.format(name)
    other.parent.mkdir(exist_ok=True)
    other.write_bytes(b"no square picture")
    assert not holds_photographs(tmp_path)


@pytest.mark.parametrize("folder", ["silk", "Silhouette photos", "silo 3"])
def test_photographs_of_silk_are_photographs(photographs, tmp_path, folder):
    """A folder is one of silhouettes where the layout reads it as one, not where its name begins like that."""
    (tmp_path / folder).mkdir()
    for path in photographs.glob("*.jpg"):
        (tmp_path / (folder if path.stem.startswith("Fabric") else ".") / path.name).write_bytes(path.read_bytes())
    assert holds_photographs(tmp_path)
