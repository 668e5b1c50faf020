"""The photograph in polar coordinates about the plate's axis: lens, tilt and scale are taken out, light is linear."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.reading import Photograph, linear_light

ANGLES = 720
STEP = 2.5e-4  # [m] between radii
REACH = 1.24  # flat radii that are looked at
RING = (1.07, REACH)  # flat radii between which nothing but ground and clutter can lie
_FINEST = 3.0  # pixels of the photograph per millimetre that are used


@dataclass(frozen=True, eq=False)
class PolarPicture:
    """A photograph on a grid of angles and radii.

    Attributes:
        light: Linear light, blue first.
        seen: Where the grid lies in the photograph.
        radii: Radius of each column [m].
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].
    """

    light: Float[ndarray, "angles radii 3"]
    seen: Bool[ndarray, "angles radii"]
    radii: Float[ndarray, " radii"]
    plate: float
    cloth: float

    def column(self, radius: float) -> int:
        """Finds the column at a radius.

        Args:
            radius: Radius [m].

        Returns:
            Its index.
        """
        return int(np.clip(round((radius - self.radii[0]) / STEP), 0, len(self.radii) - 1))

    @property
    def ring(self) -> slice:
        """Columns where nothing but ground and clutter can lie."""
        return slice(self.column(RING[0] * self.cloth), len(self.radii))

    @property
    def top(self) -> slice:
        """Columns where nothing but cloth can lie."""
        return slice(0, self.column(0.93 * self.plate))


def angles() -> Float[ndarray, " angles"]:
    """Angles of a polar picture's rows, counter-clockwise from the right [rad]."""
    return np.arange(ANGLES) * 2 * np.pi / ANGLES


def polar_picture(photograph: Photograph, view: PlateView, plate: float, cloth: float) -> PolarPicture:
    """Looks up a photograph on the polar grid.

    Args:
        photograph: The picture.
        view: The calibrated camera.
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].

    Returns:
        The polar picture.
    """
    radii = np.arange(0.4 * plate, REACH * cloth, STEP)
    way = np.stack([np.cos(angles()), np.sin(angles())], axis=-1)
    places = way[:, None] * radii[None, :, None]
    points = np.concatenate([places.reshape(-1, 2), np.zeros((places.size // 2, 1))], axis=1)
    pixels = view.project(points).reshape(*places.shape[:2], 2)
    factor = min(1.0, 1e3 * _FINEST / view.scale)
    levels = photograph.levels
    if factor < 1:
        levels = cv2.resize(levels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        pixels = (pixels + 0.5) * factor - 0.5
    width, height = levels.shape[1], levels.shape[0]
    seen = (pixels[..., 0] > 0) & (pixels[..., 0] < width - 1) & (pixels[..., 1] > 0) & (pixels[..., 1] < height - 1)
    levels_there = cv2.remap(
        levels.astype(np.float32), pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32),
        cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    return PolarPicture(linear_light(levels_there), seen, radii, plate, cloth)
