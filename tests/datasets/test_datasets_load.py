"""Loading: layouts, corrections, tables, splits, repeats, what samples hold."""

import gzip
import json
import pickle
import shutil
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch.utils.data import DataLoader, Dataset, Subset, SubsetRandomSampler
from toy_cloths import draw, surface, toy_profile, write_image, write_mesh, write_toy

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.profile import profile_from_mesh
from cusick_bench.datasets.registry import REGISTRY
from cusick_bench.datasets.torch_dataset import TorchDrapeDataset

PIXEL = 1 / 723


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def toy(tmp_path) -> Path:
    return write_toy(tmp_path / "lab")


def mesh_path(root: Path, sample: int, capture: int, fabric: int = 7) -> Path:
    return root / f"data/Fabric {fabric}/meshes/Fabric_{fabric}_Sample_{sample}_Capture_{capture}.obj"


def image_path(root: Path, sample: int, capture: int, fabric: int = 7) -> Path:
    return root / f"data/Fabric {fabric}/silhouettes/Fabric_{fabric}_Sample_{sample}_Capture_{capture}.png"


def write_turned(path: Path, profile, quarter_turns: int) -> None:
    vertices, faces = surface(profile)
    for _ in range(quarter_turns % 4):
        vertices = vertices @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    write_mesh(path, vertices, faces)


def misfit(sample) -> float:
    """Pixels between a sample's mesh and its image."""
    outline = profile_from_mesh(np.asarray(sample.mesh.vertices), np.asarray(sample.mesh.faces))
    return outline.rms(sample.profile) / PIXEL


def test_index_and_samples(toy):
    dataset = load(toy)
    index = dataset.index
    assert len(dataset) == len(index) == 12
    assert dataset.cloths == ["fabric_7"]
    assert list(index["side"]) == ["up", "up", "down", "down"] * 3
    assert list(index["sample"]) == [1] * 4 + [2] * 4 + [3] * 4
    assert (index["fabric"] == 7).all()
    assert (index["observation"] == 0).all()
    assert (index["mesh_rotation_deg"] == 0).all()
    assert (index["notes"] == "").all()
    assert index["areal_density"].isna().all()
    assert index["thickness"].isna().all()
    sample = dataset.sample(5)
    assert sample.image.shape == (256, 256)
    assert sample.image.dtype == torch.float64
    assert sample.image[128, 128] == 1
    assert sample.image[0, 0] == 0
    assert sample.profile.rms(toy_profile(7, 2, 2)) < 0.15 * PIXEL
    assert sample.row["capture"] == 2
    assert misfit(sample) < 0.5


def test_index_cannot_be_changed_from_outside(toy):
    dataset = load(toy)
    index = dataset.index
    index.loc[0, "cloth"] = "other"
    assert dataset.cloths == ["fabric_7"]
    with pytest.raises(AttributeError):
        dataset.name = "other"  # pyright: ignore[reportAttributeAccessIssue]


def test_works_with_torch_and_pickle(toy):
    dataset = load(toy)
    assert isinstance(dataset, Dataset)
    batch = next(iter(DataLoader(dataset, batch_size=4, generator=torch.Generator())))
    assert batch["image"].shape == (4, 256, 256)
    assert batch["cloth"] == ["fabric_7"] * 4
    assert batch["capture"].tolist() == [1, 2, 3, 4]
    workers = DataLoader(dataset, batch_size=5, num_workers=2, generator=torch.Generator())
    assert [image.shape[0] for batch in workers for image in [batch["image"]]] == [5, 5, 2]
    copy = pickle.loads(pickle.dumps(dataset))
    assert copy.content_hash == dataset.content_hash
    assert torch.equal(copy[3]["image"], dataset[3]["image"])


