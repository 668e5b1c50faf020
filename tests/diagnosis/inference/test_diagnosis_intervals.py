"""Intervals of parameters from probabilities of points whose answer can be worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cusick_bench.diagnosis.inference.findings.intervals import point_intervals
from cusick_bench.diagnosis.inference.findings.one_face import FacesShown
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_sets import candidate_at
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis
from cusick_bench.sim.effects import effect


def intervals(
    weight: np.ndarray, name: str = "camera-offset", best: Candidate | None = None, **values: np.ndarray
) -> dict[str, tuple[float, float]]:
    """90 % intervals of points with these parameters and probabilities, which state `best`, or the likeliest."""
    count = len(weight)
    nothing, numbers = np.zeros((count, 3)), np.zeros(count)
    grid = Grid(Hypothesis(effect(name), "lab", 0.8), values, np.ones(count), nothing, numbers, numbers)
    zeros = np.zeros(count, dtype=int)
    points = EffectPoints((name,), (grid,), zeros, zeros, np.arange(count), nothing, nothing, numbers)
    return point_intervals(points, np.arange(count), weight, best or candidate_at(points, points.densest(0, weight)))


def test_points_stand_for_all_that_is_nearer_to_them_than_to_others() -> None:
    """The point in the middle has a step about it, the outer ones half a step each, which are twice as dense."""
    shift = np.arange(1.0, 10.0)
    found = intervals(np.where(shift == 5, 1.0, 0.0), shift=shift, direction=np.zeros(9))
    assert found["shift"] == pytest.approx((4.55, 5.45))
    weight = np.where(shift == 5, 0.2, 0.1)
    assert intervals(weight, shift=shift, direction=np.zeros(9))["shift"] == pytest.approx((1.25, 8.75))


def test_the_interval_is_the_shortest_that_holds_the_value() -> None:
    """A quantile of 5 % would leave the value out where it lies at the end of a grid, or between two modes."""
    shift, ahead = np.arange(1.0, 10.0), np.zeros(9)
    end = np.array([0.6, 0.2, 0.1, 0.05, 0.05, 0, 0, 0, 0])
    assert intervals(end, shift=shift, direction=ahead)["shift"] == pytest.approx((1, 3.5))
    assert intervals(end[::-1], shift=shift, direction=ahead)["shift"] == pytest.approx((6.5, 9))
    modes = np.array([0, 0.04, 0, 0, 0, 0, 0.3, 0.36, 0.3])
    assert intervals(modes, shift=shift, direction=ahead)["shift"][0] > 6.5
    stated = Candidate(Hypothesis(effect("camera-offset"), "lab", 0.8), {"shift": 2.0, "direction": 0.0})
    low, high = intervals(modes, best=stated, shift=shift, direction=ahead)["shift"]
    assert low == pytest.approx(2)
    assert high == pytest.approx(8.5 + 0.5 * (0.9 - 0.02 - 0.66) / 0.3)


@given(st.lists(st.floats(0, 1), min_size=2, max_size=12), st.integers(0, 11), st.booleans())
def test_intervals_hold_the_value_and_nine_tenths(weight: list[float], place: int, turns: bool) -> None:
    count = len(weight)
    weights = np.array(weight) + 1e-3 * (np.arange(count) == place % count)
    values = {"shift": np.arange(count) + 1.0, "direction": np.arange(count) * 360 / count}
    stated = {name: float(column[place % count]) for name, column in values.items()}
    best = Candidate(Hypothesis(effect("camera-offset"), "lab", 0.8), stated)
    name = "direction" if turns else "shift"
    low, high = intervals(weights, best=best, **values)[name]
    assert low - 1e-6 <= stated[name] + (360 if turns and stated[name] < low - 1e-6 else 0) <= high + 1e-6
    step = 360 / count if turns else 1.0
    edge = values[name] - step / 2, values[name] + step / 2
    if not turns:
        edge = np.maximum(edge[0], 1), np.minimum(edge[1], count)
    inside = sum(
        np.clip(np.minimum(high, edge[1] + turn) - np.maximum(low, edge[0] + turn), 0, None)
        for turn in ((-360, 0, 360) if turns else (0,))
    )
    assert float(weights @ (inside / (edge[1] - edge[0]))) >= (0.9 - 1e-6) * weights.sum()


def test_directions_go_round() -> None:
    directions = np.arange(24) * 15.0
    both = intervals(np.where(np.isin(directions, (345, 15)), 0.5, 0.0), shift=np.ones(24), direction=directions)
    assert both["direction"] == pytest.approx((360 - 22.5 + 1.5, 360 + 22.5 - 1.5))
    one = intervals(np.where(directions == 120, 1.0, 0.0), shift=np.ones(24), direction=directions)
    assert one["direction"] == pytest.approx((120 - 0.9 * 7.5, 120 + 0.9 * 7.5))
    weight = np.select([directions == 0, directions == 180], [0.8, 0.2])  # what lies opposite has neighbours, too
    opposite = intervals(weight, shift=np.ones(24), direction=directions)
    assert opposite["direction"] == pytest.approx((180, 360 + 7.5))


@pytest.mark.parametrize(("first", "second"), [(165, 180), (75, 105)])
def test_an_axis_is_the_same_after_half_a_turn(first: int, second: int) -> None:
    directions = np.arange(12) * 15.0
    weight = np.where(np.isin(directions, (first, second % 180)), 0.5, 0.0)
    found = intervals(weight, "rest-curvature", curvature=np.ones(12), direction=directions)
    assert found["direction"] == pytest.approx((first - 7.5 + 1.5, second + 7.5 - 1.5))


def test_directions_of_a_face_that_lies_down_are_those_on_the_bench() -> None:
    """Both frames move the pictures alike where a direction in one is the mirror image of that in the other."""
    count, name = 24, "camera-offset"
    directions, nothing, numbers = np.arange(count) * 15.0, np.zeros((2 * count, 3)), np.zeros(2 * count)
    values = {"shift": np.ones(count), "direction": directions}
    half = np.zeros(count)
    grids = tuple(
        Grid(Hypothesis(effect(name), frame, 0.5), values, np.ones(count), nothing[:count], half, half)
        for frame in ("lab", "cloth")
    )
    grid, row = np.repeat([0, 1], count), np.tile(np.arange(count), 2)
    points = EffectPoints((name,), grids, np.zeros(2 * count, dtype=int), grid, row, nothing, nothing, numbers)
    weight = np.where(grid == 0, 0.8, 0.2) * (np.tile(directions, 2) == np.where(grid == 0, 30, 150))
    best = candidate_at(points, points.densest(0, weight))
    down = point_intervals(points, np.arange(2 * count), weight, best, FacesShown(1, np.pi))
    assert down["direction"] == pytest.approx((30 - 0.9 * 7.5, 30 + 0.9 * 7.5))
    both = point_intervals(points, np.arange(2 * count), weight, best)
    assert both["direction"][1] - both["direction"][0] > 90


@pytest.mark.parametrize(
    ("warp", "single", "stated"), [(np.pi, 1, 150), (0.0, 1, 330), (np.pi, -1, 30), (np.pi, 0, 30)]
)
def test_a_direction_in_the_cloth_is_seen_on_the_bench_as_it_was_turned_over(
    warp: float, single: int, stated: float
) -> None:
    """About y 30 degrees of a cloth face down are seen at 150, about x at -30; where both faces are known they stay."""
    offset = Hypothesis(effect("camera-offset"), "cloth", 0.2)
    shown = FacesShown(single, warp)
    assert shown.stated(offset, {"shift": 1.0, "direction": 30.0}) == pytest.approx({"shift": 1.0, "direction": stated})
    moved = shown.on_the_bench(Candidate(offset, {"shift": 1.0, "direction": 30.0}))
    assert (moved.hypothesis.frame, moved.value["direction"]) == ("lab" if single else "cloth", pytest.approx(stated))
