"""Measurements on a silhouette according to its protocol, and the camera of a protocol.

To a pinhole camera whatever hangs below the plate appears smaller, and its pictures do not show how deep it hangs.
Radii are corrected by what is known of hanging cloth (`hanging_line`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.hanging_line import without_perspective
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
        0 for a cloth that hangs vertically, 1 for one that stays flat.
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
