"""Finer grids about the points that matter: what lies between two points of a grid is no effect of its own."""

from dataclasses import replace

import numpy as np
import pytest

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.detectability.power import expected_features
from cusick_bench.diagnosis.inference.laboratory.laboratory import laboratory
from cusick_bench.diagnosis.inference.laboratory.shared_effects import LaboratoryFabric, log_prior, shared_points
from cusick_bench.diagnosis.inference.laboratory.shared_effects import finer_shared_points as finer_shared
from cusick_bench.diagnosis.inference.laboratory.shared_walk import SharedWalk
from cusick_bench.diagnosis.inference.residuals.feature_rows import DRIFT, FACE_EVEN, FACE_ODD, ROWS, SPREAD, faces_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import fabric_sets, likeliest_candidates
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, Grid, grid_at
from cusick_bench.diagnosis.inference.single_effects.finer import finer_grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import (
    DIRECTIONS,
    RINGS,
    SEVERITY_STEP,
    Hypothesis,
    hypotheses,
    shifts,
)
from cusick_bench.diagnosis.measure.features import ORDERS

BETWEEN = {"shift": 3.7e-3, "direction": 127.5}
"""Half a step between two severities and two directions."""


@pytest.fixture(scope="module")
def fabric(emulator: Emulator) -> FabricData:
    return FabricData(emulator, Calibration(), expected_features(emulator, PRIOR_MEAN, 12), None, 0.5)


@pytest.fixture(scope="module")
def residual(fabric: FabricData) -> Residual:
    return fabric.against()


def hypothesis_of(name: str, emulator: Emulator) -> Hypothesis:
    return next(one for one in hypotheses(emulator) if one.name == name and one.prior > 0.5)


def grid_of(name: str, emulator: Emulator, residual: Residual) -> Grid:
    return grid_at(emulator, hypothesis_of(name, emulator), residual)


@pytest.mark.parametrize("samples", [12, 48])
def test_what_an_atlas_does_not_know_of_a_shift_is_in_units_of_noise(emulator: Emulator, samples: int) -> None:
    """As the shift is: the more samples, the less noise there is, and the more of it the same error is."""
    expected = expected_features(emulator, PRIOR_MEAN, samples)
    residual = FabricData(emulator, Calibration(), expected, None, 0.5).against(start=PRIOR_MEAN, fixed=True)
    friction = hypothesis_of("bending-friction", emulator)
    moved = shifts(emulator, friction, PRIOR_MEAN, residual.sd, residual.drift)
    error = np.zeros((400, ROWS))
    of_means = np.random.default_rng(0).standard_normal(error[:, FACE_EVEN].shape)
    error[:, FACE_EVEN] = np.sqrt(moved.variance[-1]) * of_means
    grid = grid_of("bending-friction", emulator, residual)
    assert (residual.whiten(error) ** 2).mean() == pytest.approx(grid.variance[-1], rel=0.1)
    split = finer_grid(emulator, residual, grid, [{name: float(column[-1]) for name, column in grid.values.items()}])
    assert split.variance[-2] == pytest.approx(grid.variance[-1])


def shifted(fabric: FabricData, name: str, value: dict[str, float]) -> FabricData:
    """The fabric with an effect."""
    emulator, features = fabric.emulator, fabric.features
    hypothesis = hypothesis_of(name, emulator)
    sd, point = emulator.sd(PRIOR_MEAN), {key: np.array([number]) for key, number in value.items()}
    shift = shifts(emulator, hypothesis, PRIOR_MEAN, sd, 0.5, point).features[0]
    moved = replace(
        features,
        mean=features.mean + faces_of(shift) * sd,
        contrast=features.contrast + np.stack([shift[FACE_EVEN] * sd, shift[FACE_ODD] * sd]),
        spread=features.spread + shift[SPREAD],
        order=features.order + shift[DRIFT] * sd[list(ORDERS)],
    )
    assert len(shift) == ROWS
    return replace(fabric, features=moved)


@pytest.mark.parametrize("name", ["camera-offset", "camera-scale", "local-stiff-patch", "rest-curvature", "creep"])
def test_parts_of_a_cell_share_its_prior_and_lie_within_it(name: str, emulator: Emulator, residual: Residual) -> None:
    coarse = grid_of(name, emulator, residual)
    strong = int(np.argmax(np.where(np.isfinite(coarse.log_prior), np.linalg.norm(coarse.shift, axis=1), -1)))
    point = {key: float(column[strong]) for key, column in coarse.values.items()}
    finer = finer_grid(emulator, residual, coarse, [point])
    assert np.exp(finer.log_prior).sum() == pytest.approx(np.exp(coarse.log_prior).sum(), rel=0.1)
    assert finer.cell.sum() == pytest.approx(len(coarse.log_prior))
    new = finer.cell < 1
    assert new.any()
    for p in coarse.hypothesis.effect.parameters:
        values = finer.values[p.name][new]
        if p.role == "severity":
            assert np.abs(np.log(values / point[p.name])).max() <= 4 / 3 * np.log(SEVERITY_STEP) + 1e-9
        elif p.role == "direction":
            turn = coarse.hypothesis.turn
            away = (values - point[p.name] + turn / 2) % turn - turn / 2
            assert np.abs(away).max() <= 4 / 3 * turn / DIRECTIONS + 1e-9
        elif p.role == "radius":
            assert np.abs(values - point[p.name]).max() <= 4 / 3 * (RINGS[1] - RINGS[0]) + 1e-9