def test_rows_are_whole_numbers_of_any_kind(toy):
    """Samplers of torch give tensors, and a row counted from the end was told as -1."""
    dataset = load(toy)
    chosen = torch.tensor([4, 9])
    assert [int(item["index"]) for item in (dataset[torch.tensor(4)], dataset[np.int64(4)], dataset[-8])] == [4, 4, 4]
    assert {type(dataset[i]["index"]) for i in (4, -8, np.int64(4), torch.tensor(4))} == {int}
    assert [Subset(dataset, chosen)[i]["sample"] for i in (0, 1)] == [2, 3]
    sampler = SubsetRandomSampler(chosen, generator=torch.Generator())
    batch = next(iter(DataLoader(dataset, batch_size=2, sampler=sampler, generator=torch.Generator())))
    assert sorted(batch["index"].tolist()) == [4, 9]
    assert torch.equal(dataset.image(torch.tensor(-1)), dataset.image(11))
    assert dataset.sample(-1).row["capture"] == 4
    assert len(list(dataset)) == 12
    with pytest.raises(IndexError, match="row must be from -12 to 11, got 12"):
        dataset[12]
    for several in (slice(0, 2), [0, 1]):
        with pytest.raises(TypeError, match=r"choose several with `select` or torch\.utils\.data\.Subset"):
            dataset[several]


def test_the_torch_data_set_promises_the_items_that_it_gives(toy):
    """It promised samples: type checkers let `.image` of a dictionary pass."""
    assert Dataset[dict[str, Any]] in vars(TorchDrapeDataset)["__orig_bases__"]
    assert isinstance(load(toy)[0], dict)


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


def test_silhouettes_alone_have_the_tables_of_their_laboratory(toy):
    """They would be read by the release's scale and sizes, and give other numbers."""
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    (toy / "protocol.json").write_text('{"cloth_radius_m": 0.14}')
    dataset = load(toy / "data/Fabric 7/silhouettes")
    assert len(dataset) == 12
    assert dataset.require_density(0) == 0.2
    assert dataset.protocol.cloth_radius_m == 0.14


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
    assert load(toy).index.loc[0, "image"].endswith("Fabric_7_Sample_1_Capture_1.png")


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


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turned_mesh_is_turned_back_and_noted(toy, turns):
    write_turned(mesh_path(toy, 2, 1), toy_profile(7, 2, 1), turns)
    corrected, plain = load(toy), load(toy, correct=False)
    row = 4
    assert corrected.index.loc[row, "mesh_rotation_deg"] == 360 - 90 * turns
    assert "turned" in corrected.index.loc[row, "notes"]
    assert misfit(corrected.sample(row)) < 0.5 < 4 < misfit(plain.sample(row))
    assert (plain.index["mesh_rotation_deg"] == 0).all()
    assert (corrected.index["mesh_rotation_deg"] != 0).sum() == 1
    assert corrected.content_hash != plain.content_hash


def test_meshes_of_another_capture_are_paired_again(toy):
    up, down = mesh_path(toy, 1, 1), mesh_path(toy, 1, 3)
    up_mesh = up.read_bytes()
    up.write_bytes(down.read_bytes())
    down.write_bytes(up_mesh)
    corrected = load(toy)
    assert corrected.index.loc[0, "mesh"].endswith("Sample_1_Capture_3.obj")
    assert corrected.index.loc[2, "mesh"].endswith("Sample_1_Capture_1.obj")
    assert "re-paired" in corrected.index.loc[0, "notes"]
    assert all(misfit(corrected.sample(row)) < 0.5 for row in range(12))
    assert load(toy, correct=False).index.loc[0, "mesh"].endswith("Sample_1_Capture_1.obj")
    assert (corrected.index["side"] == load(toy, correct=False).index["side"]).all()  # one sample is no majority


def test_a_mesh_of_another_drape_leaves_its_capture_without(toy):
    down = mesh_path(toy, 1, 3)
    down.write_bytes(mesh_path(toy, 1, 1).read_bytes())
    index = load(toy).index
    assert index.loc[2, "mesh"] == ""
    assert "fits" in index.loc[2, "notes"]
    assert index.loc[0, "mesh"].endswith("Sample_1_Capture_1.obj")


def test_a_stray_mesh_is_given_once(toy):
    mesh_path(toy, 1, 3).write_bytes(mesh_path(toy, 1, 1).read_bytes())
    for capture in (1, 2):  # it fits both, which are alike
        mesh_path(toy, 1, capture).unlink()
    meshes = list(load(toy).index["mesh"][:3])
    assert sorted(bool(mesh) for mesh in meshes) == [False, False, True]
    assert meshes[2] == ""


