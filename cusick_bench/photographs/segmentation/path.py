"""The outline as the best closed path around the plate, by dynamic programming over angles and radii."""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba

_FARTHEST = 12  # largest number of columns between neighbouring angles of the path


@numba.njit(cache=True)
def _best(cost: ndarray, stiffness: float, farthest: int) -> ndarray:
    rows, columns = cost.shape
    came = np.zeros((rows, columns), np.int32)
    total = cost[0].copy()
    for row in range(1, rows):
        following = np.empty(columns)
        for column in range(columns):
            least, place = np.inf, column
            for other in range(max(0, column - farthest), min(columns, column + farthest + 1)):
                step = abs(other - column)
                value = total[other] + stiffness * step * (1.0 + 0.15 * step)
                if value < least:
                    least, place = value, other
            following[column] = least + cost[row, column]
            came[row, column] = place
        total = following
    path = np.zeros(rows, np.int64)
    path[rows - 1] = np.argmin(total)
    for row in range(rows - 1, 0, -1):
        path[row - 1] = came[row, path[row]]
    return path


def closed_path(cost: Float[ndarray, "angles radii"], stiffness: float) -> Int[ndarray, " angles"]:
    """Finds the cheapest closed path.

    Args:
        cost: Cost of an outline at each place.
        stiffness: Price of a column's change from one angle to the next.

    Returns:
        Column at each angle.
    """
    count = len(cost)
    half = count // 2
    twice = np.concatenate([cost[-half:], cost, cost[:half]]).astype(np.float64)
    return _best(np.ascontiguousarray(twice), stiffness, _FARTHEST)[half : half + count]
