"""The best of draws from the prior."""

from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cusick_bench import BudgetExceeded, DrapeProblem
from cusick_bench.solvers.base import Prediction, Progress, Solver, prediction_at
from cusick_bench.solvers.incumbent import Incumbent


@dataclass(frozen=True)
class RandomSearch(Solver):
    """The best of draws from the prior."""

    name: ClassVar[str] = "random-search"
    summary: ClassVar[str] = "best of prior draws"
    reference: ClassVar[str] = "Bergstra, Bengio, JMLR 2012"

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        incumbent = Incumbent(problem)  # keeps the best point
        with problem.meter.reserve(1), suppress(BudgetExceeded):  # a drape is kept for the answer
            while True:
                incumbent.value(problem.sample_prior(generator))
        return prediction_at(problem, incumbent.tau, finished=False)  # it never ends by itself
