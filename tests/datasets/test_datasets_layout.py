"""Layouts of folders that are read, and where tables are looked for."""

import gzip
import shutil
from pathlib import Path
from unicodedata import normalize

import pytest
from PIL import Image
from toy_cloths import (
    draw,
    image_path,
    surface,
    toy_profile,
    write_image,
    write_mesh,
    write_toy,
)

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit


@pytest.mark.parametrize("root", [".", "data", "data/Fabric 7"])
def test_any_level_of_the_layout_is_a_root(toy, root):
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    dataset = load(toy / root)
    assert len(dataset) == 12
    assert dataset.require_density(0) == 0.2
    assert (dataset.index["mesh"] != "").all()
    assert dataset.sample(0).mesh is not None


@pytest.mark.parametrize(
    ("root", "silhouettes", "fabric"),
    [
        ("Sample 3/lab", "data/Fabric 7/silhouettes", 7),
        ("Sample 3", "data/Fabric 7/silhouettes", 7),
        ("Fabric 9/lab", "silhouettes", 7),
        ("Sample 3/Fabric 9", "silhouettes", 9),
    ],
)
def test_folders_above_the_data_rename_nothing(toy, root, silhouettes, fabric):
    """All samples became sample 3, or the fabric another one, without a word."""
    lab = toy.parent / "elsewhere" / root
    shutil.copytree(toy / "data/Fabric 7/silhouettes", lab / silhouettes)
    index = load(lab).index
    assert set(index["fabric"]) == {fabric}
    assert sorted(set(index["sample"])) == [1, 2, 3]


def test_folders_of_a_root_within_the_data_still_decide(toy):
    """Their names decide, as they do where the whole data set is the root, not those in the files' names."""
    fabric, sample = toy / "data/Fabric 8", toy / "data/Fabric 8 Observations/Sample 5"
    named = toy / "bnn_image_gt/cotton_blue"
    shutil.copytree(toy / "data/Fabric 7/silhouettes", fabric / "silhouettes")
    write_image(sample / "Fabric_7_Sample_1_Obs_2.png", draw(toy_profile(8, 5, 1)))
    write_image(named / "sample_1_Upward_Drape_1.png", draw(toy_profile(8, 1, 1)))
    assert set(load(fabric).cloths) == set(load(fabric / "silhouettes").cloths) == {"fabric_8"}
    assert load(sample).index[["cloth", "sample"]].values.tolist() == [["fabric_8_observations", 5]]
    assert load(named).cloths == load(named.parent).cloths == ["cotton_blue"]


@pytest.mark.parametrize("row", ["Raw Silk-2", "raw_silk_2"])
def test_a_named_set_finds_its_weight_however_its_name_is_written(toy, row):
    """Rows have one spelling, and sets that of their folder: a space or a hyphen kept the two apart."""
    folder = toy / "bnn_image_gt" / "Raw Silk-2"
    folder.mkdir(parents=True)
    write_image(folder / "sample_1_Upward_Drape_1.png", draw(toy_profile(8, 1, 1)))
    (toy / "fabrics.csv").write_text(f"fabric,areal_density_kg_m2\n{row},0.3\n")
    dataset = load(toy).select(cloth="raw silk-2")
    assert dataset.require_density(0) == 0.3
    assert not [one for one in audit(toy).irregularities if one.kind == "fabrics-unused"]


def test_a_number_at_the_start_of_a_named_set_is_no_fabric(toy):
    """It was to be weighed as `fabric_7`: the row of another cloth, which is not read for this one."""
    write_image(toy / "bnn_image_gt/7_oz_denim/sample_1_Upward_Drape_1.png", draw(toy_profile(8, 1, 1)))
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    dataset = load(toy).select(cloth="7_oz_denim")
    assert dataset.index["fabric"].tolist() == [0]
    with pytest.raises(DataError, match="add `7_oz_denim,<kg/m2>,`"):
        dataset.require_density(0)


def test_fabrics_may_be_numbered_by_their_article(toy):
    """The weight of a number of ten digits or more was lost, also of photographs to which it had been given."""
    number = 4006381333931
    folder = image_path(toy, 1, 1).parent.parent
    folder.rename(folder.with_name(f"Fabric {number}"))
    (toy / "fabrics.csv").write_text(f"fabric,areal_density_kg_m2\n{number},0.2\n")
    assert load(toy).require_density(0) == 0.2
    assert not [one for one in audit(toy).irregularities if one.kind == "fabrics-unused"]