@pytest.mark.parametrize(("unit", "radius"), [(1e3, r"1[12]\d"), (1 / 0.0254, r"4\.\d+")])
def test_meshes_in_another_unit_are_left_out(toy, unit, radius):
    for path in toy.rglob("*.obj"):
        mesh = read_mesh(path)
        write_mesh(path, unit * mesh.vertices, mesh.faces)
    index = load(toy).index
    assert (index["mesh"] == "").all()
    assert index["notes"].str.contains(rf"^mesh left out: mean radius {radius} m, not in metres; scale it$").all()
    assert (index["side"] != "").all()
    assert (load(toy, correct=False).index["mesh"] != "").all()


def test_faces_are_unknown_where_meshes_contradict_the_numbers(toy):
    for sample in (1, 2, 3):
        for low, high in ((1, 3), (2, 4)):
            first, second = mesh_path(toy, sample, low), mesh_path(toy, sample, high)
            content = first.read_bytes()
            first.write_bytes(second.read_bytes())
            second.write_bytes(content)
    assert (load(toy).index["side"] == "").all()
    assert (load(toy, correct=("pairing", "rotation")).index["side"] != "").all()


def test_off_centre_image_is_moved_only_if_asked(toy):
    path = image_path(toy, 1, 1)
    write_image(path, draw(toy_profile(7, 1, 1), centre=(129.5, 105.5)))
    plain, moved = load(toy), load(toy, correct=True)
    assert "off-centre" in plain.index.loc[0, "notes"]
    assert (plain.index["image_shift_rows_px"] == 0).all()
    assert moved.index.loc[0, "image_shift_rows_px"] == pytest.approx(22, abs=3)
    assert misfit(moved.sample(0)) < 3 < 8 < misfit(plain.sample(0))
    assert plain.index.loc[0, "mesh"] != ""  # its mesh is recognised although the image is off-centre


@pytest.fixture
def with_named(tmp_path) -> Path:
    """Fabric 2 and the named set made of it; sample 3's image is none of its captures."""
    root = write_toy(tmp_path, fabrics=(2,))
    named = root / "bnn_image_gt" / "cotton_blue"
    named.mkdir(parents=True)
    for sample in (1, 2):
        shutil.copy(image_path(root, sample, 1, 2), named / f"cotton_blue_sample_{sample}_Upward_Drape_1.png")
    write_image(named / "cotton_blue_sample_3_Upward_Drape_1.png", draw(toy_profile(9, 9, 1)))
    write_turned(mesh_path(root, 2, 1, 2), toy_profile(2, 2, 1), 1)
    return root


def test_named_sets_take_meshes_and_repeats_of_their_fabric(with_named):
    dataset = load(with_named)
    index = dataset.index[dataset.index["cloth"] == "cotton_blue"]
    assert list(index["fabric"]) == [2, 2, 2]
    assert list(index["mesh"].str.slice(-24)) == ["2_Sample_1_Capture_1.obj", "2_Sample_2_Capture_1.obj", ""]
    assert list(index["mesh_rotation_deg"]) == [0, 270, 0]
    assert list(index["areal_density"]) == [0.192] * 3
    rows = list(index.index)
    assert index.loc[rows[0], "same_as"] == dataset.index.loc[0, "image"]
    assert dataset.repeats(rows[0]) == [1]  # capture 2 of the same sample
    assert dataset.repeats(rows[2]) == []
    assert dataset.repeat_pairs("cotton_blue") == dataset.repeat_pairs("fabric_2") == [
        (0, 1), (2, 3), (4, 5), (6, 7), (8, 9), (10, 11)
    ]  # fmt: skip
    assert dataset.select(cloth="cotton_blue").repeats(0) == []
    assert load(with_named, correct=False).index.loc[rows[1], "mesh"] != ""


