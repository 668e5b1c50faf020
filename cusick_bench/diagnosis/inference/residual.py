"""A fabric against the base model: what is left when the base parameters have done their best, in units of noise.

With features y, the emulated base y0(theta), its Jacobian J at the best theta, and the prior N(theta0, P) on theta,

    y - y0(theta) ~ N(0, C),    C = S / n + Q + E + J P J^T,

S the covariance between samples (of the model, widened to what the data show, that of even and of odd parts of a
sample's faces each for itself), Q the model's discrepancy, which both faces share, E the emulator's own uncertainty.
`feature_rows` says what the rows are. Integrating theta out in this way is the projection of everything orthogonal to
the base parameters: a shift that theta could have made costs nothing. With C = L L^T, w = L^-1 (y - y0) is white noise
where the base model holds, and an effect that moves the features by D moves w by L^-1 D.

References:
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001. Rasmussen, Williams. Gaussian
    processes for machine learning, 2006, Sec. 2.7 (integrating out a linear model).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.linalg import cholesky, solve_triangular

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.regression_terms import base_terms, spread_terms
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.feature_rows import DRIFT, FACE_EVEN, MEANS, ROWS, SPREAD, as_seen
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import NAMES, RESOLUTION

_COUNT = len(NAMES)
_TRUST = 12.0  # degrees of freedom that the model's own scatter counts for beside the data's
_SPREAD_DISCREPANCY = np.array([0.5 if name.startswith(("harmonic", "envelope")) else 0.2 for name, _ in SPREADS])
"""Of ln sd: how much samples differ in the low orders depends on how they were laid, which no two laboratories do alike
(fabrics without effect in other simulators and real ones differ by .2 to .8 from the base model)."""
_SWEEPS = 25


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance of a fabric's features, apart from the base parameters' uncertainty.

    Attributes:
        sd: Standard deviation of every statistic between samples [its unit].
        covariance: Covariance of all entries of `feature_vector`.
    """

    sd: Float[ndarray, "statistics"]
    covariance: Float[ndarray, "rows rows"]


@dataclass(frozen=True, eq=False)
class Residual:
    """What the best base model leaves.

    Attributes:
        theta: Best base parameters.
        theta_covariance: Their posterior covariance, by linearisation.
        kept: Which entries of `feature_vector` are known.
        sd: Standard deviation of every statistic between samples [its unit].
        white: w, the known entries' difference to the base model, whitened.
        root: L, the Cholesky factor of the known entries' covariance.
        drift: Share of each face's captures that are later ones.
        freedom: Degrees of freedom of the variances between samples that the noise is made of.
        single: Which face alone is known, as in `Features.single`; 0 for both.
    """

    theta: Float[ndarray, "parameters"]
    theta_covariance: Float[ndarray, "parameters parameters"]
    kept: Bool[ndarray, "rows"]
    sd: Float[ndarray, "statistics"]
    white: Float[ndarray, "kept"]
    root: Float[ndarray, "kept kept"]
    drift: float
    freedom: float = np.inf
    single: int = 0

    def whiten(self, shift: Float[ndarray, "shifts rows"]) -> Float[ndarray, "shifts kept"]:
        """Turns shifts of the features into shifts of w.

        Args:
            shift: Shift of the features, in the rows of `feature_rows` [sd].

        Returns:
            L^-1 times the known entries.
        """
        return solve_triangular(self.root, as_seen(shift, self.single)[:, self.kept].T, lower=True).T

    @property
    def squares(self) -> float:
        """|w|^2; its mean is the number of rows where the base model holds."""
        return float(self.white @ self.white)


def feature_vector(features: Features, sd: Float[ndarray, "statistics"]) -> Float[ndarray, "rows"]:
    """Features in one vector: contrasts of the faces and drifts in units of sd, spreads as they are.

    Args:
        features: Features of the data.
        sd: Standard deviation of every statistic between samples [its unit].

    Returns:
        In the rows of `feature_rows`.
    """
    return np.concatenate([(features.contrast / sd).ravel(), features.spread, features.order / sd[list(ORDERS)]])


def base_vector(emulator: Emulator, theta: Float[ndarray, "parameters"], sd: ndarray) -> Float[ndarray, "rows"]:
    """Features of the base model in one vector.

    Args:
        emulator: The atlas.
        theta: Base parameters.
        sd: Standard deviation of every statistic between samples [its unit].

    Returns:
        In the rows of `feature_rows`.
    """
    mean = emulator.mean(theta) / sd
    return np.concatenate([mean, np.zeros(_COUNT), emulator.spread(theta), np.zeros(len(ORDERS))])


