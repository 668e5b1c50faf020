"""How much one effect moves a fabric's features, as a smooth function of the base parameters and of its own.

With z = theta scaled to [-1, 1] and s the severity in typical ones, statistic k moves by

    D_k(z, s) = sd_k(z) g(z, s) times a polynomial in s, without constant, times one in z

with the statistic's scatter between samples sd_k and the effect's gain g, the exponential of a polynomial in z and
ln(1 + |s| / 2): how far the effect moves all statistics together. The response of stiff cloth can be twenty times that
of limp cloth; fitted without the gain, the polynomials follow the stiff end and are wrong at the limp end by more than
the whole response.

What symmetry forbids is not fitted: an effect with a direction is fitted in the frame of that direction, in which it is
symmetric; an effect that the cloth carries on one face acts with the opposite sign when the cloth is turned over.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.drapes import LEAST
from cusick_bench.diagnosis.atlas.points import Point
from cusick_bench.diagnosis.atlas.regression_terms import effect_terms, gain_terms, spread_terms
from cusick_bench.diagnosis.atlas.ridge import Fit, ridge
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.statistics import EVEN, FREE, NAMES, REAL, rotated
from cusick_bench.sim.effects import Effect
from cusick_bench.sim.effects.effect_timing import acts_later, in_lab

LEAST_SAMPLES = 2
"""Samples that a simulated fabric needs for its response to count."""
_OWN_ERROR = 1 / 3
"""Square of the polynomials' own relative error of a shift: added to the scatter of a point's samples in its weight."""
_MISMATCHED = 0.3  # typical difference of an effect's shift between two laws, as a share of the shift
_LEAST_MISMATCH = 0.1
_TYPICAL = 4.0  # number of fabrics that the typical mismatch counts for
_RATIOS = (0.3, 3.0)  # least and largest ratio of a shift under the base model to that under the cheaper model
_SHRUNK = (4.0, 12.0)  # precision of the prior that the gain needs no correction: its level, its slope
_VISIBLE = 0.3  # least square of a shift, as a share of its noise's, so that the logarithm of the gain is finite
_NOTHING = 1e-30  # square of a shift that is none


@dataclass(frozen=True, eq=False)
class Response:
    """Response of a fabric's features to one effect.

    Attributes:
        effect: Name of the effect.
        gain: Fit of ln g.
        mean: Fit of every statistic's shift over sd and gain, in the frame of the effect's direction, face up.
        spread: Fit of the shift of `Features.spread`.
        later: Whether it acts on later captures, so that half of it is seen in the mean.
        mismatch: How far the shift differs between two laws of the cloth, as a share of it: along the shift, and across
            it in all directions together; None where it was not compared.
    """

    effect: str
    gain: Fit
    mean: Fit
    spread: Fit
    later: bool
    mismatch: tuple[float, float] | None = None

    def shift(
        self, theta: Float[ndarray, "rows parameters"], severity: Float[ndarray, "rows"], place: ndarray
    ) -> tuple[Float[ndarray, "rows statistics"], Float[ndarray, "rows statistics"]]:
        """Shift of every statistic [sd], and its variance from the atlas' finite number of points.

        Args:
            theta: Base parameters.
            severity: Severity as a multiple of the typical one; negative where the effect acts the other way round.
            place: From `scaled_place`.

        Returns:
            Shifts and their variances.
        """
        terms, gain = effect_terms(theta, severity, place), _gain(self.gain, theta, severity, place)
        return gain * self.mean(terms), gain**2 * self.mean.variance(terms)

    def spreads(
        self, theta: Float[ndarray, "rows parameters"], severity: Float[ndarray, "rows"]
    ) -> Float[ndarray, "rows spreads"]:
        """Shift of `Features.spread`.

        Args:
            theta: Base parameters.
            severity: Severity as a multiple of the typical one.

        Returns:
            The shifts.
        """
        return self.spread(_scatter_terms(theta, severity))


def scaled_place(effect: Effect, value: Mapping[str, ndarray]) -> Float[ndarray, "rows place"]:
    """Radius and size in the units of the regression: -1 to 1 over the atlas.

    Args:
        effect: The effect.
        value: Its parameters by name, all of one length.

    Returns:
        A column for each of radius and size that the effect has.
    """
    columns = []
    for p in effect.parameters:
        if p.role == "radius":
            columns.append((np.asarray(value[p.name]) - 0.122) / 0.025)
        elif p.role == "size":
            middle, half = (0.022, 0.01) if effect.located == "patch" else (1.25 * p.default, 0.75 * p.default)
            columns.append((np.asarray(value[p.name]) - middle) / half)
    rows = len(np.atleast_1d(next(iter(value.values()))))
    return np.stack(columns, axis=1) if columns else np.zeros((rows, 0))


@dataclass(frozen=True, eq=False)
class Changes:
    """Changes of the atlas' fabrics by one effect, in the frame of its direction.

    Attributes:
        theta: Base parameters.
        severity: Severity by face (up, down), as a multiple of the typical one.
        place: From `scaled_place`.
        shift: Shift of every statistic by face [sd]; 0 where symmetry forbids one.
        noise: Variance of these from the fabric's few samples, likewise.
        spread: Shift of `Features.spread`.
    """

    theta: Float[ndarray, "rows parameters"]
    severity: Float[ndarray, "rows 2"]
    place: Float[ndarray, "rows place"]
    shift: Float[ndarray, "rows 2 statistics"]
    noise: Float[ndarray, "rows 2 statistics"]
    spread: Float[ndarray, "rows spreads"]

    def of(self, rows: ndarray) -> "Changes":
        """Changes of some of the fabrics.

        Args:
            rows: Indices of the fabrics, or a mask.

        Returns:
            Their changes.
        """
        return Changes(*(column[rows] for column in vars(self).values()))


def changes(
    effect: Effect,
    theta: Float[ndarray, "points parameters"],
    base: Mapping[int, Point],
    with_effect: Mapping[int, Point],
    sd: Float[ndarray, "points statistics"],
) -> Changes:
    """Differences under common random numbers.

    Args:
        effect: The effect.
        theta: Base parameters of all fabrics of the atlas.
        base: Their drapes.
        with_effect: The same with the effect, as far as they are made.
        sd: Standard deviation of every statistic between samples of each fabric.

    Returns:
        The changes of all fabrics with enough good drapes.
    """
    names = [p.name for p in effect.parameters]
    differences = {
        n: difference
        for n, point in with_effect.items()
        if n in base and (difference := _difference(effect, base[n], point)) is not None
    }
    numbers = list(differences)
    value = np.stack([with_effect[n].value for n in numbers])
    severity = value[:, names.index(effect.severity.name)] / effect.severity.typical
    allowed = np.isin(np.arange(len(NAMES)), _allowed(effect))
    shift, noise, spread = (np.stack([differences[n][k] for n in numbers]) for k in range(3))
    unit = sd[numbers][:, None]
    return Changes(
        theta[numbers],
        np.column_stack([severity, -severity if effect.face_odd else severity]),
        scaled_place(effect, dict(zip(names, value.T, strict=True))),
        np.where(allowed, shift / unit, 0.0),
        np.where(allowed, noise / unit**2, 0.0),
        spread,
    )


def response(effect: Effect, measured: Changes) -> Response:
    """Fits one effect to what it does to the atlas' fabrics.

    Args:
        effect: The effect.
        measured: What it does to them.

    Returns:
        The response.
    """
    at, severity, place = measured.theta, measured.severity[:, 0], measured.place
    noise = measured.noise.sum((1, 2))
    gain = _fitted_gain(at, severity, place, (measured.shift**2).sum((1, 2)), noise)
    size = _gain(gain, at, severity, place)
    amount = np.maximum(np.abs(severity), LEAST)
    precision = 1 / (amount**2 * _OWN_ERROR + noise / size[:, 0] ** 2)
    terms = np.concatenate([effect_terms(at, of_face, place) for of_face in measured.severity.T])
    values = np.concatenate([measured.shift[:, 0] / size, measured.shift[:, 1] / size])
    mean = ridge(terms, values, 1, np.tile(precision, 2))
    spread = ridge(_scatter_terms(at, severity), measured.spread, 1)
    return Response(effect.name, gain, mean, spread, acts_later(effect))


def corrected(fitted: Response, cheap: Changes, fine: Changes) -> Response:
    """A response whose gain is that under the base model's own law and mesh, and how far shifts differ then.

    The gain is corrected by a function of the bending level, shrunk towards no correction. The scatter of the ratio of
    fine to cheap shifts about it, and how far fine shifts point in other directions than cheap ones, tell how much the
    effect's shift depends on the material law.

    Args:
        fitted: The response under the cheaper model.
        cheap: What the effect does under the cheaper model to the same fabrics as
        fine: what it does under the base model's own law and mesh.

    Returns:
        The response, corrected.
    """
    predicted = np.stack([fitted.shift(fine.theta, severity, fine.place)[0] for severity in fine.severity.T], axis=1)
    size = (predicted**2).sum((1, 2))
    along = (predicted * fine.shift).sum((1, 2)) / size
    doubt = _MISMATCHED**2 + (fine.noise * predicted**2).sum((1, 2)) / size**2
    terms = spread_terms(fine.theta)[:, :2]
    logs, precision = np.log(np.clip(along, *_RATIOS)), 1 / doubt
    prior = np.diag(_SHRUNK)
    slope = np.linalg.solve(terms.T @ (precision[:, None] * terms) + prior, terms.T @ (precision * logs))
    ratio = np.exp(terms @ slope)
    weights = fitted.gain.weights.copy()
    weights[:2, 0] += slope
    gain = Fit(weights, fitted.gain.covariance, fitted.gain.residual)
    freedom = len(along)
    first = max(float(((along / ratio - 1) ** 2 - doubt + _MISMATCHED**2).mean()), _LEAST_MISMATCH**2)
    factor = along[:, None, None]
    noise = (fine.noise + factor**2 * cheap.noise).sum((1, 2))
    left = ((fine.shift - factor * cheap.shift) ** 2).sum((1, 2)) - noise
    weight = 1 / (1 + noise / (ratio**2 * size))
    across = max(float(np.average(left / (ratio**2 * size), weights=weight)), _LEAST_MISMATCH**2)
    shrunk = [np.sqrt((freedom * one + _TYPICAL * _MISMATCHED**2) / (freedom + _TYPICAL)) for one in (first, across)]
    return replace(fitted, gain=gain, mismatch=(float(shrunk[0]), float(shrunk[1])))


def _scatter_terms(theta: Float[ndarray, "rows parameters"], severity: ndarray) -> Float[ndarray, "rows terms"]:
    """Terms of the shift of the spreads; they vanish with the severity and do not depend on its sign."""
    return np.abs(severity)[:, None] * spread_terms(theta)


def _gain(
    fit: Fit, theta: Float[ndarray, "rows parameters"], severity: ndarray, place: ndarray
) -> Float[ndarray, "rows 1"]:
    return np.exp(fit(gain_terms(theta, severity, place)))


def _fitted_gain(theta: ndarray, severity: ndarray, place: ndarray, square: ndarray, noise: ndarray) -> Fit:
    """Fit of ln of a shift's size over the severity; points that do not rise above their noise have less weight.

    Those whose drapes an effect leaves exactly as they are have none.
    """
    large = np.maximum(np.maximum(square - noise, _VISIBLE * noise), _NOTHING)
    size = 0.5 * np.log(large) - np.log(np.abs(severity))
    return ridge(
        gain_terms(theta, severity, place), size[:, None], 1, square / np.maximum(square + 3 * noise, _NOTHING)
    )


def _difference(effect: Effect, base: Point, changed: Point) -> tuple[ndarray, ndarray, ndarray] | None:
    """For each face the mean difference under common random numbers and its variance; and the difference of spreads."""
    acted, plain = _in_own_frame(effect, changed), _in_own_frame(effect, Point(changed.value, base.statistics))
    good = np.isfinite(acted).all((1, 2)) & np.isfinite(plain).all((1, 2))
    if good.sum() < LEAST_SAMPLES:
        return None
    change = (acted - plain)[good]
    with_effect, without = features(acted[good]), features(plain[good])
    return change.mean(0), change.var(0, ddof=1) / len(change), with_effect.spread - without.spread


def _in_own_frame(effect: Effect, point: Point) -> ndarray:
    """Statistics of a point turned so that the effect's direction is +x, face by face."""
    names = [p.name for p in effect.parameters]
    roles = {p.role: p.name for p in effect.parameters}
    if "direction" not in roles:
        return point.statistics
    up = np.deg2rad(point.value[names.index(roles["direction"])])
    down = np.pi - up if in_lab(effect) else up
    return rotated(point.statistics, np.array([[-up, -down]]))


def _allowed(effect: Effect) -> list[int]:
    """Columns of the statistics that an effect can move without breaking its symmetry, in the effect's own frame."""
    return [*FREE, *(REAL if effect.located in ("direction", "patch") else EVEN)]
