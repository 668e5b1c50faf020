"""Triangle meshes of the cloth disc: seeded near-uniform disc mesher, and the topology that forces need.

The mesher keeps a ring of vertices on the rim and one on the plate edge, so that both circles are resolved exactly at
every mesh size, and relaxes the other vertices to the area-weighted centroids of their triangle fans
(centroidal patch triangulation, Chen and Holst 2011), which gives near-equilateral triangles.

References:
    L. Chen, M. Holst. Efficient mesh optimization schemes based on optimal Delaunay triangulations.
    Computer Methods in Applied Mechanics and Engineering 200 (2011), Section 3.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError

_MINIMUM_VERTICES = 60
_RELAXATION_SWEEPS = 60


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulated cloth in its flat material frame (warp = +x, face up = +z).

    Attributes:
        material: Material coordinates of the vertices [m].
        faces: Vertex indices, counter-clockwise seen from +z.
        pattern: Material coordinates of every face's corners [m], where they are not those of its vertices: panels
            that are sewn together share the vertices of a seam, and each has its own place and grain for them.
            `material` is then any layout of the whole in the plane without folds.

    Raises:
        SimulationError: Not a manifold triangle mesh, unused vertices, degenerate or clockwise faces.
    """

    material: Float[ndarray, "vertices 2"]
    faces: Int[ndarray, "faces 3"]
    pattern: Float[ndarray, "faces 3 2"] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "material", np.ascontiguousarray(self.material, dtype=np.float64))
        object.__setattr__(self, "faces", np.ascontiguousarray(self.faces, dtype=np.int64))
        if self.pattern is not None:
            object.__setattr__(self, "pattern", np.ascontiguousarray(self.pattern, dtype=np.float64))
        _check(self)

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return len(self.material)

    @property
    def flat(self) -> Float[ndarray, "vertices 3"]:
        """The cloth laid flat: material coordinates with z = 0 [m]; an array of its own each time."""
        return np.column_stack([self.material, np.zeros(self.vertices)])

    @cached_property
    def corners(self) -> Float[ndarray, "faces 3 2"]:
        """Material coordinates of every face's corners [m]."""
        return self.material[self.faces] if self.pattern is None else self.pattern

    @cached_property
    def areas(self) -> Float[ndarray, "faces"]:
        """Material areas of the faces [m2]."""
        return _corner_areas(self.corners)

    @cached_property
    def vertex_areas(self) -> Float[ndarray, "vertices"]:
        """A third of the material area of the faces around every vertex [m2]."""
        return np.bincount(self.faces.ravel(), np.repeat(self.areas / 3, 3), self.vertices)

    @cached_property
    def squared_spacing(self) -> float:
        """Squared mean spacing of the vertices, of as many equilateral triangles [m2]."""
        return float(2 / np.sqrt(3) * self.areas.sum() / self.vertices)

    @cached_property
    def _half_edges(self) -> tuple[Int[ndarray, "sides 2"], Int[ndarray, "sides"], Int[ndarray, "sides"]]:
        """Directed sides of all faces, with the face and the vertex opposite, sorted by undirected edge."""
        sides = np.concatenate([self.faces[:, [1, 2]], self.faces[:, [2, 0]], self.faces[:, [0, 1]]])
        face = np.tile(np.arange(len(self.faces)), 3)
        opposite = np.concatenate([self.faces[:, 0], self.faces[:, 1], self.faces[:, 2]])
        order = np.lexsort((sides[:, 0], sides.max(1), sides.min(1)))
        return sides[order], face[order], opposite[order]

    @cached_property
    def edges(self) -> Int[ndarray, "edges 2"]:
        """Undirected edges, smaller vertex index first."""
        return np.unique(np.sort(self._half_edges[0], axis=1), axis=0)

    @cached_property
    def hinges(self) -> Int[ndarray, "hinges 4"]:
        """Interior edges as (v0, v1, opposite in face 0, opposite in face 1); face 0 holds the side v0 -> v1."""
        sides, _, opposite = self._half_edges
        undirected = np.sort(sides, axis=1)
        first = np.flatnonzero((undirected[1:] == undirected[:-1]).all(1))
        return np.column_stack([sides[first], opposite[first], opposite[first + 1]])

    @cached_property
    def hinge_corners(self) -> Float[ndarray, "hinges 2 3 2"]:
        """Material coordinates of (v0, v1, opposite) in either face of every hinge [m]; the two differ at seams."""
        sides, face, _ = self._half_edges
        undirected = np.sort(sides, axis=1)
        first = np.flatnonzero((undirected[1:] == undirected[:-1]).all(1))
        found = np.empty((len(first), 2, 3, 2))
        for side in (0, 1):
            own = face[first + side]
            vertices = self.hinges[:, [0, 1, 2 + side]]
            place = (self.faces[own][:, None, :] == vertices[:, :, None]).argmax(2)
            found[:, side] = self.corners[own[:, None], place]
        return found

    @cached_property
    def boundary(self) -> Int[ndarray, "rim"]:
        """Rim vertices in counter-clockwise order, starting at the one with the smallest index."""
        sides, _, _ = self._half_edges
        undirected = np.sort(sides, axis=1)
        same_as_next = np.append((undirected[1:] == undirected[:-1]).all(1), False)
        same_as_previous = np.append(False, same_as_next[:-1])
        open_sides = sides[~(same_as_next | same_as_previous)]
        following = dict(open_sides.tolist())
        if not 0 < len(open_sides) == len(following):
            raise SimulationError(
                f"the mesh has {len(open_sides)} rim edges that are not closed loops; mend the mesh (no bow ties)"
            )
        loop = [min(following)]
        while (vertex := following[loop[-1]]) != loop[0]:
            loop.append(vertex)
            if len(loop) > len(following):
                raise SimulationError(
                    "the rim of the mesh is not one closed loop; mend the mesh (no holes, no bow ties)"
                )
        if len(loop) != len(following):
            raise SimulationError(
                f"the mesh has more than one boundary loop ({len(following)} rim edges); fill its holes"
            )
        return np.array(loop)


