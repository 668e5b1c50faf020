"""The same drapes under another laboratory's protocol have the same statistics, meshes and irregularities."""

import numpy as np
import pytest
from other_laboratory import LARGE_IMAGES, NEAR_CAMERA, SMALL_CLOTH, write_laboratory
from toy_cloths import write_mesh

from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.stats import ClothStatistics, statistics

PROTOCOLS = {"release": RELEASE, "large images": LARGE_IMAGES, "small cloth": SMALL_CLOTH, "near camera": NEAR_CAMERA}


@pytest.fixture(scope="module")
def laboratories(tmp_path_factory):
    """Two samples, up, up again and down; with their meshes, in the laboratory's size."""
    made = {}
    synthetic = load("synthetic").select(fabric=3, sample=[1, 2], capture=[1, 2, 3])
    for name, protocol in PROTOCOLS.items():
        root = tmp_path_factory.mktemp("lab")
        made[name] = write_laboratory(root, protocol, samples=2, captures=(1, 2, 3))
        for row in range(len(synthetic)):
            drape = synthetic.sample(row)
            path = root / str(drape.row["mesh"]).removesuffix(".gz")
            write_mesh(path, protocol.cloth_scale * np.asarray(drape.mesh.vertices), np.asarray(drape.mesh.faces))
    return made


def measured(laboratories, name: str) -> ClothStatistics:
    (found,) = statistics(load(laboratories[name]))
    return found


@pytest.mark.parametrize(("name", "tolerance"), [("large images", 1e-3), ("small cloth", 1e-3), ("near camera", 0.02)])
def test_statistics_agree_with_the_releases_protocol(laboratories, name, tolerance):
    ours, nominal = measured(laboratories, name), measured(laboratories, "release")
    assert ours.units == nominal.units == 4
    assert ours.drape_coefficient == pytest.approx(nominal.drape_coefficient, abs=tolerance)
    assert ours.folds == nominal.folds
    assert ours.down_minus_up.mean == pytest.approx(nominal.down_minus_up.mean, abs=tolerance)


@pytest.mark.parametrize("name", ["large images", "small cloth"])
def test_differences_of_drapes_agree_too(laboratories, name):
    ours, nominal = measured(laboratories, name), measured(laboratories, "release")
    for field, tolerance in (("mse_repeat", 0.15), ("mse_flip", 0.05), ("mse_other_sample", 0.05)):
        # coarse pixels blur what differs by a pixel or two, as repeats do: the finer the images, the more of it counts
        assert getattr(ours, field) == pytest.approx(getattr(nominal, field), rel=tolerance), field


@pytest.mark.parametrize("name", PROTOCOLS)
def test_the_audit_finds_the_same(laboratories, name):
    found = audit(laboratories[name])
    assert found.kinds.keys() == {"fabrics-unused"}, found.irregularities
    assert found.impossible == ()
    assert all(match.fits_own and match.own_rotation == 0 for match in found.matches)
    assert load(laboratories[name]).index["notes"].eq("").all()
