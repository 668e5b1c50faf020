"""Gradient-free minimisation in the box [-1, 1]^D, independent of the function that is minimised.

A search is a generator: it yields a point and is sent that point's loss, inf where the point failed. So the same
code minimises the misfit of a drape (`BoxSolver.solve`) and a test function (`run_search`).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from cusick_bench.problem import BudgetExceeded
from cusick_bench.solvers.base import Prediction, Progress, Solver, SolverError, prediction_at
from cusick_bench.solvers.incumbent import PENALTY, Incumbent

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


Point = Float[np.ndarray, " dimension"]
Points = Float[np.ndarray, "points dimension"]
Search = Generator[Point, float, None]

# Number of evaluations that a method may plan with where the budget is given in seconds only.
DEFAULT_EVALUATIONS = 500


def run_search(search: Search, function: Callable[[Point], float], evaluations: float = math.inf) -> bool:
    """Minimises a function by a search.

    Args:
        search: Yields points of [-1, 1]^D.
        function: Gives the loss of a point, inf where there is none; may raise to end the search.
        evaluations: Most points to ask for.

    Returns:
        Whether the search ended by itself.
    """
    asked = 0
    try:
        point = next(search)
        while asked < evaluations:
            loss = function(point)
            asked += 1
            if asked < evaluations:
                point = search.send(loss)
    except StopIteration:
        return True
    finally:
        search.close()
    return False


def digestible(losses: Sequence[float]) -> Float[np.ndarray, " evaluations"]:
    """Losses with failures set to the worst success: bad enough to be avoided, but no outlier that hides the others.

    Args:
        losses: Losses, inf where a point failed.

    Returns:
        Finite losses; 0 where all failed.
    """
    values = np.array(losses, dtype=np.float64)
    known = np.isfinite(values)
    return np.where(known, values, values[known].max() if known.any() else 0.0)


@dataclass(frozen=True)
class BoxSolver(Solver):
    """A gradient-free method that searches the problem's box, scaled to [-1, 1]^D."""

    @property
    def drapes_of_design(self) -> int:
        return getattr(self, "initial", 0)

    @abstractmethod
    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Starts a search.

        Args:
            dimension: Number of coordinates D.
            evaluations: Number of evaluations that it may expect to be granted.
            generator: Source of all randomness.

        Yields:
            Points of [-1, 1]^D; each is to be answered by its loss.
        """

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        budget = problem.meter.budget
        if budget.forward_equivalents is None and budget.seconds is None:
            raise SolverError(f"{self.name} ends with its budget only: give --budget")
        affordable = DEFAULT_EVALUATIONS
        if budget.forward_equivalents is not None:
            affordable = max(int(budget.forward_equivalents) - 1, 1)
        search = self.search(problem.dimension, affordable, generator)
        incumbent = Incumbent(problem)
        lower, upper = problem.bounds
        centre, half = (lower + upper) / 2, (upper - lower) / 2

        def misfit(point: Point) -> float:
            loss = incumbent.value(centre + half * point)
            progress(f"choosing drape {problem.meter.forward + 1}", problem.meter.share)
            return math.inf if loss >= PENALTY else loss

        finished = False
        with problem.meter.reserve(1), suppress(BudgetExceeded):
            finished = run_search(search, misfit)
        return prediction_at(problem, incumbent.tau, finished=finished)
