"""Bayesian optimisation in a box: a Sobol design, then the point of largest log expected improvement, again and again.

The loop that `vanilla-bo`, `rembo` and `hesbo` share.
"""

from __future__ import annotations

from collections.abc import Generator
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.black_box.box import Point, Points, Search
from cusick_bench.solvers.black_box.sobol import sobol_points

if TYPE_CHECKING:
    from cusick_bench.solvers.bayesian_optimisation.gaussian_process import Hyperparameters


def bayesian_search(dimension: int, initial: int, generator: np.random.Generator) -> Search:
    """Searches [-1, 1]^d.

    Args:
        dimension: Number of coordinates d.
        initial: Points of the Sobol design.
        generator: Source of all randomness.

    Yields:
        Points of [-1, 1]^d; each is to be answered by its loss.
    """
    from cusick_bench.solvers.bayesian_optimisation.gaussian_process import fit, local_torch, most_promising

    points, losses = yield from design(dimension, initial, generator)
    last: Hyperparameters | None = None
    while True:
        with local_torch(int(generator.integers(2**31))):
            surrogate = fit(points, losses, last=last)
            last = surrogate.hyperparameters
            point = most_promising(surrogate)
        points = np.vstack([points, point])
        losses.append((yield 2 * point - 1))


def design(
    dimension: int, count: int, generator: np.random.Generator
) -> Generator[Point, float, tuple[Points, list[float]]]:
    """Asks for the first points of a Sobol sequence.

    Args:
        dimension: Number of coordinates.
        count: Number of points.
        generator: Source of all randomness.

    Returns:
        The points, in the unit cube, and their losses.
    """
    points = np.stack(list(islice(sobol_points(dimension, generator), count)))
    losses = []
    for point in points:
        losses.append((yield 2 * point - 1))
    return points, losses


def check_initial(name: str, initial: int) -> None:
    """Refuses a design that is too small to fit a process to.

    Args:
        name: Name of the solver.
        initial: Number of points of its design.

    Raises:
        SolverError: The design has fewer than two points.
    """
    if initial < 2:
        raise SolverError(f"{name} needs at least 2 initial points to fit a process to, got initial={initial}")
