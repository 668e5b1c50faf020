"""Test functions of optimisers, hidden in many dimensions: only a few coordinates of [-1, 1]^D matter.

References:
    Branin, Widely convergent method for finding multiple solutions of simultaneous nonlinear equations, IBM J. Research
    and Development 16(5), 1972. Dixon, Szego, The global optimization problem: an introduction, Towards Global
    Optimization 2, 1978 (Hartmann's function of six variables).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cusick_bench.sim.errors import CusickError

NUMERICS_VERSION = 1  # raised when a function's numbers change: see runner/numerics.py

Point = Float[np.ndarray, " dimension"]

_HARTMANN_HEIGHT = np.array([1.0, 1.2, 3.0, 3.2])
_HARTMANN_WIDTH = np.array(
    [
        [10.0, 3.0, 17.0, 3.5, 1.7, 8.0],
        [0.05, 10.0, 17.0, 0.1, 8.0, 14.0],
        [3.0, 3.5, 1.7, 10.0, 17.0, 8.0],
        [17.0, 8.0, 0.05, 10.0, 0.1, 14.0],
    ]
)
_HARTMANN_CENTRE = 1e-4 * np.array(
    [
        [1312, 1696, 5569, 124, 8283, 5886],
        [2329, 4135, 8307, 3736, 1004, 9991],
        [2348, 1451, 3522, 2883, 3047, 6650],
        [4047, 8828, 8732, 5743, 1091, 381],
    ]
)


def branin(unit: Float[np.ndarray, "2"]) -> float:
    """Branin's function, its domain [-5, 10] x [0, 15] scaled to the unit square.

    Args:
        unit: Point of the unit square.

    Returns:
        Value.
    """
    x, y = 15 * unit[0] - 5, 15 * unit[1]
    valley = y - 5.1 / (4 * math.pi**2) * x**2 + 5 / math.pi * x - 6
    return float(valley**2 + 10 * (1 - 1 / (8 * math.pi)) * math.cos(x) + 10)


def hartmann6(unit: Float[np.ndarray, "6"]) -> float:
    """Hartmann's function of six variables in [0, 1].

    Args:
        unit: Point of the unit cube of six dimensions.

    Returns:
        Value.
    """
    distances = (_HARTMANN_WIDTH * (unit - _HARTMANN_CENTRE) ** 2).sum(1)
    return float(-(_HARTMANN_HEIGHT * np.exp(-distances)).sum())


class BenchmarkError(CusickError, ValueError):
    """A benchmark is asked for something that it cannot measure."""


@dataclass(frozen=True)
class AnalyticFunction:
    """A function of the unit cube.

    Attributes:
        value: To be minimised.
        coordinates: Coordinates of the unit cube.
        optimum: Least value.
        evaluations: As many as published comparisons spend.
    """

    value: Callable[[np.ndarray], float]
    coordinates: int
    optimum: float
    evaluations: int


FUNCTIONS = {
    "branin": AnalyticFunction(branin, coordinates=2, optimum=0.397887, evaluations=50),
    "hartmann6": AnalyticFunction(hartmann6, coordinates=6, optimum=-3.322368, evaluations=200),
}


@dataclass(frozen=True)
class HiddenFunction:
    """A test function of some coordinates of [-1, 1]^D, whatever the others are.

    Attributes:
        function: The test function.
        active: The coordinates that matter.
    """

    function: AnalyticFunction
    active: Int[np.ndarray, " coordinates"]

    def __call__(self, point: Point) -> float:
        """Value at a point of [-1, 1]^D."""
        return self.function.value((point[self.active] + 1) / 2)


def hide(name: str, dimension: int, generator: np.random.Generator) -> HiddenFunction:
    """Hides a test function among D coordinates, at random places.

    Args:
        name: Name in `FUNCTIONS`.
        dimension: D.
        generator: Chooses the coordinates that matter.

    Returns:
        The function of D coordinates.

    Raises:
        BenchmarkError: The function is unknown, or has more coordinates than D.
    """
    if name not in FUNCTIONS:
        raise BenchmarkError(f"unknown test function {name!r}; use one of {', '.join(FUNCTIONS)}")
    function = FUNCTIONS[name]
    if dimension < function.coordinates:
        raise BenchmarkError(f"{name} has {function.coordinates} coordinates, got dimension {dimension}; raise it")
    return HiddenFunction(function, generator.choice(dimension, size=function.coordinates, replace=False))
