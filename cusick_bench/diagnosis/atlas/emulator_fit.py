"""Fit of the atlas' smooth functions to the drapes that it is made of.

Base, scatter and responses (see `emulator`) are fitted to the points of the atlas by ridge regression. What symmetry
forbids is not fitted: without an effect a fabric has no harmonics of odd order and none that are not symmetric about
warp and weft; exchanging warp and weft turns a drape by 90 degrees.

Most drapes are made by a cheaper model. Its error is known from fewer drapes of the same samples under the base model's
own law and mesh, and for limp cloth also on a still finer mesh. Each of these two differences is fitted by a smooth
function of z with fewer terms, a correction, and added. The model's discrepancy is what the corrections leave
unexplained, what other laws change, and each correction itself as one direction of error.

References:
    Kennedy, O'Hagan. Predicting the output from a complex computer code when fast approximations are available.
    Biometrika 87(1), 2000 (many cheap runs, few exact ones).
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001 (the model's discrepancy as a
    covariance).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.special import digamma

from cusick_bench.diagnosis.atlas.base_model import NAMES as PARAMETERS
from cusick_bench.diagnosis.atlas.design import BASE, FINE, FINEST, LAWS, ONE_MESH, Design, at_fine
from cusick_bench.diagnosis.atlas.emulator import Emulator, nearness_to_ends
from cusick_bench.diagnosis.atlas.points import Point
from cusick_bench.diagnosis.atlas.regression_terms import (
    CORRECTED,
    LIMP,
    SPREAD_CORRECTED,
    base_terms,
    spread_terms,
)
from cusick_bench.diagnosis.atlas.response import LEAST_SAMPLES, changes, corrected, response
from cusick_bench.diagnosis.atlas.ridge import Fit, SummedFit, ridge
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

_COUNT = len(NAMES)
LEAST_POINTS = 60
"""Number of fabrics that the means, and the response of an effect, need."""
_LEAST_FINE = 8  # number of fabrics that a correction needs
_EXCHANGED = np.array([-1 if name == "anisotropy" else 1 for name in PARAMETERS])
_SHRINK = 0.1  # share by which correlations are shrunk towards 0
_CHEAP_FREEDOM = 60.0  # degrees of freedom that the correlations of the cheaper drapes count for


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
) -> tuple[Float[ndarray, "faces_statistics faces_statistics"], int]:
    """Correlation of all statistics of both faces of a sample, pooled over fabrics, and its degrees of freedom.

    Faces are exchangeable. Statistics are divided by the scatter of their own fabric and model; otherwise the fabrics
    that scatter most would decide.
    """
    total, freedom = np.zeros((2 * _COUNT, 2 * _COUNT)), 0
    for number, scale in sd.items():
        statistics = points[number].statistics
        values = statistics[np.isfinite(statistics).all((1, 2))] / scale
        deviation = (values - values.mean(0)).reshape(len(values), -1)
        total += deviation.T @ deviation
        freedom += len(values) - 1
    other = np.roll(np.arange(2 * _COUNT), _COUNT)
    total = total + total[np.ix_(other, other)]
    size = np.sqrt(np.diag(total))
    return total / np.outer(size, size), freedom


def _shrunk_correlation(
    points: Mapping[str, Mapping[int, Point]], base_sd: Mapping[int, ndarray], sd: Float[ndarray, "points statistics"]
) -> Float[ndarray, "faces_statistics faces_statistics"]:
    """Correlation of the base model's own drapes, with that of the cheaper drapes as its prior mean.

    The cheaper drapes alone will not do: their coarse meshes add scatter between the faces of a sample.
    """
    correlation, _ = _correlation(points[BASE], base_sd)
    fine = {n: sd[n] for n, point in points.get(FINE, {}).items() if _usable(point)}
    if len(fine) >= _LEAST_FINE:
        exact, freedom = _correlation(points[FINE], fine)
        correlation = (freedom * exact + _CHEAP_FREEDOM * correlation) / (freedom + _CHEAP_FREEDOM)
    return (1 - _SHRINK) * correlation + _SHRINK * np.eye(2 * _COUNT)


def _discrepancy(
    points: Mapping[str, Mapping[int, Point]],
    theta: ndarray,
    sd: ndarray,
    known: Mapping[str, Mapping[int, ndarray]],
) -> ndarray:
    """Covariance of the error of the base model's means [sd], for limp and for stiff cloth.

    The corrections, which are `known`, are subtracted before.
    """
    total = np.zeros((2, _COUNT, _COUNT))
    for name, beside in ((FINE, BASE), (FINEST, FINE), (LAWS, BASE)):
        other = points.get(name, {})
        for end, weight in enumerate(nearness_to_ends(theta[:, 0])):
            total[end] += _second_moment_of_changes(points.get(beside, {}), other, weight, sd, known.get(name, {}))
    return total + np.diag(_shared_asymmetry(points.get(ONE_MESH, {}), sd))


def _lack_of_fit(points: Mapping[int, Point], theta: ndarray, sd: ndarray, fit: Fit, terms: ndarray) -> ndarray:
    """Second moment of the fit's residuals over the fabrics that it is fitted to, less the noise of few samples."""
    total, freedom = np.zeros((2, _COUNT, _COUNT)), 1 - fit.weights.shape[0] / (2 * len(points))
    predicted = fit(terms[:, : len(fit.weights)])
    for end, weight in enumerate(nearness_to_ends(theta[:, 0])):
        mass = 0.0
        for number, point in points.items():
            values = point.statistics[np.isfinite(point.statistics).all((1, 2))].mean(1)
            if len(values) < LEAST_SAMPLES:
                continue
            left = (values.mean(0) - predicted[number]) / sd[number]
            scatter = np.cov((values / sd[number]).T) / len(values)
            total[end] += weight[number] * (np.outer(left, left) / freedom - scatter)
            mass += weight[number]
        total[end] = _nearest_covariance(_symmetric_only(total[end] / mass))
    return total


