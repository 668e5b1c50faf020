"""Statistics and tests of the diagnosis on the real release, where answers are known; skipped where it is absent.

Known are: faces of most cloths differ (Fabrics 1 to 4 and 9; Fabric 5's do not, by its drape coefficients), and a
drape sinks from observation to observation.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.diagnosis.measure.captures import Captures, read_captures
from cusick_bench.diagnosis.measure.resampling import sign_flip_test
from cusick_bench.diagnosis.measure.statistics import (
    NAMES,
    columns,
    specimen_statistics,
)

FABRICS = ("fabric_1", "fabric_2", "fabric_3", "fabric_4", "fabric_5", "fabric_9")
AREA = NAMES.index("area_dc")


@lru_cache(maxsize=1)
def _dataset(root: Path) -> DrapeDataset:
    return load(root)


@lru_cache(maxsize=16)
def _captures(root: Path, fabric: str) -> Captures:
    return read_captures(_dataset(root), fabric)


@pytest.fixture
def read(real_data):
    return lambda fabric: _captures(real_data, fabric)


def test_real_labels_and_slips(read):
    fabric = read("fabric_3")
    assert len(fabric) == 47
    assert fabric.areal_density == 0.213
    assert len(fabric.notes) == 1
    assert "Fabric_3_Sample_7_Capture_3.jpg: off-centre" in fabric.notes[0]
    series = read("fabric_1_observations")
    assert len(series) == 60
    assert "Fabric_1_Sample_4_Observation_5.jpg: shrunken-image" in series.notes[0]
    assert "the face of 20 of 20 images is unknown" in read("fabric_20").notes


@pytest.mark.parametrize("fabric", FABRICS)
def test_real_profiles_and_images_agree_on_the_area(read, fabric):
    captures = read(fabric)
    enclosed = np.pi * (captures.radii**2).mean(1)
    assert enclosed == pytest.approx(captures.area, rel=0.01)


def test_real_faces_differ(read):
    found = {fabric: sign_flip_test(specimen_statistics(read(fabric)).face_odd, np.random.default_rng(0))
             for fabric in FABRICS}  # fmt: skip
    rejected = {fabric for fabric, test in found.items() if test.p <= 0.05}
    assert rejected >= {"fabric_1", "fabric_2", "fabric_3", "fabric_4", "fabric_9"}
    assert all(found[fabric].each[AREA] <= 0.05 for fabric in ("fabric_1", "fabric_2", "fabric_4", "fabric_9"))
    assert found["fabric_2"].mean[AREA] == pytest.approx(0.060, abs=0.003)  # half of 12 points
    assert abs(found["fabric_5"].t[AREA]) < 2


def test_real_faces_dealt_at_random_do_not_differ(read):
    """The same test on contrasts whose sign is chance."""
    generator, rejected, runs = np.random.default_rng(1), 0, 25
    for fabric in FABRICS:
        odd = specimen_statistics(read(fabric)).face_odd
        odd = odd[np.isfinite(odd).all(1)]
        for _ in range(runs):
            signs = generator.choice([-1.0, 1.0], (len(odd), 1))
            rejected += sign_flip_test(signs * odd, generator, 499).p <= 0.05
    assert rejected / (runs * len(FABRICS)) < 0.1


def test_real_drapes_sink_with_time(read):
    drift = sign_flip_test(specimen_statistics(read("fabric_1_observations")).order_odd, np.random.default_rng(0))
    assert drift.samples == 12
    assert drift.mean[AREA] == pytest.approx(-0.066, abs=0.007)
    assert drift.each[AREA] <= 0.001
    depth = columns("fold_depth")[0]
    assert drift.mean[depth] > 0
    assert drift.each[depth] <= 0.001


def test_real_warp_and_weft_show_in_the_second_harmonic(read):
    """The faces of Fabrics 1, 3 and 4 differ most in c_2, which belongs to the cloth and not to chance."""
    pair = columns("harmonic_2_real", "harmonic_2_imaginary")
    for fabric in ("fabric_1", "fabric_3", "fabric_4"):
        test = sign_flip_test(specimen_statistics(read(fabric)).face_odd, np.random.default_rng(0))
        assert test.each[list(pair)].min() <= 0.005
