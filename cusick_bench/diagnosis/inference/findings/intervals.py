"""Intervals of effects' parameters, from the posterior probability of the points of their grids.

The probability of a point is spread evenly over all values that are nearer to it than to its neighbours: where one
point has all of the probability, the interval is as wide as the grid's step.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.diagnosis.inference.findings.one_face import FacesShown
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior

_LEVEL = 0.9
_DIGITS = 9  # decimals to which values of a grid are compared
_LEAST = 0.01  # probability of an effect from which its parameters are worth an interval
ParameterInterval = tuple[float, float]
"""Lower and upper end; of a direction [deg], the upper may exceed 360."""


def parameter_intervals(
    points: EffectPoints, posterior: SetPosterior, shown: FacesShown | None = None
) -> dict[str, Mapping[str, ParameterInterval]]:
    """90 % intervals of the parameters of every effect that may act, given that it does.

    Args:
        points: Points of the effects' grids.
        posterior: Their posterior.
        shown: Which faces the data show; both by default.

    Returns:
        By effect and parameter.
    """
    intervals: dict[str, Mapping[str, ParameterInterval]] = {}
    for number, name in enumerate(points.names):
        own = np.flatnonzero(points.effect == number)
        weight = posterior.weight[own]
        if weight.sum() < _LEAST:
            continue
        intervals[name] = point_intervals(points, own, weight, shown)
    return intervals


def point_intervals(
    points: EffectPoints,
    own: Int[ndarray, "chosen"],
    weight: Float[ndarray, "chosen"],
    shown: FacesShown | None = None,
) -> dict[str, ParameterInterval]:
    """90 % intervals of the parameters of one effect, given that it acts.

    Args:
        points: Points of grids.
        own: Which of them are the effect's.
        weight: Their probabilities.
        shown: Which faces the data show; both by default.

    Returns:
        By parameter.
    """
    faces = shown or FacesShown()
    values = [faces.stated(points.grids[points.grid[point]].hypothesis, points.value(int(point))) for point in own]
    hypothesis = points.grids[points.grid[own[0]]].hypothesis
    share = weight / max(float(weight.sum()), 1e-300)
    return {
        p.name: _interval(
            np.array([v[p.name] for v in values]), share, hypothesis.turn if p.role == "direction" else None
        )
        for p in hypothesis.effect.parameters
    }


def _interval(
    values: Float[ndarray, "points"], weight: Float[ndarray, "points"], turn: float | None
) -> ParameterInterval:
    """From the 5 % to the 95 % quantile; of a direction with a period `turn` [deg], about its circular mean."""
    middle = 0.0
    if turn is not None:
        angle = 2j * np.pi * values / turn
        middle = float(np.angle(np.sum(weight * np.exp(angle)))) * turn / (2 * np.pi)
        values = (values - middle + turn / 2) % turn - turn / 2
    points, place = np.unique(np.round(values, _DIGITS), return_inverse=True)
    between = (points[1:] + points[:-1]) / 2
    first, last = points[0], points[-1]
    if turn is not None and len(points) > 1:  # a circle: the first and the last point are neighbours
        first, last = first - (between[0] - first), last + (last - between[-1])
    edges = np.concatenate([[first], between, [last]])
    total = np.concatenate([[0.0], np.cumsum(np.bincount(place, weight))])
    low, high = (float(np.interp(q * total[-1], total, edges)) for q in ((1 - _LEVEL) / 2, (1 + _LEVEL) / 2))
    start = low if turn is None else (middle + low) % turn
    return start, start + high - low