def _second_moment_of_changes(
    base: Mapping[int, Point], other: Mapping[int, Point], weight: ndarray, sd: ndarray, known: Mapping[int, ndarray]
) -> ndarray:
    """Second moment over fabrics of what another model changes beyond the known part, less the noise of few samples."""
    total, mass = np.zeros((_COUNT, _COUNT)), 0.0
    for number in sorted(other.keys() & base.keys()):
        change = _difference(base[number], other[number])
        if len(change) < LEAST_SAMPLES:
            continue
        own = (change / sd[number]).reshape(-1, _COUNT)
        mean = own.mean(0) - known.get(number, 0.0) / sd[number]
        total += weight[number] * (np.outer(mean, mean) - np.cov(own.T) / len(own))
        mass += weight[number]
    if not mass:
        return total
    return _nearest_covariance(_symmetric_only(total / mass))


def _nearest_covariance(covariance: ndarray) -> ndarray:
    """The nearest positive semidefinite matrix: subtracting noise can leave negative variances."""
    value, vector = np.linalg.eigh((covariance + covariance.T) / 2)
    return (vector * np.maximum(value, 0)) @ vector.T


def _difference(base: Point, other: Point) -> Float[ndarray, "samples 2 statistics"]:
    """Change of statistics from one model to another, of the samples that both have draped on both sides."""
    change = other.statistics - base.statistics[: len(other.statistics)]
    return change[np.isfinite(change).all((1, 2))]


