"""Surfaces of cloth and ground: plain, woven, striped, checked, dotted, blotched or grained, as maps of albedo."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

CELLS = 1024  # pixels of a map along each side
GROUND_SIDE, CLOTH_SIDE = 1.2, 0.33  # [m] that a map spans
_ROW = 1024  # values that are looked up side by side
CLOTH_PATTERNS = ("plain", "woven", "woven", "stripes", "checks", "dots", "blotches")
GROUND_PATTERNS = ("plain", "paper", "paper", "grain", "blotches", "stripes", "tiles")


@dataclass(frozen=True, eq=False)
class Surface:
    """A map of a surface, whose middle lies at the origin.

    Attributes:
        side: Length that it spans [m].
        values: What is known of every place.
    """

    side: float
    values: Float[ndarray, "cells cells *channels"]

    def at(self, places: Float[ndarray, "*places 2"]) -> ndarray:
        """Values at places.

        Args:
            places: x and y [m].

        Returns:
            Values there; beyond its edge the map is mirrored.
        """
        flat = places.reshape(-1, 2)
        padded = np.zeros((-(-len(flat) // _ROW) * _ROW, 2), np.float32)  # OpenCV takes no lists, only pictures
        cells = self.values.shape[0]
        padded[: len(flat)] = (flat / self.side + 0.5) * cells - 0.5
        grid = padded.reshape(-1, _ROW, 2)
        values = cv2.remap(self.values, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        channels = self.values.shape[2:]
        return values.reshape(-1, *channels)[: len(flat)].reshape(*places.shape[:-1], *channels)


def _smooth_noise(generator: np.random.Generator, length: float, side: float) -> Float[ndarray, "cells cells"]:
    """A smooth random field of unit variance that varies over a length [m]."""
    coarse = max(4, min(CELLS, round(2 * side / length)))
    field = cv2.resize(
        generator.normal(size=(coarse, coarse)).astype(np.float32), (CELLS, CELLS), interpolation=cv2.INTER_CUBIC
    )
    return (field - field.mean()) / field.std()


def _shares(pattern: str, side: float, generator: np.random.Generator) -> Float[ndarray, "cells cells"]:
    """Share of the second colour, 0 to 1."""
    line = ((np.arange(CELLS) + 0.5) / CELLS - 0.5) * side
    x, y = np.meshgrid(line, line)
    angle, period = generator.uniform(0, np.pi), generator.uniform(0.006, 0.03)
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    if pattern == "stripes":
        return (np.sin(2 * np.pi * along / period) > generator.uniform(-0.6, 0.6)).astype(np.float32)
    if pattern == "checks":
        return (
            0.5 * (np.sin(2 * np.pi * along / period) > 0) + 0.5 * (np.sin(2 * np.pi * across / period) > 0)
        ).astype(np.float32)
    if pattern == "dots":
        distance = np.hypot((along / period) % 1 - 0.5, (across / period) % 1 - 0.5)
        return (distance < generator.uniform(0.2, 0.35)).astype(np.float32)
    if pattern == "blotches":
        return (_smooth_noise(generator, generator.uniform(0.008, 0.03), side) > 0.3).astype(np.float32)
    if pattern == "tiles":
        joint = 0.04 * np.maximum(period, 0.015) / 0.02
        large = 6 * period
        return ((along % large < joint * 0.1) | (across % large < joint * 0.1)).astype(np.float32)
    if pattern == "grain":
        warped = across + 0.01 * _smooth_noise(generator, 0.2, side)
        field = np.sin(2 * np.pi * warped / generator.uniform(0.008, 0.02)) + 0.6 * _smooth_noise(generator, 0.02, side)
        return (0.5 + 0.25 * np.clip(field, -2, 2)).astype(np.float32)
    return np.zeros((CELLS, CELLS), np.float32)


def coloured(
    pattern: str,
    first: Float[ndarray, " 3"],
    second: Float[ndarray, " 3"],
    side: float,
    generator: np.random.Generator,
) -> Surface:
    """A surface's albedo.

    Args:
        pattern: One of `CLOTH_PATTERNS` or `GROUND_PATTERNS`.
        first: Linear albedo of the first colour.
        second: Linear albedo of the second.
        side: Length that the map spans [m].
        generator: Source of random numbers.

    Returns:
        Linear albedo.
    """
    share = _shares(pattern, side, generator)[..., None]
    albedo = first * (1 - share) + second * share
    fine = {"plain": 0.01, "paper": 0.02}.get(pattern, 0.04)
    noise = _smooth_noise(generator, 0.002, side) + 0.7 * _smooth_noise(generator, 0.05, side)
    return Surface(side, (albedo * np.exp(fine * noise)[..., None]).astype(np.float32))
