"""Silhouettes drawn from radius profiles, for predictors that know no physics."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from cusick_bench.sim.constants import IMAGE_CENTRE, PIXELS_PER_METRE

SIZE = 256


@lru_cache(maxsize=4)
def _pixels(angles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of every pixel's centre: radius [m], the two angles of the profile it lies between, weight of the second."""
    row, column = np.mgrid[:SIZE, :SIZE]
    x = (column - IMAGE_CENTRE[0]) / PIXELS_PER_METRE
    y = (IMAGE_CENTRE[1] - row) / PIXELS_PER_METRE
    position = np.arctan2(y, x) * (angles / (2 * np.pi)) % angles
    before = position.astype(np.int64) % angles
    return np.hypot(x, y), before, (before + 1) % angles, position - np.floor(position)


def silhouette(radii: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "256 256"]:
    """Image of a star-shaped region with given radii [m] at equidistant angles; its edge is a pixel wide."""
    radius, before, after, share = _pixels(len(radii))
    edge = radii[before] * (1 - share) + radii[after] * share
    return np.clip((edge - radius) * PIXELS_PER_METRE + 0.5, 0.0, 1.0)
