"""Where on the cloth: regions in its face-up frame, and how well a claimed one agrees with the true one.

Angles are counter-clockwise from +x (warp). The map of an answer has 4 rings from the plate's edge to the rim and 16
sectors, the first from 0 to 22.5 degrees.

References:
    J. Zhang, S. A. Bargal, Z. Lin, J. Brandt, X. Shen, S. Sclaroff. Top-down neural attention by excitation backprop.
        International Journal of Computer Vision 126 (2018), 1084-1102 (the pointing game).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

RINGS, SECTORS = 4, 16
PLATE_EDGE, RIM = PLATE_RADIUS, CLOTH_RADIUS  # [m], nominal: labels and answers speak of the suites' own laboratory
FULL_TURN = 360.0  # [deg]
KINDS = ("sector", "ring", "patch")


@dataclass(frozen=True)
class Region:
    """A part of an annulus.

    Attributes:
        start: Direction of its first edge, counter-clockwise [deg].
        width: Angle from there to its second edge [deg], 360 for a ring.
        inner, outer: Inner and outer radius [m].
    """

    start: float
    width: float
    inner: float
    outer: float

    @property
    def middle(self) -> "Region":
        """The point in its middle; of a ring, the circle."""
        radius = (self.inner + self.outer) / 2
        if self.width == FULL_TURN:
            return Region(0.0, FULL_TURN, radius, radius)
        return Region((self.start + self.width / 2) % FULL_TURN, 0.0, radius, radius)

    def overlaps(self, other: "Region") -> bool:
        """Whether the two share a point, be it on their edges.

        Args:
            other: The other region.

        Returns:
            True if they do.
        """
        return self._overlaps_in_angle(other) and self.inner <= other.outer and other.inner <= self.outer

    def _overlaps_in_angle(self, other: "Region") -> bool:
        apart = (other.start - self.start) % FULL_TURN
        return apart <= self.width or FULL_TURN - apart <= other.width


def angular_overlap(first: Region, second: Region) -> float:
    """Intersection over union of two ranges of directions.

    Two arcs may meet at both of their ends, so the second is looked at from the first's start, once as it is and
    once a turn earlier.

    Args:
        first: One region.
        second: The other.

    Returns:
        The share, 0 where both have no width.
    """
    apart = (second.start - first.start) % FULL_TURN
    shared = sum(
        max(0.0, min(first.width, apart + turn + second.width) - max(0.0, apart + turn)) for turn in (0.0, -FULL_TURN)
    )
    union = first.width + second.width - shared
    return shared / union if union > 0 else 0.0


def arc(angles: Sequence[float]) -> tuple[float, float]:
    """The arc that goes counter-clockwise from the first of two directions to the second.

    Args:
        angles: The two directions [deg].

    Returns:
        Start and width [deg].
    """
    first, second = angles
    width = second - first
    return first % FULL_TURN, FULL_TURN if abs(width) >= FULL_TURN else width % FULL_TURN


def around(direction: float, half_width: float) -> tuple[float, float]:
    """The arc that reaches as far to both sides of a direction.

    Args:
        direction: Its middle [deg].
        half_width: How far it reaches to either side [deg].

    Returns:
        Start and width [deg].
    """
    return (direction - half_width) % FULL_TURN, min(2 * half_width, FULL_TURN)


def cell(ring: int, sector: int, inner: float = PLATE_EDGE, outer: float = RIM) -> Region:
    """A cell of the map.

    Args:
        ring: Number of the ring from inside, from 0.
        sector: Number of the sector counter-clockwise, from 0.
        inner: Inner radius of the map [m].
        outer: Outer radius of the map [m].

    Returns:
        The region of the cell.
    """
    step, turn = (outer - inner) / RINGS, FULL_TURN / SECTORS
    return Region(sector * turn, turn, inner + ring * step, inner + (ring + 1) * step)


def peak(values: Float[ndarray, "rings sectors"], kind: str) -> Region | None:
    """Place of the largest value of a map: a cell, or for a ring the ring with the largest sum.

    Args:
        values: Weight of each cell, rings from the plate to the rim.
        kind: `ring` for an effect that acts all around.

    Returns:
        The region; None if the map is flat.
    """
    weights = np.nan_to_num(np.abs(values))
    if np.ptp(weights) == 0:
        return None
    if kind == "ring":
        ring = cell(int(weights.sum(1).argmax()), 0)
        return Region(0.0, FULL_TURN, ring.inner, ring.outer)
    ring, sector = np.unravel_index(int(weights.argmax()), weights.shape)
    return cell(int(ring), int(sector))
