"""Loading: the index and its samples, hash, names, stored measures."""

import json
import pickle
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from PIL import Image
from torch.utils.data import DataLoader, Dataset, Subset, SubsetRandomSampler
from toy_cloths import PIXEL, draw, image_path, mesh_path, misfit_px, toy_profile, write_image, write_toy

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.files.image import _silent_opencv, without_specks
from cusick_bench.datasets.impossible import impossible
from cusick_bench.datasets.registry import REGISTRY
from cusick_bench.datasets.torch_dataset import TorchDrapeDataset


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
    assert misfit_px(sample) < 0.5


@pytest.mark.parametrize(("row", "size"), [(22, 2), (20, 6), (2, 6), (0, 2)])  # the last on the picture's border
def test_specks_beside_the_cloth_are_background(toy, row, size):
    """Dust of 8 mm made a fold, and skewed radii; farther out the picture was refused as a cloth of that size."""
    path, clean = image_path(toy, 1, 1), load(toy).sample(0)
    with Image.open(path) as image:
        pixels = np.array(image)
    pixels[row : row + size, 120 : 120 + size] = 0
    pixels[row + size, 120 : 120 + size] = 180  # its blurred edge
    Image.fromarray(pixels).save(path)
    dataset = load(toy)
    assert torch.equal(dataset.image(0), clean.image)
    assert dataset.sample(0).profile == clean.profile
    assert impossible(dataset, [0]) == []
    assert {one.kind for one in audit(toy).irregularities if one.path == path.relative_to(toy).as_posix()} == {"specks"}


def test_pixels_that_touch_the_cloth_at_a_corner_belong_to_it():
    image = np.zeros((16, 16))
    image[4:12, 4:12] = 1
    image[12, 12] = image[3, 12] = 0.6
    assert without_specks(image) is image


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


def test_an_entry_of_a_batch_selects(toy):
    """A number in a tensor or an array of its own ended in "iteration over a 0-d tensor"."""
    dataset = load(toy)
    batch = next(iter(DataLoader(dataset, batch_size=8, generator=torch.Generator())))
    for value in (batch["sample"][4], np.array(2), torch.tensor([2]), np.int64(2), {2}):
        assert len(dataset.select(sample=value)) == 4


@pytest.mark.parametrize("missing", [float("nan"), np.nan, None, torch.tensor(float("nan"))])
def test_what_is_not_known_selects(toy, missing):
    dataset = load(toy)
    known = replace(dataset, table=dataset.table.assign(thickness=[0.4e-3, *[np.nan] * (len(dataset) - 1)]))
    assert len(known.select(thickness=missing)) == len(dataset) - 1
    assert len(known.select(thickness=0.4e-3)) == 1


def test_threads_leave_the_log_of_opencv_as_it_was():
    level = cv2.utils.logging.getLogLevel()
    one, other = _silent_opencv(), _silent_opencv()
    for context in (one, other):
        context.__enter__()
    assert cv2.utils.logging.getLogLevel() == cv2.utils.logging.LOG_LEVEL_SILENT
    for context in (one, other):
        context.__exit__(None, None, None)
    assert cv2.utils.logging.getLogLevel() == level


def test_the_torch_data_set_promises_the_items_that_it_gives(toy):
    """It promised samples: type checkers let `.image` of a dictionary pass."""
    assert Dataset[dict[str, Any]] in vars(TorchDrapeDataset)["__orig_bases__"]
    assert isinstance(load(toy)[0], dict)


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
    with_image = load(toy).content_hash
    assert with_image not in (before, with_density)
    mesh = mesh_path(toy, 3, 4)
    mesh.write_text(mesh.read_text() + "# scanned again\n")
    assert load(toy).content_hash not in (before, with_density, with_image)


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
