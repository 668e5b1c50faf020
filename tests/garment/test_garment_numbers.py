"""Numbers of a hanging skirt."""

import numpy as np
import pytest
from worn_skirts import SIZE

from cusick_bench.garment import circular_skirt, spread
from cusick_bench.garment.measurement import measure


def test_a_flat_skirt_has_a_drape_coefficient_of_one_and_no_folds():
    skirt = circular_skirt(SIZE, 2000)
    found = measure(skirt, skirt.start)
    assert found.drape_coefficient == pytest.approx(1, abs=0.005)
    assert found.hem_radius_m == pytest.approx(0.51)
    assert found.projected_area_m2 == pytest.approx(np.pi * 0.51**2, rel=0.005)
    assert (found.folds, found.hem_depth_m) == (0, 0)


def test_a_skirt_that_hangs_straight_down_has_a_drape_coefficient_of_zero():
    skirt = circular_skirt(SIZE, 1000)
    radius = np.hypot(*skirt.start[:, :2].T)
    x = np.column_stack([skirt.start[:, :2] * (0.11 / radius)[:, None], 0.11 - radius])
    found = measure(skirt, x)
    assert found.drape_coefficient == pytest.approx(0, abs=0.005)
    assert (found.hem_radius_m, found.hem_depth_m) == pytest.approx((0.11, 0.4))


@pytest.mark.parametrize("folds", [3, 11])
def test_folds_of_a_waved_hem_are_counted(folds: int):
    skirt = circular_skirt(SIZE, 2000)
    angle = np.arctan2(skirt.start[:, 1], skirt.start[:, 0])
    x = skirt.start.copy()
    x[:, :2] *= (0.6 + 0.1 * np.cos(folds * angle))[:, None]
    found = measure(skirt, x)
    assert found.folds == folds
    assert found.fold_amplitude_m == pytest.approx(0.051 / np.sqrt(2), rel=0.02)


def test_the_spread_of_draws_that_differ_by_a_known_shift():
    skirt = circular_skirt(SIZE, 200)
    x = skirt.start + np.array([-0.01, 0.0, 0.01])[:, None, None] * [0, 0, 1]
    found = spread(x, [measure(skirt, each) for each in x])
    assert found["vertex_sd_rms_m"] == pytest.approx(0.01)
    assert found["sd"]["hem_depth_m"] == pytest.approx(0.01)
    assert found["sd"]["hem_radius_m"] == pytest.approx(0)
    assert np.isnan(spread(x[:1], [measure(skirt, x[0])])["vertex_sd_rms_m"])
