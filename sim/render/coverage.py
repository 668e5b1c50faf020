"""Exact pixel coverage of a projected mesh, and its exact gradient.

The value of a pixel is the area of (union of projected triangles) intersected with the pixel's unit square, a smooth
function of the vertices as long as the outline's topology stays. It follows from the outline by Green's theorem, piece
by piece, as font rasterisers do it.

Only normal motion of the outline changes the area (Reynolds' transport theorem). For L = sum_p W_p A_p,

    dL/dx_k = -sum over pieces of sign * integral of W(x(y), y) phi_k(y) dy,

with phi_k the linear weight of end k on its edge. The y-gradient comes from the same sweep of the transposed plane,
which keeps every term well conditioned: edges along the sweep line add nothing.

References:
    T.-M. Li, M. Aittala, F. Durand, J. Lehtinen. Differentiable Monte Carlo Ray Tracing through Edge Sampling.
    ACM Transactions on Graphics 37 (2018), Eq. 4-5 (the boundary integral, here in closed form).
"""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.render.outline import Outline, outline


@numba.njit(nogil=True)  # a generator that is itself cached cannot be compiled into a second kernel by a later process
def _columns(a, b, bottom, top, columns):
    """Cuts a piece of edge a-b at column borders: yields (column, from y, to y, mean x).

    Column -1 stands for all that is left of the image, column `columns` for all that is right of it.
    """
    slope = (b[0] - a[0]) / (b[1] - a[1])
    first, last = a[0] + (bottom - a[1]) * slope, a[0] + (top - a[1]) * slope
    left, right = min(first, last), max(first, last)
    low = int(min(max(np.floor(left), -1), columns))
    high = int(min(max(np.floor(right), -1), columns))
    for column in range(low, high + 1):
        x0 = left if column == low else float(column)
        x1 = right if column == high else column + 1.0
        y0 = bottom + (top - bottom) * ((x0 - first) / (last - first) if low < high else 0.0)
        y1 = bottom + (top - bottom) * ((x1 - first) / (last - first) if low < high else 1.0)
        yield column, min(y0, y1), max(y0, y1), 0.5 * (x0 + x1)


@numba.njit(cache=True, nogil=True)
def _areas(points, row, ends, span, sign, columns, image):
    """Kernel of `pixel_areas`."""
    rows = image.shape[0]
    begun = np.zeros((rows, columns + 1))  # what a piece adds to every pixel to its right
    for i in range(len(row)):
        a, b = points[ends[i, 0]], points[ends[i, 1]]
        for column, y0, y1, x in _columns(a, b, span[i, 0], span[i, 1], columns):
            amount = sign[i] * (y1 - y0)
            if column < columns:
                begun[row[i], column + 1] += amount
            if 0 <= column < columns:
                image[row[i], column] += amount * (column + 1 - x)
    for r in range(rows):
        covered = 0.0
        for column in range(columns):
            covered += begun[r, column]
            image[r, column] = min(max(image[r, column] + covered, 0.0), 1.0)


@numba.njit(cache=True, nogil=True)
def _gradient(points, row, ends, span, sign, weight, gradient):
    """Kernel of `area_gradient`."""
    columns = weight.shape[1]
    for i in range(len(row)):
        a, b = points[ends[i, 0]], points[ends[i, 1]]
        for column, y0, y1, _ in _columns(a, b, span[i, 0], span[i, 1], columns):
            if 0 <= column < columns:
                moved = sign[i] * weight[row[i], column] * (y1 - y0)
                upper = (0.5 * (y0 + y1) - a[1]) / (b[1] - a[1])
                gradient[ends[i, 0]] -= moved * (1 - upper)
                gradient[ends[i, 1]] -= moved * upper


def pixel_areas(
    points: Float[ndarray, "vertices 2"], pieces: Outline, rows: int, columns: int
) -> Float[ndarray, "rows columns"]:
    """Area of every pixel inside an outline, in [0, 1].

    Args:
        points: Vertices (x, y) [px].
        pieces: Outline of the triangles.
        rows: Height of the image [px].
        columns: Width of the image [px].

    Returns:
        Areas [px2].
    """
    image = np.zeros((rows, columns))
    _areas(points, *pieces, columns, image)
    return image


def area_gradient(
    points: Float[ndarray, "vertices 2"],
    faces: Int[ndarray, "faces 3"],
    pieces: Outline,
    weight: Float[ndarray, "rows columns"],
) -> Float[ndarray, "vertices 2"]:
    """Derivatives of sum(weight * pixel areas) to the vertices.

    Args:
        points: Vertices (x, y) [px].
        faces: Vertex indices.
        pieces: Their outline.
        weight: Weights of the pixels.

    Returns:
        Derivatives to x and y.
    """
    gradient = np.zeros((2, len(points)))
    _gradient(points, *pieces, np.ascontiguousarray(weight), gradient[0])
    transposed = np.ascontiguousarray(points[:, ::-1])
    across = outline(transposed, faces, weight.shape[1])
    _gradient(transposed, *across, np.ascontiguousarray(weight.T), gradient[1])
    return gradient.T
