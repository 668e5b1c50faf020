"""Profiles of light across the outline, relative to the ground outside it: the input of the fitted model of edges.

Gamma-coded light is used, in which the sensor's noise is about uniform. Brightness and the two colour differences are
separate, because JPEG blurs colours more than brightness.
"""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.segmentation.curve import Curve, normals, smoothed
from cusick_bench.photographs.segmentation.plane import PlanePicture

ALONG = 2e-4  # [m] between places along a normal
REACH = 2.4e-3  # [m] to either side of the curve
_OUTSIDE, _INSIDE = (
    1.2e-3,
    0.4e-3,
)  # [m] from the curve at which the ground's light, and the cloth's, begins to be taken
_SIMILAR = 2e-3  # [m] along the curve over which the ground's light is averaged
_NEIGHBOURS = (-3, 0, 3)  # points whose profiles are read together
_LEAST = 0.01  # contrast that noise makes, of gamma-coded light
_GAMMA = 1 / 2.4
_BRIGHTNESS = np.array([0.114, 0.587, 0.299])  # of blue, green, red


def profiles(picture: PlanePicture, curve: Curve) -> Float[ndarray, "points features"]:
    """Looks up what the light does across a curve.

    Args:
        picture: Evenly lit.
        curve: Points in even distances, counter-clockwise [m].

    Returns:
        For every point: differences from the ground's brightness and colour across the curve, here and at two
        neighbours, over the contrast; and logarithms of the contrast and of the ground's variation.
    """
    along = np.arange(-REACH, REACH + ALONG / 2, ALONG)
    light, _ = picture.light_at(curve[:, None] + along[:, None] * normals(curve)[:, None])
    coded = np.clip(light, 0, 4).astype(np.float64) ** _GAMMA
    coded = cv2.blur(np.pad(coded, ((1, 1), (0, 0), (0, 0)), mode="wrap"), (1, 3))[1:-1]
    brightness = coded @ _BRIGHTNESS
    colours = np.stack([brightness, coded[..., 0] - brightness, coded[..., 2] - brightness], axis=-1)
    outside = along >= _OUTSIDE
    difference = colours - smoothed(colours[:, outside].mean(axis=1), _SIMILAR)[:, None]
    inside = (difference[:, along <= -_INSIDE] ** 2).sum(axis=-1).mean(axis=1, keepdims=True)
    around = (difference[:, outside] ** 2).sum(axis=-1).mean(axis=1, keepdims=True)
    contrast = np.sqrt(smoothed(inside, _SIMILAR) + _LEAST**2)
    variation = np.sqrt(smoothed(around, _SIMILAR) + _LEAST**2)
    relative = np.clip(difference / contrast[:, None], -4, 4).reshape(len(curve), -1)
    read = [np.roll(relative, -step, axis=0) for step in _NEIGHBOURS]
    return np.concatenate([*read, np.log(contrast), np.log(variation / contrast)], axis=1)
