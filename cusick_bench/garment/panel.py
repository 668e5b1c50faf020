"""Flat pattern pieces: triangulated sectors of a ring, of any opening, with evenly spaced vertices on their border.

A sector is what the mantle of a cone unrolls to, so it is the pattern of an A-line panel; one of a full turn is the
pattern of a circular skirt. Vertices inside start on a jittered triangular grid and are relaxed to the centroids of
their triangle fans, as those of the disc (`cusick_bench.sim.cloth.mesh`).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.spatial import Delaunay

_RELAXATION_SWEEPS = 40
_JITTER = 0.2  # of the spacing; a regular grid would favour three directions
_KEEP_OFF = 0.6  # of the spacing, between the border and the nearest vertex inside
_SLIVER = 1e-3  # of the spacing squared: smallest face
_FAR_APEX = 10.0  # [lengths of the piece] distance of the apex from which points are scattered about the piece alone


@dataclass(frozen=True)
class Sector:
    """A sector of a ring in polar coordinates about the apex, symmetric to the warp direction +x.

    Attributes:
        inner: Radius of the inner arc [m].
        outer: Radius of the outer arc [m].
        opening: Angle between the straight sides [rad]; 2 pi is the whole ring, without sides.
    """

    inner: float
    outer: float
    opening: float

    @property
    def closed(self) -> bool:
        """Whether it is the whole ring."""
        return self.opening >= 2 * np.pi - 1e-12

    @property
    def area(self) -> float:
        """Area [m2]."""
        return 0.5 * self.opening * (self.outer**2 - self.inner**2)

    @property
    def scattered_circle(self) -> tuple[float, float]:
        """Centre on the warp direction and radius of the circle in which points are scattered [m].

        It lies about the apex, or about a piece whose apex is far away: that of a skirt hardly wider at its hem than at
        its waist is a hundred lengths away, and points all around it would fill the memory.
        """
        if self.inner <= _FAR_APEX * (self.outer - self.inner):
            return 0.0, self.outer
        centre, half = 0.5 * (self.inner + self.outer), 0.5 * self.opening
        corners = [np.hypot(r * np.cos(half) - centre, r * np.sin(half)) for r in (self.inner, self.outer)]
        return centre, float(max(corners))

    def inside(self, points: Float[ndarray, "points 2"], margin: float) -> Bool[ndarray, "points"]:
        """Which points lie inside of the sector.

        Args:
            points: Material coordinates [m].
            margin: Least distance from the border [m].

        Returns:
            True for each such point.
        """
        radius, angle = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
        within = (radius > self.inner + margin) & (radius < self.outer - margin)
        if self.closed:
            return within
        to_side = radius * np.sin(np.clip(self.opening / 2 - np.abs(angle), -np.pi / 2, np.pi / 2))
        return within & (to_side > margin)

    def arc(self, radius: float, spacing: float) -> Float[ndarray, "points 2"]:
        """Evenly spaced points of an arc, counter-clockwise, both ends included (one where they meet).

        Args:
            radius: Radius of the arc [m].
            spacing: Distance between neighbouring points [m], met nearly.

        Returns:
            The points [m].
        """
        pieces = max(round(radius * self.opening / spacing), 3)
        angle = np.linspace(-self.opening / 2, self.opening / 2, pieces + 1)[: pieces if self.closed else None]
        return radius * np.column_stack([np.cos(angle), np.sin(angle)])

    def side(self, sign: int, spacing: float) -> Float[ndarray, "points 2"]:
        """Evenly spaced points of a straight side between the arcs, from the inner one outwards.

        Args:
            sign: 1 for the side at positive angles, -1 for the other.
            spacing: Distance between neighbouring points [m], met nearly.

        Returns:
            The points [m].
        """
        pieces = max(round((self.outer - self.inner) / spacing), 2)
        radius = np.linspace(self.inner, self.outer, pieces + 1)[1:-1, None]
        return radius * [np.cos(self.opening / 2), sign * np.sin(self.opening / 2)]


@dataclass(frozen=True, eq=False)
class Panel:
    """A meshed pattern piece.

    Attributes:
        points: Material coordinates [m], warp = +x.
        faces: Vertex indices, counter-clockwise.
        inner: Vertices of the inner arc, counter-clockwise.
        outer: Vertices of the outer arc, counter-clockwise.
        right: Vertices of the side at negative angles, from the inner to the outer arc, ends included; empty in a ring.
        left: Vertices of the side at positive angles, likewise.
    """

    points: Float[ndarray, "vertices 2"]
    faces: Int[ndarray, "faces 3"]
    inner: Int[ndarray, "inner"]
    outer: Int[ndarray, "outer"]
    right: Int[ndarray, "side"]
    left: Int[ndarray, "side"]


def mesh_sector(sector: Sector, spacing: float, generator: np.random.Generator) -> Panel:
    """Meshes a pattern piece with near-equilateral triangles.

    Args:
        sector: Its shape.
        spacing: Distance between neighbouring vertices [m].
        generator: Source of the jitter; another one gives another mesh with the same border.

    Returns:
        The mesh.
    """
    sides = () if sector.closed else (sector.side(-1, spacing), sector.side(1, spacing))
    border = [sector.arc(sector.inner, spacing), sector.arc(sector.outer, spacing), *sides]
    fixed = np.concatenate(border)
    points = np.concatenate([fixed, _scatter(sector, spacing, generator)])
    points = _relax(sector, points, len(fixed))
    ends = np.cumsum([0, *(len(part) for part in border)])
    inner, outer, *between = (np.arange(start, end) for start, end in pairwise(ends))
    right, left = (
        np.concatenate([[inner[at]], middle, [outer[at]]]) for at, middle in zip((0, -1), between, strict=True)
    ) if between else (np.zeros(0, np.int64), np.zeros(0, np.int64))  # fmt: skip
    faces = _faces(sector, points)
    return Panel(points, faces[doubled_areas(points, faces) > _SLIVER * spacing**2], inner, outer, right, left)


def _scatter(sector: Sector, spacing: float, generator: np.random.Generator) -> Float[ndarray, "points 2"]:
    """A jittered triangular grid, turned at random, where it lies inside."""
    centre, reach = sector.scattered_circle
    count = int(np.ceil(reach / spacing)) + 1
    row, column = np.mgrid[-2 * count : 2 * count + 1, -2 * count : 2 * count + 1]
    grid = spacing * np.column_stack([(column + 0.5 * row).ravel(), (np.sqrt(0.75) * row).ravel()])
    turn = generator.uniform(0, np.pi / 3)
    turned = grid @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    shifted = turned + generator.uniform(0, spacing, 2) + generator.normal(0, _JITTER * spacing, grid.shape)
    shifted[:, 0] += centre
    return shifted[sector.inside(shifted, _KEEP_OFF * spacing)]


def doubled_areas(points: Float[ndarray, "vertices 2"], faces: Int[ndarray, "faces 3"]) -> Float[ndarray, "faces"]:
    """Twice the signed area of every face.

    Args:
        points: Places of the vertices [m].
        faces: Vertex indices.

    Returns:
        Areas, positive where the corners run counter-clockwise [m2].
    """
    first, second = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def _faces(sector: Sector, points: ndarray) -> Int[ndarray, "faces 3"]:
    """Delaunay triangles whose centroids lie inside, counter-clockwise."""
    faces = Delaunay(points).simplices.astype(np.int64)
    faces = faces[sector.inside(points[faces].mean(1), 0.0)]
    clockwise = doubled_areas(points, faces) < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    return faces


def _relax(sector: Sector, points: ndarray, fixed: int) -> ndarray:
    """Moves every point behind the first `fixed` ones to the centroid of its triangle fan, again and again."""
    for _ in range(_RELAXATION_SWEEPS):
        faces = _faces(sector, points)
        area = doubled_areas(points, faces)
        weighted = np.repeat(points[faces].mean(1) * area[:, None], 3, axis=0)
        total = np.bincount(faces.ravel(), np.repeat(area, 3), len(points))
        moved = [np.bincount(faces.ravel(), weighted[:, axis], len(points)) / total for axis in (0, 1)]
        points[fixed:] = np.column_stack(moved)[fixed:]
    return points