def test_accents_are_the_same_letters_however_they_are_stored(toy):
    """Folders from a Mac have them as two characters: the cloth had no weight, and could not be named."""
    folder = toy / "bnn_image_gt" / normalize("NFD", "Étamine")
    write_image(folder / "sample_1_Upward_Drape_1.png", draw(toy_profile(8, 1, 1)))
    for form in ("NFC", "NFD"):
        (toy / "fabrics.csv").write_text(normalize(form, "fabric,areal_density_kg_m2\nÉtamine,0.3\n"), encoding="utf-8")
        assert load(toy).select(cloth="étamine").require_density(0) == 0.3


def test_a_line_without_a_weight_is_to_be_filled_in(toy):
    """A second line, which the message wanted, was refused since the fabric was given twice."""
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n7,,\n")
    with pytest.raises(DataError, match="where the fabric has a line already, fill in that one"):
        load(toy).require_density(0)


@pytest.mark.parametrize("root", [".", "data", "data/Fabric 7/silhouettes"])
def test_a_missing_weight_belongs_into_the_table_that_is_read(toy, root):
    """A new table, where the message wanted one, would have hidden this one with all its weights."""
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n8,0.2\n")
    with pytest.raises(DataError, match="add `fabric_7,<kg/m2>,`") as caught:
        load(toy / root).require_density(0)
    assert f" to {toy / 'fabrics.csv'} " in str(caught.value)


def test_silhouettes_alone_have_the_tables_of_their_laboratory(toy):
    """They would be read by the release's scale and sizes, and give other numbers."""
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    (toy / "protocol.json").write_text('{"cloth_radius_m": 0.14}')
    dataset = load(toy / "data/Fabric 7/silhouettes")
    assert len(dataset) == 12
    assert dataset.require_density(0) == 0.2
    assert dataset.protocol.cloth_radius_m == 0.14


def test_a_laboratory_of_silk_has_its_own_tables_only(toy):
    """Its folder was taken for one of silhouettes, and the tables of the folder that it lies in were used."""
    (toy / "protocol.json").write_text('{"cloth_radius_m": 0.14}')
    shutil.copytree(toy / "data/Fabric 7/silhouettes", toy / "silk")
    shutil.copytree(toy / "data/Fabric 7/silhouettes", toy / "sil")
    assert load(toy / "silk").protocol.cloth_radius_m == 0.15
    assert load(toy / "sil").protocol.cloth_radius_m == 0.14


def test_tables_may_begin_with_a_capital(toy):
    """They were taken for side files, and the release's scale for that of the pictures, without a word."""
    (toy / "Fabrics.CSV").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    (toy / "Protocol.json").write_text('{"cloth_radius_m": 0.14}')
    for root in (toy, toy / "data/Fabric 7"):
        dataset = load(root)
        assert dataset.require_density(0) == 0.2
        assert dataset.protocol.cloth_radius_m == 0.14
    (toy / "protocol.json").write_text('{"cloth_radius_m": 0.145}')
    assert load(toy).protocol.cloth_radius_m == 0.145  # that name first, where both can be


