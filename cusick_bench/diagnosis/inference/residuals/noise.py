"""Noise of a fabric's features: how its samples scatter, and how far the base model may be off.

A dozen samples tell little about the scatter of 60 statistics, and other cloths, laboratories and simulators scatter
more or less than the base model, with up to several times its variance, mostly in statistics that symmetry forbids. So
the variance of a statistic, separately for the even and the odd part of a sample's faces, is

    s_k^2 = (T g m_k^2 + f d_k^2) / (T + f)

with d_k^2 the data's variance (f degrees of freedom), m_k^2 the model's, and g the ratio of the fabric's variance to
the model's in statistics of that sort (those that symmetry forbids, or the rest), from the mean of ln d_k^2 / m_k^2.
Correlations are averages of the model's and the data's.

References:
    Smyth. Linear models and empirical Bayes methods for assessing differential expression in microarray experiments.
    Statistical Applications in Genetics and Molecular Biology 3(1), 2004 (variances shrunk towards a prior's that is
    scaled to the data). Ledoit, Wolf. A well-conditioned estimator for large-dimensional covariance matrices. Journal
    of Multivariate Analysis 88(2), 2004.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.special import digamma, polygamma

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.regression_terms import base_terms, spread_terms
from cusick_bench.diagnosis.inference.residuals.feature_rows import DRIFT, FACE_EVEN, MAY_BE_WRONG, MEANS, ROWS, SPREAD
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import NAMES, RESOLUTION

_COUNT = len(NAMES)
MODEL_FREEDOM: Final = 6.0
"""T, degrees of freedom that the model's own variances count for."""
TOGETHER: Final = 1.8
"""Degrees of freedom of a factor common to all rows of a fabric, over those of one variance; it reproduces how the mean
squares of cases without effect scatter in three simulators."""
_CORRELATION_FREEDOM = 60.0  # of the model's correlations; with fewer, directions absent in few samples get no noise
_DRIFT_FREEDOM = 12.0  # the same for drifts
_SCALE_SD = 1.0  # standard deviation of ln g between fabrics; values of g from 0.2 to 6 were observed
_UNEVEN = 0.5  # variance of ln d_k^2 / (g m_k^2) between statistics
_ALIKE = 3.0  # number of statistics that count as one, since they are correlated
_RESOLVED = 2.0  # image resolutions; statistics that scatter by less are not used for g
_SPREAD_DISCREPANCY = np.array([0.5 if name.startswith(("harmonic", "envelope")) else 0.2 for name, _ in SPREADS])
"""Standard deviation of the model's error of ln sd. In the low orders the scatter of samples depends on how they were
laid down, which differs between laboratories (fabrics without effect in other simulators, and real ones, differ by .2
to .8 from the base model)."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """How a fabric's samples scatter.

    Attributes:
        within: Covariance of the statistics within faces.
        even: That of the even parts (up + down) / 2 of samples with both faces.
        odd: That of the odd parts (down - up) / 2.
        within_freedom: Degrees of freedom of `within`.
        paired_freedom: Degrees of freedom of `even` and of `odd`; 0 where no two samples have both faces.
    """

    within: Float[ndarray, "statistics statistics"]
    even: Float[ndarray, "statistics statistics"]
    odd: Float[ndarray, "statistics statistics"]
    within_freedom: int
    paired_freedom: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the covariances that the noise of the means is computed from."""
        return self.paired_freedom or self.within_freedom


def scatter_of(specimens: Float[ndarray, "samples 2 statistics"]) -> Scatter:
    """Scatter between samples.

    Args:
        specimens: Statistics of every sample and face; NaN where there is none.

    Returns:
        Their covariances.
    """
    known = np.isfinite(specimens[..., 0])
    paired = specimens[known.all(1)]
    within, within_freedom = _pooled([specimens[known[:, face], face] for face in (0, 1)])
    even, freedom = _pooled([(paired[:, 1] + paired[:, 0]) / 2])
    odd, _ = _pooled([(paired[:, 1] - paired[:, 0]) / 2])
    return Scatter(within, even, odd, within_freedom, freedom)


