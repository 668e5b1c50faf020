"""Observed order of convergence, and the limit to which values on finer and finer meshes tend.

With h the spacing of vertices, an error behaves like c h^p on meshes that are fine enough: p is the slope of log error
over log h. Where no exact value is known, values are fitted by limit + c h^p, which takes three meshes at least.

References:
    Roache. Quantification of uncertainty in computational fluid dynamics. Annual Review of Fluid Mechanics 29, 1997.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.optimize import minimize_scalar

from cusick_bench.sim.constants import CLOTH_RADIUS

_ORDERS = (0.3, 4.0)  # range of orders that values can tell; at its ends they tell none
_RESAMPLED = 400
_FIRST, _LAST = 5, 95  # [%] of the interval that is said


@dataclass(frozen=True)
class Order:
    """Slope of log error over log spacing.

    Attributes:
        order: The slope, positive where the error falls.
        standard_error: Its standard error from the scatter about the line; None from two errors, which have none.
        errors: How many errors it was fitted to.
    """

    order: float
    standard_error: float | None
    errors: int


@dataclass(frozen=True)
class Limit:
    """Limit of values as meshes get finer.

    Attributes:
        value: The limit, in the values' unit.
        value_90: Interval that holds 90 % of the limits of resampled drapes.
        order: Observed order.
        order_90: Its interval.
    """

    value: float
    value_90: tuple[float, float]
    order: float
    order_90: tuple[float, float]


def mesh_spacing(vertices: Int[ndarray, "*sizes"]) -> Float[ndarray, "*sizes"]:
    """Spacing of the vertices of a disc of near-equilateral triangles.

    Args:
        vertices: Number of vertices.

    Returns:
        Length of an edge on the standard's cloth [m].
    """
    return np.sqrt(2 / np.sqrt(3) * np.pi * CLOTH_RADIUS**2 / vertices)


def observed_order(vertices: Sequence[int], errors: Sequence[float], *, least: float = 0.0) -> Order | None:
    """Fits the order of convergence to errors on several meshes, several of one size if need be.

    Args:
        vertices: Number of vertices of each mesh.
        errors: Errors against an exact value, of either sign; NaN where there is none.
        least: Errors up to this size are left out: below the exact value's own error they tell nothing.

    Returns:
        The order; None where errors of two sizes are not left.
    """
    size = np.abs(np.asarray(errors, dtype=np.float64))
    known = size > max(least, 0.0)
    if len(set(np.asarray(vertices)[known].tolist())) < 2:
        return None
    x, y = np.log(mesh_spacing(np.asarray(vertices)[known])), np.log(size[known])
    centred = x - x.mean()
    slope = float(centred @ (y - y.mean()) / (centred @ centred))
    residual = y - y.mean() - slope * centred
    freedom = len(x) - 2
    spread = float(np.sqrt(residual @ residual / freedom / (centred @ centred))) if freedom > 0 else None
    return Order(slope, spread, len(x))


def extrapolated_limit(
    vertices: Sequence[int], values: Float[ndarray, "drapes sizes"], *, seed: int = 0
) -> Limit | None:
    """Fits limit + c h^p to the means of drapes on several mesh sizes; drapes are resampled for the intervals.

    Args:
        vertices: Mesh sizes.
        values: A value a drape and size; NaN where a drape failed.
        seed: Seed of the resampling.

    Returns:
        The limit; None from fewer than three sizes or drapes, and where the values tell no order: they scatter, or do
        not tend to a limit.
    """
    known = values[np.isfinite(values).all(1)]
    if len(set(vertices)) < 3 or len(known) < 3:
        return None
    spacing = mesh_spacing(np.asarray(vertices))
    value, order = _fit(spacing, known.mean(0))
    if not _ORDERS[0] * 1.01 < order < _ORDERS[1] * 0.99:
        return None
    generator = np.random.default_rng([seed, 5])
    rows = generator.integers(len(known), size=(_RESAMPLED, len(known)))
    again = np.array([_fit(spacing, known[row].mean(0)) for row in rows])
    low, high = np.percentile(again, [_FIRST, _LAST], axis=0)
    return Limit(value, (float(low[0]), float(high[0])), order, (float(low[1]), float(high[1])))


def _fit(spacing: ndarray, means: ndarray) -> tuple[float, float]:
    """Limit and order: the order is searched for, the rest is linear in it."""

    def solve(order: float) -> tuple[ndarray, float]:
        terms = np.column_stack([np.ones_like(spacing), (spacing / spacing.max()) ** order])
        found = np.linalg.lstsq(terms, means, rcond=None)[0]
        return found, float(((terms @ found - means) ** 2).sum())

    grid = np.linspace(*_ORDERS, 38)
    best = int(np.argmin([solve(float(order))[1] for order in grid]))
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)]))
    found: Any = minimize_scalar(lambda p: solve(float(p))[1], bounds=bounds, method="bounded")
    order = float(found.x)
    return float(solve(order)[0][0]), order