def _signed_areas(material: ndarray, faces: ndarray) -> ndarray:
    return _corner_areas(material[faces])


def _corner_areas(corners: ndarray) -> ndarray:
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _check(mesh: Mesh) -> None:
    material, faces = mesh.material, mesh.faces
    if material.ndim != 2 or material.shape[1] != 2 or not np.isfinite(material).all():
        raise SimulationError("material coordinates must be finite with shape (vertices, 2)")
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise SimulationError(f"faces must be triangles with shape (faces, 3), got {faces.shape}")
    if faces.min() < 0 or faces.max() >= len(material):
        raise SimulationError(f"face indices must lie in [0, {len(material) - 1}], got {faces.min()} to {faces.max()}")
    if len(np.unique(faces)) != len(material):
        raise SimulationError("some vertices belong to no face; remove them from the mesh")
    if mesh.corners.shape != (*faces.shape, 2) or not np.isfinite(mesh.corners).all():
        raise SimulationError(f"pattern must be finite with shape {(*faces.shape, 2)}, got {mesh.corners.shape}")
    for areas in (mesh.areas, _signed_areas(material, faces)):
        if (bad := int(np.argmin(areas))) >= 0 and areas[bad] <= 1e-12:
            raise SimulationError(
                f"face {bad} has area {areas[bad]:.3g} m2; faces must be counter-clockwise, not degenerate"
            )
    counts = np.unique(np.sort(mesh._half_edges[0], axis=1), axis=0, return_counts=True)[1]
    if counts.max() > 2:
        raise SimulationError("an edge belongs to more than two faces; the mesh must be a manifold sheet")


def _ring(radius: float, count: int, phase: float) -> ndarray:
    angle = phase + 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _scatter(count: int, inner: float, outer: float, generator: np.random.Generator) -> ndarray:
    """`count` jittered sunflower points in the annulus: even density without any preferred direction."""
    fraction = (np.arange(count) + 0.5) / count
    radius = np.sqrt(inner**2 + fraction * (outer**2 - inner**2))
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5)) + generator.uniform(0, 2 * np.pi)
    spacing = np.sqrt(max(outer**2 - inner**2, 0.0) / max(count, 1))
    jitter = generator.normal(0, 0.25 * spacing, (count, 2))
    return radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + jitter