def _pooled(groups: Sequence[Float[ndarray, "_ statistics"]]) -> tuple[Float[ndarray, "statistics statistics"], int]:
    """Covariance within groups, and its degrees of freedom."""
    freedom = sum(max(len(group) - 1, 0) for group in groups)
    if freedom < 1:
        return np.zeros((groups[0].shape[1],) * 2), 0
    deviations = [group - group.mean(0) for group in groups if len(group)]
    return np.asarray(sum(one.T @ one for one in deviations)) / freedom, freedom


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance of a fabric's features, apart from the base parameters' uncertainty.

    Attributes:
        sd: Standard deviation of every statistic between samples [its unit].
        covariance: Covariance of all rows of `feature_rows`.
    """

    sd: Float[ndarray, "statistics"]
    covariance: Float[ndarray, "rows rows"]


def noise(
    emulator: Emulator,
    theta: Float[ndarray, "parameters"],
    features: Features,
    scatter: Scatter | None,
    *,
    exact: bool = False,
) -> Noise:
    """Covariance of the features at theta.

    Args:
        emulator: The atlas.
        theta: Base parameters.
        features: Features of the data, for their numbers of samples.
        scatter: How the data's samples scatter; None for the model's own scatter.
        exact: Whether to leave the errors of model and atlas out of the means' covariance.

    Returns:
        Their covariance, and the unit of the means.
    """
    sd, between = _between_samples(emulator, theta, scatter)
    covariance = np.zeros((ROWS, ROWS))
    covariance[MEANS, MEANS] = sum(np.kron(share, one) for share, one in zip(features.share, between, strict=True))
    ratio = emulator.sd(theta) / sd
    wrong = emulator.wrong(theta) * np.outer(ratio, ratio)
    wrong = wrong + np.diag(emulator.base.variance(base_terms(theta[None]))[0] / sd**2)
    covariance[FACE_EVEN, FACE_EVEN] += 0.0 if exact else wrong
    spreads = features.spread_variance + emulator.base_spread.variance(spread_terms(theta[None]))[0]
    covariance[SPREAD, SPREAD] = np.diag(spreads + _SPREAD_DISCREPANCY**2)
    covariance[DRIFT, DRIFT] = _drift_covariance(features, sd, between[0])
    return Noise(sd, covariance)


def _between_samples(
    emulator: Emulator, theta: Float[ndarray, "parameters"], scatter: Scatter | None
) -> tuple[Float[ndarray, "statistics"], list[Float[ndarray, "statistics statistics"]]]:
    """Standard deviation of every statistic, and covariances of even and of odd parts in units of it."""
    model = emulator.sd(theta)
    own, other = emulator.correlation[:_COUNT, :_COUNT], emulator.correlation[:_COUNT, _COUNT:]
    own = (own + emulator.correlation[_COUNT:, _COUNT:]) / 2
    other = (other + other.T) / 2
    parts = [(own + other) / 2, (own - other) / 2]  # faces are exchangeable: even and odd parts do not correlate
    found, expected = [np.zeros_like(own)] * 2, parts
    freedom = 0 if scatter is None else scatter.freedom
    if scatter is not None and freedom:
        paired = scatter.paired_freedom > 0
        unit = np.outer(model, model)
        found = [one / unit for one in ((scatter.even, scatter.odd) if paired else (scatter.within, scatter.within))]
        expected = parts if paired else [own, own]
    resolved = model > _RESOLVED * RESOLUTION
    wider = [
        _variance_ratios(np.diag(data) / np.diag(by_model), freedom, resolved)
        for data, by_model in zip(found, expected, strict=True)
    ]
    variance = sum(np.diag(part) * factor for part, factor in zip(parts, wider, strict=True))
    sd = np.maximum(model * np.sqrt(variance), RESOLUTION)
    between = []
    for part, data, factor in zip(parts, found, wider, strict=True):
        scale = np.sqrt(factor / variance)  # relative to sd, which is at least the resolution of images
        covariance = part * np.outer(scale, scale)
        between.append(_averaged_correlations(covariance, data, _CORRELATION_FREEDOM, freedom))
    return sd, between


def _variance_ratios(
    ratio: Float[ndarray, "statistics"], freedom: int, resolved: Bool[ndarray, "statistics"]
) -> ndarray:
    """Ratios s_k^2 / m_k^2 of the module's equation, from the ratios d_k^2 / m_k^2."""
    if not freedom:
        return np.ones(len(ratio))
    scale = np.ones(len(ratio))
    for sort in (MAY_BE_WRONG[:_COUNT], ~MAY_BE_WRONG[:_COUNT]):
        known = np.logical_and(sort, resolved)
        if known.any():
            # The expectation of ln(chi^2 / f) is negative; it is subtracted.
            mean = np.log(np.maximum(ratio[known], 1e-6)).mean() - (digamma(freedom / 2) - np.log(freedom / 2))
            error = (float(polygamma(1, freedom / 2)) + _UNEVEN) * _ALIKE / known.sum()
            scale[sort] = np.exp(mean * _SCALE_SD**2 / (_SCALE_SD**2 + error))
    return (MODEL_FREEDOM * scale + freedom * ratio) / (MODEL_FREEDOM + freedom)


def _averaged_correlations(
    covariance: ndarray, data: ndarray, trust: float, freedom: float
) -> Float[ndarray, "columns columns"]:
    """A covariance with the same variances, and with correlations averaged with the data's."""
    if not freedom:
        return covariance
    tiny = np.finfo(np.float64).tiny
    # where all drapes are equal, variances are 0
    size, seen = (np.sqrt(np.maximum(np.diag(one), tiny)) for one in (covariance, data))
    own, found = covariance / np.outer(size, size), data / np.outer(seen, seen)
    np.fill_diagonal(found, 1.0)
    return (trust * own + freedom * found) / (trust + freedom) * np.outer(size, size)


def _drift_covariance(
    features: Features, sd: Float[ndarray, "statistics"], even: Float[ndarray, "statistics statistics"]
) -> Float[ndarray, "orders orders"]:
    """Covariance of the mean drifts in sd: the data's variances, their correlation shrunk to that of even parts."""
    chosen = list(ORDERS)
    variance = np.diag(features.order_covariance) / sd[chosen] ** 2
    if not np.isfinite(variance).all():
        return np.diag(variance)
    model = even[np.ix_(chosen, chosen)]
    size = np.sqrt(variance / np.diag(model))
    own = model * np.outer(size, size)
    data = features.order_covariance / np.outer(sd[chosen], sd[chosen])
    return _averaged_correlations(own, data, _DRIFT_FREEDOM, features.order_freedom) + np.diag(
        (0.5 * RESOLUTION / sd)[chosen] ** 2
    )