def test_shifts_of_the_parts_are_those_of_their_parameters(emulator: Emulator, residual: Residual) -> None:
    coarse = grid_of("camera-offset", emulator, residual)
    finer = finer_grid(emulator, residual, coarse, [{"shift": coarse.values["shift"][-1], "direction": 120.0}])
    for place in (0, len(finer.cell) - 1):
        point = {key: column[place : place + 1] for key, column in finer.values.items()}
        moved = shifts(emulator, coarse.hypothesis, residual.theta, residual.sd, residual.drift, point)
        np.testing.assert_allclose(finer.shift[place], residual.whiten(moved.features)[0], atol=1e-9)


def test_without_points_a_grid_stays_as_it_is(emulator: Emulator, residual: Residual) -> None:
    coarse = grid_of("camera-scale", emulator, residual)
    assert finer_grid(emulator, residual, coarse, []) is coarse


def test_the_likeliest_point_is_that_of_largest_density(emulator: Emulator, residual: Residual) -> None:
    """A density so wide that whole cells beside the finer ones have more probability than any part at its mode."""
    coarse = grid_of("camera-scale", emulator, residual)
    larger = coarse.values["error"][coarse.values["error"] > 0]
    middle = float(larger[len(larger) // 2])
    finer = finer_grid(emulator, residual, coarse, [{"error": middle}], least=0.0)
    count, mode = len(finer.cell), middle * SEVERITY_STEP ** (1 / 3)
    none, zeros, shift = np.zeros(count, dtype=int), np.zeros(count), np.zeros((count, 1))
    points = EffectPoints(("camera-scale",), (finer,), none, none, np.arange(count), shift, shift, zeros)
    error = finer.values["error"]
    far = np.log(np.where(error > 0, error, 1e-9) / mode) / np.log(SEVERITY_STEP)
    weight = finer.cell * np.exp(-0.5 * (far / 3) ** 2)
    assert finer.cell[np.argmax(weight)] == 1
    assert points.value(points.densest(0, weight)) == pytest.approx({"error": mode})


def test_what_lies_between_two_points_is_found_there(fabric: FabricData) -> None:
    data = shifted(fabric, "camera-offset", BETWEEN)
    sets = fabric_sets(data, data.against(), np.random.default_rng(0), steps=40)
    found: Candidate = likeliest_candidates(sets)["camera-offset"]
    assert sets.posterior.effects["camera-offset"] > 0.9
    assert abs(found.value["direction"] - BETWEEN["direction"]) <= 0.5 * 360 / DIRECTIONS / 3 + 0.01
    assert abs(np.log(found.value["shift"] / BETWEEN["shift"])) <= 0.5 * np.log(SEVERITY_STEP)


@pytest.fixture(scope="module")
def fabrics(fabric: FabricData) -> list[LaboratoryFabric]:
    """Six fabrics under one camera beside its place, between the points of the grid."""
    data = shifted(fabric, "camera-offset", BETWEEN)
    sets = fabric_sets(data, data.against(), np.random.default_rng(0), steps=20)
    return [LaboratoryFabric(name, data, sets) for name in "abcdef"]


class TestWhatAllShare:
    @pytest.mark.slow
    def test_nothing_else_is_named_beside_it(self, fabrics: list[LaboratoryFabric]) -> None:
        found = laboratory(fabrics, np.random.default_rng(0), steps=10)
        assert found is not None
        assert [one.hypothesis.name for one in found.named] == ["camera-offset"]
        assert all(one.probability < 0.3 for one in found.effects if one.name != "camera-offset")
        low, high = next(one for one in found.effects if one.name == "camera-offset").intervals["direction"]
        assert low - 0.01 <= BETWEEN["direction"] <= high + 0.01
        assert high - low < 10, "finer than a step of the grid, 15 deg"

    @pytest.mark.slow
    def test_a_walk_goes_on_where_it_was_on_finer_grids(self, fabrics: list[LaboratoryFabric]) -> None:
        points = [shared_points(one) for one in fabrics]
        start = int(
            np.argmax(np.where(points[0].effect == points[0].names.index("camera-offset"), points[0].size(), 0))
        )
        walk = SharedWalk(fabrics, points, np.random.default_rng(0), [start])
        finer = [finer_shared(one, before, [start]) for one, before in zip(fabrics, points, strict=True)]
        again = walk.on(finer)
        (point,) = again.shared
        assert finer[0].value(point) == pytest.approx(points[0].value(start))
        assert again.own == walk.own
        before, after = (np.exp(log_prior(one)).sum() for one in (points, finer))
        assert after == pytest.approx(before), "the prior of every effect adds up to 1"
