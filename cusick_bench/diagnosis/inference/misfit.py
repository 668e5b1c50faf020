"""Noise of the whitened residual, and the misfit of the base model that is no effect's doing.

    w = sum_e d_e + delta + noise,   noise ~ N(0, I),   delta = delta_sym + delta_any

delta_sym is what a base model without any effect may get wrong: means that both faces share and that are symmetric
about warp and weft (`allowed_directions`), and spreads. It is N(0, s^2 A), A the pattern of what meshes and laws change
in the atlas with a share of any such direction. delta_any is N(0, t^2 I) in all other rows, which no base model without
effect may get wrong: something that is not on the list. Both sizes are integrated over a grid that begins with 0.

Rows are turned so that forbidden ones come first and A is diagonal: both integrals are sums over rows.

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
from cusick_bench.diagnosis.inference.residual import Residual
from cusick_bench.diagnosis.measure.features import SPREADS
from cusick_bench.diagnosis.measure.statistics import EVEN, FREE, NAMES

_COUNT = len(NAMES)
_ANY_DIRECTION = 0.5  # share of A that prefers no direction
_SPREAD_MISFIT = 0.7  # standard deviation of ln sd beside one standard deviation of a mean's misfit
MISFIT_SIZES: Final = np.array([0.0, 0.7, 1.4, 2.8, 5.6, 11.0])
"""s, in standard deviations of the noise."""
MISFIT_PRIOR: Final = np.array([0.3, 0.22, 0.2, 0.15, 0.09, 0.04])
ANY_SIZES: Final = np.array([0.0, 0.7, 1.4, 2.8, 5.6])
"""t, likewise."""
ANY_PRIOR: Final = np.array([0.88, 0.06, 0.03, 0.02, 0.01])


@dataclass(frozen=True, eq=False)
class Misfit:
    """Rows of the whitened residual, turned.

    Attributes:
        rotation: Orthonormal; forbidden rows first.
        forbidden: How many rows no base model without effect may get wrong.
        pattern: Eigenvalues of A in the other rows; their mean is 1.
    """

    rotation: Float[ndarray, "kept kept"]
    forbidden: int
    pattern: Float[ndarray, "allowed"]

    def turned(self, white: Float[ndarray, "*rows kept"]) -> Float[ndarray, "*rows kept"]:
        """Whitened residuals or shifts in the turned rows.

        Args:
            white: In the rows of `Residual.white`.

        Returns:
            Forbidden rows first.
        """
        return white @ self.rotation.T

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
    allowed, contrasts = allowed_directions(residual.kept)
    covariance = _pattern(emulator, residual, allowed)
    white = solve_triangular(residual.root, allowed, lower=True)
    # contrasts c of the rows have c^T allowed = 0: L^T c is how the whitened residual holds them
    forbidden = np.linalg.qr(residual.root.T @ contrasts)[0]
    inside = np.linalg.qr(white)[0]
    projected = inside.T @ white
    value, vector = np.linalg.eigh(projected @ covariance @ projected.T)
    value = np.maximum(value, 0) + 1e-9
    rotation = np.concatenate([forbidden.T, (inside @ vector).T])
    return Misfit(rotation, forbidden.shape[1], value / value.mean())


def allowed_directions(
    kept: Bool[ndarray, "rows"],
) -> tuple[Float[ndarray, "kept allowed"], Float[ndarray, "kept forbidden"]]:
    """What a base model without effect may get wrong, and what it may not, as directions of the known features.

    Args:
        kept: Which entries of `feature_vector` are known.

    Returns:
        Orthonormal columns: symmetric means of both faces together and spreads; all that is orthogonal to them.
    """
    rows = len(kept)
    shared = [(k, _COUNT + k) for k in (*FREE, *EVEN)]
    spreads = [(2 * _COUNT + k,) for k in range(len(SPREADS))]
    paired = [k for pair in shared for k in pair]
    others = [(k,) for k in range(rows) if k not in paired and (k,) not in spreads]
    allowed = [_direction(rows, one, kept) for one in (*shared, *spreads)]
    contrasts = [_direction(rows, one, kept, -1.0) for one in shared if kept[list(one)].all()]
    contrasts += [_direction(rows, one, kept) for one in others]
    return _columns(allowed, kept), _columns(contrasts, kept)


def _direction(rows: int, places: tuple[int, ...], kept: ndarray, last: float = 1.0) -> Float[ndarray, "rows"]:
    """A direction of all rows: known places alike, or the last one against the first."""
    column = np.zeros(rows)
    column[list(places)] = 1.0
    column[places[-1]] *= last
    return column * kept


def _columns(directions: list[ndarray], kept: ndarray) -> Float[ndarray, "kept columns"]:
    """Unit columns of the known rows."""
    known = np.stack(directions, axis=1)[kept]
    size = np.linalg.norm(known, axis=0)
    return known[:, size > 0] / size[size > 0]


def _pattern(emulator: Emulator, residual: Residual, allowed: ndarray) -> Float[ndarray, "allowed allowed"]:
    """A among the allowed directions [sd]."""
    rows = np.zeros((len(residual.kept), allowed.shape[1]))
    rows[residual.kept] = allowed
    mean = rows[:_COUNT] + rows[_COUNT : 2 * _COUNT]
    spread = np.abs(rows[2 * _COUNT : 2 * _COUNT + len(SPREADS)]).sum(0) > 0
    ratio = emulator.sd(residual.theta) / residual.sd
    wrong = mean.T @ (emulator.wrong(residual.theta) * np.outer(ratio, ratio)) @ mean
    typical = max(float(np.trace(wrong)) / max(int((~spread).sum()), 1), 1e-12)
    diagonal = np.where(spread, _SPREAD_MISFIT**2, _ANY_DIRECTION)
    return (1 - _ANY_DIRECTION) * wrong / typical + np.diag(diagonal)