@pytest.mark.parametrize(("root", "tables"), [("Data", "."), ("Data", "Data"), (".", "Data"), ("Data/Fabric 7", ".")])
def test_the_folder_of_the_data_may_begin_with_a_capital(toy, root, tables):
    """Fabrics were found there, and the tables beside them were not: the release's scale and gravity were used."""
    (toy / "data").rename(toy / "Data")
    (toy / tables / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    (toy / tables / "protocol.json").write_text('{"cloth_radius_m": 0.14}')
    dataset = load(toy / root)
    assert dataset.require_density(0) == 0.2
    assert dataset.protocol.cloth_radius_m == 0.14


@pytest.mark.parametrize("folder", ["Fabric 1234567890123456789", "Fabric 8 Observations/Sample 1234567890123456789"])
def test_a_folder_whose_number_has_more_than_18_digits_decides_nothing(toy, folder):
    """Numbers beyond 64 bits ended exports and torch's loaders with a traceback."""
    write_image(toy / "data" / folder / "silhouettes/Fabric_8_Sample_1_Obs_1.png", draw(toy_profile(8, 1, 1)))
    index = load(toy).index
    assert len(index) == 13
    assert index[["fabric", "sample"]].to_numpy()[-1].tolist() == [8, 1]  # of the file's name, as in other folders


def test_the_name_of_a_named_set_tells_the_face(toy):
    """`captures` of the protocol did: a second drape that lay upward was said to lie downward."""
    (toy / "protocol.json").write_text('{"captures": {"1": "up", "2": "down"}}')
    for name in ("Upward_Drape_1", "Upward_Drape_2", "Downward_Drape_1"):
        write_image(toy / f"bnn_image_gt/silk/sample_1_{name}.png", draw(toy_profile(8, 1, 1)))
    index = load(toy).select(cloth="silk").index
    assert dict(zip(index["capture"], index["side"], strict=True)) == {1: "up", 2: "up", 3: "down"}


def test_samples_may_be_numbered_by_their_date(toy):
    for path in image_path(toy, 1, 1).parent.iterdir():
        path.rename(path.with_name(path.name.replace("Sample_", "Sample_2026112")))
    assert sorted(set(load(toy).index["sample"])) == [20261121, 20261122, 20261123]


@pytest.mark.parametrize("change", ["no-meshes", "fabric-at-root", "misspelt", "flat", "gz", "underscores"])
def test_variants_of_the_layout(toy, change):
    fabric = toy / "data" / "Fabric 7"
    root = toy
    if change == "no-meshes":
        shutil.rmtree(fabric / "meshes")
    elif change == "fabric-at-root":
        fabric.rename(toy / "Fabric 7")
    elif change == "misspelt":
        (fabric / "silhouettes").rename(fabric / "silouettes")
    elif change == "flat":
        root = toy / "data" / "case"
        fabric.rename(root)  # the fabric's number is only in the file names
    elif change == "gz":
        for path in (fabric / "meshes").iterdir():
            Path(f"{path}.gz").write_bytes(gzip.compress(path.read_bytes()))
            path.unlink()
    else:
        fabric.rename(toy / "data" / "Fabric_7")
    dataset = load(root)
    assert len(dataset) == 12
    assert dataset.cloths == ["fabric_7"]
    assert (dataset.index["mesh"] != "").all() == (change != "no-meshes")
    assert (dataset.sample(0).mesh is None) == (change == "no-meshes")


def test_a_drape_that_is_stored_in_two_formats_counts_once(toy):
    path = image_path(toy, 1, 1)
    Image.open(path).save(path.with_suffix(".bmp"))
    index = load(toy).index
    assert len(index) == 12
    assert index.loc[0, "image"].endswith("Fabric_7_Sample_1_Capture_1.bmp")
    assert index.loc[0, "notes"] == f"also stored as {path.relative_to(toy)}; left out"
    assert index.loc[0, "mesh"] != ""
    assert (index["notes"][1:] == "").all()
    path.with_suffix(".bmp").write_bytes(b"junk")
    for correct in (True, False):  # uncorrected, nothing is measured, and the unusable one was taken
        assert load(toy, correct=correct).index.loc[0, "image"].endswith("Fabric_7_Sample_1_Capture_1.png")


def test_observations_are_a_series_of_their_own(tmp_path):
    root = write_toy(tmp_path)
    for sample, folder, word in ((1, "Sample 1", "Obs"), (2, "Sample_2", "Observation")):
        for observation in (1, 2, 3):
            home = root / "data" / "Fabric 7 Observations" / folder
            profile = toy_profile(7, sample, 1)
            write_image(home / "silhouettes" / f"Fabric_7_Sample_{sample}_{word}_{observation}.png", draw(profile))
            write_mesh(home / "meshes" / f"Fabric_7_Sample_{sample}_Obs_{observation}.obj", *surface(profile))
    index = load(root).select(cloth="fabric_7_observations").index
    assert list(index["observation"]) == [1, 2, 3] * 2
    assert (index["mesh"] != "").all()
    assert (index["side"] == "up").all()
    assert load(root).repeat_pairs("fabric_7_observations") == []


def test_observations_may_be_of_several_captures(tmp_path):
    """All of them counted as the first capture, so that cloth that lay face down seemed to lie face up."""
    home = tmp_path / "data" / "Fabric 7 Observations" / "Sample 1" / "silhouettes"
    for capture in (1, 3):
        for observation in (1, 2):
            name = f"Fabric_7_Sample_1_Capture_{capture}_Obs_{observation}.png"
            write_image(home / name, draw(toy_profile(7, observation, capture)))
    index = load(tmp_path).index
    assert index[["capture", "observation"]].values.tolist() == [[1, 1], [1, 2], [3, 1], [3, 2]]
    assert list(index["side"]) == ["up", "up", "down", "down"]
