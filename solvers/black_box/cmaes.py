"""Covariance matrix adaptation evolution strategy, by the package `cma`.

From `DIAGONAL_FROM` coordinates on the covariance is diagonal (sep-CMA-ES): a full one takes D^2 numbers.

References:
    Hansen, Ostermeier, Completely Derandomized Self-Adaptation in Evolution Strategies, Evolutionary Computation 9(2),
    2001. Ros, Hansen, A Simple Modification in CMA-ES Achieving Linear Time and Space Complexity, PPSN X, 2008.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.black_box.box import BoxSolver, Search, digestible

DIAGONAL_FROM = 1000


@dataclass(frozen=True)
class CmaEs(BoxSolver):
    """CMA-ES from the centre of the box, which for a cloth is the prior median.

    Attributes:
        sigma: First step length [half widths of the box].
        population: Points a generation; 0 for 4 + 3 log D.
    """

    sigma: float = 0.3
    population: int = 0
    name: ClassVar[str] = "cmaes"
    summary: ClassVar[str] = "covariance matrix adaptation evolution strategy"
    reference: ClassVar[str] = "Hansen, Ostermeier 2001; Ros, Hansen 2008; package cma"

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise SolverError(f"sigma must be > 0 half widths of the box, got {self.sigma}")
        if self.population < 0 or self.population == 1:
            raise SolverError(f"population must be >= 2, or 0 for 4 + 3 log D, got {self.population}")

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Searches by generations, each from a normal distribution that adapts to the losses of the last."""
        import cma  # slow to import

        options: dict[str, Any] = {
            "bounds": [-1, 1],
            "popsize": self.population or 4 + int(3 * math.log(dimension)),
            "CMA_diagonal": dimension >= DIAGONAL_FROM,
            "randn": lambda *shape: generator.standard_normal(shape),
            "seed": math.nan,  # leaves numpy's global generator alone
            "signals_filename": "",  # no file of the working folder may steer a run
            "verbose": -9,
        }
        strategy = cma.CMAEvolutionStrategy(np.zeros(dimension), self.sigma, options)
        while not strategy.stop():
            points = strategy.ask()
            losses = []
            for point in points:
                losses.append((yield np.clip(point, -1, 1)))
            known = np.isfinite(losses)
            if not known.any():
                continue  # nothing is learned, and equal losses would end the search
            told = digestible(losses)
            if known.sum() == 1:  # else the only success would be told as a failure's equal
                told[~known] += 1.0
            strategy.tell(points, told.tolist())
