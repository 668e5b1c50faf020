"""Quasi-random search: a scrambled Sobol sequence in the box. What any cleverer method must beat.

References:
    Sobol, On the distribution of points in a cube, USSR Comput. Math. Math. Phys. 7(4), 1967. Owen, Scrambling
    Sobol and Niederreiter-Xing points, J. Complexity 14(4), 1998.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.solvers.black_box.box import BoxSolver, Point, Points, Search


def sobol_points(dimension: int, generator: np.random.Generator) -> Iterator[Point]:
    """An endless scrambled Sobol sequence in the unit cube.

    Coordinates for which there are no direction numbers are drawn independently; for the few points of a search in so
    many coordinates that is no worse.

    Args:
        dimension: Number of coordinates.
        generator: Source of all randomness.

    Yields:
        Points of the unit cube, one after the other.
    """
    draw = _sequence(dimension, generator)
    while True:
        yield _with_rest(draw(1), dimension, generator)[0]


def sobol_block(count: int, dimension: int, generator: np.random.Generator) -> Points:
    """The first `count` points of such a sequence.

    Args:
        count: Number of points.
        dimension: Number of coordinates.
        generator: Source of all randomness.

    Returns:
        Points of the unit cube, one a row.
    """
    return _with_rest(_sequence(dimension, generator)(count), dimension, generator)


def _sequence(dimension: int, generator: np.random.Generator) -> Callable[[int], Points]:
    """A scrambled sequence in as many coordinates as there are direction numbers for, 21,201 at most."""
    import torch
    from torch.quasirandom import SobolEngine

    known = min(dimension, SobolEngine.MAXDIM)
    engine = SobolEngine(known, scramble=True, seed=int(generator.integers(2**31)))
    return lambda count: engine.draw(count, dtype=torch.float64).numpy()


def _with_rest(known: Points, dimension: int, generator: np.random.Generator) -> Float[np.ndarray, "points every"]:
    return np.hstack([known, generator.random((len(known), dimension - known.shape[1]))])


@dataclass(frozen=True)
class Sobol(BoxSolver):
    """The points of a scrambled Sobol sequence, one after the other."""

    name: ClassVar[str] = "sobol"
    summary: ClassVar[str] = "quasi-random search"
    reference: ClassVar[str] = "Sobol 1967; Owen 1998"

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Asks for the points of the sequence."""
        for point in sobol_points(dimension, generator):
            yield 2 * point - 1
