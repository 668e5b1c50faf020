"""The atlas as smooth functions: what a fabric's features are at theta, and how much an effect moves them.

With z = theta scaled to [-1, 1] and s the severity in typical ones, every statistic k has

    base     m_k(z)      = polynomial in z;                    sd_k(z) = exp(polynomial), scatter between samples
    effect   D_k(z, s)   = sd_k(z) times a polynomial in s, without constant, times one in z

fitted to the points of the atlas by ridge regression whose strength is set by generalised cross-validation. What
symmetry forbids is not fitted: without an effect a fabric has no harmonics of odd order and none that are not symmetric
about warp and weft; exchanging warp and weft turns a drape by 90 degrees; an effect with a direction is fitted in the
frame of that direction, in which it is symmetric; an effect that the cloth carries on one face acts with the opposite
sign when the cloth is turned over.

What a finer mesh with shorter steps and what other laws change is the model's discrepancy.

References:
    Golub, Heath, Wahba. Generalized cross-validation as a method for choosing a good ridge parameter.
    Technometrics 21(2), 1979. Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001 (the
    model's discrepancy as a covariance).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import digamma

from cusick_bench.diagnosis.atlas import BASE, FINE, FINE_VERTICES, LAWS, ONE_MESH, Design, Point
from cusick_bench.diagnosis.base_model import DENSITY, HIGH, LOW, BaseModel
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.features import Features, features
from cusick_bench.diagnosis.statistics import LOCKED_ORDERS, LOCKED_PAIRS, NAMES, PHASE_FREE, RESOLUTION, rotated
from cusick_bench.sim.effects import Effect, registered
from cusick_bench.sim.material import uniform_material
from cusick_bench.sim.mesh import disc_mesh
from cusick_bench.sim.settings import DrapeSettings
from cusick_bench.sim.setup import Setup

_COUNT = len(NAMES)
_REAL = [real for real, _ in LOCKED_PAIRS]
_IMAGINARY = [imaginary for _, imaginary in LOCKED_PAIRS]
_EVEN = [real for real, order in zip(_REAL, LOCKED_ORDERS, strict=True) if order % 2 == 0]
FREE = list(range(len(PHASE_FREE)))
_RIDGES = np.geomspace(1e-3, 1e3, 13)
_LEAST_POINTS = 60
_LEAST_SAMPLES = 2
_BEYOND_FINE = 1 / (1 - BaseModel().vertices / FINE_VERTICES)
"""Error of the atlas' mesh over its difference to the fine one; errors go with the square of an edge's length."""
_EXCHANGED = np.array([1, -1, 1, 1, 1, 1, 1])
_SHRINK = 0.1  # of correlations towards none


def _scaled(theta: Float[ndarray, "*rows parameters"]) -> Float[ndarray, "*rows parameters"]:
    return np.clip((2 * theta - HIGH - LOW) / (HIGH - LOW), -1.3, 1.3)


def base_terms(theta: Float[ndarray, "rows parameters"]) -> Float[ndarray, "rows terms"]:
    """All products of up to two z, and up to four of the bending level's with one other."""
    z = _scaled(theta)
    pairs = [z[:, i] * z[:, j] for i, j in combinations_with_replacement(range(z.shape[1]), 2)]
    level = z[:, 0]
    more = [level**3, level**4, *(level**2 * z[:, i] for i in range(1, z.shape[1]))]
    return np.stack([np.ones(len(z)), *z.T, *pairs, *more], axis=1)


def spread_terms(theta: Float[ndarray, "rows parameters"]) -> Float[ndarray, "rows terms"]:
    """1, z, and the level's square."""
    z = _scaled(theta)
    return np.column_stack([np.ones(len(z)), z, z[:, 0] ** 2])


