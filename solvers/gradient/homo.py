"""Gradient fit of one stretch and one bending table to the training silhouette, in log space.

From the best of the drapes by which the bending level with the training drape coefficient is sought (`level_search`),
rounds of Adam and L-BFGS (`descent`), each from the best point so far.

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024 (the row HOMO of
    Table 1).
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cusick_bench.problem import BudgetExceeded
from cusick_bench.solvers.base import Prediction, Progress, Solver, prediction_at, require_at_least, require_positive
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.level_search import match_bending_level

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


@dataclass(frozen=True)
class Homo(Solver):
    """Level search, then Adam and L-BFGS in turn.

    Attributes:
        search: Most drapes for the bending level.
        adam_steps: Gradients for Adam in a round.
        adam_rate: Its first step length [prior standard deviations].
        lbfgs_iterations: Most iterations of L-BFGS in a round.
    """

    search: int = 8
    adam_steps: int = 10
    adam_rate: float = 0.6
    lbfgs_iterations: int = 60
    name: ClassVar[str] = "homo"
    summary: ClassVar[str] = "gradient fit of one stretch and one bending table (Adam and L-BFGS in turn)"
    reference: ClassVar[str] = "Gong, Mao, Wang, CVPR 2024, Table 1 HOMO; Kingma, Ba 2015; Liu, Nocedal 1989"
    needs_gradient: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_at_least(self, 0, "search", "adam_steps", "lbfgs_iterations")
        require_positive(self, "adam_rate")

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        from cusick_bench.solvers.descent import rounds

        incumbent = Incumbent(problem)
        finished = False
        with problem.meter.reserve(1), contextlib.suppress(BudgetExceeded):
            match_bending_level(incumbent, self.search)
            rounds(incumbent, steps=self.adam_steps, rate=self.adam_rate, iterations=self.lbfgs_iterations)
            finished = True
        return prediction_at(problem, incumbent.tau, finished=finished)
