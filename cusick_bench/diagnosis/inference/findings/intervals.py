"""Intervals of effects' parameters, from the posterior probability of the points of their grids.

The probability of a point is spread evenly over all values that are nearer to it than to its neighbours: where one
point has all of the probability, the interval is as wide as the grid's step. Of all intervals with 90 % of it that hold
the stated value, the shortest is given: that between two quantiles leaves a likeliest value out which lies at the end
of a grid.

References:
    Box, Tiao. Bayesian inference in statistical analysis, 1973, Section 2.8 (regions of highest density).
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.diagnosis.inference.findings.one_face import FacesShown
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate

_LEVEL = 0.9
_DIGITS = 9  # decimals to which values of a grid are compared
_ROUNDING = 1e-9  # of sums of probabilities
_LEAST = 0.01  # probability of an effect from which its parameters are worth an interval
ParameterInterval = tuple[float, float]
"""Lower and upper end; of a direction [deg], the upper may exceed 360."""


def parameter_intervals(
    points: EffectPoints, posterior: SetPosterior, best: Mapping[str, Candidate], shown: FacesShown | None = None
) -> dict[str, Mapping[str, ParameterInterval]]:
    """90 % intervals of the parameters of every effect that may act, given that it does.

    Args:
        points: Points of the effects' grids.
        posterior: Their posterior.
        best: Effects at the values that are stated, by name; others get no intervals.
        shown: Which faces the data show; both by default.

    Returns:
        By effect and parameter.
    """
    intervals: dict[str, Mapping[str, ParameterInterval]] = {}
    for number, name in enumerate(points.names):
        own = np.flatnonzero(points.effect == number)
        weight = posterior.weight[own]
        if name not in best or weight.sum() < _LEAST:
            continue
        intervals[name] = point_intervals(points, own, weight, best[name], shown)
    return intervals


def point_intervals(
    points: EffectPoints,
    own: Int[ndarray, "chosen"],
    weight: Float[ndarray, "chosen"],
    best: Candidate,
    shown: FacesShown | None = None,
) -> dict[str, ParameterInterval]:
    """90 % intervals of the parameters of one effect, given that it acts.

    Args:
        points: Points of grids.
        own: Which of them are the effect's.
        weight: Their probabilities.
        best: The effect at the values that are stated.
        shown: Which faces the data show; both by default.

    Returns:
        By parameter.
    """
    faces = shown or FacesShown()
    values = [faces.stated(points.grids[points.grid[point]].hypothesis, points.value(int(point))) for point in own]
    stated = faces.stated(best.hypothesis, best.value)
    share = weight / max(float(weight.sum()), 1e-300)
    return {
        p.name: _interval(
            np.array([v[p.name] for v in values]),
            share,
            stated[p.name],
            best.hypothesis.turn if p.role == "direction" else None,
        )
        for p in best.hypothesis.effect.parameters
    }


def _interval(
    values: Float[ndarray, "points"], weight: Float[ndarray, "points"], stated: float, turn: float | None
) -> ParameterInterval:
    """The shortest interval that holds `stated`; directions with a period `turn` [deg] are cut opposite of it."""
    if turn is not None:
        values = (values - stated + turn / 2) % turn - turn / 2
    points, place = np.unique(np.round(values, _DIGITS), return_inverse=True)
    between = (points[1:] + points[:-1]) / 2
    first, last = points[0], points[-1]
    if turn is not None and len(points) > 1:  # a circle: the first and the last point are neighbours
        first, last = first - (between[0] - first), last + (last - between[-1])
    edges = np.concatenate([[first], between, [last]])
    total = np.concatenate([[0.0], np.cumsum(np.bincount(place, weight))])
    if turn is None:
        return _shortest(edges, total / total[-1], stated)
    low, high = _shortest(edges, total / total[-1], 0.0)
    start = (stated + low) % turn
    return start, start + high - low


def _shortest(edges: Float[ndarray, "edges"], total: Float[ndarray, "edges"], held: float) -> ParameterInterval:
    """The shortest interval that holds a value and `_LEVEL` of a probability which is even between its edges.

    Args:
        edges: Where the density changes.
        total: Probability of all that is below each.
        held: The value.

    Returns:
        Its ends; of several that are as short, those with the most equal tails.
    """
    below, tail = float(np.interp(held, edges, total)), 1 - _LEVEL
    least, most = max(0.0, below - _LEVEL), min(tail, below)
    start = np.clip([*total, *(total - _LEVEL), least, tail / 2, most], least, most)  # lengths are linear between these
    low = _quantile(edges, total, np.searchsorted(total, start + _ROUNDING, "right"), start)
    high = _quantile(edges, total, np.searchsorted(total, start + _LEVEL - _ROUNDING), start + _LEVEL)
    low, high = np.minimum(low, held), np.maximum(high, held)  # where the value itself has no probability
    short = np.flatnonzero(high - low <= (high - low).min() * (1 + 1e-6))
    chosen = short[np.argmin(np.abs(start[short] - tail / 2))]
    return float(low[chosen]), float(high[chosen])


def _quantile(
    edges: Float[ndarray, "edges"],
    total: Float[ndarray, "edges"],
    upper: Int[ndarray, "all"],
    level: Float[ndarray, "all"],
) -> Float[ndarray, "all"]:
    """Where the probability below is `level`, between the edge `upper` and the one before, which enclose some."""
    share = (level - total[upper - 1]) / (total[upper] - total[upper - 1])
    return edges[upper - 1] + np.clip(share, 0, 1) * (edges[upper] - edges[upper - 1])