def _shared_asymmetry(points: Mapping[int, Point], sd: ndarray) -> Float[ndarray, "statistics"]:
    """Variance of the locked statistics of fabrics all of whose samples share a mesh, less sampling noise, in sd.

    A mesh has a small influence on where folds lie, and so has anything else that the samples of a fabric share;
    without this variance such an asymmetry would be taken for a patch. Real and imaginary parts are pooled.
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
            # Real parts of even order are left out: they differ from 0 in the base model, too.
            found[[real, imaginary]] = max(0.0, mean[imaginary] if order % 2 == 0 else mean[[real, imaginary]].mean())
    return found


def _symmetric_only(covariance: ndarray) -> ndarray:
    """The covariance without statistics that symmetry forbids: an error of the model prefers no side of the cloth."""
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
    numbers = [n for n, point in base.items() if _usable(point)]
    if len(numbers) < LEAST_POINTS:
        raise DiagnosisError(f"an atlas needs at least {LEAST_POINTS} fabrics, got {len(numbers)}; go on building it")
    at, of_fabrics = theta[numbers], [features(base[n].statistics) for n in numbers]
    level, corrections = fit_base_means(theta, points)
    scatter = spread_terms(theta)
    variance = _log_variances(base)
    log_sd = _summed_fit(
        ridge(scatter[list(variance)], np.stack(list(variance.values())) / 2, 2),
        [_scatter_correction(scatter, _halved(variance), _halved(_log_variances(points.get(FINE, {}))))],
    )
    spreads = {n: one.spread for n, one in zip(numbers, of_fabrics, strict=True)}
    fine_spreads = {n: features(p.statistics).spread for n, p in points.get(FINE, {}).items() if _usable(p)}
    spread = _summed_fit(
        ridge(spread_terms(at), np.stack(list(spreads.values())), 2),
        [_scatter_correction(scatter, spreads, fine_spreads)],
    )
    sd = np.maximum(np.exp(log_sd(scatter)), RESOLUTION)
    cheap_sd = np.maximum(np.exp(log_sd.fits[0](scatter)), RESOLUTION)
    correlation = _shrunk_correlation(points, {n: cheap_sd[n] for n in numbers}, sd)
    covered = {name: one for name, one in registered().items() if len(points.get(name, {})) >= LEAST_POINTS}
    responses = {}
    for place, (name, effect) in enumerate(covered.items()):
        progress(place, len(covered))
        fitted = response(effect, changes(effect, theta, base, points[name], sd))
        fine = points.get(at_fine(name), {})
        compared = _compared(base, points.get(FINE, {}), points[name], fine)
        if len(compared) >= _LEAST_FINE:
            cheap, exact = (
                changes(effect, theta, plain, {n: acted[n] for n in compared}, sd)
                for plain, acted in ((base, points[name]), (points[FINE], fine))
            )
            fitted = corrected(fitted, cheap, exact)
        responses[name] = fitted
    known = {}
    for name, (correction, columns) in corrections.items():
        known[name] = dict(enumerate(correction(base_terms(theta)[:, columns])))
    discrepancy = _discrepancy(points, theta, sd, known)
    discrepancy = discrepancy + _lack_of_fit(base, theta, sd, level.fits[0], base_terms(theta))
    return Emulator(level, spread, log_sd, correlation, discrepancy, responses)


_Correction = tuple[Fit, Int[ndarray, " chosen"]]


def fit_base_means(
    theta: Float[ndarray, "points parameters"], points: Mapping[str, Mapping[int, Point]]
) -> tuple[SummedFit, dict[str, _Correction]]:
    """Fits the mean of every statistic without an effect.

    Args:
        theta: Base parameters of all fabrics.
        points: Their drapes, as far as they are made.

    Returns:
        The mean under the base model, and the corrections to the cheaper model that are part of it: by the drapes that
        they come from.
    """
    base, free = points[BASE], 1 + theta.shape[1]
    numbers = [n for n, point in base.items() if _usable(point)]
    mean = np.stack([features(base[n].statistics).mean.mean(0) for n in numbers])
    terms, values = _with_exchanged_directions(theta[numbers], mean)
    found = {
        FINE: _correction(theta, points, FINE, BASE, CORRECTED, free),
        FINEST: _correction(theta, points, FINEST, FINE, LIMP, 1),
    }
    corrections = {name: one for name, one in found.items() if one is not None}
    return _summed_fit(ridge(terms, values, free), list(corrections.values())), corrections


def _usable(point: Point) -> bool:
    return bool(np.isfinite(point.statistics).all((1, 2)).sum() >= LEAST_SAMPLES)


def _compared(*drapes: Mapping[int, Point]) -> list[int]:
    """Numbers of the fabrics of which no drape failed, in any of several groups of drapes."""
    shared = set.intersection(*(set(one) for one in drapes))
    return [n for n in sorted(shared) if all(np.isfinite(one[n].statistics).all() for one in drapes)]


def _log_variances(points: Mapping[int, Point]) -> dict[int, ndarray]:
    """`_log_variance` of all usable fabrics."""
    numbers = [n for n, point in points.items() if _usable(point)]
    return dict(zip(numbers, _log_variance(points, numbers), strict=True)) if numbers else {}


def _halved(values: Mapping[int, ndarray]) -> dict[int, ndarray]:
    return {number: value / 2 for number, value in values.items()}


def _with_exchanged_directions(
    theta: Float[ndarray, "rows parameters"], mean: Float[ndarray, "rows statistics"]
) -> tuple[Float[ndarray, "twice_rows terms"], Float[ndarray, "twice_rows statistics"]]:
    """Terms and means of fabrics, and of the same fabrics with warp and weft exchanged."""
    terms = base_terms(np.concatenate([theta, theta * _EXCHANGED]))
    return terms, np.concatenate([_symmetric_means(mean), _symmetric_means(rotated(mean, np.pi / 2))])


def _summed_fit(fit: Fit, corrections: Sequence[_Correction | None]) -> SummedFit:
    known = [one for one in corrections if one is not None]
    return SummedFit(
        (fit, *(one for one, _ in known)), (np.arange(len(fit.weights)), *(columns for _, columns in known))
    )


def _correction(
    theta: ndarray, points: Mapping[str, Mapping[int, Point]], name: str, beside: str, columns: ndarray, free: int
) -> _Correction | None:
    """Fit to the mean difference between the drapes `name` and the drapes `beside`; None where there are too few."""
    base, other = points.get(beside, {}), points.get(name, {})
    found = {n: _difference(base[n], other[n]) for n in sorted(other.keys() & base.keys())}
    found = {n: change for n, change in found.items() if len(change) >= min(LEAST_SAMPLES, len(other[n].statistics))}
    if len(found) < max(_LEAST_FINE, 2 * free):
        return None
    mean = np.stack([change.mean((0, 1)) for change in found.values()])
    terms, values = _with_exchanged_directions(theta[list(found)], mean)
    return ridge(terms[:, columns], values, free), columns


def _scatter_correction(
    terms: Float[ndarray, "points terms"], base: Mapping[int, ndarray], fine: Mapping[int, ndarray]
) -> _Correction | None:
    """Fit to the mean difference of the logarithms of scatter; None where there are too few fabrics."""
    both = sorted(base.keys() & fine.keys())
    if len(both) < _LEAST_FINE:
        return None
    difference = np.stack([fine[n] - base[n] for n in both])
    return ridge(terms[both][:, SPREAD_CORRECTED], difference, 1), SPREAD_CORRECTED


def _symmetric_means(mean: ndarray) -> ndarray:
    """Means in which the statistics that vanish by symmetry are set to 0."""
    kept, columns = np.zeros_like(mean), [*FREE, *EVEN]
    kept[:, columns] = mean[:, columns]
    return kept
