"""Grids with finer steps about some of their points.

A strong effect that lies between two points of its grid leaves part of its shift unexplained, which another effect may
take up: half a step of 15 deg leaves 13 %, half a step of severity 20 %. So the cells of likely points, and those next
to them, are each split into three along severity, direction and radius; the parts share the cell's prior.
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.single_effects.evidence import LEAST_SIZE, Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import (
    DIRECTIONS,
    RINGS,
    SEVERITY_STEP,
    Hypothesis,
    shifts,
)
from cusick_bench.sim.effects import Parameter

_THIRDS = (-1 / 3, 0.0, 1 / 3)
_BESIDE = 1.01  # [steps] distance up to which points are neighbours, with a tolerance for rounding


def finer_grid(
    emulator: Emulator,
    residual: Residual,
    grid: Grid,
    near: Sequence[Mapping[str, float]],
    *,
    least: float = LEAST_SIZE,
) -> Grid:
    """A grid with finer steps about some of its points.

    Args:
        emulator: The atlas.
        residual: What the base model leaves of the fabric.
        grid: The grid.
        near: Parameters of the points, by name.
        least: Least |d| of points with a prior.

    Returns:
        The grid, its cells at these points and beside them split; the points that are kept come first.
    """
    if not near:
        return grid
    split = np.any([_beside(grid, one) for one in near], axis=0)
    parts, pieces = _split(grid, split)
    hypothesis = grid.hypothesis
    moved = shifts(emulator, hypothesis, residual.theta, residual.sd, residual.drift, parts)
    shift = residual.whiten(moved.features)
    strong = np.linalg.norm(shift, axis=1) >= least
    prior = np.repeat(grid.log_prior[split], pieces) - np.log(pieces)
    return Grid(
        hypothesis,
        {name: np.concatenate([grid.values[name][~split], parts[name]]) for name in parts},
        np.concatenate([grid.cell[~split], np.repeat(grid.cell[split] / pieces, pieces)]),
        np.concatenate([grid.shift[~split], shift]),
        np.concatenate([grid.variance[~split], moved.variance * residual.variance_of_unit]),
        np.concatenate([grid.log_prior[~split], np.where(strong, prior, -np.inf)]),
    )


def _beside(grid: Grid, point: Mapping[str, float]) -> Bool[ndarray, "points"]:
    """Points of a grid that are at most one step from one of them, along every parameter."""
    beside = np.ones(len(grid.log_prior), dtype=bool)
    for p in grid.hypothesis.effect.parameters:
        beside &= _steps(grid.hypothesis, p, grid.values[p.name], point[p.name]) <= _BESIDE
    return beside


def _steps(hypothesis: Hypothesis, p: Parameter, values: ndarray, point: float) -> Float[ndarray, "points"]:
    """Distance of a parameter's values from one of them, in steps of the grid; infinite for other sizes."""
    if p.role == "severity":
        alike = values * point > 0
        ratio = np.where(alike, values, point) / point
        return np.where(alike, np.abs(np.log(ratio)) / np.log(SEVERITY_STEP), np.inf)
    if p.role == "direction":
        turn = hypothesis.turn
        return np.abs((values - point + turn / 2) % turn - turn / 2) * DIRECTIONS / turn
    if p.role == "radius":
        return np.abs(values - point) / (RINGS[1] - RINGS[0])
    return np.where(values == point, 0.0, np.inf)


def _split(grid: Grid, chosen: Bool[ndarray, "points"]) -> tuple[dict[str, Float[ndarray, "parts"]], int]:
    """Parameters of the parts of some cells, and how many parts a cell has; severities stay within their bounds."""
    hypothesis = grid.hypothesis
    axes = [_THIRDS if p.role in ("severity", "direction", "radius") else (0.0,) for p in hypothesis.effect.parameters]
    offsets = np.array(list(product(*axes)))
    parts = {}
    for p, offset in zip(hypothesis.effect.parameters, offsets.T, strict=True):
        middle = np.repeat(grid.values[p.name][chosen], len(offsets))
        steps = np.tile(offset, int(chosen.sum()))
        if p.role == "severity":
            moved = middle * SEVERITY_STEP**steps
            parts[p.name] = np.sign(moved) * np.minimum(np.abs(moved), max(abs(p.low), abs(p.high)))
        elif p.role == "direction":
            parts[p.name] = (middle + steps * hypothesis.turn / DIRECTIONS) % hypothesis.turn
        else:
            parts[p.name] = middle + steps * (RINGS[1] - RINGS[0])
    return parts, len(offsets)
