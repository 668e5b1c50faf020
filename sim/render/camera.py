"""Cameras: where a point of the cloth lands in the image, in pixels.

Pixel centres lie at integers and (column, row) = (0, 0) is the upper left pixel, so pixel p covers [p - 1/2, p + 1/2].
The world is right-handed, in metres: x right (warp), y up in the image, z towards the camera, plate at z = 0.
"""

import math
from dataclasses import dataclass
from typing import Literal, Protocol, get_args, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.constants import EYE_HEIGHT, FIELD_OF_VIEW, IMAGE_CENTRE, IMAGE_SIZE, PIXELS_PER_METRE
from cusick_bench.sim.errors import SimulationError

ImageY = Literal["up", "down"]


@runtime_checkable
class Camera(Protocol):
    """Whatever projects points of space into the image, differentiably."""

    def project(self, vertices: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 2"]:
        """Maps positions [m] to pixel coordinates (column, row).

        Args:
            vertices: Positions [m].

        Returns:
            Pixel coordinates [px], differentiable.
        """
        ...


def _check(name: str, value: float | int, limit: float, unit: str) -> None:
    if not 0 < value < limit:  # also false for NaN
        raise SimulationError(f"camera: {name} must lie between 0 and {limit:g} {unit}, got {value}")


def _check_frame(centre_px: tuple[float, float], image_y: str) -> None:
    if len(centre_px) != 2 or not all(math.isfinite(c) for c in centre_px):
        raise SimulationError(f"camera: centre_px must be two finite numbers (column, row), got {centre_px}")
    if image_y not in get_args(ImageY):
        raise SimulationError(f"camera: image_y must be 'up' or 'down', got {image_y!r}")


def _place(plane: Tensor, centre_px: tuple[float, float], image_y: ImageY) -> Tensor:
    """Moves the origin of image-plane coordinates (x right, y up) [px] to the centre and turns y into rows."""
    rows = -plane[..., 1] if image_y == "up" else plane[..., 1]
    return torch.stack([centre_px[0] + plane[..., 0], centre_px[1] + rows], dim=-1)


@dataclass(frozen=True)
class ParallelCamera:
    """Parallel projection along z: column = centre + px_per_m x, row = centre - px_per_m y.

    Attributes:
        px_per_m: Scale [px/m].
        centre_px: Pixel (column, row) of the plate's axis.
        image_y: Whether +y points up or down in the image.

    Raises:
        SimulationError: A value out of range.
    """

    px_per_m: float = PIXELS_PER_METRE
    centre_px: tuple[float, float] = IMAGE_CENTRE
    image_y: ImageY = "up"

    def __post_init__(self) -> None:
        _check("px_per_m", self.px_per_m, math.inf, "px/m")
        _check_frame(self.centre_px, self.image_y)

    def project(self, vertices: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 2"]:
        """Maps positions [m] to pixel coordinates (column, row)."""
        return _place(self.px_per_m * vertices[..., :2], self.centre_px, self.image_y)


@dataclass(frozen=True)
class PinholeCamera:
    """Perspective projection from an eye on the z axis that looks down at the plate.

    A point at height z is seen at f / (eye_height_m - z) pixels per metre, f = size_px / (2 tan(fov_rad / 2)).

    Attributes:
        fov_rad: Full angle of view across the image [rad].
        eye_height_m: Height of the eye above the plate [m].
        size_px: Width and height of the image that the angle of view spans [px].
        centre_px: Pixel (column, row) of the plate's axis.
        image_y: Whether +y points up or down in the image.

    Raises:
        SimulationError: A value out of range, or (in `project`) a point at or above the eye.
    """

    fov_rad: float = FIELD_OF_VIEW
    eye_height_m: float = EYE_HEIGHT
    size_px: float = IMAGE_SIZE
    centre_px: tuple[float, float] = IMAGE_CENTRE
    image_y: ImageY = "up"

    def __post_init__(self) -> None:
        _check("fov_rad", self.fov_rad, math.pi, "rad")
        _check("eye_height_m", self.eye_height_m, math.inf, "m")
        _check("size_px", self.size_px, math.inf, "px")
        _check_frame(self.centre_px, self.image_y)

    @property
    def focal_px(self) -> float:
        """Focal length f [px]."""
        return self.size_px / (2 * math.tan(self.fov_rad / 2))

    def project(self, vertices: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 2"]:
        """Maps positions [m] to pixel coordinates (column, row)."""
        depth = self.eye_height_m - vertices[..., 2:]
        if bool((depth <= 0).any()):
            highest = float(vertices[..., 2].max())
            raise SimulationError(
                f"every point must lie below the camera at {self.eye_height_m} m, but one is at {highest:.4g} m;"
                " raise eye_height_m or check the unit of the vertices (metres)"
            )
        return _place(self.focal_px * vertices[..., :2] / depth, self.centre_px, self.image_y)
