"""The atlas as smooth functions: what a fabric's features are at theta, and how much an effect moves them.

With z = theta scaled to [-1, 1], every statistic k has

    base     m_k(z)      = polynomial in z;                    sd_k(z) = exp(polynomial), scatter between samples

and every effect a response (`response`), all fitted to the points of the atlas by ridge regression. What symmetry
forbids is not fitted: without an effect a fabric has no harmonics of odd order and none that are not symmetric about
warp and weft; exchanging warp and weft turns a drape by 90 degrees.

What a finer mesh with shorter steps and what other laws change is the model's discrepancy.

References:
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001 (the model's discrepancy as a
    covariance).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import digamma

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, BaseModel
from cusick_bench.diagnosis.atlas.design import BASE, FINE, FINE_VERTICES, LAWS, ONE_MESH, Design
from cusick_bench.diagnosis.atlas.points import Point
from cusick_bench.diagnosis.atlas.regression_terms import base_terms, spread_terms
from cusick_bench.diagnosis.atlas.response import LEAST_SAMPLES, Response, changes, response
from cusick_bench.diagnosis.atlas.ridge import Fit, ridge
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.statistics import (
    EVEN,
    FREE,
    LOCKED_ORDERS,
    LOCKED_PAIRS,
    NAMES,
    RESOLUTION,
    rotated,
)
from cusick_bench.sim.effects import registered
from cusick_bench.sim.engine.settings import Clamp

_COUNT = len(NAMES)
_LEAST_POINTS = 60
_BEYOND_FINE = 1 / (1 - BaseModel().vertices / FINE_VERTICES)
"""Error of the atlas' mesh over its difference to the fine one; errors go with the square of an edge's length."""
_EXCHANGED = np.array([1, -1, 1, 1, 1, 1, 1])
_SHRINK = 0.1  # of correlations towards none


@dataclass(frozen=True, eq=False)
class Emulator:
    """The atlas, fitted.

    Attributes:
        base: Fitted function of every statistic (see the module) [its unit].
        base_spread: Fitted function of `Features.spread`.
        log_sd: ln of the standard deviation between samples of every statistic.
        correlation: Correlation of all statistics of both faces, between samples.
        discrepancy: Covariance of what the base model gets wrong, in sd, the same on both faces, at the limp and at the
            stiff end of the atlas.
        responses: Response of each effect, by its name.
        clamp: How hinges on the plate's edge bend in the drapes that it was fitted to (see `DrapeSettings`): what is
            simulated beside it bends likewise.
    """

    base: Fit
    base_spread: Fit
    log_sd: Fit
    correlation: Float[ndarray, "faces_statistics faces_statistics"]
    discrepancy: Float[ndarray, "2 statistics statistics"]
    responses: Mapping[str, Response]
    clamp: Clamp = "half"

    def mean(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics"]:
        """Mean of every statistic, the same on both faces.

        Args:
            theta: Base parameters.

        Returns:
            Means [each statistic's unit].
        """
        return self.base(base_terms(theta[None]))[0]

    def spread(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "spreads"]:
        """`Features.spread` of the base model.

        Args:
            theta: Base parameters.

        Returns:
            The spreads.
        """
        return self.base_spread(spread_terms(theta[None]))[0]

    def sd(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics"]:
        """Standard deviation of every statistic between samples; never below what images resolve.

        Args:
            theta: Base parameters.

        Returns:
            Standard deviations [each statistic's unit].
        """
        return np.maximum(np.exp(self.log_sd(spread_terms(theta[None]))[0]), RESOLUTION)

    def wrong(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics statistics"]:
        """Discrepancy of the base model's means.

        Args:
            theta: Base parameters.

        Returns:
            Its covariance, in units of sd.
        """
        limp, stiff = _ends(theta[0])
        return limp * self.discrepancy[0] + stiff * self.discrepancy[1]


def _log_variance(points: Mapping[int, Point], numbers: list[int]) -> Float[ndarray, "points statistics"]:
    """ln of the variance between samples, free of bias, both faces pooled; never below what images resolve."""
    rows = []
    for number in numbers:
        statistics = points[number].statistics
        good = statistics[np.isfinite(statistics).all((1, 2))]
        freedom = 2 * (len(good) - 1)
        variance = ((good - good.mean(0)) ** 2).sum((0, 1)) / freedom
        rows.append(np.log(np.maximum(variance, (RESOLUTION / 3) ** 2)) - digamma(freedom / 2) + np.log(freedom / 2))
    return np.stack(rows)


def _correlation(
    points: Mapping[int, Point], sd: Mapping[int, ndarray]
) -> Float[ndarray, "faces_statistics faces_statistics"]:
    """Between all statistics of both faces of a sample, pooled over fabrics; faces are exchangeable."""
    total = np.zeros((2 * _COUNT, 2 * _COUNT))
    for number, scale in sd.items():
        statistics = points[number].statistics
        values = statistics[np.isfinite(statistics).all((1, 2))] / scale
        deviation = (values - values.mean(0)).reshape(len(values), -1)
        total += deviation.T @ deviation
    other = np.roll(np.arange(2 * _COUNT), _COUNT)
    total = total + total[np.ix_(other, other)]
    size = np.sqrt(np.diag(total))
    return (1 - _SHRINK) * total / np.outer(size, size) + _SHRINK * np.eye(2 * _COUNT)


def _discrepancy(points: Mapping[str, Mapping[int, Point]], theta: ndarray, sd: ndarray) -> ndarray:
    """What the base model gets wrong in the mean, in sd, for limp and for stiff cloth."""
    total = np.zeros((2, _COUNT, _COUNT))
    for name, factor in ((FINE, _BEYOND_FINE**2), (LAWS, 1.0)):
        other = points.get(name, {})
        for end, weight in enumerate(_ends(theta[:, 0])):
            total[end] += factor * _changed(points[BASE], other, weight, sd)
    return total + np.diag(_shared_asymmetry(points.get(ONE_MESH, {}), sd))


def _ends(bending: Float[ndarray, "*rows"]) -> tuple[Float[ndarray, "*rows"], Float[ndarray, "*rows"]]:
    """How near cloth is to the limp and to the stiff end of the atlas."""
    share = np.clip((bending - LOW[0]) / (HIGH[0] - LOW[0]), 0, 1)
    return 1 - share, share


def _changed(base: Mapping[int, Point], other: Mapping[int, Point], weight: ndarray, sd: ndarray) -> ndarray:
    """Second moment over fabrics of what another model changes, less what the finite number of samples makes."""
    total, mass = np.zeros((_COUNT, _COUNT)), 0.0
    for number in sorted(other.keys() & base.keys()):
        change = other[number].statistics - base[number].statistics
        good = np.isfinite(change).all((1, 2))
        if good.sum() < LEAST_SAMPLES:
            continue
        own = (change[good] / sd[number]).reshape(-1, _COUNT)
        total += weight[number] * (np.outer(own.mean(0), own.mean(0)) - np.cov(own.T) / len(own))
        mass += weight[number]
    if not mass:
        return total
    total = _symmetric_only(total / mass)
    value, vector = np.linalg.eigh((total + total.T) / 2)
    return (vector * np.maximum(value, 0)) @ vector.T


def _shared_asymmetry(points: Mapping[int, Point], sd: ndarray) -> Float[ndarray, "statistics"]:
    """Variance of the locked statistics of fabrics all of whose samples share a mesh, less sampling noise, in sd.

    A mesh decides a little where folds lie, and so does whatever else the samples of a fabric share; without this any
    such asymmetry would be taken for a patch. Real and imaginary parts count together.
    """
    excess = []
    for number, point in points.items():
        good = np.isfinite(point.statistics).all((1, 2))
        if good.sum() < LEAST_SAMPLES:
            continue
        values = (point.statistics[good] / sd[number]).mean(1)
        excess.append(values.mean(0) ** 2 - values.var(0, ddof=1) / len(values))
    found = np.zeros(_COUNT)
    if excess:
        mean = np.mean(excess, axis=0)
        for (real, imaginary), order in zip(LOCKED_PAIRS, LOCKED_ORDERS, strict=True):
            # the real parts of even order are the base model's own
            found[[real, imaginary]] = max(0.0, mean[imaginary] if order % 2 == 0 else mean[[real, imaginary]].mean())
    return found


def _symmetric_only(covariance: ndarray) -> ndarray:
    """Without what symmetry forbids: no discrepancy of the model can make a drape prefer one side."""
    kept = np.zeros(_COUNT, dtype=bool)
    kept[[*FREE, *EVEN]] = True
    return np.where(np.outer(kept, kept), covariance, 0.0)


def fit(
    design: Design,
    points: Mapping[str, Mapping[int, Point]],
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Emulator:
    """Fits the atlas.

    Args:
        design: What it was made of.
        points: What `points.read_points` returned.
        progress: Called with the effects that are fitted, and their number.

    Returns:
        The atlas as smooth functions.

    Raises:
        DiagnosisError: Too few points.
    """
    theta, base = design.theta(), points.get(BASE, {})
    numbers = [n for n, p in base.items() if np.isfinite(p.statistics).all((1, 2)).sum() >= LEAST_SAMPLES]
    if len(numbers) < _LEAST_POINTS:
        raise DiagnosisError(f"an atlas needs at least {_LEAST_POINTS} fabrics, got {len(numbers)}; go on building it")
    at, of_fabrics = theta[numbers], [features(base[n].statistics) for n in numbers]
    mean = np.stack([one.mean.mean(0) for one in of_fabrics])
    log_sd_values = _log_variance(base, numbers) / 2
    other, twin = at * _EXCHANGED, rotated(mean, np.pi / 2)  # the same fabrics with warp and weft exchanged
    mean, twin = _only_even(mean), _only_even(twin)
    both = np.concatenate([at, other])
    level = ridge(base_terms(both), np.concatenate([mean, twin]), 1 + at.shape[1])
    log_sd = ridge(spread_terms(both), np.tile(log_sd_values, (2, 1)), 2)
    spread = ridge(spread_terms(at), np.stack([one.spread for one in of_fabrics]), 2)
    sd = np.maximum(np.exp(log_sd(spread_terms(theta))), RESOLUTION)
    correlation = _correlation(base, {n: sd[n] for n in numbers})
    covered = {name: one for name, one in registered().items() if len(points.get(name, {})) >= _LEAST_POINTS}
    responses = {}
    for place, (name, effect) in enumerate(covered.items()):
        progress(place, len(covered))
        responses[name] = response(effect, changes(effect, theta, base, points[name], sd))
    discrepancy = _discrepancy(points, theta, sd)
    return Emulator(level, spread, log_sd, correlation, discrepancy, responses, design.clamp)


def _only_even(mean: ndarray) -> ndarray:
    """Without the statistics that are 0 by symmetry."""
    kept, columns = np.zeros_like(mean), [*FREE, *EVEN]
    kept[:, columns] = mean[:, columns]
    return kept
