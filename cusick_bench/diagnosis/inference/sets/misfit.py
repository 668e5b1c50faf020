"""Noise of the whitened residual, and the misfit of the base model that no effect causes.

    w = sum_e d_e + delta + noise,   noise ~ N(0, I),   delta = delta_sym + delta_any

delta_sym is the error of a base model without any effect, in the rows where it may be wrong
(`feature_rows.MAY_BE_WRONG`): spreads, and means that both faces share and that are symmetric about warp and weft. It
is N(0, s^2 A), where A mixes the pattern of what meshes and laws change in the atlas with an isotropic part. delta_any
is N(0, t^2 I) in all other rows, the *forbidden* ones, which no base model without effect may get wrong: something that
is not on the list. Both sizes, s and t, are integrated over grids that begin with 0.

Rows are rotated so that the forbidden ones come first and A is diagonal: both integrals are then sums over rows.
Forbidden rows stay sorted into means that both faces share, contrasts of the faces, and drifts. A symmetric property of
the cloth moves none of them, whatever its law (`across`).

References:
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001 (the model's discrepancy).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.linalg import solve_triangular

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.feature_rows import (
    DRIFT,
    FACE_EVEN,
    FACE_ODD,
    MAY_BE_WRONG,
    SPREAD,
)
from cusick_bench.diagnosis.inference.residuals.residual import Residual

_ANY_DIRECTION = 0.5  # share of A that is isotropic
_SPREAD_MISFIT = 0.7  # standard deviation of ln sd beside one standard deviation of a mean's misfit
MISFIT_SIZES: Final = np.array([0.0, 0.7, 1.4, 2.8, 5.6, 11.0])
"""s, in standard deviations of the noise."""
MISFIT_PRIOR: Final = np.array([0.1, 0.25, 0.25, 0.2, 0.12, 0.08])
ANY_SIZES: Final = np.array([0.0, 0.7, 1.4, 2.8, 5.6])
"""t, likewise."""
ANY_PRIOR: Final = np.array([0.88, 0.06, 0.03, 0.02, 0.01])


@dataclass(frozen=True, eq=False)
class Misfit:
    """Rotation of the rows of the whitened residual, and the pattern of the misfit.

    Attributes:
        rotation: Orthonormal matrix that puts forbidden rows first.
        sorts: Number of rows of each sort; the last sort is that of rows which a base model without effect may get
            wrong.
        pattern: Eigenvalues of A in the rows of the last sort; their mean is 1.
    """

    rotation: Float[ndarray, "kept kept"]
    sorts: tuple[int, ...]
    pattern: Float[ndarray, "allowed"]

    @property
    def forbidden(self) -> int:
        """Number of rows that no base model without effect may get wrong."""
        return sum(self.sorts[:-1])

    def turned(self, white: Float[ndarray, "*rows kept"]) -> Float[ndarray, "*rows kept"]:
        """Whitened residuals or shifts in the turned rows.

        Args:
            white: In the rows of `Residual.white`.

        Returns:
            Forbidden rows first.
        """
        return white @ self.rotation.T

    def across(self, shift: Float[ndarray, "*shifts kept"]) -> Float[ndarray, "*shifts kept"]:
        """Mean square of shifts within the sort of each row.

        Another law for an effect moves the same sorts of rows, though not in the same proportions.

        Args:
            shift: Shifts of the turned rows.

        Returns:
            The mean square that belongs to each row.
        """
        means = [part.mean(-1) if part.shape[-1] else part.sum(-1) for part in self._parts(shift**2)]
        return np.repeat(np.stack(means, axis=-1), self.sorts, axis=-1)

    def _parts(self, values: Float[ndarray, "*shifts kept"]) -> list[Float[ndarray, "*shifts _"]]:
        return np.split(values, np.cumsum(self.sorts)[:-1], axis=-1)

    def variance(self, symmetric: float, anything: float) -> Float[ndarray, "kept"]:
        """Variance of noise and misfit in every row.

        Args:
            symmetric: s.
            anything: t.

        Returns:
            The variances.
        """
        return np.concatenate([np.full(self.forbidden, 1 + anything**2), 1 + symmetric**2 * self.pattern])


def misfit_of(emulator: Emulator, residual: Residual) -> Misfit:
    """The misfit that is allowed for at a fabric's base parameters.

    Args:
        emulator: The atlas.
        residual: What the base model leaves of the fabric.

    Returns:
        Rows and pattern.
    """
    allowed = np.logical_and(MAY_BE_WRONG, residual.kept)
    covariance = _pattern(emulator, residual, allowed)
    inside = allowed[residual.kept]
    unit = np.eye(len(inside))
    white = solve_triangular(residual.root, unit[:, inside], lower=True)
    # A linear functional c of the features that vanishes on all allowed rows is L^T c on the whitened residual.
    forbidden = np.linalg.qr(residual.root.T @ unit[:, ~inside])[0]
    basis = np.linalg.qr(white)[0]
    projected = basis.T @ white
    value, vector = np.linalg.eigh(projected @ covariance @ projected.T)
    value = np.maximum(value, 0) + 1e-9
    rotation = np.concatenate([forbidden.T, (basis @ vector).T])
    return Misfit(rotation, _sorts(residual, allowed), value / value.mean())


def _sorts(residual: Residual, allowed: Bool[ndarray, "rows"]) -> tuple[int, ...]:
    """Known forbidden rows of each sort, in their order, then those that are allowed."""
    forbidden = np.logical_and(residual.kept, ~allowed)
    return *(int(forbidden[rows].sum()) for rows in (FACE_EVEN, FACE_ODD, DRIFT)), int(allowed.sum())


def _pattern(
    emulator: Emulator, residual: Residual, allowed: Bool[ndarray, "rows"]
) -> Float[ndarray, "allowed allowed"]:
    """A among the allowed rows [sd]."""
    rows = len(allowed)
    covariance = np.zeros((rows, rows))
    ratio = emulator.sd(residual.theta) / residual.sd
    covariance[FACE_EVEN, FACE_EVEN] = emulator.wrong(residual.theta) * np.outer(ratio, ratio)
    covariance = covariance[np.ix_(allowed, allowed)]
    spread = np.zeros(rows, dtype=bool)
    spread[SPREAD] = True
    spread = spread[allowed]
    typical = max(float(np.trace(covariance)) / max(int((~spread).sum()), 1), 1e-12)
    diagonal = np.where(spread, _SPREAD_MISFIT**2, _ANY_DIRECTION)
    return (1 - _ANY_DIRECTION) * covariance / typical + np.diag(diagonal)
