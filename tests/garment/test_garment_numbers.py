"""Numbers of a hanging skirt."""

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from worn_skirts import SIZE, skirt_cloth

from cusick_bench.cli.simulate.garment_options import MotionName, waist_motion
from cusick_bench.garment import Body, WaistMotion, a_line_skirt, circular_skirt, spread
from cusick_bench.garment.measurement import measure, pixels_per_metre, seen_from_above, seen_from_front
from cusick_bench.garment.page import write_page
from cusick_bench.garment.side_by_side import compared
from cusick_bench.garment.wearing import Wearing, Worn, wear


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


def test_what_is_worn_hangs_by_its_own_law_on_its_body_each_laid_otherwise(monkeypatch: pytest.MonkeyPatch):
    caught = []

    def stopped(fitting, laid, **_):
        caught.append((fitting, laid))
        raise KeyboardInterrupt

    monkeypatch.setattr("cusick_bench.garment.wearing.hang", stopped)
    cloth, body = replace(skirt_cloth(), law="published"), Body(hip=0.12)
    with pytest.raises(KeyboardInterrupt):
        wear(cloth, Wearing(size=SIZE, vertices=160, body=body, draws=2, laying_height=0.01, seed=3))
    ((fitting, laid),) = caught
    assert (fitting.system.law, fitting.body) == ("published", body)
    assert len(laid) == 2
    assert np.abs(laid[0] - laid[1]).max() > 1e-3


def test_many_draws_are_worn_in_packs(monkeypatch: pytest.MonkeyPatch):
    """All at a time, a thousand took 10 GB of memory."""
    monkeypatch.setattr("cusick_bench.garment.wearing._TOGETHER", 2)
    told: dict[str, None] = {}
    wearing = Wearing(size=SIZE, vertices=160, motion=WaistMotion(seconds=0.1), draws=3)
    pair, three = (
        wear(skirt_cloth(), replace(wearing, draws=draws), lambda what, *_: told.setdefault(what)) for draws in (2, 3)
    )
    assert list(told) == [
        *("hanging", "moving the waist", "hanging 1 to 2 of 3", "moving the waist 1 to 2 of 3"),
        *("hanging 3 to 3 of 3", "moving the waist 3 to 3 of 3"),
    ]
    assert np.array_equal(three.positions[:2], pair.positions)
    assert np.array_equal(three.frames[:, :2], pair.frames)
    assert np.array_equal(three.frames[0], three.positions)
    assert np.abs(three.positions[2] - three.positions[:2]).max((1, 2)).min() > 1e-4, "each of its own draw"
    assert len(three.measures) == len(three.resting) == 3
    assert three.resting.all()


def test_the_hem_trails_the_waist_and_not_the_room():
    skirt, motion = circular_skirt(SIZE, 200), WaistMotion(sway=0.05, period=1.0, seconds=1.0)
    times = np.linspace(0, 1, 11)
    measured, resting = [measure(skirt, skirt.start)], np.array([True])
    shifts = np.stack([motion.pose(time)[1] for time in times])[:, None, None]
    still = np.broadcast_to(skirt.start, (len(times), 1, *skirt.start.shape))
    for frames, trail in ((still + shifts, 0.0), (still, np.abs(shifts).max())):
        worn = Worn(skirt_cloth(), Wearing(motion=motion), skirt, skirt.start[None], resting, measured, times, frames)
        found = worn.document()["motion"]
        assert found["hem_trail_max_m"] == pytest.approx(trail, abs=1e-9)
        assert found["hem_radius_rest_m"] == pytest.approx(0.51)
        assert (found["hem_radius_max_m"] == pytest.approx(0.51)) == (trail == 0)


def test_hems_of_several_draws_are_measured_one_by_one():
    """Of each its largest radius and trail, whenever that is; then mean and standard deviation over the draws."""
    skirt, motion = circular_skirt(SIZE, 200), WaistMotion(sway=0.05, period=1.0, seconds=1.0)
    times = np.array([0.0, 0.3, 0.6])
    sizes, trails = np.array([[0.8, 0.8], [0.9, 0.8], [0.8, 1.0]]), np.array([[0, 0], [0, 0.02], [0.01, 0]])
    shifts = np.stack([motion.pose(time)[1] for time in times])[:, None, None]
    frames = skirt.start * sizes[..., None, None] + trails[..., None, None] * [0.0, 1.0, 0.0] + shifts
    measured = [measure(skirt, skirt.start)] * 2
    worn = Worn(
        skirt_cloth(), Wearing(motion=motion), skirt, frames[0], np.ones(2, bool), measured, times, frames
    )  # fmt: skip
    found = worn.document()["motion"]
    radii = 0.51 * np.array([0.9, 1.0])
    assert found["hem_radius_rest_m"] == pytest.approx(0.8 * 0.51)
    assert found["hem_radius_max_m"] == pytest.approx(radii.mean())
    assert found["hem_radius_max_sd_m"] == pytest.approx(radii.std(ddof=1))
    assert found["hem_trail_max_m"] == pytest.approx(0.015)
    assert found["hem_trail_max_sd_m"] == pytest.approx(0.01 / np.sqrt(2))


def test_the_front_is_below_and_the_left_hand_right_in_the_view_from_above():
    skirt = circular_skirt(SIZE, 400)
    for shift, axis, way in (([0, -0.1, 0], 0, 1), ([0.1, 0, 0], 1, 1)):
        seen = seen_from_above(skirt, skirt.start * 0.7 + shift)
        places = np.arange(len(seen)) - (len(seen) - 1) / 2
        middle = seen.sum(1 - axis) @ places / seen.sum() / pixels_per_metre(skirt)
        assert middle == pytest.approx(0.1 * way, abs=1e-3)


def test_a_skirt_stands_upright_in_its_view_from_the_front():
    skirt = a_line_skirt(SIZE, 400)
    wide = seen_from_front(skirt, skirt.start).sum(1)
    wide = wide[wide > 0]
    assert wide[: len(wide) // 4].mean() < 0.8 * wide[-len(wide) // 4 :].mean()


def test_skirts_side_by_side_have_their_own_numbers_in_their_units(tmp_path: Path):
    skirt = circular_skirt(SIZE, 200)
    x = np.stack([skirt.start * [size, size, 1.0] for size in (0.9, 0.98)])
    measured, none = [measure(skirt, each) for each in x], np.zeros((0, *x.shape))
    worn = Worn(skirt_cloth(), Wearing(size=SIZE), skirt, x, np.ones(2, bool), measured, np.zeros(0), none)
    (row,) = compared([worn])
    assert (row["hem_radius_m"], row["hem_radius_m_sd"]) == pytest.approx((0.4794, 0.0408 / np.sqrt(2)))
    assert row["vertex_sd_m"] == pytest.approx(spread(x, measured)["vertex_sd_rms_m"])
    write_page([worn], tmp_path / "page.html")
    coefficients = 100 * np.array([one.drape_coefficient for one in measured])
    numbers = f"479 ± 29 {coefficients.mean():.1f} ± {coefficients.std(ddof=1):.1f} {1e3 * row['vertex_sd_m']:.0f}"
    assert numbers in Page((tmp_path / "page.html").read_text()).text


def test_a_waist_turns_by_degrees_and_sways_by_metres():
    turned, swayed = (waist_motion(True, MotionName(kind), 60.0, 2.0, 3.0) for kind in ("turn", "sway"))
    assert turned is not None
    assert swayed is not None
    assert astuple(turned) == pytest.approx((0.0, np.pi / 3, 2.0, 3.0))
    assert astuple(swayed) == (60.0, 0.0, 2.0, 3.0)