def noise(
    emulator: Emulator,
    theta: Float[ndarray, "parameters"],
    features: Features,
    scatter: ndarray | None,
    *,
    exact: bool = False,
) -> Noise:
    """Covariance of the features at theta.

    Args:
        emulator: The atlas.
        theta: Base parameters.
        features: Features of the data, for their numbers of samples.
        scatter: Variances between samples in the data, from `scatter_of`, or None.
        exact: Leave the errors of model and atlas out of the means' covariance.

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
    emulator: Emulator, theta: Float[ndarray, "parameters"], scatter: ndarray | None
) -> tuple[Float[ndarray, "statistics"], tuple[ndarray, ndarray]]:
    """Standard deviation of every statistic, and covariances of even and of odd parts in units of it."""
    model = emulator.sd(theta)
    own, other = emulator.correlation[:_COUNT, :_COUNT], emulator.correlation[:_COUNT, _COUNT:]
    own = (own + emulator.correlation[_COUNT:, _COUNT:]) / 2
    other = (other + other.T) / 2
    parts = [(own + other) / 2, (own - other) / 2]  # faces are exchangeable: even and odd parts do not correlate
    wider = [np.ones(_COUNT), np.ones(_COUNT)]  # variances over the model's
    if scatter is not None:
        freedom = scatter[:, -1]
        data = scatter[:, :-1] / model**2
        if freedom[1] > 0:  # samples with both faces
            each = [(part, data[row], freedom[row]) for row, part in enumerate(parts, start=1)]
        else:
            each = [(own, data[0], freedom[0])] * 2
        wider = [(_TRUST + known * found / np.diag(part)) / (_TRUST + known) for part, found, known in each]
    variance = sum(np.diag(part) * factor for part, factor in zip(parts, wider, strict=True))
    sd = np.maximum(model * np.sqrt(variance), RESOLUTION)
    scale = 1 / np.sqrt(variance)  # what images do not resolve is as noisy as their resolution
    first, second = (
        part * np.outer(scale * np.sqrt(factor), scale * np.sqrt(factor))
        for part, factor in zip(parts, wider, strict=True)
    )
    return sd, (first, second)


def _drift_covariance(
    features: Features, sd: Float[ndarray, "statistics"], even: Float[ndarray, "statistics statistics"]
) -> Float[ndarray, "orders orders"]:
    """Covariance of the mean drifts in sd: the data's variances, their correlation shrunk to that of even parts."""
    chosen = list(ORDERS)
    variance = np.diag(features.order_covariance) / sd[chosen] ** 2
    model = even[np.ix_(chosen, chosen)]
    correlation = model / np.sqrt(np.outer(np.diag(model), np.diag(model)))
    if features.order_freedom > 0:
        size = np.sqrt(np.maximum(np.diag(features.order_covariance), np.finfo(np.float64).tiny))
        found = features.order_covariance / np.outer(size, size)
        correlation = (_TRUST * correlation + features.order_freedom * found) / (_TRUST + features.order_freedom)
    if not np.isfinite(variance).all():
        return np.diag(variance)
    return correlation * np.sqrt(np.outer(variance, variance)) + np.diag((0.5 * RESOLUTION / sd)[chosen] ** 2)


def scatter_of(specimens: Float[ndarray, "samples 2 statistics"]) -> Float[ndarray, "3 statistics_and_freedom"]:
    """Variances between samples: within faces, of the even and of the odd parts of samples with both faces.

    Args:
        specimens: Statistics of every sample and face; NaN where there is none.

    Returns:
        A row for each of the three: the variance of every statistic, then its degrees of freedom.
    """
    known = np.isfinite(specimens[..., 0])
    paired = specimens[known.all(1)]
    parts = [(paired[:, 1] + paired[:, 0]) / 2, (paired[:, 1] - paired[:, 0]) / 2]
    within = [specimens[known[:, face], face] for face in (0, 1)]
    return np.stack([_pooled(within), *(_pooled([part]) for part in parts)])


def _pooled(groups: Sequence[Float[ndarray, "_ statistics"]]) -> Float[ndarray, "statistics_and_freedom"]:
    """Variance within groups, and its degrees of freedom."""
    freedom = sum(max(len(group) - 1, 0) for group in groups)
    if freedom < 1:
        return np.zeros(groups[0].shape[1] + 1)
    squares = sum(((group - group.mean(0)) ** 2).sum(0) for group in groups if len(group))
    return np.append(squares / freedom, freedom)


