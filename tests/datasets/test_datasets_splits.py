"""Named sets beside their fabrics, and what trains and is held out."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from toy_cloths import (
    draw,
    image_path,
    mesh_path,
    toy_profile,
    write_image,
    write_mesh,
    write_toy,
    write_turned,
)

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import RELEASE, Protocol


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


def test_a_named_sets_own_row_comes_before_that_of_its_fabric(with_named):
    (with_named / "fabrics.csv").write_text("fabric,areal_density_kg_m2\n2,0.2\ncotton_blue,0.3\n")
    densities = load(with_named).index.groupby("cloth")["areal_density"].unique()
    assert densities["cotton_blue"].tolist() == [0.3]
    assert densities["fabric_2"].tolist() == [0.2]
