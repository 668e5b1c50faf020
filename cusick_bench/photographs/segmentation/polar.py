"""The photograph in polar coordinates about the plate's axis: lens, tilt and scale are taken out, light is linear."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.reading import Photograph
from cusick_bench.photographs.segmentation.plane import PlanePicture, plane_picture

ANGLES = 720
STEP = 2.5e-4  # [m] between radii
REACH = 1.24  # flat radii that are looked at
RING = (1.07, REACH)  # flat radii between which nothing but ground and clutter can lie


@dataclass(frozen=True, eq=False)
class PolarPicture:
    """A photograph on a grid of angles and radii.

    Attributes:
        light: Linear light, blue first.
        seen: Where the grid lies in the photograph.
        radii: Radius of each column [m].
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].
        plane: The photograph itself, asked by places.
    """

    light: Float[ndarray, "angles radii 3"]
    seen: Bool[ndarray, "angles radii"]
    radii: Float[ndarray, " radii"]
    plate: float
    cloth: float
    plane: PlanePicture

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
    picture = plane_picture(photograph, view, float(radii[-1]))
    light, seen = picture.light_at(places)
    return PolarPicture(light, seen, radii, plate, cloth, picture)
