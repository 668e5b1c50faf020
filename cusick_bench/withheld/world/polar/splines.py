"""Uniform cubic B-splines: clamped ones over a radius from 0 to 1, periodic ones around the circle.

References:
    Piegl, Tiller. The NURBS Book, 2nd edition, 1997, Algorithm A2.3.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.interpolate import BSpline

DEGREE = 3


@dataclass(frozen=True)
class SplineValues:
    """Splines that do not vanish at some points.

    Attributes:
        first: Number of the first of them, at each point.
        value: Values and first and second derivatives of that one and the three after it.
    """

    first: Int[ndarray, "points"]
    value: Float[ndarray, "points 3 4"]


def clamped_splines(spans: int, at: Float[ndarray, "points"]) -> SplineValues:
    """Splines over [0, 1]: the first two alone have a value or a slope at 0.

    Args:
        spans: Number of equal intervals; there are three splines more.
        at: Points in [0, 1].

    Returns:
        The splines at the points.
    """
    inner = np.linspace(0, 1, spans + 1)
    return _values(np.concatenate([np.zeros(DEGREE), inner, np.ones(DEGREE)]), spans, at)


def periodic_splines(spans: int, at: Float[ndarray, "points"]) -> SplineValues:
    """Splines around the circle, as many as intervals; the fourth at a point may have a number beyond the last one.

    Args:
        spans: Number of equal intervals.
        at: Angles in [0, 2 pi) [rad].

    Returns:
        The splines at the points; their numbers count modulo `spans`.
    """
    return _values(np.arange(-DEGREE, spans + DEGREE + 1) * (2 * np.pi / spans), spans, at)


def _values(knots: ndarray, spans: int, at: Float[ndarray, "points"]) -> SplineValues:
    low, high = knots[DEGREE], knots[DEGREE + spans]
    first = np.clip(((at - low) / (high - low) * spans).astype(np.int64), 0, spans - 1)
    everything = BSpline(knots, np.eye(spans + DEGREE), DEGREE)
    chosen = first[:, None] + np.arange(DEGREE + 1)
    found = [np.take_along_axis(everything(at, order), chosen, 1) for order in range(3)]
    return SplineValues(first, np.stack(found, 1))
