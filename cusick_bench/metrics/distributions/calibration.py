"""Whether held-out samples look like draws: coverage of intervals, ranks, and a test of the number of folds.

A sample that is one more draw from the same distribution takes every rank among N draws with probability 1/(N + 1).
So the interval between the draws at the positions (N + 1)(1 - level)/2 from below and from above covers it with
probability `level`, whatever the distribution. Below 2/(1 - level) - 1 draws there are no such positions; Student's
prediction interval, exact for normal draws, then takes their place. One draw stands for a distribution without
spread: its intervals have no width, and the test of its folds has only the answers 0 and 1.

References:
    T. M. Hamill. Interpretation of rank histograms for verifying ensemble forecasts. Monthly Weather Review 129
        (2001), 550-560.
    B. Phipson, G. K. Smyth. Permutation p-values should never be zero. Statistical Applications in Genetics and
        Molecular Biology 9 (2010), 39.
"""

from math import sqrt

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import stdtrit

from cusick_bench.metrics.distributions.proper_scores import check_draws
from cusick_bench.metrics.errors import MetricError

PERMUTATIONS = 9999


def coverage(draws: Float[ndarray, " draws"], samples: Float[ndarray, " samples"], level: float) -> float:
    """Share of the samples within the central interval that one more draw would be in with probability `level`.

    Where the interval's ends lie between two draws, samples between those count in part: so the expected share is
    `level` for any distribution, which it is not for ends that are interpolated.

    Args:
        draws: Numbers drawn.
        samples: Numbers of the held-out samples.
        level: Probability of the interval, in (0, 1).

    Returns:
        The share, 0 to 1.

    Raises:
        MetricError: No draws, no samples, values that are not finite, or a level that is not between 0 and 1.
    """
    if not 0 < level < 1:
        raise MetricError(f"the level of an interval must lie between 0 and 1, got {level}; 0.9 is usual")
    check_draws(draws, samples)
    ordered, place = np.sort(draws), (len(draws) + 1) * (1 - level) / 2 + 1e-9
    if len(draws) == 1:
        return _within(samples, ordered[0], ordered[0])
    if place < 1:
        reach = stdtrit(len(draws) - 1, (1 + level) / 2) * np.std(draws, ddof=1) * sqrt(1 + 1 / len(draws))
        return _within(samples, draws.mean() - reach, draws.mean() + reach)
    outer = int(place)
    wide, narrow = (_within(samples, ordered[i], ordered[-1 - i]) for i in (outer - 1, outer))
    step = 0.5 if 2 * outer == len(draws) else 1.0  # half-way between the two middle draws nothing is left of it
    return wide + (place - outer) / step * (narrow - wide)


def _within(samples: ndarray, low: float, high: float) -> float:
    return float(np.mean((samples >= low) & (samples <= high)))


def ranks(draws: Float[ndarray, " draws"], samples: Float[ndarray, " samples"]) -> Float[ndarray, " samples"]:
    """Rank of every sample among the draws, scaled to (0, 1); uniform where samples are like draws.

    A histogram of them that is low in the middle says that the draws differ too little, one that leans to a side
    that they are shifted. Ties count half.

    Args:
        draws: Numbers drawn.
        samples: Numbers of the held-out samples.

    Returns:
        One scaled rank a sample.

    Raises:
        MetricError: No draws, no samples, or values that are not finite.
    """
    check_draws(draws, samples)
    below = (draws[:, None] < samples).sum(0) + 0.5 * (draws[:, None] == samples).sum(0)
    return (below + 0.5) / (len(draws) + 1)


def fold_test(
    drawn: Float[ndarray, " draws"],
    seen: Float[ndarray, " samples"],
    generator: np.random.Generator,
    permutations: int = PERMUTATIONS,
) -> float:
    """p-value of the hypothesis that drawn and held-out numbers of folds have one distribution.

    A permutation test of the squared difference of the two cumulative distributions, which notices a shift as well
    as a wrong spread. The samples must be independent of each other: captures of one drape are not.

    Args:
        drawn: Numbers of folds of the draws.
        seen: Numbers of folds of held-out samples.
        generator: Source of randomness of the permutations.
        permutations: Number of permutations.

    Returns:
        The probability of a difference this large if there is none; for a single draw 1 if all samples have its
        number of folds, else 0.

    Raises:
        MetricError: No draws, no samples, or values that are not finite.
    """
    check_draws(drawn, seen)
    if len(drawn) == 1:
        return float(np.all(seen == drawn))
    first = int(min(drawn.min(), seen.min()))
    bins = int(max(drawn.max(), seen.max())) - first + 1
    own, other = (np.bincount(values.astype(int) - first, minlength=bins) for values in (drawn, seen))
    pooled = own + other
    shuffled = generator.multivariate_hypergeometric(pooled, len(seen), size=permutations)
    difference = _difference(shuffled, pooled)
    as_large = np.count_nonzero(difference >= _difference(other[None], pooled)[0] * (1 - 1e-12))
    return (1 + as_large) / (1 + permutations)


def _difference(counts: ndarray, pooled: ndarray) -> Float[ndarray, " sets"]:
    """Squared difference of the cumulative distribution of each set of samples and that of the remaining draws."""
    rest = pooled - counts
    gap = counts.cumsum(1) / counts.sum(1, keepdims=True) - rest.cumsum(1) / rest.sum(1, keepdims=True)
    return (gap**2).sum(1)
