"""Intervals of parameters from probabilities of points whose answer can be worked out by hand."""

import numpy as np
import pytest

from cusick_bench.diagnosis.inference.findings.intervals import point_intervals
from cusick_bench.diagnosis.inference.findings.one_face import FacesShown
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.single_effects.evidence import Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis
from cusick_bench.sim.effects import effect


def intervals(weight: np.ndarray, name: str = "camera-offset", **values: np.ndarray) -> dict[str, tuple[float, float]]:
    """90 % intervals of points with these parameters and probabilities."""
    count = len(weight)
    nothing, numbers = np.zeros((count, 3)), np.zeros(count)
    grid = Grid(Hypothesis(effect(name), "lab", 0.8), values, np.ones(count), nothing, numbers, numbers)
    zeros = np.zeros(count, dtype=int)
    points = EffectPoints((name,), (grid,), zeros, zeros, np.arange(count), nothing, nothing, numbers)
    return point_intervals(points, np.arange(count), weight)


def test_points_stand_for_all_that_is_nearer_to_them_than_to_others() -> None:
    """Nine equally likely points, the outer two with half a step each: a ninth of the probability lies within it."""
    found = intervals(np.full(9, 0.3), shift=np.arange(1.0, 10.0), direction=np.zeros(9))
    assert found["shift"] == pytest.approx((1 + 0.5 * 9 * 0.05, 9 - 0.5 * 9 * 0.05))


def test_directions_go_round() -> None:
    directions = np.arange(24) * 15.0
    both = intervals(np.where(np.isin(directions, (345, 15)), 0.5, 0.0), shift=np.ones(24), direction=directions)
    assert both["direction"] == pytest.approx((360 - 22.5 + 1.5, 360 + 22.5 - 1.5))
    one = intervals(np.where(directions == 120, 1.0, 0.0), shift=np.ones(24), direction=directions)
    assert one["direction"] == pytest.approx((120 - 0.9 * 7.5, 120 + 0.9 * 7.5))
    weight = np.select([directions == 0, directions == 180], [0.8, 0.2])  # what lies opposite has neighbours, too
    opposite = intervals(weight, shift=np.ones(24), direction=directions)
    assert opposite["direction"] == pytest.approx((180 - 7.5 + 15 * 0.05 / 0.2, 360 + 7.5 - 15 * 0.05 / 0.8))


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
    down = point_intervals(points, np.arange(2 * count), weight, FacesShown(1, np.pi))
    assert down["direction"] == pytest.approx((30 - 0.9 * 7.5, 30 + 0.9 * 7.5))
    both = point_intervals(points, np.arange(2 * count), weight)
    assert both["direction"][1] - both["direction"][0] > 90