def test_named_images_of_a_small_cloth_are_judged_by_its_size(with_named):
    """The same pixels, of a cloth of a quarter of the size, whose drapes differ by a quarter as much."""
    for path in with_named.rglob("*.obj"):
        mesh = read_mesh(path)
        write_mesh(path, mesh.vertices / 4, mesh.faces)
    small = Protocol(cloth_radius_m=0.0375, plate_radius_m=0.0225, px_per_m=4 * RELEASE.px_per_m)
    (with_named / "protocol.json").write_text(json.dumps(small.document()))
    index = load(with_named).index
    meshes = index.loc[index["cloth"] == "cotton_blue", "mesh"].str.slice(-24)
    assert list(meshes) == ["2_Sample_1_Capture_1.obj", "2_Sample_2_Capture_1.obj", ""]
    table = audit(with_named).table
    assert list(table.loc[table["kind"] == "named-unmatched", "path"].str.slice(-27)) == ["sample_3_Upward_Drape_1.png"]


def test_paper_split_takes_the_published_sample(with_named):
    dataset = load(with_named)
    (split,) = dataset.split("paper")
    assert split.cloth == "cotton_blue"
    assert [dataset.index.loc[row, "sample"] for row in split.train] == [2]
    assert [dataset.index.loc[row, "sample"] for row in split.test] == [1, 3]
    (other,) = dataset.split("paper", ["fabric_2"])
    assert len(other.train) == 1
    assert len(other.test) == 2
    assert dataset.index.loc[other.train[0], "sample"] == 1
    assert dataset.split("paper", ["fabric_2", "fabric_2"]) == [other]


def test_splits_elsewhere(toy):
    dataset = load(toy)
    (paper,) = dataset.split()
    assert paper.train == (0,)
    assert paper.test == (4, 8)
    chosen = {dataset.split(generator=np.random.default_rng(seed))[0].train for seed in range(20)}
    assert chosen == {(0,), (4,), (8,)}
    folds = dataset.split("leave-one-sample-out")
    assert [fold.test for fold in folds] == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)]
    assert all(set(fold.train) | set(fold.test) == set(range(12)) and len(fold.train) == 8 for fold in folds)
    with pytest.raises(DataError, match="unknown split 'random'; use one of paper"):
        dataset.split("random")
    with pytest.raises(DataError, match="unknown cloth silk; use one of fabric_7"):
        dataset.split("paper", ["silk"])
    assert dataset.split("paper", "fabric_7") == [paper]  # was an unknown cloth f, a, b, r, i, c
    with pytest.raises(DataError, match="unknown cloth silk; use one of fabric_7"):
        dataset.split("paper", "silk")
    with pytest.raises(DataError, match="at least 2 samples"):
        dataset.select(sample=1).split()


def test_tests_show_the_training_face_where_they_can(tmp_path):
    """Sample 2 lacks the first capture, sample 3 the face."""
    root = write_toy(tmp_path)
    for sample, capture in ((2, 1), (3, 1), (3, 2)):
        image_path(root, sample, capture).unlink()
    dataset = load(root)
    (split,) = dataset.split()
    rows = dataset.index.loc[[*split.train, *split.test]]
    assert list(zip(rows["sample"], rows["capture"], strict=True)) == [(1, 1), (2, 2), (3, 3)]
    (root / "protocol.json").write_text('{"captures": {"1": "up", "2": "down", "3": "up", "4": "down"}}')
    dataset = load(root)
    rows = dataset.index.loc[list(dataset.split()[0].test)]
    assert list(rows["capture"]) == [3, 3]


def test_select(toy):
    part = load(toy).select(sample=[1, 3], side="down")
    assert list(part.index["sample"]) == [1, 1, 3, 3]
    assert list(part.index.index) == [0, 1, 2, 3]
    assert part.repeats(0) == [1]
    with pytest.raises(DataError, match="unknown column 'colour'"):
        part.select(colour="red")
    with pytest.raises(DataError, match="cloths are fabric_7"):
        part.select(cloth="silk")


def test_content_hash_is_the_same_however_numpy_shows_numbers(toy):
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n7,0.123456789,0.0004\n")
    before = load(toy).content_hash
    with np.printoptions(legacy="1.25"):  # as NumPy 1 shows them
        assert load(toy).content_hash == before


