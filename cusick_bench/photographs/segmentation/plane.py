"""Light at any place of the plate's plane, interpolated in the photograph itself instead of a resampled grid."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.reading import Photograph, linear_light

_FINEST = 3.0  # pixels of the photograph per millimetre that are used


def brightness_terms(x: Float[ndarray, "*places"], y: Float[ndarray, "*places"]) -> Float[ndarray, "*places 6"]:
    """Terms of a smooth surface through log brightness.

    Args:
        x, y: Places, in units of the largest radius that is looked at.

    Returns:
        The terms of second order, the constant first.
    """
    return np.stack([np.ones_like(x), x, y, x**2 + y**2, x**2 - y**2, x * y], axis=-1)


@dataclass(frozen=True, eq=False)
class PlanePicture:
    """A photograph that is asked by places in the plate's plane.

    Attributes:
        levels: Levels 0 to 255, blue first.
        factor: Pixels of `levels` for one of the photograph.
        view: The calibrated camera.
        reach: Largest radius that is looked at [m].
        shading: Log brightness that is taken off, as coefficients of `brightness_terms`.
    """

    levels: UInt8[ndarray, "height width 3"]
    factor: float
    view: PlateView
    reach: float
    shading: Float[ndarray, " 6"]

    def light_at(
        self, places: Float[ndarray, "rows columns 2"]
    ) -> tuple[Float[ndarray, "rows columns 3"], Bool[ndarray, "rows columns"]]:
        """Looks up light.

        Args:
            places: x and y [m].

        Returns:
            Linear light, shading taken off; and whether the photograph shows the place.
        """
        points = np.concatenate([places.reshape(-1, 2), np.zeros((places.size // 2, 1))], axis=1)
        pixels = (self.view.project(points).reshape(places.shape) + 0.5) * self.factor - 0.5
        column, row = pixels[..., 0], pixels[..., 1]
        height, width = self.levels.shape[:2]
        seen = (column > 0) & (column < width - 1) & (row > 0) & (row < height - 1)
        levels = cv2.remap(
            self.levels.astype(np.float32), column.astype(np.float32), row.astype(np.float32),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        light = linear_light(levels)
        if self.shading.any():
            x, y = np.moveaxis(places / self.reach, -1, 0)
            light = light / np.exp(brightness_terms(x, y) @ self.shading)[..., None].astype(np.float32)
        return light, seen


def plane_picture(photograph: Photograph, view: PlateView, reach: float) -> PlanePicture:
    """Makes a photograph ready to be asked by places.

    Args:
        photograph: The picture.
        view: The calibrated camera.
        reach: Largest radius that is looked at [m].

    Returns:
        The picture; its pixels averaged where they are much finer than needed.
    """
    factor = min(1.0, 1e3 * _FINEST / view.scale)
    levels = photograph.levels
    if factor < 1:
        levels = cv2.resize(levels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return PlanePicture(levels, factor, view, reach, np.zeros(6))
