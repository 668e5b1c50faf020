"""Measurements on a silhouette according to its protocol, and the camera of a protocol.

To a pinhole camera whatever hangs below the plate appears smaller. Its pictures do not show how deep the rim hangs, so
radii are computed as those of straight generators of the overhang's length L from the plate's edge (radius r, at the
distance H from the eye) to the rim, as in the ruled surfaces of the release:

    a = rho H / (H + d),    d^2 + (rho - r)^2 = L^2,

with a the apparent radius, at the scale of the plate's plane, and rho the radius from the axis.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.profile import Profile, drape_coefficient, fold_count, profile_from_image
from cusick_bench.sim.cloth.folds import FOLD_PROMINENCE

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.render.camera import Camera

    Image: TypeAlias = Float[ndarray, "size size"] | Float[Tensor, "size size"]


def camera_of(protocol: Protocol) -> Camera:
    """The camera of an experiment.

    Args:
        protocol: Gives projection, scale, centre and orientation.

    Returns:
        A camera that places points of the plate's plane where the protocol says.
    """
    from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera

    image_y: Any = protocol.image_y
    if protocol.projection == "parallel":
        return ParallelCamera(protocol.px_per_m, protocol.centre_px, image_y)
    size, height = protocol.image_size_px, protocol.camera_height_m
    field = 2 * math.atan(size / (2 * protocol.px_per_m * height))
    return PinholeCamera(field, height, size, protocol.centre_px, image_y)


def profile_of(image: Image, protocol: Protocol, centre: tuple[float, float] | None = None) -> Profile:
    """Radius-angle profile of a silhouette.

    Args:
        image: Coverage, cloth = 1.
        protocol: Gives scale, centre, orientation and projection.
        centre: Column and row to start from [px], the protocol's by default.

    Returns:
        The profile; of a pinhole camera's image with its perspective taken out. 0 where a ray meets no cloth.
    """
    profile = _apparent_profile(image, protocol, centre)
    if protocol.projection == "parallel":
        return profile
    return Profile(np.where(profile.radii > 0, without_perspective(profile.radii, protocol), 0.0))


def drape_coefficient_of(image: Image, protocol: Protocol) -> float:
    """Drape coefficient of a silhouette: the share of the annulus between plate and flat cloth that it covers.

    Args:
        image: Coverage, cloth = 1.
        protocol: Gives scale, radii and projection.

    Returns:
        0 for a cloth that hangs vertically, 1 for one that stays flat. To a pinhole camera a rim that hangs below the
        plate's edge is hidden up to the radius that is seen at the edge, and counts as if it hung at that: a cloth
        that hangs vertically has .10 in the standard's sizes under an eye 0.7 m above the plate, .05 under one at
        1.5 m.
    """
    cloth, plate = protocol.cloth_radius_m, protocol.plate_radius_m
    seen = drape_coefficient(image, pixels_per_metre=protocol.px_per_m, cloth_radius=cloth, plate_radius=plate)
    if protocol.projection == "parallel":
        return seen
    radii = _apparent_profile(image, protocol).radii
    hidden = np.mean(without_perspective(radii, protocol) ** 2 - radii**2)  # what perspective takes off r^2 [m2]
    return seen + float(hidden) / (cloth**2 - plate**2)


def fold_count_of(profile: Profile, protocol: Protocol) -> int:
    """Number of folds of a profile; a peak stands out in proportion to the cloth's radius (2.8 mm of 150 mm).

    Args:
        profile: From `profile_of`.
        protocol: Gives the cloth's radius.

    Returns:
        Number of folds: the same for drapes of the same shape and another size.
    """
    return fold_count(profile, prominence=FOLD_PROMINENCE * protocol.cloth_scale)


def without_perspective(radii: Any, protocol: Protocol, height: float | None = None) -> Any:
    """Radii from the plate's axis of rim points that a pinhole camera sees.

    Args:
        radii: Apparent radii, at the scale of the plate's plane, as an array or a tensor [m].
        protocol: Gives radii of plate and cloth, and the camera's height.
        height: Height of the camera's eye over the plate [m], by default the protocol's.

    Returns:
        Radii [m], differentiable if a tensor is given; beyond the flat cloth as they are.
    """
    overhang, plate = protocol.overhang_m, protocol.plate_radius_m
    height = protocol.camera_height_m if height is None else height
    slope = height / radii.clip(min=1e-3 * plate)  # k = H / a
    offset = slope * plate - height  # (k u + offset)^2 + u^2 = L^2 with u = rho - r
    square = ((slope**2 + 1) * overhang**2 - offset**2).clip(min=1e-12 * overhang**2)
    reach = (square**0.5 - slope * offset) / (slope**2 + 1)
    flat = radii >= protocol.cloth_radius_m
    return flat * radii + ~flat * (plate + reach)


def with_perspective(radii: Float[ndarray, " angles"], protocol: Protocol) -> Float[ndarray, " angles"]:
    """Apparent radii of rim points, as a pinhole camera sees them: inverse of `without_perspective`.

    Args:
        radii: Radii from the plate's axis [m].
        protocol: Gives radii of plate and cloth, and the camera's height.

    Returns:
        Radii at the scale of the plate's plane [m].
    """
    return radii * protocol.camera_height_m / (protocol.camera_height_m + rim_depth(radii, protocol))


def rim_depth(radii: Float[ndarray, "*shape"], protocol: Protocol) -> Float[ndarray, "*shape"]:
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


def outline_pixels(image: Image, protocol: Protocol) -> tuple[Float[ndarray, " points"], Float[ndarray, " points"]]:
    """Closed outline of a silhouette in its picture.

    Args:
        image: Coverage, cloth = 1.
        protocol: Gives scale, centre and orientation.

    Returns:
        Columns and rows [px].
    """
    profile = _apparent_profile(image, protocol)
    radius = protocol.px_per_m * np.append(profile.radii, profile.radii[0])
    angle = np.append(profile.angles, 2 * np.pi)
    up = 1 if protocol.image_y == "up" else -1
    return protocol.centre_px[0] + radius * np.cos(angle), protocol.centre_px[1] - up * radius * np.sin(angle)


def _apparent_profile(image: Image, protocol: Protocol, centre: tuple[float, float] | None = None) -> Profile:
    return profile_from_image(
        image,
        pixels_per_metre=protocol.px_per_m,
        centre=centre or protocol.centre_px,
        image_y=protocol.image_y,
    )
