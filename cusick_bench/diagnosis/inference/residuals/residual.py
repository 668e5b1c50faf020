"""Residual of a fabric's features after the best fit of the base parameters, in units of noise.

With features y, the emulated base y0(theta), its Jacobian J at the best theta, and the prior N(theta0, P) on theta,

    y - y0(theta) ~ N(0, C),    C = S / n + Q + E + J P J^T,

with S the covariance between samples, Q the model's discrepancy, which both faces share, and E the emulator's own
uncertainty (all three from `noise`). `feature_rows` defines the rows. Integrating theta out in this way projects off
what the base parameters can explain: a shift that a change of theta would cause hardly contributes. With C = L L^T,
w = L^-1 (y - y0) is white noise where the base model holds, and an effect that moves the features by D moves w by
L^-1 D.

References:
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001. Rasmussen, Williams. Gaussian
    processes for machine learning, 2006, Sec. 2.7 (integrating out a linear model).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.linalg import cholesky, solve_triangular

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.regression_terms import base_terms
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.residuals.feature_rows import FACE_EVEN, as_seen
from cusick_bench.diagnosis.inference.residuals.noise import MODEL_FREEDOM, TOGETHER, Noise, Scatter, noise
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import NAMES

_SWEEPS = 25
_DIFFERENCE = 1e-3  # of each base parameter, for the Jacobian


@dataclass(frozen=True, eq=False)
class Residual:
    """Residual of the best base model.

    Attributes:
        theta: Best base parameters.
        theta_covariance: Their posterior covariance, by linearisation.
        kept: Which entries of `feature_vector` are known.
        sd: Standard deviation of every statistic between samples [its unit].
        white: w, the known entries' difference to the base model, whitened.
        root: L, the Cholesky factor of the known entries' covariance.
        drift: Share of each face's captures that are later ones.
        freedom: Degrees of freedom of Student's t of all rows together: how well the common size of the noise is known.
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

    @cached_property
    def variance_of_unit(self) -> float:
        """Mean variance of w's rows where every mean that both faces share is off at random by one sd."""
        unit = np.eye(len(self.root))[:, np.flatnonzero(self.kept) < FACE_EVEN.stop]
        return float((solve_triangular(self.root, unit, lower=True) ** 2).sum() / len(self.root))

    @property
    def log_likelihood(self) -> float:
        """ln of the density of the known features in the base model, but for a constant; of any base parameters, whose
        units differ [nat]."""
        return -0.5 * self.squares - self.log_unit

    @property
    def log_unit(self) -> float:
        """ln of the product of the units of the known entries; with it, densities at other base parameters compare."""
        unit = np.concatenate([self.sd, self.sd, np.ones(len(SPREADS)), self.sd[list(ORDERS)]])
        return float(np.log(unit[self.kept]).sum() + np.log(np.diag(self.root)).sum())

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


def base_vector(
    emulator: Emulator, theta: Float[ndarray, "*cloths parameters"], sd: Float[ndarray, "statistics"]
) -> Float[ndarray, "*cloths rows"]:
    """Features of the base model in one vector.

    Args:
        emulator: The atlas.
        theta: Base parameters of one cloth or of several.
        sd: Standard deviation of every statistic between samples [its unit].

    Returns:
        In the rows of `feature_rows`, for each cloth.
    """
    mean = emulator.mean(theta) / sd
    still = np.zeros((*theta.shape[:-1], len(ORDERS)))
    return np.concatenate([mean, np.zeros_like(mean), emulator.spread(theta), still], axis=-1)


def against_base(
    emulator: Emulator,
    features: Features,
    *,
    scatter: Scatter | None = None,
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
        scatter: How the data's samples scatter, from `scatter_of`.
        drift: Share of each face's captures that are later ones.
        start: Base parameters to start from, instead of a search over the bending level.
        shift: Shift of all rows of both faces by effects, which is subtracted first [sd].
        fixed: Whether to linearise at `start` instead of searching for the best parameters.
        exact: Whether to take model and atlas as exact: the result is then nearest to the data instead of likeliest.

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
    # y - y0(theta) = noise + J (true - theta) with true - theta = (true - theta0) + (theta0 - theta), where theta0 is
    # the prior mean: what remains after the last term has the covariance C.
    centred = value - jacobian @ (PRIOR_MEAN - theta)
    white = solve_triangular(root, centred, lower=True)
    freedom = np.inf if scatter is None else TOGETHER * (MODEL_FREEDOM + scatter.freedom)
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
    """Prior means, with the bending level at which the atlas has the fabric's drape coefficient."""
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
    step = _DIFFERENCE * np.eye(len(theta))
    ahead, behind = base_vector(emulator, np.stack([theta + step, theta - step]), errors.sd)
    return value[kept], (ahead - behind)[:, kept].T / (2 * _DIFFERENCE), kept