def against_base(
    emulator: Emulator,
    features: Features,
    *,
    scatter: ndarray | None = None,
    drift: float = 0.5,
    start: ndarray | None = None,
    shift: ndarray | None = None,
    fixed: bool = False,
    exact: bool = False,
) -> Residual:
    """The best base model and what it leaves.

    Args:
        emulator: The atlas.
        features: Features of the data.
        scatter: Variances between samples in the data, from `scatter_of`.
        drift: Share of each face's captures that are later ones.
        start: Base parameters to start from, instead of a search over the bending level.
        shift: Shift of all rows of both faces, in sd, that is taken off before (of an effect).
        fixed: Linearise at `start` instead of searching on.
        exact: As if model and atlas were without error: what is nearest to the data, not what is likeliest.

    Returns:
        The best base parameters and the whitened residual.

    Raises:
        DiagnosisError: No face has any drape.
    """
    if not np.isfinite(features.mean).any():
        raise DiagnosisError("a diagnosis needs at least one drape, got none")
    theta = _start(emulator, features) if start is None else start.copy()
    precision = np.diag(PRIOR_SD**-2)
    errors = noise(emulator, theta, features, scatter, exact=exact)
    for sweep in range(0 if fixed else _SWEEPS):
        errors = noise(emulator, theta, features, scatter, exact=exact) if sweep < 8 else errors
        value, jacobian, kept = _linearised(emulator, theta, features, errors, shift)
        inverse = np.linalg.inv(errors.covariance[np.ix_(kept, kept)])
        hessian = jacobian.T @ inverse @ jacobian + precision
        gradient = jacobian.T @ inverse @ value - precision @ (theta - PRIOR_MEAN)
        step = np.linalg.solve(hessian, gradient)
        step *= min(1.0, 0.6 / max(float(np.abs(step / PRIOR_SD).max()), 1e-12))
        moved = np.clip(theta + step, LOW, HIGH)
        done = float(np.abs(moved - theta).max()) < 1e-3
        theta = moved
        if done:
            break
    value, jacobian, kept = _linearised(emulator, theta, features, errors, shift)
    covariance = errors.covariance[np.ix_(kept, kept)]
    inverse = np.linalg.inv(covariance)
    posterior = np.linalg.inv(jacobian.T @ inverse @ jacobian + precision)
    total = covariance + jacobian @ np.diag(PRIOR_SD**2) @ jacobian.T
    root = cholesky(total, lower=True)
    # y - y0(theta) = noise + J (true - theta), and true - theta = (true - theta0) + (theta0 - theta) about the prior
    centred = value - jacobian @ (PRIOR_MEAN - theta)
    white = solve_triangular(root, centred, lower=True)
    freedom = np.inf if scatter is None else _TRUST + scatter[1 if scatter[1, -1] > 0 else 0, -1]
    return Residual(theta, posterior, kept, errors.sd, white, root, drift, freedom, features.single)


def inflated(residual: Residual, factor: float) -> Residual:
    """The residual where noise is larger by a factor.

    Args:
        residual: The residual.
        factor: Factor on the noise's standard deviation.

    Returns:
        It, scaled.
    """
    return replace(residual, white=residual.white / factor, root=residual.root * factor)


def _start(emulator: Emulator, features: Features) -> ndarray:
    """Prior means, with the bending level that has the fabric's drape coefficient."""
    column = NAMES.index("area_dc")
    coverage = float(np.nanmean(features.mean[:, column]))
    levels = np.linspace(LOW[0], HIGH[0], 60)
    trial = np.tile(PRIOR_MEAN, (60, 1))
    trial[:, 0] = levels
    return trial[int(np.argmin(np.abs(emulator.base(base_terms(trial))[:, column] - coverage)))]


def _linearised(
    emulator: Emulator, theta: ndarray, features: Features, errors: Noise, shift: ndarray | None
) -> tuple[ndarray, ndarray, ndarray]:
    """Known rows of y - y0, of its Jacobian to theta, and which they are."""
    value = feature_vector(features, errors.sd) - base_vector(emulator, theta, errors.sd)
    if shift is not None:
        value = value - as_seen(shift, features.single)
    kept = np.isfinite(value) & np.isfinite(np.diag(errors.covariance))
    step = 1e-3
    columns = []
    for i in range(len(theta)):
        ahead, behind = theta.copy(), theta.copy()
        ahead[i] += step
        behind[i] -= step
        change = base_vector(emulator, ahead, errors.sd) - base_vector(emulator, behind, errors.sd)
        columns.append(change[kept] / (2 * step))
    return value[kept], np.stack(columns, axis=1), kept
