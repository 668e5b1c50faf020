"""Correction of uneven light: a smooth surface through the ground's log brightness is subtracted from the picture."""

from dataclasses import replace

import numpy as np

from cusick_bench.photographs.segmentation.plane import brightness_terms
from cusick_bench.photographs.segmentation.polar import PolarPicture, angles

_DARK = 4e-3  # linear light below which noise dominates
_EVERY = 4  # every fourth row and column of the ring is used
_ROUNDS = 6


def evenly_lit(picture: PolarPicture) -> PolarPicture:
    """Divides a picture by the light, as estimated from the ground around the cloth.

    Args:
        picture: As it was taken.

    Returns:
        The same as if the light were even; the brightness of the ground stays.
    """
    scale = picture.radii[-1]
    x, y = (function(angles())[:, None] * picture.radii / scale for function in (np.cos, np.sin))
    part = (slice(None, None, _EVERY), slice(picture.ring.start, None, _EVERY))
    good = picture.seen[part].ravel()
    brightness = np.log(picture.light[part].mean(axis=-1).ravel() + _DARK)
    terms = brightness_terms(x[part].ravel(), y[part].ravel())
    if good.sum() < 50:
        return picture
    weights = good.astype(float)
    fitted = np.zeros(6)
    for _ in range(_ROUNDS):  # Tukey's weights: clutter and shadows count little
        root = np.sqrt(weights)[:, None]
        ridge = np.diag([0, 1e-3, 1e-3, 0.3, 0.3, 0.3]) * weights.sum() * 0.02
        fitted = np.linalg.solve((terms * root).T @ (terms * root) + ridge, (terms * weights[:, None]).T @ brightness)
        miss = brightness - terms @ fitted
        spread = 1.4826 * np.median(np.abs(miss[good])) + 1e-3
        weights = np.where(good & (np.abs(miss) < 4 * spread), (1 - (miss / (4 * spread)) ** 2) ** 2, 0.0)
    fitted[0] = 0.0
    light = (picture.light / np.exp(brightness_terms(x, y) @ fitted)[..., None]).astype(np.float32)
    return replace(picture, light=light, plane=replace(picture.plane, shading=fitted))
