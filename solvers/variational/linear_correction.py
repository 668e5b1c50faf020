"""Difference between the drapes of one problem and their expected statistics, as a linear function of the cloth.

The expected statistics of a cloth (`cusick_bench.problem.population.expected_statistics`) were learned for one law, one
mesh and the standard's plate, and depend on the cloth by a few numbers u. In another problem the difference

    s - expected(theta) = B u + b + e,    e ~ N(0, V),

is fitted by regression to pairs (theta, s) simulated there, with larger weights near the observation. The slopes of one
statistic have a common normal prior, whose width maximises the evidence: slopes stay 0 unless the data need them.

References:
    MacKay. Bayesian interpolation. Neural Computation 4(3), 1992. Kennedy, O'Hagan. Predicting the output from a
    complex computer code when fast approximations are available. Biometrika 87(1), 2000.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_WIDTHS = np.geomspace(1e-4, 10, 26)  # candidates for the prior variance of slopes, in units of the scatter's
PAIRS = 4  # number of pairs for every slope that a correction needs


@dataclass(frozen=True)
class LinearCorrection:
    """Difference between simulated and expected statistics: mean + (u - centre) slope + e, e ~ N(0, scatter).

    Attributes:
        centre: Mean of u over the pairs.
        mean: The correction there.
        slope: Derivative of the correction by u.
        scatter: Covariance of statistics about their corrected expectation.
        doubt: Covariance of the slopes, in units of the scatter.
        pairs: Effective number of pairs.
    """

    centre: Float[ndarray, " leading"]
    mean: Float[ndarray, " statistics"]
    slope: Float[ndarray, "leading statistics"]
    scatter: Float[ndarray, "statistics statistics"]
    doubt: Float[ndarray, "leading leading"]
    pairs: float

    def __call__(
        self, leading: Float[ndarray, "cloths leading"]
    ) -> tuple[Float[ndarray, "cloths statistics"], Float[ndarray, " cloths"]]:
        """Corrections for cloths.

        Args:
            leading: u of the cloths.

        Returns:
            The corrections, and their variances in units of the scatter.
        """
        apart = leading - self.centre
        return self.mean + apart @ self.slope, 1 / self.pairs + ((apart @ self.doubt) * apart).sum(1)


def nearness(
    gap: Float[ndarray, "pairs statistics"], scatter: Float[ndarray, "statistics statistics"], least: float
) -> Float[ndarray, " pairs"]:
    """Weights exp(-g^2), g the root mean square gap between expected and observed statistics in units of scatter.

    Args:
        gap: Expected less observed statistics of the cloth of every pair.
        scatter: Their covariance.
        least: Least effective number of pairs; weights fall more slowly if there would be fewer.

    Returns:
        A weight for each pair.
    """
    squares = (gap * np.linalg.solve(scatter, gap.T).T).mean(1)
    squares -= squares.min()
    least = min(least, 0.99 * len(gap))
    while _effective(weights := np.exp(-squares)) < least:
        squares /= 2
    return weights


def linear_correction(
    leading: Float[ndarray, "pairs leading"],
    beyond: Float[ndarray, "pairs statistics"],
    weights: Float[ndarray, " pairs"],
) -> LinearCorrection:
    """Fits the difference between simulated and expected statistics by regression.

    Args:
        leading: u of every pair.
        beyond: Statistics of its drape less those that were expected.
        weights: How much a pair counts, > 0; of effectively more pairs than there are slopes.

    Returns:
        The correction.
    """
    share = weights / weights.sum()
    centre, mean = share @ leading, share @ beyond
    pairs = _effective(weights)
    scale = np.sqrt(pairs * share)[:, None]  # weights that add up to the effective number of pairs
    left, singular, right = np.linalg.svd(scale * (leading - centre), full_matrices=False)
    response = scale * (beyond - mean)
    fits = [_shrunk(left, singular, column, pairs - 1) for column in response.T]  # one for the mean
    along = np.stack([coefficient for coefficient, _, _ in fits], 1)
    residual = response - left * singular @ along
    freedom = np.sqrt([max(pairs - 1 - used, 1.0) for _, used, _ in fits])
    width = float(np.exp(np.mean([np.log(one) for _, _, one in fits])))
    doubt = right.T @ (right / (singular**2 + 1 / width)[:, None])
    scatter = residual.T @ residual / np.outer(freedom, freedom)
    return LinearCorrection(centre, mean, right.T @ along, scatter, doubt, pairs)


def _effective(weights: Float[ndarray, " pairs"]) -> float:
    """Effective number of pairs: (sum of weights)^2 over the sum of their squares."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def _shrunk(
    left: ndarray, singular: ndarray, response: ndarray, numbers: float
) -> tuple[Float[ndarray, " axes"], float, float]:
    """Slopes along the right singular vectors at the width of highest evidence, how many the data decide, the width.

    With slopes ~ N(0, width v) and noise v, the response has covariance v (I + width X X^T); v is maximised out. The
    response counts for as many independent numbers as are given, which is fewer than it has where weights differ.
    """
    along = left.T @ response
    rest = float(response @ response - along @ along)
    best = (-np.inf, 0.0)
    for width in _WIDTHS:
        stretched = 1 + width * singular**2
        noise = (rest + (along**2 / stretched).sum()) / numbers
        best = max(best, (-0.5 * (numbers * np.log(noise) + np.log(stretched).sum()), width))
    kept = singular**2 / (singular**2 + 1 / best[1])
    return kept * along / np.maximum(singular, 1e-300), float(kept.sum()), best[1]
