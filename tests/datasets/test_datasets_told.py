"""What of a folder is not read, or counts twice, is told."""

import shutil

import pytest
from PIL import Image
from toy_cloths import image_path

from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit


def test_pictures_outside_the_layout_are_told(toy, caplog):
    """A capture whose name is misspelt went missing, and only the audit said so."""
    (toy / "diary.txt").write_text("it rained")
    assert len(load(toy)) == 12
    assert not caplog.messages
    for capture in range(1, 5):
        path = image_path(toy, 2, capture)
        path.rename(path.with_name(path.name.replace("Sample", "Smaple")))
    assert len(load(toy)) == 8
    (told,) = caplog.messages
    folder = "data/Fabric 7/silhouettes"
    first = ", ".join(f"{folder}/Fabric_7_Smaple_2_Capture_{capture}.png" for capture in (1, 2, 3))
    assert told.startswith(f"{toy}: 4 pictures are not read, ")
    assert f": {first}, ...; `cusick-bench data audit`" in told


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_pictures_in_other_formats_are_told(toy, caplog, suffix):
    """A capture in a format that is not read went missing, and only the audit said so."""
    first, second = image_path(toy, 1, 1), image_path(toy, 2, 1)
    shutil.copy(first, first.with_suffix(suffix))  # beside one that is read
    assert len(load(toy)) == 12
    assert not caplog.messages
    second.rename(second.with_suffix(suffix))
    assert len(load(toy)) == 11
    (told,) = caplog.messages
    assert told.startswith(f"{toy}: 1 picture is not read, ")
    assert f"Fabric_7_Sample_2_Capture_1{suffix}; `cusick-bench data audit`" in told


@pytest.mark.parametrize(
    "table",
    ["data/Fabric 7/protocol.json", "data/Fabric 7/silhouettes/Fabrics.csv", "data/fabrics.csv", "protocol.json.txt",
     "fabrics.xlsx", "protocol (1).json"],
)  # fmt: skip
def test_tables_that_are_not_read_are_told(toy, caplog, table):
    """Pictures were measured by the release's scale although their own stood beside them."""
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    (toy / "protocol.json").write_text('{"gravity_m_s2": 9.81}')
    load(toy)
    assert not caplog.messages
    (toy / table).write_text('{"px_per_m": 700}')
    load(toy)
    (told,) = caplog.messages
    assert told.startswith(f"{toy}: {table}: not read, so no weight, size or scale in there is used; ")
    unused = [one for one in audit(toy).irregularities if one.kind == "unused-file"]
    assert [one.detail.endswith(f": {table.rpartition('/')[2]}") for one in unused] == [True]
    caplog.clear()
    load(toy, fabrics_csv=toy / "fabrics.csv")
    assert len(caplog.messages) == 1


def test_a_table_that_is_read_is_not_told_however_its_path_is_written(toy, caplog, monkeypatch):
    (toy / "fabrics-2026.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    link = toy.with_name("link")
    link.symlink_to(toy)
    monkeypatch.chdir(toy)
    for root, table in ((link, link / "fabrics-2026.csv"), (".", "../lab/fabrics-2026.csv")):
        assert load(root, fabrics_csv=table).require_density(0) == 0.2
    assert not caplog.messages


def test_thumbnails_of_a_network_disk_are_no_pictures(toy, caplog):
    thumbnails = toy / "data/Fabric 7/silhouettes/@eaDir/Fabric_7_Sample_1_Capture_1.png"
    thumbnails.mkdir(parents=True)
    shutil.copy(image_path(toy, 1, 1), thumbnails / "SYNOPHOTO_THUMB_M.png")
    assert len(load(toy)) == 12
    assert not caplog.messages


@pytest.mark.parametrize("root", [".", "data", "data/Fabric 1"])
def test_the_shipped_set_has_no_pictures_outside_the_layout(root, caplog):
    load(load("synthetic").root / root)
    assert not caplog.messages


def test_two_pictures_of_one_capture_are_told(toy, caplog):
    """The other sample's drape counted as a repeat of the first one's."""
    stranger = image_path(toy, 3, 3)
    renamed = stranger.rename(stranger.with_name("fabric-7-sample-01-capture-01.png"))
    assert list(load(toy).index["capture"][:3]) == [1, 1, 2]
    (told,) = caplog.messages
    first, second = (path.relative_to(toy).as_posix() for path in (image_path(toy, 1, 1), renamed))
    same = "1 silhouette has the same fabric, sample and capture as another one"
    assert told.startswith(f"{toy}: {same}, such as {second} and {first}, ")
    assert told.endswith("remove the wrong ones")


def test_a_capture_without_its_number_is_told_beside_the_first_one(toy, caplog):
    path = image_path(toy, 1, 3)
    path.rename(path.with_name("Fabric_7_Sample_1.png"))
    load(toy)
    folder = "data/Fabric 7/silhouettes"
    assert f"such as {folder}/Fabric_7_Sample_1_Capture_1.png and {folder}/Fabric_7_Sample_1.png, " in caplog.text


def test_a_second_picture_of_a_capture_that_cannot_be_used_does_not_count(toy, caplog):
    image_path(toy, 1, 1).with_name("fabric-7-sample-01-capture-01.png").write_bytes(b"junk")
    assert len(load(toy)) == 13
    assert not caplog.messages


def test_a_drape_in_two_formats_is_not_told_as_two_pictures(toy, caplog):
    path = image_path(toy, 1, 1)
    Image.open(path).save(path.with_suffix(".bmp"))
    load(toy)
    assert not caplog.messages


def test_copies_of_a_picture_that_count_as_drapes_are_told(toy, caplog):
    load(toy)
    assert "copy" not in caplog.text
    shutil.copy(image_path(toy, 1, 1), image_path(toy, 2, 1))
    load(toy)
    first, second = (image_path(toy, sample, 1).relative_to(toy).as_posix() for sample in (1, 2))
    assert f"{toy}: 1 silhouette is a copy of another one, such as {second} of {first}" in caplog.text
    assert "remove the copies" in caplog.text