def test_content_hash_tells_other_data(toy):
    before = load(toy).content_hash
    assert load(toy).content_hash == before
    (toy / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n7,0.2\n")
    with_density = load(toy).content_hash
    assert with_density != before
    write_image(image_path(toy, 3, 4), draw(toy_profile(7, 1, 4)))
    assert load(toy).content_hash not in (before, with_density)


def test_notes_of_a_protocol_are_not_hashed(toy):
    before = load(toy).content_hash
    (toy / "protocol.json").write_text('{"notes": {"humidity": 0.65}, "room": "3 b"}')
    assert load(toy).content_hash == before
    (toy / "protocol.json").write_text('{"turn_over": "about x"}')
    assert load(toy).content_hash != before


def test_the_height_of_a_pinhole_camera_is_hashed(tmp_path):
    """Silhouettes read from another height are others; a parallel projection has none."""
    toy, hashes = write_toy(tmp_path, samples=1, meshes=False), {}
    for projection, height in product(("pinhole", "parallel"), (0.7, 1.2)):
        (toy / "protocol.json").write_text(json.dumps({"projection": projection, "camera_height_m": height}))
        hashes[projection, height] = load(toy).content_hash
    assert len({*hashes.values()}) == 3
    assert hashes["parallel", 0.7] == hashes["parallel", 1.2]


def test_a_named_sets_own_row_comes_before_that_of_its_fabric(with_named):
    (with_named / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n2,0.2\ncotton_blue,0.3\n")
    densities = load(with_named).index.groupby("cloth")["areal_density"].unique()
    assert densities["cotton_blue"].tolist() == [0.3]
    assert densities["fabric_2"].tolist() == [0.2]


def test_a_folder_that_is_called_as_the_release_is_told_how_to_be_given(monkeypatch, toy):
    monkeypatch.delenv("CUSICK_DATA", raising=False)
    monkeypatch.chdir(toy.parent)
    with pytest.raises(DataError) as without:
        load("cusick")
    assert "./cusick" not in str(without.value)
    toy.rename("cusick")
    with pytest.raises(DataError, match=r"the folder of that name here is given as \./cusick"):
        load("cusick")
    assert len(load("./cusick"))


def test_names(monkeypatch, toy):
    assert set(REGISTRY) >= {"synthetic", "cusick"}
    monkeypatch.delenv("CUSICK_DATA", raising=False)
    with pytest.raises(DataError, match="set CUSICK_DATA"):
        load("cusick")
    monkeypatch.setenv("CUSICK_DATA", str(toy))
    dataset = load("cusick")
    assert dataset.name == "cusick"
    assert (dataset.index["dataset"] == "cusick").all()
    with pytest.raises(DataError, match="unknown correction colour; use some of pairing"):
        load(toy, correct=("colour",))


def test_a_path_is_a_folder_even_one_with_the_name_of_a_data_set(toy, monkeypatch):
    """The shipped set was loaded instead."""
    monkeypatch.chdir(toy.parent)
    toy.rename("synthetic")
    dataset = load(Path("synthetic"))
    assert dataset.root == toy.parent / "synthetic"
    assert dataset.cloths == ["fabric_7"]
    assert audit(Path("synthetic")).silhouettes == 12
    assert load("synthetic").root != dataset.root


def test_measuring_survives_any_cache(toy, monkeypatch, tmp_path):
    expected = load(toy).index
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(blocked))
    assert load(toy).index.equals(expected)
    cache = tmp_path / "cache"
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(cache))
    assert load(toy).index.equals(expected)
    stored = list(cache.rglob("*.npy"))
    assert len(stored) == 24
    with monkeypatch.context() as patch:
        patch.setattr("cusick_bench.datasets.files.measure.read_mesh", None)  # nothing is measured twice
        patch.setattr("cusick_bench.datasets.files.measure.inspect", None)
        assert load(toy).index.equals(expected)
    for path in stored:
        path.write_bytes(b"garbage")
    assert load(toy).index.equals(expected)


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
