"""Silhouettes drawn from radius profiles, for predictors that know no physics."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cusick_bench.datasets.files.hanging_line import with_perspective
from cusick_bench.datasets.files.protocol import RELEASE, Protocol


@dataclass(frozen=True, eq=False)
class Canvas:
    """Polar coordinates of all pixels, computed once for many profiles with the same number of angles.

    Attributes:
        radius: Distance from the middle [m].
        before: Number of the profile's last angle before the pixel's.
        after: Number of the next angle.
        share: Weight of the next angle, in [0, 1).
        protocol: How the pictures are taken.
    """

    radius: Float[np.ndarray, "size size"]
    before: Int[np.ndarray, "size size"]
    after: Int[np.ndarray, "size size"]
    share: Float[np.ndarray, "size size"]
    protocol: Protocol

    @classmethod
    def of(cls, angles: int, protocol: Protocol) -> "Canvas":
        """The canvas of profiles with so many equidistant angles.

        Args:
            angles: Their number.
            protocol: How the pictures are taken.

        Returns:
            The canvas.
        """
        row, column = np.mgrid[: protocol.image_size_px, : protocol.image_size_px]
        x = (column - protocol.centre_px[0]) / protocol.px_per_m
        y = (protocol.centre_px[1] - row) / protocol.px_per_m
        y = y if protocol.image_y == "up" else -y
        position = np.arctan2(y, x) * (angles / (2 * np.pi)) % angles
        before = position.astype(np.int64) % angles
        return cls(np.hypot(x, y), before, (before + 1) % angles, position - np.floor(position), protocol)

    def silhouette(self, radii: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "size size"]:
        """Draws a star-shaped region; its edge is a pixel wide.

        Args:
            radii: Radii at the angles [m].

        Returns:
            Its image, 1 within.
        """
        if self.protocol.projection == "pinhole":
            radii = with_perspective(radii, self.protocol)
        edge = radii[self.before] * (1 - self.share) + radii[self.after] * self.share
        return np.clip((edge - self.radius) * self.protocol.px_per_m + 0.5, 0.0, 1.0)


def silhouette(radii: Float[np.ndarray, " angles"], protocol: Protocol = RELEASE) -> Float[np.ndarray, "size size"]:
    """Draws one star-shaped region; see `Canvas.silhouette`.

    Args:
        radii: Radii at equidistant angles [m].
        protocol: How the picture is taken.

    Returns:
        Its image, 1 within.
    """
    return Canvas.of(len(radii), protocol).silhouette(radii)
