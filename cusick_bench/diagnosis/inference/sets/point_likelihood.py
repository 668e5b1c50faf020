"""Log likelihoods of many points at once, for every size of the misfit: the inner loop of the posterior over sets."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba


@numba.njit(cache=True, fastmath=True)
def log_densities(
    left: Float[ndarray, "rows"],
    variance: Float[ndarray, "rows"],
    shift: Float[ndarray, "points rows"],
    added: Float[ndarray, "points rows"],
    misfit: Float[ndarray, "sizes rows"],
) -> Float[ndarray, "points sizes"]:
    """ln N(left - shift; 0, variance + added + misfit) but for a constant, summed over rows.

    Args:
        left: Residual that is to be explained.
        variance: Its variance without the point.
        shift: Shift by each point.
        added: Variance that each point adds.
        misfit: Variance of the misfit, for each of its sizes.

    Returns:
        Log densities of every point and size.
    """
    points, rows = shift.shape
    half = rows // 2
    result = np.empty((points, len(misfit)))
    squares, total = np.empty(rows), np.empty(rows)
    for point in range(points):
        for k in range(rows):
            squares[k] = (left[k] - shift[point, k]) ** 2
            total[k] = variance[k] + added[point, k]
        for size in range(len(misfit)):
            quadratic, first, last = 0.0, 1.0, 1.0  # two products of variances, far from overflow
            for k in range(half):
                v = total[k] + misfit[size, k]
                quadratic += squares[k] / v
                first *= v
            for k in range(half, rows):
                v = total[k] + misfit[size, k]
                quadratic += squares[k] / v
                last *= v
            result[point, size] = -0.5 * (quadratic + np.log(first) + np.log(last))
    return result
