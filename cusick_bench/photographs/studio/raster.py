"""Which triangle of a mesh every pixel sees, and where in it: a depth buffer."""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba


@numba.njit(cache=True)
def _fill(
    corners: ndarray, depths: ndarray, faces: ndarray, face_of: ndarray, weights: ndarray, nearest: ndarray
) -> None:
    """Draws the triangles into `face_of`, `weights` and `nearest`, the depth of what is drawn so far."""
    height, width = face_of.shape
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, bx, by, cx, cy = (
            corners[a, 0],
            corners[a, 1],
            corners[b, 0],
            corners[b, 1],
            corners[c, 0],
            corners[c, 1],
        )
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:
            continue
        first, last = max(0, int(np.ceil(min(ax, bx, cx)))), min(width - 1, int(np.floor(max(ax, bx, cx))))
        top, bottom = max(0, int(np.ceil(min(ay, by, cy)))), min(height - 1, int(np.floor(max(ay, by, cy))))
        for row in range(top, bottom + 1):
            for column in range(first, last + 1):
                wb = ((column - ax) * (cy - ay) - (cx - ax) * (row - ay)) / area
                wc = ((bx - ax) * (row - ay) - (column - ax) * (by - ay)) / area
                wa = 1.0 - wb - wc
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                depth = wa * depths[a] + wb * depths[b] + wc * depths[c]
                if depth < nearest[row, column]:
                    nearest[row, column] = depth
                    face_of[row, column] = face
                    weights[row, column, 0], weights[row, column, 1], weights[row, column, 2] = wa, wb, wc


def rasterise(
    corners: Float[ndarray, "vertices 2"],
    depths: Float[ndarray, " vertices"],
    faces: Int[ndarray, "faces 3"],
    size: tuple[int, int],
) -> tuple[Int[ndarray, "height width"], Float[ndarray, "height width 3"]]:
    """Finds the nearest triangle behind each pixel.

    Args:
        corners: Columns and rows of the vertices [px].
        depths: Their distances from the camera [m].
        faces: Vertex indices of each triangle.
        size: Width and height of the picture [px].

    Returns:
        Triangle of every pixel, -1 for none, and its barycentric coordinates there.
    """
    face_of = np.full((size[1], size[0]), -1, np.int32)
    weights = np.zeros((size[1], size[0], 3), np.float32)
    nearest = np.full((size[1], size[0]), np.inf, np.float32)
    _fill(
        np.ascontiguousarray(corners), np.ascontiguousarray(depths), faces.astype(np.int64), face_of, weights, nearest
    )
    return face_of, weights
