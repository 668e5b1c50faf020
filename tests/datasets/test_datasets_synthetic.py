"""The shipped set: complete, unchanged, regular."""

import numpy as np
import pytest

from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.profile import profile_from_mesh
from cusick_bench.datasets.stats import statistics
from cusick_bench.datasets.synthetic_set import recipe


@pytest.fixture(scope="module")
def synthetic():
    return load("synthetic")


def test_contents(synthetic):
    index = synthetic.index
    assert synthetic.name == "synthetic"
    assert len(synthetic.cloths) == 5
    assert (index.groupby("cloth")["sample"].nunique() == 12).all()
    assert list(index["side"]) == ["up", "up", "down", "down"] * 60
    assert (index["mesh"] != "").all()
    assert (index["areal_density"] > 0).all()
    assert (index["thickness"] > 0).all()
    assert len(synthetic.split("paper")) == 5
    assert len(synthetic.repeat_pairs(synthetic.cloths[0])) == 24


def test_meshes_are_those_of_the_images(synthetic):
    for row in range(0, 240, 23):
        sample = synthetic.sample(row)
        outline = profile_from_mesh(np.asarray(sample.mesh.vertices), np.asarray(sample.mesh.faces))
        assert outline.rms(sample.profile) < 0.3 / 723


def test_the_recipe_drapes_what_is_shipped(synthetic):
    """The stiffest cloth, of which rounding changes least on another platform."""
    drape = next(recipe.drapes(recipe.cloths()[4], samples=1))
    index = synthetic.index
    shown = index[(index["cloth"] == "fabric_5") & (index["sample"] == drape.sample)]
    (row,) = shown.index[shown["capture"] == drape.capture]
    np.testing.assert_allclose(synthetic.sample(row).mesh.vertices, drape.vertices, rtol=0, atol=5e-5)


def test_audit_finds_nothing_but_what_the_layout_brings(synthetic, monkeypatch, tmp_path):
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(tmp_path))
    result = audit(synthetic.root / "data" / "Fabric 1")
    assert (result.fabrics, result.samples, result.silhouettes, result.meshes) == (1, 12, 48, 48)
    assert result.kinds == {}


def test_differences_form_a_ladder(synthetic):
    for item in statistics(synthetic.select(cloth=synthetic.cloths[:2])):
        assert item.mse_repeat < item.mse_other_sample
        assert item.mse_repeat < item.mse_flip
