"""How deep the rim of a drape hangs, from how far it reaches: what a silhouette tells of the third dimension.

A strip of the cloth from the plate's edge to the rim has a length l = cloth radius - plate radius. Were it alone, it
would hang as a heavy elastica, clamped level at the plate's edge and free at the rim; with the angle a below the
horizontal and the distance t from the rim, in units of (bending stiffness / weight)^(1/3),

    a''(t) = -t cos a,   a'(0) = 0,   a = 0 at the plate's edge t = T

All such curves are one family: the reach, integral of cos a over T, fixes the depth, integral of sin a over T, whatever
the stiffness. Folds lean strips over and couple them, and yet the rims of the shipped cloths' meshes follow this curve
with correlations above .97 and to 4 mm (`tests/diagnosis/test_diagnosis_own_outlines.py`).

References:
    Bickley. The heavy elastica. Philosophical Magazine 17, 1934. Peirce. The "handle" of cloth as a measurable
    quantity. Journal of the Textile Institute 21, 1930.
"""

from functools import cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.integrate import solve_ivp

from cusick_bench.datasets.files.protocol import Protocol

_RIM_ANGLES = np.deg2rad([*np.linspace(2, 80, 30), *np.linspace(82, 89.9, 20)])  # a at the rim: stiff to limp
_LONGEST = 60.0  # T of the limpest strip is below it


def rim_depth(radius: Float[ndarray, "*shape"], protocol: Protocol) -> Float[ndarray, "*shape"]:
    """Depth of the rim below the plate where the outline has some radius.

    Args:
        radius: Radii of outlines [m]; those inside the plate or beyond the flat cloth count as at its limits.
        protocol: Gives the radii of plate and cloth.

    Returns:
        Depths [m], 0 to cloth radius - plate radius.
    """
    length = protocol.cloth_radius_m - protocol.plate_radius_m
    reach, depth = _elastica()
    return length * np.interp((radius - protocol.plate_radius_m) / length, reach, depth)


@cache
def _elastica() -> tuple[Float[ndarray, "curves"], Float[ndarray, "curves"]]:
    """Reaches, rising, and depths of heavy elasticas of length 1."""
    curves = [(0.0, 1.0), *(_hanging(angle) for angle in _RIM_ANGLES[::-1]), (1.0, 0.0)]
    reach, depth = np.array(curves).T
    return reach, depth


def _hanging(rim: float) -> tuple[float, float]:
    """Reach and depth, over its length, of the strip that hangs at some angle at its rim."""

    def level(_: float, state: ndarray) -> float:
        return float(state[0])

    def slope(t: float, state: ndarray) -> list[float]:
        angle, bend = float(state[0]), float(state[1])
        return [bend, -t * np.cos(angle), np.cos(angle), np.sin(angle)]

    level.terminal = True  # type: ignore[attr-defined]
    solved = solve_ivp(slope, (0, _LONGEST), [rim, 0.0, 0.0, 0.0], events=level, rtol=1e-8)
    length = float(solved.t[-1])
    return float(solved.y[2, -1]) / length, float(solved.y[3, -1]) / length
