"""The Gaussian that is nearest to a posterior, from a linear model regressed on draws from the last such Gaussian.

Statistics s of a cloth theta, which has the prior N(0, I), scatter from specimen to specimen about a mean that is
nearly linear where the posterior lies:

    s = A theta + b + e,    e ~ N(0, V).

For this likelihood the negative ELBO, KL(q || prior) - E_q log N(s_observed; A theta + b, V), has its minimum in closed
form, q = N(mu, P^-1) with P = I + A^T V^-1 A and mu = P^-1 A^T V^-1 (s_observed - b). A, b and V are regressed on
simulated pairs (theta, s), those near the observation counting most; drawing further pairs from q makes the model
right where it matters. V holds all that a cloth does not decide: chance, and what is left of nonlinearity.

The slopes of one statistic have a common normal prior, whose width maximises the evidence: most of a cloth's numbers
move no statistic, and their slopes are shrunk to nothing. They are found in passes, each over what the last has left:
over all pairs along an axis that is known to matter, without shrinking; over all pairs; over those near the
observation. Near pairs alone, drawn from a narrow q, show no slope along what is known already: q would forget it, and
the next round draw from the prior again. Where adjoints give the slopes of a statistic, these stand in for the first
two passes: over all pairs, from limp cloth to stiff, a saturating statistic looks half as steep as it is.

References:
    Garcia-Fernandez, Svensson, Morelande, Sarkka. Posterior linearization filter: principles and implementation using
    sigma points. IEEE Trans. Signal Processing 63(20), 2015. MacKay. Bayesian interpolation. Neural Computation 4(3),
    1992. Wood. Statistical inference for noisy nonlinear ecological dynamic systems. Nature 466, 2010.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_WIDTHS = np.geomspace(1e-4, 10, 26)  # variance of slopes that the evidence chooses from, in units of the scatter's
PAIRS = 2  # for every number of the cloth: fewer can be interpolated, and then leave no scatter


@dataclass(frozen=True)
class Normal:
    """A normal distribution of cloths, N(mean, root root^T)."""

    mean: Float[ndarray, " cloth"]
    root: Float[ndarray, "cloth cloth"]

    def draw(self, noise: Float[ndarray, " cloth"]) -> Float[ndarray, " cloth"]:
        """mean + root noise.

        Args:
            noise: Numbers from N(0, 1).

        Returns:
            A cloth.
        """
        return self.mean + self.root @ noise


@dataclass(frozen=True)
class LinearModel:
    """s = slope theta + intercept + e, e ~ N(0, scatter)."""

    slope: Float[ndarray, "statistics cloth"]
    intercept: Float[ndarray, " statistics"]
    scatter: Float[ndarray, "statistics statistics"]

    def __call__(self, cloths: Float[ndarray, "*pairs cloth"]) -> Float[ndarray, "*pairs statistics"]:
        """Expected statistics of cloths."""
        return cloths @ self.slope.T + self.intercept

    def posterior(self, observed: Float[ndarray, " statistics"]) -> Normal:
        """Distribution of the cloth, given statistics of one specimen.

        Args:
            observed: Statistics s of the specimen.

        Returns:
            The posterior under the prior N(0, I).
        """
        weighted = np.linalg.solve(self.scatter, self.slope).T
        precision = np.eye(self.slope.shape[1]) + weighted @ self.slope
        root = np.linalg.inv(np.linalg.cholesky(precision)).T
        return Normal(root @ root.T @ weighted @ (observed - self.intercept), root)

    def nearness(
        self, cloths: Float[ndarray, "pairs cloth"], observed: Float[ndarray, " statistics"]
    ) -> Float[ndarray, " pairs"]:
        """Weights exp(-g^2), g the root mean square gap between expected and observed statistics in units of scatter.

        They fall more slowly where fewer than `PAIRS` for every number of the cloth would be left.

        Args:
            cloths: theta of every pair.
            observed: Statistics s of the specimen.

        Returns:
            A weight for each pair.
        """
        gap = self(cloths) - observed
        squares = (gap * np.linalg.solve(self.scatter, gap.T).T).mean(1)
        squares -= squares.min()
        least = min(PAIRS * cloths.shape[1], 0.99 * len(cloths))
        while _effective(weights := np.exp(-squares)) < least:
            squares /= 2
        return weights


def linearise(
    cloths: Float[ndarray, "pairs cloth"],
    statistics: Float[ndarray, "pairs statistics"],
    weights: Float[ndarray, " pairs"],
    axis: Float[ndarray, " cloth"] | None = None,
    known: Mapping[int, Float[ndarray, " cloth"]] | None = None,
) -> LinearModel:
    """Regresses statistics on cloths: on all pairs alike, and what that leaves on the pairs as they are weighted.

    Args:
        cloths: theta of every pair.
        statistics: s of every pair; `PAIRS` for every number of the cloth, or more.
        weights: How much a pair counts, > 0.
        axis: Unit vector along which slopes are not shrunk.
        known: Slopes near the observation that are known otherwise, by statistic: only what they leave is regressed.

    Returns:
        Slopes, intercept, and the scatter about them.
    """
    slope = np.zeros((statistics.shape[1], cloths.shape[1]))
    if axis is not None:
        along = cloths @ axis - (cloths @ axis).mean()
        slope = np.outer(along @ statistics / (along @ along), axis)
    slope = slope + _regressed(cloths, statistics - cloths @ slope.T, np.ones(len(cloths))).slope
    for statistic, own in (known or {}).items():
        slope[statistic] = own
    near = _regressed(cloths, statistics - cloths @ slope.T, weights)
    return LinearModel(slope + near.slope, near.intercept, near.scatter)


def _regressed(
    cloths: Float[ndarray, "pairs cloth"],
    statistics: Float[ndarray, "pairs statistics"],
    weights: Float[ndarray, " pairs"],
) -> LinearModel:
    share = weights / weights.sum()
    centre, middle = share @ cloths, share @ statistics
    pairs = _effective(weights)
    scale = np.sqrt(pairs * share)[:, None]  # weights that add up to the effective number of pairs
    left, singular, right = np.linalg.svd(scale * (cloths - centre), full_matrices=False)
    response = scale * (statistics - middle)
    fits = [_shrunk(left, singular, column) for column in response.T]
    coefficients = np.stack([coefficient for coefficient, _ in fits])
    residual = response - left * singular @ coefficients.T
    freedom = np.sqrt([max(pairs - 1 - used, 1.0) for _, used in fits])
    slope = coefficients @ right
    return LinearModel(slope, middle - slope @ centre, residual.T @ residual / np.outer(freedom, freedom))


def _effective(weights: Float[ndarray, " pairs"]) -> float:
    """How many pairs of equal weight tell as much."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def _shrunk(left: ndarray, singular: ndarray, response: ndarray) -> tuple[Float[ndarray, " axes"], float]:
    """Slopes along the right singular vectors at the width of highest evidence, and how many of them the data decide.

    With slopes ~ N(0, width v) and noise v, the response has covariance v (I + width X X^T); v is maximised out.
    """
    along = left.T @ response
    rest = float(response @ response - along @ along)
    best = (-np.inf, 0.0)
    for width in _WIDTHS:
        stretched = 1 + width * singular**2
        noise = (rest + (along**2 / stretched).sum()) / len(response)
        best = max(best, (-0.5 * (len(response) * np.log(noise) + np.log(stretched).sum()), width))
    kept = singular**2 / (singular**2 + 1 / best[1])
    return kept * along / np.maximum(singular, 1e-300), float(kept.sum())