def effect_terms(
    theta: Float[ndarray, "rows parameters"], severity: Float[ndarray, "rows"], place: Float[ndarray, "rows place"]
) -> Float[ndarray, "rows terms"]:
    """Powers of the severity times low ones of z and of the place; all vanish with the severity."""
    z, s = _scaled(theta), np.asarray(severity)
    level = z[:, 0]
    linear = [np.ones(len(z)), *z.T, level**2]
    curved = [np.ones(len(z)), level, level**2]
    for own in place.T:
        linear += [own, own * level, own**2]
        curved += [own]
    cubic = [np.ones(len(z)), level]
    # Beyond the first order in units of three typical severities, so that all terms are of like size.
    first, second, third = s, s * np.abs(s) / 3, s**2 / 3
    return np.stack(
        [*(first * t for t in linear), *(third * t for t in curved), *(second * t for t in cubic)], axis=1
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Fit:
    """Ridge regressions of several quantities on the same terms.

    Attributes:
        weights: One column a quantity.
        covariance: Of the weights, for unit residual variance of each quantity: (quantities, terms, terms) would be
            large, so the average ridge's is kept.
        residual: Residual variance of each quantity.
    """

    weights: Float[ndarray, "terms quantities"]
    covariance: Float[ndarray, "terms terms"]
    residual: Float[ndarray, "quantities"]

    def __call__(self, terms: Float[ndarray, "rows terms"]) -> Float[ndarray, "rows quantities"]:
        return terms @ self.weights

    def variance(self, terms: Float[ndarray, "rows terms"]) -> Float[ndarray, "rows quantities"]:
        """Of the predictions, from the finite number of points."""
        return np.einsum("ri,ij,rj->r", terms, self.covariance, terms)[:, None] * self.residual


def ridge(terms: Float[ndarray, "rows terms"], values: Float[ndarray, "rows quantities"], free: int) -> Fit:
    """Ridge regression, its strength by generalised cross-validation for each quantity.

    Args:
        terms: Regressors.
        values: What to predict.
        free: The first so many terms are not shrunk.
    """
    scale = np.sqrt((terms**2).mean(0)) + 1e-12
    penalty = np.ones(terms.shape[1])
    penalty[:free] = 1e-6
    x = terms / scale
    gram, moment = x.T @ x, x.T @ values
    best = np.full(values.shape[1], np.inf)
    weights, residual, chosen = np.zeros_like(moment), np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for strength in _RIDGES:
        inverse = np.linalg.inv(gram + strength * np.diag(penalty))
        freedom = np.trace(inverse @ gram)
        trial = inverse @ moment
        squares = ((values - x @ trial) ** 2).sum(0)
        score = squares / (len(x) - min(freedom, 0.9 * len(x))) ** 2
        better = score < best
        best[better], weights[:, better], chosen[better] = score[better], trial[:, better], strength
        residual[better] = squares[better] / (len(x) - min(freedom, 0.9 * len(x)))
    typical = float(np.exp(np.log(chosen).mean()))
    covariance = np.linalg.inv(gram + typical * np.diag(penalty)) / np.outer(scale, scale)
    return Fit(weights / scale[:, None], covariance, residual)


@dataclass(frozen=True, eq=False)
class Response:
    """How much one effect moves a fabric's features.

    Attributes:
        effect: Which.
        mean: Of every statistic, in sd, in the frame of the effect's direction, face up.
        spread: Of `Features.spread`.
        order: Whether it acts on later captures, so that half of it is seen in the mean.
    """

    effect: str
    mean: Fit
    spread: Fit
    later: bool


@dataclass(frozen=True, eq=False)
class Emulator:
    """The atlas, fitted.

    Attributes:
        base: Of every statistic (see the module) [its unit].
        base_spread: Of `Features.spread`.
        log_sd: ln of the standard deviation between samples of every statistic.
        correlation: Of all statistics of both faces, between samples.
        discrepancy: Covariance of what the base model gets wrong, in sd, the same on both faces, at the limp and at the
            stiff end of the atlas.
        responses: By effect.
    """

    base: Fit
    base_spread: Fit
    log_sd: Fit
    correlation: Float[ndarray, "faces_statistics faces_statistics"]
    discrepancy: Float[ndarray, "2 statistics statistics"]
    responses: Mapping[str, Response]

    def mean(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics"]:
        """Of every statistic, the same on both faces."""
        return self.base(base_terms(theta[None]))[0]

    def spread(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "spreads"]:
        """`Features.spread` of the base model."""
        return self.base_spread(spread_terms(theta[None]))[0]

    def sd(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics"]:
        """Between samples, of every statistic; never below what images resolve."""
        return np.maximum(np.exp(self.log_sd(spread_terms(theta[None]))[0]), RESOLUTION)

    def wrong(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics statistics"]:
        """The discrepancy at theta."""
        limp, stiff = _ends(theta[0])
        return limp * self.discrepancy[0] + stiff * self.discrepancy[1]


def scaled_place(effect: Effect, value: Mapping[str, ndarray]) -> Float[ndarray, "rows place"]:
    """Radius and size in the units of the regression: -1 to 1 over the atlas."""
    columns = []
    for p in effect.parameters:
        if p.role == "radius":
            columns.append((np.asarray(value[p.name]) - 0.122) / 0.025)
        elif p.role == "size":
            middle, half = (0.022, 0.01) if effect.located == "patch" else (1.25 * p.default, 0.75 * p.default)
            columns.append((np.asarray(value[p.name]) - middle) / half)
    rows = len(np.atleast_1d(next(iter(value.values()))))
    return np.stack(columns, axis=1) if columns else np.zeros((rows, 0))


@lru_cache(maxsize=64)
def acts_later(effect: Effect) -> bool:
    """Whether it is seen in later captures only."""
    first = Setup(disc_mesh(60), DrapeSettings(), uniform_material(density=DENSITY, bending=1e-5))
    return effect.apply(first, {}) is first


def in_lab(effect: Effect) -> bool:
    """Whether its direction is the laboratory's rather than the cloth's."""
    return effect.located == "direction" and effect.kind in ("boundary", "imaging")


def _in_own_frame(effect: Effect, point: Point) -> ndarray:
    """Statistics of a point turned so that the effect's direction is +x, face by face."""
    names = [p.name for p in effect.parameters]
    roles = {p.role: p.name for p in effect.parameters}
    if "direction" not in roles:
        return point.statistics
    up = np.deg2rad(point.value[names.index(roles["direction"])])
    down = np.pi - up if in_lab(effect) else up
    return rotated(point.statistics, np.array([[-up, -down]]))


def _difference(effect: Effect, base: Point, changed: Point) -> tuple[ndarray, Features, Features] | None:
    """By face: mean difference under common random numbers, and the features of both."""
    own, plain = _in_own_frame(effect, changed), _in_own_frame(effect, Point(changed.value, base.statistics))
    good = np.isfinite(own).all((1, 2)) & np.isfinite(plain).all((1, 2))
    if good.sum() < 2:
        return None
    return (own - plain)[good].mean(0), features(own[good]), features(plain[good])


def _allowed(effect: Effect) -> list[int]:
    """Statistics that symmetry lets it move, in its own frame."""
    return FREE + (_REAL if effect.located in ("direction", "patch") else _EVEN)


def _response(
    effect: Effect, theta: ndarray, base: Mapping[int, Point], own: Mapping[int, Point], sd: ndarray
) -> Response:
    rows: list[tuple[ndarray, ndarray, ndarray, ndarray]] = []
    names = [p.name for p in effect.parameters]
    for point, changed in own.items():
        found = _difference(effect, base[point], changed) if point in base else None
        if found is None:
            continue
        shift, with_effect, without = found
        rows.append((theta[point], changed.value, shift / sd[point], with_effect.spread - without.spread))
    places = scaled_place(effect, {name: np.array([row[1][i] for row in rows]) for i, name in enumerate(names)})
    at = np.array([row[0] for row in rows])
    severity = np.array([row[1][names.index(effect.severity.name)] for row in rows]) / effect.severity.typical
    shifts = np.stack([row[2] for row in rows])  # (rows, faces, statistics)
    turned = -severity if effect.face_odd else severity
    terms = np.concatenate([effect_terms(at, severity, places), effect_terms(at, turned, places)])
    values = np.concatenate([shifts[:, 0], shifts[:, 1]])
    forbidden = np.setdiff1d(np.arange(_COUNT), _allowed(effect))
    values[:, forbidden] = 0
    mean = ridge(terms, values, 1)
    spread = ridge(np.abs(severity)[:, None] * spread_terms(at), np.stack([row[3] for row in rows]), 1)
    return Response(effect.name, mean, spread, acts_later(effect))


def _log_variance(points: Mapping[int, Point], numbers: list[int]) -> Float[ndarray, "points statistics"]:
    """ln of the variance between samples, free of bias, both faces pooled; never below what images resolve."""
    rows = []
    for number in numbers:
        own = points[number].statistics
        good = own[np.isfinite(own).all((1, 2))]
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
        own = points[number].statistics
        values = own[np.isfinite(own).all((1, 2))] / scale
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
        if good.sum() < _LEAST_SAMPLES:
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
        if good.sum() < 2:
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
    kept[FREE + _EVEN] = True
    return np.where(np.outer(kept, kept), covariance, 0.0)


def fit(design: Design, points: Mapping[str, Mapping[int, Point]]) -> Emulator:
    """Fits the atlas.

    Args:
        design: What it was made of.
        points: What `atlas.read` returned.

    Raises:
        DiagnosisError: Too few points.
    """
    theta, base = design.theta(), points.get(BASE, {})
    numbers = [n for n, p in base.items() if np.isfinite(p.statistics).all((1, 2)).sum() >= 2]
    if len(numbers) < _LEAST_POINTS:
        raise DiagnosisError(f"an atlas needs at least {_LEAST_POINTS} fabrics, got {len(numbers)}; go on building it")
    at, found = theta[numbers], [features(base[n].statistics) for n in numbers]
    mean = np.stack([one.mean.mean(0) for one in found])
    log_sd_values = _log_variance(base, numbers) / 2
    other, twin = at * _EXCHANGED, rotated(mean, np.pi / 2)  # the same fabrics with warp and weft exchanged
    mean, twin = _only_even(mean), _only_even(twin)
    both = np.concatenate([at, other])
    level = ridge(base_terms(both), np.concatenate([mean, twin]), 1 + at.shape[1])
    log_sd = ridge(spread_terms(both), np.tile(log_sd_values, (2, 1)), 2)
    spread = ridge(spread_terms(at), np.stack([one.spread for one in found]), 2)
    sd = np.maximum(np.exp(log_sd(spread_terms(theta))), RESOLUTION)
    correlation = _correlation(base, {n: sd[n] for n in numbers})
    responses = {
        name: _response(effect, theta, base, points[name], sd)
        for name, effect in registered().items()
        if len(points.get(name, {})) >= _LEAST_POINTS
    }
    discrepancy = _discrepancy(points, theta, sd)
    return Emulator(level, spread, log_sd, correlation, discrepancy, responses)


def _only_even(mean: ndarray) -> ndarray:
    """Without the statistics that are 0 by symmetry."""
    kept = np.zeros_like(mean)
    kept[:, FREE + _EVEN] = mean[:, FREE + _EVEN]
    return kept
