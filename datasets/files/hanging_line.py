"""Which point of a hanging cloth a camera sees as its outline, where the line of sight is not vertical.

In a view from straight above and far away, a point of the outline is the end of a line of cloth that hangs from the
plate's edge. It ends at the distance d beyond the edge and at the depth h below it,

    h = min((L^2 - d^2)^(1/2), 25 d),

with L the overhang: the rim hangs as if the line were straight, and in deep valleys back underneath the plate. The line
bulges, since the cloth leaves the edge outwards and then hangs almost vertically. At the depth z it is

    u(z) = d (1 - exp(-z/s)) / (1 - exp(-h/s)),   s = 2.5 d,

beyond the edge. Lines of sight that go outwards by t for each length that they go down see the outermost point of it,

    max_z (u(z) - t z),

which is the rim's as long as the line leans by more than t there, and else one higher up: the rim is then hidden behind
the bulge. As a rule the outline of a valley therefore recedes far less than the rim does. Where lines of sight go
inwards (t <= 0) its end is seen.

To an eye at the height H over the plate's centre, which sees a point at the radius a in the scale of the plate's plane,
t = a / H: what hangs below the plate appears smaller.

The two numbers are measured on drapes of the shipped cloths, the limp one and that of medium stiffness, by cameras that
lean by 4 and 8 deg and by eyes .8 to 2.5 m above the plate (`test_datasets_hanging_line.py`,
`test_diagnosis_own_outlines.py`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol

NUMERICS_VERSION = 2  # raised when radii from a pinhole camera change: see runner/numerics.py
BULGE: Final = 2.5
"""s as a multiple of d."""
DEEPEST: Final = 25.0
"""Largest h as a multiple of d."""
_LEAST = 1e-6  # [m] distance beyond the edge, and slope, below which they count as this
_ROUNDS = 8  # for the slope, which depends on the radius that is seen; each leaves a tenth of the error
_STEEPEST = 1e-3  # least change of an apparent radius by the true one, below which nothing is read off it
_TABLE = 2001  # radii between which what a near eye sees is interpolated


class Sizes(NamedTuple):
    """What of a protocol this model depends on.

    Attributes:
        plate_radius_m: Radius of the plate [m].
        cloth_radius_m: Radius of the flat cloth [m].
    """

    plate_radius_m: float
    cloth_radius_m: float

    @property
    def overhang_m(self) -> float:
        """As a protocol's."""
        return self.cloth_radius_m - self.plate_radius_m


def rim_depth(radii: Float[ndarray, "*shape"], protocol: Protocol | Sizes) -> Float[ndarray, "*shape"]:
    """Depth of the rim below the plate, of a cloth that hangs in straight lines from the plate's edge.

    A lone strip hangs in a curve, less deep than its chord, and the cloth's weight stretches it: the two nearly cancel.
    The rims of the shipped cloths' meshes hang within 2 mm of it on average (see `test_datasets_profile.py`).

    Args:
        radii: Radii from the plate's axis [m]; inside the plate or beyond the flat cloth they count as at its limits.
        protocol: Gives radii of plate and cloth.

    Returns:
        Depths [m].
    """
    reach = np.clip(radii - protocol.plate_radius_m, 0, protocol.overhang_m)
    return np.sqrt(protocol.overhang_m**2 - reach**2)


def outline_depth(
    radii: Float[ndarray, "*shape"], slope: Float[ndarray, "*shape"], protocol: Protocol | Sizes
) -> Float[ndarray, "*shape"]:
    """Depth that a point of the outline seems to have: the outline recedes by the slope times this.

    Args:
        radii: Radii of the outline as seen from straight above [m].
        slope: How far lines of sight go outwards for each length that they go down.
        protocol: Gives radii of plate and cloth.

    Returns:
        h, or less where the end of the line is hidden behind the cloth above it [m].
    """
    beyond = np.clip(radii - protocol.plate_radius_m, _LEAST, protocol.overhang_m)
    deep = np.minimum(rim_depth(radii, protocol), DEEPEST * beyond)
    length, steep = BULGE * beyond, np.maximum(slope, _LEAST)
    end = np.maximum(-np.expm1(-deep / length), _LEAST)
    height = np.minimum(length * np.log(np.maximum(1 / (BULGE * steep * end), 1.0)), deep)
    outwards = np.where(height < deep, -np.expm1(-height / length) / end, 1.0)
    return np.where(slope > 0, height + beyond * (1 - outwards) / steep, deep)


