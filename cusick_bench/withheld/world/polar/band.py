"""Cholesky factorisation of a symmetric band matrix, column by column; the same bits on any number of threads."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba


@numba.njit(cache=True)
def factorise(band: Float[ndarray, "size width"]) -> bool:
    """Replaces a matrix A by its factor L, A = L L^T.

    Args:
        band: A[j + d, j] at [j, d], zero beyond the last row; changed into L.

    Returns:
        Whether A is positive definite; otherwise nothing in `band` is of use.
    """
    size, width = band.shape
    for j in range(size):
        column = band[j]
        if not column[0] > 0:
            return False
        column /= np.sqrt(column[0])
        for k in range(1, min(width, size - j)):
            factor = column[k]
            if factor != 0:
                target = band[j + k]
                for d in range(width - k):
                    target[d] -= factor * column[k + d]
    return True


@numba.njit(cache=True)
def solve(band: Float[ndarray, "size width"], right: Float[ndarray, "size"]) -> None:
    """Solves L L^T x = right in place.

    Args:
        band: The factor.
        right: Right-hand side; changed into the solution.
    """
    size, width = band.shape
    for j in range(size):
        right[j] /= band[j, 0]
        for d in range(1, min(width, size - j)):
            right[j + d] -= band[j, d] * right[j]
    for j in range(size - 1, -1, -1):
        total = right[j]
        for d in range(1, min(width, size - j)):
            total -= band[j, d] * right[j + d]
        right[j] = total / band[j, 0]
