"""A trust region for Bayesian optimisation: a box around the best point that follows success and failure.

The side doubles after `SUCCESSES` improvements in a row and halves after as many failures in a row as the method
tolerates. Within the region a Thompson sample of the process picks the next point among candidates that differ from
the best point in about `MOVED` coordinates.

References:
    Eriksson, Pearce, Gardner, Turner, Poloczek, Scalable Global Optimization via Local Bayesian Optimization,
    NeurIPS 2019 (Sec. 2 and its supplement for the constants).
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from cusick_bench.solvers.black_box.box import Point, Points
from cusick_bench.solvers.black_box.sobol import sobol_block

if TYPE_CHECKING:
    from cusick_bench.solvers.bayesian_optimisation.gaussian_process import Hyperparameters


FIRST, SHORTEST, LONGEST = 0.8, 0.5**7, 1.6  # side lengths of the region [sides of the unit cube]
SUCCESSES = 3
IMPROVEMENT = 1e-3  # least relative improvement that counts as a success
MOVED = 20  # average number of coordinates in which candidates differ from the best point


@dataclass(frozen=True)
class TrustRegion:
    """Side length of the region, and successes and failures since it last changed.

    Attributes:
        tolerance: Failures in a row that halve it.
        length: Side for a coordinate of average length scale.
        successes: Improvements in a row.
        failures: Points in a row that were no improvement.
    """

    tolerance: int
    length: float = FIRST
    successes: int = 0
    failures: int = 0

    @property
    def exhausted(self) -> bool:
        """Whether the region is too small to go on with."""
        return self.length < SHORTEST

    def after(self, improved: bool) -> TrustRegion:
        """The region after another point.

        Args:
            improved: Whether that point was an improvement.

        Returns:
            The region to go on with.
        """
        if improved and self.successes + 1 == SUCCESSES:
            return replace(self, length=min(2 * self.length, LONGEST), successes=0, failures=0)
        if not improved and self.failures + 1 >= self.tolerance:
            return replace(self, length=self.length / 2, successes=0, failures=0)
        if improved:
            return replace(self, successes=self.successes + 1, failures=0)
        return replace(self, successes=0, failures=self.failures + 1)


def local_search(
    points: Points, losses: list[float], region: TrustRegion, candidates: int, generator: np.random.Generator
) -> Generator[Point, float, tuple[Points, list[float]]]:
    """Searches [-1, 1]^d until its trust region is exhausted.

    Args:
        points: What is known already, in the unit cube.
        losses: Losses of these points.
        region: To start with.
        candidates: Most points to choose from.
        generator: Source of all randomness.

    Returns:
        All points, in the unit cube, and their losses.
    """
    from cusick_bench.solvers.bayesian_optimisation.gaussian_process import fit, local_torch, thompson

    last: Hyperparameters | None = None
    while not region.exhausted:
        with local_torch(int(generator.integers(2**31))):
            surrogate = fit(points, losses, covariance="local", last=last)
            last = surrogate.hyperparameters
            centre = points[int(np.argmin(losses))]
            offered = candidates_around(centre, surrogate.lengthscale, region.length, candidates, generator)
            point = thompson(surrogate, offered)
        loss = yield 2 * point - 1
        best = min(losses)
        region = region.after(loss < best - IMPROVEMENT * abs(best) if np.isfinite(best) else np.isfinite(loss))
        points, losses = np.vstack([points, point]), [*losses, loss]
    return points, losses


def candidates_around(
    centre: Point, lengthscale: Float[np.ndarray, " scales"], length: float, most: int, generator: np.random.Generator
) -> Points:
    """Quasi-random points of the region, each with most coordinates left at the centre's.

    The region's sides are proportional to the length scales, its volume is length^d.

    Args:
        centre: Best point so far, in the unit cube.
        lengthscale: Length scales of the process, one a coordinate or one for all.
        length: Side of the region for a coordinate of average length scale.
        most: Most points.
        generator: Source of all randomness.

    Returns:
        The points, in the unit cube.
    """
    from cusick_bench.solvers.bayesian_optimisation.gaussian_process import MOST_NUMBERS

    dimension = len(centre)
    count = int(max(min(100 * dimension, most, MOST_NUMBERS / dimension), 2))
    sides = length * lengthscale / np.exp(np.log(lengthscale).mean())
    lower, upper = np.clip(centre - sides / 2, 0, 1), np.clip(centre + sides / 2, 0, 1)
    moved = generator.random((count, dimension)) < min(1.0, MOVED / dimension)
    moved[np.arange(count), generator.integers(dimension, size=count)] = True
    return np.where(moved, lower + (upper - lower) * sobol_block(count, dimension, generator), centre)
