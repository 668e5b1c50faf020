"""Joint probability of a set of effects, each at a point of its grid, and of the misfit of the base model.

With w the rotated, whitened residual, d_e the shift of each effect of the set Z and v_e the variance that another law
adds,

    p(w | Z, s, t) = prod_k N(w_k - sum_e d_ek; 0, 1 + sum_e v_ek + m_k),   m = t^2 in forbidden rows, else s^2 a_k

s and t have priors on grids and are summed over; given Z, forbidden and allowed rows are independent. The prior of a
set of m effects is p(m) divided by the number of sets of that size, times the priors of the points. So choosing among
more sets, or among more points of an effect, costs evidence.

References:
    George, McCulloch. Variable selection via Gibbs sampling. JASA 88(423), 1993 (spike and slab). Scott, Berger. Bayes
    and empirical-Bayes multiplicity adjustment in the variable-selection problem. Annals of Statistics 38(5), 2010.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import gammaln, logsumexp
from scipy.stats import chi2
from scipy.stats.qmc import LatinHypercube

from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.misfit import ANY_PRIOR, ANY_SIZES, MISFIT_PRIOR, MISFIT_SIZES, Misfit
from cusick_bench.diagnosis.inference.sets.point_likelihood import log_densities

MOST = 5
"""Largest number of effects in a set."""
COUNT_PRIOR: Final = np.array([0.5, 0.27, 0.13, 0.06, 0.03, 0.01])
"""Prior probability of 0, 1, 2, ... effects."""


@dataclass(frozen=True, eq=False)
class Likelihoods:
    """Log likelihoods of several sets, by size of the misfit.

    Attributes:
        anything: Log likelihood of the forbidden rows, with the prior of t, for each of `ANY_SIZES`.
        symmetric: Log likelihood of the allowed rows, with the prior of s, for each of `MISFIT_SIZES`.
    """

    anything: Float[ndarray, "sets anything"]
    symmetric: Float[ndarray, "sets symmetric"]

    @cached_property
    def total(self) -> Float[ndarray, "sets"]:
        """Log likelihood with both sizes integrated out."""
        return np.asarray(logsumexp(self.anything, axis=1)) + np.asarray(logsumexp(self.symmetric, axis=1))


@dataclass(frozen=True, eq=False)
class SetModel:
    """Joint probability of sets of effects, given a fabric's residual.

    Attributes:
        white: w in the turned rows.
        misfit: The rows, and the pattern of the misfit.
        points: All effects' points.
        listed: Effects that a set is chosen from, those without a point included.
        freedom: Degrees of freedom of Student's t of all rows together, as in `Residual`.
    """

    white: Float[ndarray, "kept"]
    misfit: Misfit
    points: EffectPoints
    listed: int
    freedom: float = np.inf

    def null_noise(self, draws: int, generator: np.random.Generator) -> Float[ndarray, "draws kept"]:
        """Noise of fabrics without effect, in units of its estimated standard deviation.

        The standard deviation is estimated from about a dozen samples, and its error is common to all statistics: the
        rows together have a multivariate Student's t distribution. How large the common error is, is drawn in equal
        strata, which halves the variance of p-values that are near the level of a test.

        Args:
            draws: Number of fabrics.
            generator: Generator of the bootstrap.

        Returns:
            The noise of every turned row.
        """
        noise = generator.standard_normal((draws, len(self.white)))
        if not np.isfinite(self.freedom):
            return noise
        squares = chi2.ppf(LatinHypercube(1, rng=generator).random(draws), self.freedom)
        return noise * np.sqrt(self.freedom / squares)

    def log_prior(self, count: int) -> float:
        """Log prior of any one set of a size.

        Args:
            count: Number of its effects.

        Returns:
            The log prior.
        """
        choices = gammaln(self.listed + 1) - gammaln(count + 1) - gammaln(max(self.listed - count, 0) + 1)
        return float(np.log(COUNT_PRIOR[count]) - choices)

    def likelihoods(
        self, others: Sequence[int], *, more: "SharedShift | None" = None, points: EffectPoints | None = None
    ) -> Likelihoods:
        """Log likelihoods of a set with each of the points added, and last of the set as it is.

        Args:
            others: Points of the set.
            more: A shift beside that of the set.
            points: Points to add instead of the model's own.

        Returns:
            One more than there are points.
        """
        chosen, added = list(others), self.points if points is None else points
        left = self.white - self.points.shift[chosen].sum(0)
        variance = 1 + self.points.variance[chosen].sum(0)
        if more is not None:
            left, variance = left - more.shift, variance + more.variance
        return likelihoods_of(self.misfit, left, variance, added)

    def log_joint(self, chosen: Sequence[int], more: "SharedShift | None" = None) -> float:
        """Log of prior times likelihood of a set.

        Args:
            chosen: Points of the set.
            more: A shift beside that of the set.

        Returns:
            The log joint probability.
        """
        likelihood = float(self.likelihoods(chosen, more=more, points=_no_points(self.points)).total[-1])
        return likelihood + self.log_prior(len(chosen)) + float(self.points.log_prior[list(chosen)].sum())


@dataclass(frozen=True, eq=False)
class SharedShift:
    """Shift by effects that are not the fabric's own.

    Attributes:
        shift: Shift of the turned rows.
        variance: What another law adds to the variance of each row.
    """

    shift: Float[ndarray, "kept"]
    variance: Float[ndarray, "kept"]


def likelihoods_of(
    misfit: Misfit, left: Float[ndarray, "kept"], variance: Float[ndarray, "kept"], points: EffectPoints
) -> Likelihoods:
    """Log likelihoods of what a set leaves, with each of some points added, and last as it is.

    Args:
        misfit: The rows.
        left: What the set leaves.
        variance: Variance of noise and laws, without the misfit.
        points: The points.

    Returns:
        For every size of the misfit.
    """
    split = misfit.forbidden
    anything = np.broadcast_to(ANY_SIZES[:, None] ** 2, (len(ANY_SIZES), split)).copy()
    parts = []
    for rows, sizes in ((slice(0, split), anything), (slice(split, None), MISFIT_SIZES[:, None] ** 2 * misfit.pattern)):
        own, spread = np.ascontiguousarray(left[rows]), np.ascontiguousarray(variance[rows])
        nothing = np.zeros((1, len(own)))
        parts.append(
            np.concatenate(
                [
                    log_densities(own, spread, points.shift[:, rows], points.variance[:, rows], sizes),
                    log_densities(own, spread, nothing, nothing, sizes),
                ]
            )
        )
    return Likelihoods(parts[0] + np.log(ANY_PRIOR), parts[1] + np.log(MISFIT_PRIOR))


def _no_points(points: EffectPoints) -> EffectPoints:
    nothing = np.zeros(0, dtype=int)
    kept = points.shift.shape[1]
    return EffectPoints((), (), nothing, nothing, nothing, np.zeros((0, kept)), np.zeros((0, kept)), np.zeros(0))
