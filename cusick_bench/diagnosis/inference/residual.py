"""A fabric against the base model: what is left when the base parameters have done their best, in units of noise.

With features y, the emulated base y0(theta), its Jacobian J at the best theta, and the prior N(theta0, P) on theta,

    y - y0(theta) ~ N(0, C),    C = S / n + Q + E + J P J^T,

S the covariance between samples (of the model, widened to what the data show), Q the model's discrepancy, E the
emulator's own uncertainty. Integrating theta out in this way is the projection of everything orthogonal to the base
parameters: a shift that theta could have made costs nothing. With C = L L^T, w = L^-1 (y - y0) is white noise where
the base model holds, and an effect that moves the features by D moves w by L^-1 D.

References:
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001. Rasmussen, Williams. Gaussian
    processes for machine learning, 2006, Sec. 2.7 (integrating out a linear model).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.linalg import cholesky, solve_triangular

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.regression_terms import base_terms, spread_terms
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import NAMES, RESOLUTION

_COUNT = len(NAMES)
_MEANS = slice(0, 2 * _COUNT)
_SPREADS = slice(2 * _COUNT, 2 * _COUNT + len(SPREADS))
_TRUST = 12.0  # degrees of freedom that the model's own scatter counts for beside the data's
_SPREAD_DISCREPANCY = 0.12  # of ln sd: correlation lengths and shapes of natural variability that are not the model's
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
    """

    theta: Float[ndarray, "parameters"]
    theta_covariance: Float[ndarray, "parameters parameters"]
    kept: Bool[ndarray, "rows"]
    sd: Float[ndarray, "statistics"]
    white: Float[ndarray, "kept"]
    root: Float[ndarray, "kept kept"]
    drift: float

    def whiten(self, shift: Float[ndarray, "shifts rows"]) -> Float[ndarray, "shifts kept"]:
        """Turns shifts of the features into shifts of w.

        Args:
            shift: Shift of the features, in the order of `feature_vector` [sd].

        Returns:
            L^-1 times the known entries.
        """
        return solve_triangular(self.root, shift[:, self.kept].T, lower=True).T

    @property
    def misfit(self) -> float:
        """|w|^2; its mean is the number of rows where the base model holds."""
        return float(self.white @ self.white)


def feature_vector(features: Features, sd: Float[ndarray, "statistics"]) -> Float[ndarray, "rows"]:
    """Features in one vector: means by face and drifts in units of sd, spreads as they are.

    Args:
        features: Features of the data.
        sd: Standard deviation of every statistic between samples [its unit].

    Returns:
        Means of both faces, spreads, drifts.
    """
    return np.concatenate([(features.mean / sd).ravel(), features.spread, features.order / sd[list(ORDERS)]])


def base_vector(emulator: Emulator, theta: Float[ndarray, "parameters"], sd: ndarray) -> Float[ndarray, "rows"]:
    """Features of the base model in one vector.

    Args:
        emulator: The atlas.
        theta: Base parameters.
        sd: Standard deviation of every statistic between samples [its unit].

    Returns:
        In the order of `feature_vector`.
    """
    mean = emulator.mean(theta) / sd
    return np.concatenate([mean, mean, emulator.spread(theta), np.zeros(len(ORDERS))])


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
        scatter: Variances between samples in the data with their degrees of freedom in the last entry, or None.
        exact: Leave the errors of model and atlas out of the means' covariance.

    Returns:
        Their covariance, and the unit of the means.
    """
    sd = emulator.sd(theta)
    if scatter is not None and scatter[-1] > 0:
        freedom = scatter[-1]
        sd = np.sqrt((_TRUST * sd**2 + freedom * scatter[:-1]) / (_TRUST + freedom))
        sd = np.maximum(sd, RESOLUTION)
    size = 2 * _COUNT + len(SPREADS) + len(ORDERS)
    covariance = np.zeros((size, size))
    n = np.maximum(features.samples, 1).astype(np.float64)
    share = np.array([[1 / n[0], features.both / (n[0] * n[1])], [features.both / (n[0] * n[1]), 1 / n[1]]])
    covariance[_MEANS, _MEANS] = emulator.correlation * np.kron(share, np.ones((_COUNT, _COUNT)))
    ratio = emulator.sd(theta) / sd
    wrong = emulator.wrong(theta) * np.outer(ratio, ratio)
    wrong = wrong + np.diag(emulator.base.variance(base_terms(theta[None]))[0] / sd**2)
    covariance[_MEANS, _MEANS] += 0.0 if exact else np.kron(np.ones((2, 2)), wrong)
    spreads = features.spread_variance + emulator.base_spread.variance(spread_terms(theta[None]))[0]
    covariance[_SPREADS, _SPREADS] = np.diag(spreads + _SPREAD_DISCREPANCY**2)
    start = _SPREADS.stop
    order = features.order_variance / sd[list(ORDERS)] ** 2 + (0.5 * RESOLUTION / sd)[list(ORDERS)] ** 2
    covariance[start:, start:] = np.diag(order)
    return Noise(sd, covariance)


def scatter_of(specimens: Float[ndarray, "samples 2 statistics"]) -> Float[ndarray, "statistics_and_freedom"]:
    """Variance between samples within faces.

    Args:
        specimens: Statistics of every sample and face; NaN where there is none.

    Returns:
        The variance of every statistic, then its degrees of freedom.
    """
    known = np.isfinite(specimens[..., 0])
    count = known.sum(0)
    freedom = int(np.maximum(count - 1, 0).sum())
    if freedom < 1:
        return np.zeros(specimens.shape[2] + 1)
    mean = np.where(known[..., None], specimens, 0.0).sum(0) / np.maximum(count, 1)[:, None]
    squares = np.where(known[..., None], (specimens - mean) ** 2, 0.0).sum((0, 1))
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
        shift: Shift of the rows, in sd, that is taken off before (of an effect).
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
    return Residual(theta, posterior, kept, errors.sd, white, root, drift)


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
        value = value - shift
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
