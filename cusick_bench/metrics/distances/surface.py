"""Triangle surfaces prepared for nearest-point queries: bounding-volume tree, exact distances to triangles.

References:
    C. Ericson. Real-Time Collision Detection (2005), Section 5.1.5 (closest point on a triangle), Chapter 6
    (trees).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.metrics.errors import MetricError
from cusick_bench.sim.kernel_cache import numba

_LEAF = 4  # triangles in a leaf of the tree
_STACK = 128  # depth-first stack; a balanced tree of 2^60 leaves would need 61


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle surface in space.

    Attributes:
        vertices: Positions [m].
        faces: Vertex indices of the triangles.

    Raises:
        MetricError: Wrong shapes, no triangles, indices out of range, or positions that are not finite.
    """

    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            raise MetricError(f"a surface needs (V, 3) positions and (F, 3) faces, got {vertices.shape}, {faces.shape}")
        if len(faces) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
            raise MetricError("a surface needs triangles whose vertex indices exist; check the faces")
        if not np.isfinite(vertices).all():
            raise MetricError("vertex positions must be finite; the drape diverged or its file is damaged")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @classmethod
    def of(cls, mesh: "Surface | trimesh.Trimesh") -> "Surface":
        """Takes a mesh as it is; a `Surface` is returned unchanged, so that its tree is built only once.

        Args:
            mesh: A triangle mesh.

        Returns:
            The surface.
        """
        return mesh if isinstance(mesh, Surface) else cls(np.asarray(mesh.vertices), np.asarray(mesh.faces))

    @cached_property
    def tree(
        self,
    ) -> tuple[Float[ndarray, "faces 3 3"], Float[ndarray, "nodes 2 3"], Int[ndarray, "nodes 2"]]:
        """Bounding-volume tree: triangle corners in leaf order [m], boxes [m], ranges of triangles.

        Node i has the children 2 i + 1 and 2 i + 2 and the triangles ranges[i, 0] <= index < ranges[i, 1].
        """
        return _build(self.vertices[self.faces])

    def distance(self, points: Float[ndarray, "points 3"]) -> Float[ndarray, "points"]:
        """Exact distance of every point to the surface [m]."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        return _distances(points, *self.tree)


@numba.njit(cache=True)
def _build(corners):
    """Splits at the median along the longest side of the centroids' box until the leaves are small."""
    levels = max(0, int(np.ceil(np.log2(max(1.0, len(corners) / _LEAF)))))
    leaves = 2**levels
    ranges = np.zeros((2 * leaves - 1, 2), dtype=np.int64)
    ranges[0, 1] = len(corners)
    order = np.arange(len(corners))
    centroids = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
    for node in range(leaves - 1):
        start, stop = ranges[node]
        part = order[start:stop].copy()
        middle = (start + stop) // 2
        if len(part) > 1:
            lengths = np.empty(3)
            for axis in range(3):
                lengths[axis] = np.ptp(centroids[part, axis])
            axis = np.argmax(lengths)
            order[start:stop] = part[np.argsort(centroids[part, axis])]
        ranges[2 * node + 1, 0], ranges[2 * node + 1, 1] = start, middle
        ranges[2 * node + 2, 0], ranges[2 * node + 2, 1] = middle, stop
    corners = corners[order]
    boxes = np.empty((len(ranges), 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for node in range(len(ranges) - 1, -1, -1):
        if node < leaves - 1:
            left, right = boxes[2 * node + 1], boxes[2 * node + 2]
            boxes[node, 0] = np.minimum(left[0], right[0])
            boxes[node, 1] = np.maximum(left[1], right[1])
            continue
        for index in range(ranges[node, 0], ranges[node, 1]):
            for corner in range(3):
                boxes[node, 0] = np.minimum(boxes[node, 0], corners[index, corner])
                boxes[node, 1] = np.maximum(boxes[node, 1], corners[index, corner])
    return corners, boxes, ranges


@numba.njit(cache=True, inline="always")
def _dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz


@numba.njit(cache=True)
def squared_distance_to_triangle(point, triangle):
    """Squared distance of a point to a triangle; exact for slivers and degenerate triangles too.

    Args:
        point: A point [m].
        triangle: Three corners, one a row [m].

    Returns:
        Squared distance [m2].
    """
    px, py, pz = point
    ax, ay, az = triangle[0, 0] - px, triangle[0, 1] - py, triangle[0, 2] - pz
    bx, by, bz = triangle[1, 0] - px, triangle[1, 1] - py, triangle[1, 2] - pz
    cx, cy, cz = triangle[2, 0] - px, triangle[2, 1] - py, triangle[2, 2] - pz
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = _dot(nx, ny, nz, nx, ny, nz)
    if area > 0.0:
        # Signs of the three sub-triangles seen along the normal: all positive = the foot lies inside.
        first = _dot(by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx, nx, ny, nz)
        second = _dot(cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax, nx, ny, nz)
        third = _dot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx, nx, ny, nz)
        if first >= 0.0 and second >= 0.0 and third >= 0.0:
            height = _dot(ax, ay, az, nx, ny, nz)
            return height * height / area
    result = _squared_distance_to_segment(ax, ay, az, bx, by, bz)
    result = min(result, _squared_distance_to_segment(bx, by, bz, cx, cy, cz))
    return min(result, _squared_distance_to_segment(cx, cy, cz, ax, ay, az))


@numba.njit(cache=True, inline="always")
def _squared_distance_to_segment(ax, ay, az, bx, by, bz):
    """Squared distance of the origin to the segment a-b."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    length = _dot(ux, uy, uz, ux, uy, uz)
    along = 0.0
    if length > 0.0:
        along = min(1.0, max(0.0, -_dot(ax, ay, az, ux, uy, uz) / length))
    x, y, z = ax + along * ux, ay + along * uy, az + along * uz
    return _dot(x, y, z, x, y, z)


@numba.njit(cache=True)
def _squared_distance_to_box(point, box):
    result = 0.0
    for axis in range(3):
        gap = max(box[0, axis] - point[axis], point[axis] - box[1, axis])
        if gap > 0.0:
            result += gap * gap
    return result


@numba.njit(cache=True)
def nearest(point, triangles, boxes, ranges, guess):
    """Finds the triangle of a surface that is nearest to a point, by descent through its tree.

    Args:
        point: A point [m].
        triangles: Corners of the triangles in the order of the tree [m].
        boxes: Bounding boxes of the nodes of the tree [m].
        ranges: First and last triangle of each node.
        guess: A triangle that is probably near: a good guess prunes most of the tree.

    Returns:
        Squared distance [m2], and the index of the triangle.
    """
    best, winner = squared_distance_to_triangle(point, triangles[guess]), guess
    first_leaf = len(boxes) // 2
    stack = np.empty(_STACK, dtype=np.int64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _squared_distance_to_box(point, boxes[node]) >= best:
            continue
        if node >= first_leaf:
            for index in range(ranges[node, 0], ranges[node, 1]):
                squared = squared_distance_to_triangle(point, triangles[index])
                if squared < best:
                    best, winner = squared, index
            continue
        near, far = 2 * node + 1, 2 * node + 2
        if _squared_distance_to_box(point, boxes[near]) > _squared_distance_to_box(point, boxes[far]):
            near, far = far, near
        stack[top] = far
        stack[top + 1] = near
        top += 2
    return best, winner


@numba.njit(cache=True)
def _distances(points, triangles, boxes, ranges):
    result = np.empty(len(points))
    guess = 0
    for index in range(len(points)):
        squared, guess = nearest(points[index], triangles, boxes, ranges, guess)
        result[index] = np.sqrt(squared)
    return result
