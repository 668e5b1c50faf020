"""Silhouettes drawn from radius profiles, for predictors that know no physics."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cusick_bench.sim.constants import IMAGE_CENTRE, PIXELS_PER_METRE

SIZE = 256


@dataclass(frozen=True, eq=False)
class Canvas:
    """Where every pixel's centre lies, seen from the middle: made once for many profiles of as many angles.

    Attributes:
        radius: Distance from the middle [m].
        before: Number of the profile's last angle before the pixel's.
        after: Number of the next angle.
        share: Weight of the next angle, in [0, 1).
    """

    radius: Float[np.ndarray, "256 256"]
    before: Int[np.ndarray, "256 256"]
    after: Int[np.ndarray, "256 256"]
    share: Float[np.ndarray, "256 256"]

    @classmethod
    def of(cls, angles: int) -> "Canvas":
        """The canvas of profiles with so many equidistant angles.

        Args:
            angles: Their number.

        Returns:
            The canvas.
        """
        row, column = np.mgrid[:SIZE, :SIZE]
        x = (column - IMAGE_CENTRE[0]) / PIXELS_PER_METRE
        y = (IMAGE_CENTRE[1] - row) / PIXELS_PER_METRE
        position = np.arctan2(y, x) * (angles / (2 * np.pi)) % angles
        before = position.astype(np.int64) % angles
        return cls(np.hypot(x, y), before, (before + 1) % angles, position - np.floor(position))

    def silhouette(self, radii: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "256 256"]:
        """Draws a star-shaped region; its edge is a pixel wide.

        Args:
            radii: Radii at the angles [m].

        Returns:
            Its image, 1 within.
        """
        edge = radii[self.before] * (1 - self.share) + radii[self.after] * self.share
        return np.clip((edge - self.radius) * PIXELS_PER_METRE + 0.5, 0.0, 1.0)


def silhouette(radii: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "256 256"]:
    """Draws one star-shaped region; see `Canvas.silhouette`.

    Args:
        radii: Radii at equidistant angles [m].

    Returns:
        Its image, 1 within.
    """
    return Canvas.of(len(radii)).silhouette(radii)
