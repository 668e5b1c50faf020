"""Silhouettes drawn from radius profiles, for predictors that know no physics."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets.profile import CENTRE_PIXEL, PIXELS_PER_METRE

SIZE = 256


@lru_cache(maxsize=1)
def _polar() -> tuple[np.ndarray, np.ndarray]:
    """Radius [m] and angle [rad, 0..2 pi) of every pixel's centre."""
    row, column = np.mgrid[:SIZE, :SIZE]
    x = (column - CENTRE_PIXEL[0]) / PIXELS_PER_METRE
    y = (CENTRE_PIXEL[1] - row) / PIXELS_PER_METRE
    return np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)


def silhouette(radii: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "256 256"]:
    """Image of a star-shaped region with given radii [m] at equidistant angles; its edge is a pixel wide."""
    radius, angle = _polar()
    edge = np.interp(angle, np.arange(len(radii) + 1) * (2 * np.pi / len(radii)), np.append(radii, radii[0]))
    return np.clip((edge - radius) * PIXELS_PER_METRE + 0.5, 0.0, 1.0)