def _relax(points: ndarray, fixed: int, plate_radius: float, radius: float, spacing: float) -> ndarray:
    """Moves every point behind the first `fixed` ones to the centroid of its triangle fan, again and again."""
    from scipy.spatial import Delaunay

    inside_plate = np.hypot(*points.T) < plate_radius
    for _ in range(_RELAXATION_SWEEPS):
        faces = Delaunay(points).simplices
        area = np.abs(_signed_areas(points, faces))
        weighted = points[faces].mean(1) * area[:, None]
        total = np.bincount(faces.ravel(), np.repeat(area, 3), len(points))
        centroid = np.column_stack(
            [np.bincount(faces.ravel(), np.repeat(weighted[:, axis], 3), len(points)) for axis in (0, 1)]
        )
        moved = centroid / total[:, None]
        distance = np.hypot(*moved.T)
        gap = 0.5 * spacing  # points keep to their side of the plate edge, half a spacing away from both rings
        low = np.where(inside_plate, 0.0, plate_radius + gap)
        high = np.where(inside_plate, plate_radius - gap, radius - gap)
        moved *= (np.clip(distance, low, high) / np.maximum(distance, 1e-12))[:, None]
        points[fixed:] = moved[fixed:]
    return points


@lru_cache(maxsize=16)
def disc_mesh(
    vertices: int = 2699,
    *,
    seed: int = 0,
    radius: float = CLOTH_RADIUS,
    plate_radius: float = PLATE_RADIUS,
) -> Mesh:
    """Meshes the cloth disc with near-equilateral triangles and vertex rings on the rim and on the plate edge.

    Args:
        vertices: Number of vertices of the mesh, met exactly; at least 60.
        seed: Another seed gives another mesh of the same quality.
        radius: Cloth radius [m].
        plate_radius: Plate radius [m], 0 < plate_radius < radius.

    Returns:
        The mesh; its first vertices are the rim, then the plate ring.

    Raises:
        SimulationError: Too few vertices, or radii out of order.
    """
    from scipy.spatial import Delaunay

    if vertices < _MINIMUM_VERTICES:
        raise SimulationError(f"a disc needs at least {_MINIMUM_VERTICES} vertices, got {vertices}")
    if not 0 < plate_radius < radius < np.inf:
        raise SimulationError(f"radii must satisfy 0 < plate < cloth, got plate {plate_radius} m and cloth {radius} m")
    spacing = np.sqrt(2 / np.sqrt(3) * np.pi * radius**2 / vertices)
    generator = np.random.default_rng([seed, vertices])
    rim = _ring(radius, round(2 * np.pi * radius / spacing), generator.uniform(0, 2 * np.pi))
    plate = _ring(plate_radius, round(2 * np.pi * plate_radius / spacing), generator.uniform(0, 2 * np.pi))
    free = vertices - len(rim) - len(plate)
    # Each ring stands for the half spacing on its inner (rim) or on both sides (plate edge).
    half = spacing / 2
    area_in, area_out = (plate_radius - half) ** 2, (radius - half) ** 2 - (plate_radius + half) ** 2
    inner_count = round(free * area_in / (area_in + area_out))
    if not 0 <= inner_count <= free:
        raise SimulationError(
            f"{vertices} vertices are too few for a cloth of {radius:g} m on a plate of {plate_radius:g} m: they would "
            f"be {1e3 * spacing:.3g} mm apart, farther than the rim is from the plate's edge; take more vertices, or "
            "ring_mesh"
        )
    inner = _scatter(inner_count, 0.0, plate_radius - half, generator)
    outer = _scatter(free - inner_count, plate_radius + half, radius - half, generator)
    points = np.concatenate([rim, plate, inner, outer])
    distance = np.hypot(*points.T)
    points[len(rim) + len(plate) : vertices - len(outer)] *= np.minimum(
        1, (plate_radius - half) / distance[len(rim) + len(plate) : vertices - len(outer), None]
    )
    outside = points[vertices - len(outer) :]
    outside_distance = np.hypot(*outside.T)[:, None]
    outside *= np.clip(outside_distance, plate_radius + half, radius - half) / outside_distance
    points = _relax(points, len(rim) + len(plate), plate_radius, radius, spacing)
    faces = Delaunay(points).simplices.astype(np.int64)
    clockwise = _signed_areas(points, faces) < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    faces = faces[_signed_areas(points, faces) > 1e-4 * spacing**2]  # slivers between collinear rim points
    return Mesh(points, faces)
