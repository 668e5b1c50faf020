"""Proper scores of a set of draws against held-out samples: the true distribution is the best answer on average.

With draws x_1..x_N and samples y_1..y_M:

    energy score     ES = mean |x_i - y| - 1/2 mean_{i /= j} |x_i - x_j|
    energy distance  D = 2 mean |x_i - y_k| - mean_{i /= j} |x_i - x_j| - mean_{k /= l} |y_k - y_l|
    variogram score  VS = sum_ab w_ab ( |y_a - y_b|^p - mean_i |x_ia - x_ib|^p )^2 - var / N,  p = 1/2

All are fair: means over pairs of different draws, and the variance of the mean taken off, make the expected score of
draws independent of their number, so that a thousand draws have no advantage over ten but less noise. A single draw
stands for a distribution without spread; its energy score is then the distance itself. The continuous ranked
probability score (CRPS) is the energy score of a single number.

References:
    T. Gneiting, A. E. Raftery. Strictly proper scoring rules, prediction, and estimation. Journal of the American
        Statistical Association 102 (2007), 359-378.
    G. J. Szekely, M. L. Rizzo. Energy statistics: a class of statistics based on distances. Journal of Statistical
        Planning and Inference 143 (2013), 1249-1272.
    M. Scheuerer, T. M. Hamill. Variogram-based proper scoring rules for probabilistic forecasts of multivariate
        quantities. Monthly Weather Review 143 (2015), 1321-1334.
    C. A. T. Ferro. Fair scores for ensemble forecasts. Quarterly Journal of the Royal Meteorological Society 140
        (2014), 1917-1923.
"""

from math import nan, sqrt

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.spatial.distance import cdist, pdist

from cusick_bench.metrics.distributions.energy import cluster_distances
from cusick_bench.metrics.errors import MetricError

VARIOGRAM_ORDER = 0.5  # p


def energy_score(draws: Float[ndarray, "draws numbers"], samples: Float[ndarray, "samples numbers"]) -> float:
    """Fair energy score, with root-mean-square distances; smaller is better.

    Args:
        draws: Vectors of the draws.
        samples: Vectors of the held-out samples.

    Returns:
        Mean over samples, in the unit of the numbers.

    Raises:
        MetricError: No draws, no samples, vectors of different lengths, or values that are not finite.
    """
    _check(draws, samples)
    root = sqrt(draws.shape[1])
    spread = float(pdist(draws).mean()) / root if len(draws) > 1 else 0.0
    return float(cdist(draws, samples).mean()) / root - spread / 2


def energy_distance_of_draws(
    draws: Float[ndarray, "draws numbers"],
    samples: Float[ndarray, "captures numbers"],
    of: Int[ndarray, " captures"] | None = None,
) -> float:
    """Unbiased energy distance of two sets, with root-mean-square distances; a single draw counts as a point.

    Its expectation is 0 for draws from the distribution of the samples and positive otherwise; single values can
    be negative.

    Args:
        draws: Vectors of the draws.
        samples: Vectors of the held-out samples.
        of: The sample of each of these vectors, whose captures repeat each other; each its own by default.

    Returns:
        The distance, in the unit of the numbers; NaN for one sample, whose distribution cannot be known.

    Raises:
        MetricError: No draws, no samples, vectors of different lengths, or values that are not finite.
    """
    _check(draws, samples)
    if len(samples if of is None else set(of.tolist())) < 2:
        return nan
    pairs = cluster_distances(draws, samples, second_clusters=of)
    first = pairs.in_first.astype(np.float64)
    return float(pairs.distance(first, 1 - first, spread_of_one=0.0)) / sqrt(draws.shape[1])


def crps(draws: Float[ndarray, " draws"], samples: Float[ndarray, " samples"]) -> float:
    """Fair continuous ranked probability score.

    Args:
        draws: Numbers drawn.
        samples: Numbers of the held-out samples.

    Returns:
        Mean over samples, in the unit of the numbers.

    Raises:
        MetricError: No draws, no samples, or values that are not finite.
    """
    return energy_score(draws[:, None], samples[:, None])


def variogram_score(draws: Float[ndarray, "draws angles"], samples: Float[ndarray, "samples angles"]) -> float:
    """Fair variogram score of functions on the circle, p = 1/2.

    It sees how values at two angles depend on each other, which the energy score hardly does. A pair of angles
    weighs as the inverse of its separation, one half a turn apart twice as much, all weights adding up to 1.

    Args:
        draws: Values of the drawn functions at equidistant angles.
        samples: Values of the held-out functions at the same angles.

    Returns:
        Mean over samples, in the functions' unit.

    Raises:
        MetricError: No draws, no samples, fewer than two angles, vectors of different lengths, or values that are not
            finite.
    """
    _check(draws, samples)
    if draws.shape[1] < 2:
        raise MetricError("a variogram compares angles with each other and needs at least 2, got 1; give more angles")
    separations = np.arange(1, draws.shape[1] // 2 + 1)
    weights = 1 / separations
    terms = [_variogram_term(draws, samples, int(separation)) for separation in separations]
    return float(weights @ np.array(terms) / weights.sum())


def _variogram_term(draws: ndarray, samples: ndarray, separation: int) -> float:
    """The squared differences of one separation, averaged over angles and samples."""
    drawn, seen = (
        np.abs(values - np.roll(values, separation, axis=1)) ** VARIOGRAM_ORDER for values in (draws, samples)
    )
    excess = drawn.var(0, ddof=1).mean() / len(draws) if len(draws) > 1 else 0.0
    return float(((seen - drawn.mean(0)) ** 2).mean() - excess)


def _check(draws: ndarray, samples: ndarray) -> None:
    if draws.ndim != 2 or samples.ndim != 2 or draws.shape[1] != samples.shape[1]:
        raise MetricError(f"draws and samples must be vectors of one length, got {draws.shape} and {samples.shape}")
    check_draws(draws, samples)


def check_draws(draws: Float[ndarray, "draws *inner"], samples: Float[ndarray, "samples *inner"]) -> None:
    """Refuses draws and samples that cannot be compared.

    Args:
        draws: Numbers or vectors drawn.
        samples: Those of the held-out samples.

    Raises:
        MetricError: No draws, no samples, or values that are not finite.
    """
    if 0 in draws.shape or 0 in samples.shape:
        raise MetricError("a score needs at least one draw and one sample; make the solver offer draws")
    if not (np.isfinite(draws).all() and np.isfinite(samples).all()):
        raise MetricError("draws and samples must be finite; a drape behind them has probably diverged")
