"""3-vectors for compiled kernels."""

import numba

CHUNKS = 32
"""Elements are shared out in a fixed number of chunks, so that results do not depend on the number of threads."""


@numba.njit(cache=True, inline="always")
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True, inline="always")
def difference(x, first, second, out):
    for axis in range(3):
        out[axis] = x[first, axis] - x[second, axis]


@numba.njit(cache=True, inline="always")
def cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