def with_perspective(
    radii: Float[ndarray, "*shape"], protocol: Protocol, height: float | None = None
) -> Float[ndarray, "*shape"]:
    """Apparent radii of an outline, as a pinhole camera sees it: inverse of `without_perspective`.

    Args:
        radii: Radii from the plate's axis, as seen from far away [m].
        protocol: Gives radii of plate and cloth, and the camera's height.
        height: Height of the camera's eye over the plate [m], by default the protocol's.

    Returns:
        Radii at the scale of the plate's plane [m].
    """
    height = protocol.camera_height_m if height is None else height
    return _with_perspective(radii, Sizes(protocol.plate_radius_m, protocol.cloth_radius_m), height)


def without_perspective(radii: Any, protocol: Protocol, height: float | None = None) -> Any:
    """Radii from the plate's axis, as seen from far away, of an outline that a pinhole camera sees.

    Args:
        radii: Apparent radii, at the scale of the plate's plane, as an array or a tensor [m].
        protocol: Gives radii of plate and cloth, and the camera's height.
        height: Height of the camera's eye over the plate [m], by default the protocol's.

    Returns:
        Radii [m], differentiable if a tensor is given; inside the plate and beyond the flat cloth as they are.
    """
    height = protocol.camera_height_m if height is None else height
    return seen_from_afar(radii, Sizes(protocol.plate_radius_m, protocol.cloth_radius_m), height)


def seen_from_afar(radii: Any, sizes: Sizes, height: float) -> Any:
    """As `without_perspective`, of a plate and a cloth of any size.

    Args:
        radii: Apparent radii, at the scale of the plate's plane, as an array or a tensor [m].
        sizes: Radii of plate and cloth.
        height: Height of the camera's eye over the plate [m].

    Returns:
        Radii [m], differentiable if a tensor is given; inside the plate and beyond the flat cloth as they are.
    """
    seen, true = _table(sizes, height)
    if isinstance(radii, ndarray):
        hangs = (radii > seen[0]) & (radii < seen[-1])
        return np.where(hangs, np.interp(radii, seen, true), radii)
    import torch

    at, to = (torch.as_tensor(one, dtype=radii.dtype, device=radii.device) for one in (seen, true))
    hangs = (radii > at[0]) & (radii < at[-1])
    before = (torch.searchsorted(at, radii.detach().contiguous()) - 1).clamp(0, len(at) - 2)
    slope = (to[before + 1] - to[before]) / (at[before + 1] - at[before])
    return torch.where(hangs, to[before] + slope * (radii - at[before]), radii)


def _with_perspective(radii: Float[ndarray, "*shape"], sizes: Sizes, height: float) -> Float[ndarray, "*shape"]:
    seen = radii
    for _ in range(_ROUNDS):
        seen = radii * height / (height + outline_depth(radii, seen / height, sizes))
    return np.where(radii > sizes.plate_radius_m, seen, radii)


@lru_cache(maxsize=64)
def _table(sizes: Sizes, height: float) -> tuple[Float[ndarray, " radii"], Float[ndarray, " radii"]]:
    """Apparent radii of hanging outlines, which increase, and their true ones [m]."""
    true = np.linspace(sizes.plate_radius_m, sizes.cloth_radius_m, _TABLE)
    seen = _with_perspective(true, sizes, height)
    rises = np.concatenate([[True], np.diff(np.maximum.accumulate(seen)) > _STEEPEST * (true[1] - true[0])])
    return seen[rises], true[rises]
