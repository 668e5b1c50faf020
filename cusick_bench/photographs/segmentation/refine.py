"""The outline between pixels: along its normals, where linear light is halfway from the cloth's to the ground's."""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.segmentation.curve import Curve, normals, outermost, resampled, smoothed
from cusick_bench.photographs.segmentation.plane import PlanePicture

_ALONG = 1e-4  # [m] between places along a normal
_WINDOW = 1.0e-3  # [m] to either side in which the crossing is looked for
_NEAR, _FAR = 0.4e-3, 1.2e-3  # [m] between which a side's light is taken: no wider than a stripe beside the rim
_WIDE = (0.5e-3, 1.8e-3, 1.8e-3)  # the same three lengths, of the edge's width: a blurred edge is as wide as that
_NOISE = 4e-3  # linear light
_SMOOTH = 0.7e-3  # [m] along the outline: standard deviation of the filter of the crossings
_NEIGHBOURS = 2  # points to either side with whose median a point is compared
_OUTLIER = 0.5e-3  # [m] distance from that median from which a point is an outlier
_ROUNDS = 2


def refined(picture: PlanePicture, curve: Curve) -> tuple[Float[ndarray, " angles"], float, float]:
    """Moves a curve to where the light is halfway between its sides.

    Args:
        picture: Evenly lit.
        curve: Points in even distances, counter-clockwise [m].

    Returns:
        Radii [m]; the share of the outline at which no crossing was found; and the width of the edge [m].
    """
    missing = 1.0
    for _ in range(_ROUNDS):
        curve = resampled(curve)
        across = normals(curve)
        offset, found, _ = _crossings(picture, curve, across, _NEAR, _FAR, _WINDOW)
        around = np.median([np.roll(offset, step) for step in range(-_NEIGHBOURS, _NEIGHBOURS + 1)], axis=0)
        good = found & (np.abs(offset - around) < _OUTLIER)
        missing = float(1 - good.mean())
        offset = np.where(good, offset, around)
        curve = curve + across * smoothed(offset[:, None], _SMOOTH)
    width = _crossings(picture, curve, normals(curve), *_WIDE)[2]
    return outermost(curve), missing, width


def _crossings(
    picture: PlanePicture, curve: Curve, normal: Curve, near: float, far: float, window: float
) -> tuple[ndarray, ndarray, float]:
    """Distance along each normal to the nearest crossing, whether there is one, and the width of the edge [m]."""
    along = np.arange(-far, far + _ALONG / 2, _ALONG)
    light = picture.light_at(curve[:, None] + along[:, None] * normal[:, None])[0].astype(np.float64)
    light = cv2.blur(np.pad(light, ((1, 1), (0, 0), (0, 0)), mode="wrap"), (1, 3))[1:-1]
    inner, outer = light[:, along < -near], light[:, along > near]
    change = inner.mean(axis=1) - outer.mean(axis=1)
    weights = change / (inner.var(axis=1) + outer.var(axis=1) + _NOISE**2)
    part = np.abs(along) <= window
    line = ((light[:, part] - outer.mean(axis=1)[:, None]) * weights[:, None]).sum(axis=-1)
    line = line / np.maximum((change * weights).sum(axis=-1), 1e-12)[:, None] - 0.5
    falls = (line[:, :-1] >= 0) & (line[:, 1:] < 0)
    places = along[part][:-1] + _ALONG * line[:, :-1] / np.maximum(line[:, :-1] - line[:, 1:], 1e-12)
    distance = np.where(falls, np.abs(places), np.inf)
    best = distance.argmin(axis=1)
    found = falls.any(axis=1)
    steepest = -np.diff(cv2.blur(line, (5, 1)), axis=1).min(axis=1) / _ALONG
    width = float(np.median(1 / np.maximum(steepest, 10.0)))
    return np.where(found, places[np.arange(len(places)), best], 0.0), found, width
