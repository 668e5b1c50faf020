"""The optimisers of NLopt, `nlopt:<ALGORITHM>`, from the prior median within the problem's box.

Names are NLopt's own: LD_* (local, with gradients), LN_* (local, without), GD_* and GN_* (global, which end
with the budget). Random algorithms draw their seed from the solver's generator, so every run can be repeated
and resumed.

Licence: NLopt's Python package is under the MIT licence; the library inside is as well, but for the code of Luksan's
algorithms (LD_LBFGS, LD_VAR1, LD_VAR2, LD_TNEWTON*), which is under the LGPL (2.1 or later). It is linked dynamically
and not distributed with this package.

References:
    Johnson, The NLopt nonlinear-optimization package, https://github.com/stevengj/nlopt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import nlopt
import numpy as np

from cusick_bench.problem import BudgetExceeded
from cusick_bench.sim.errors import did_you_mean
from cusick_bench.solvers.base import (
    Prediction,
    Progress,
    Solver,
    SolverError,
    prediction_at,
    require_at_least,
    require_positive,
)
from cusick_bench.solvers.incumbent import PENALTY, Incumbent
from cusick_bench.solvers.level_search import match_bending_level

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


# The nine algorithms of the benchmark; any other one of NLopt works as well, unless it is named below.
BENCHMARKED = (
    "LD_LBFGS",
    "LD_MMA",
    "LD_SLSQP",
    "LN_BOBYQA",
    "LN_COBYLA",
    "LN_SBPLX",
    "GN_DIRECT_L",
    "GN_CRS2_LM",
    "GN_ESCH",
)
# Algorithms that cannot be used here, by what follows LD_, LN_, GD_ or GN_ in their name, and why.
_UNUSABLE = {
    **dict.fromkeys(("AUGLAG", "AUGLAG_EQ", "MLSL", "MLSL_LDS"), "needs a second optimiser"),
    **dict.fromkeys(("STOGO", "STOGO_RAND"), "does not stop where the budget ends"),
    "AGS": "takes at most 10 numbers, fewer than a stiffness table has",
    "LBFGS_NOCEDAL": "is not in NLopt's library",
    "NEWUOA": "leaves the problem's box, in which LN_NEWUOA_BOUND stays",
}
# Algorithms that keep a quadratic model, a simplex or a population whose size grows with the dimension.
_DENSE = ("BOBYQA", "NEWUOA", "COBYLA", "NELDERMEAD", "PRAXIS", "SLSQP", "CRS2", "ISRES")
_MOST_DENSE = 2000  # numbers: 32 MB a table, and half a minute a step of LD_SLSQP, whose work grows with the cube


@dataclass(frozen=True)
class NloptSolver(Solver):
    """One algorithm of NLopt.

    Attributes:
        search: Drapes to spend on the bending level first (see `level_search`), of which the best is the start; 0
            starts at the prior median.
        step: First step of the gradient-free local algorithms [prior standard deviations]; LN_BOBYQA takes at most half
            of the box's width.
        tolerance: Relative change of loss and parameters at which local algorithms end.
    """

    search: int = 0
    step: float = 0.5
    tolerance: float = 1e-6
    algorithm: ClassVar[str]

    def __post_init__(self) -> None:
        require_at_least(self, 0, "search", "tolerance")
        require_positive(self, "step")

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        budget = problem.meter.budget
        if self.algorithm.startswith("G") and budget.forward_equivalents is None and budget.seconds is None:
            raise SolverError(f"{self.name} searches globally and ends with its budget only: give --budget")
        self._check_step(problem)
        incumbent = Incumbent(problem)
        finished = False
        with problem.meter.reserve(1):
            try:
                if self.search:
                    match_bending_level(incumbent, self.search)
                finished = self._optimise(incumbent, generator)
            except BudgetExceeded:
                pass
        return prediction_at(problem, incumbent.tau, finished=finished)

    def _check_step(self, problem: DrapeProblem) -> None:
        """Refuses a first step that BOBYQA refuses without a word: on either side there must be room for it."""
        lower, upper = problem.bounds
        most = float((upper - lower).min()) / 2
        if self.algorithm == "LN_BOBYQA" and self.step > most:
            raise SolverError(
                f"{self.name}'s step must be <= {most:g} prior standard deviations, half of the box's width, got "
                f"{self.step:g}; leave it out for the usual one"
            )

    def _optimise(self, incumbent: Incumbent, generator: np.random.Generator) -> bool:
        problem = incumbent.problem
        nlopt.srand(int(generator.integers(1, 2**31)))  # NLopt has one global generator
        optimiser = nlopt.opt(getattr(nlopt, self.algorithm), problem.dimension)
        lower, upper = problem.bounds
        optimiser.set_lower_bounds(lower)
        optimiser.set_upper_bounds(upper)
        optimiser.set_initial_step(self.step)
        objective = _Objective(incumbent, optimiser)
        optimiser.set_min_objective(objective)
        if self.algorithm.startswith("L"):
            optimiser.set_ftol_rel(self.tolerance)
            optimiser.set_xtol_rel(self.tolerance)
        failure: Exception | None = None
        try:
            optimiser.optimize(np.clip(incumbent.tau, lower, upper))
        except Exception as error:  # NLopt's own kinds differ between its versions
            failure = error
        if objective.stopped_by is not None:
            raise objective.stopped_by
        if failure is not None and not np.isfinite(incumbent.loss):
            raise SolverError(f"NLopt's {self.algorithm} failed from the start: {failure!r}") from failure
        return failure is None  # a search that ends in rounding errors leaves its incumbent


class _Objective:
    """NLopt's callback. Some algorithms go on after an exception, so it is kept until they have stopped.

    Attributes:
        stopped_by: What ended the search from within.
    """

    def __init__(self, incumbent: Incumbent, optimiser: nlopt.opt) -> None:
        self.incumbent, self.optimiser = incumbent, optimiser
        self.stopped_by: BaseException | None = None

    def __call__(self, tau: np.ndarray, gradient: np.ndarray) -> float:
        """Loss; fills `gradient` in place where it has any length."""
        if self.stopped_by is None:
            try:
                if gradient.size == 0:
                    return self.incumbent.value(np.array(tau))
                loss, gradient[:] = self.incumbent.value_and_gradient(np.array(tau))
                return loss
            except BaseException as error:
                self.stopped_by = error
                self.optimiser.force_stop()
        gradient[:] = 0
        return PENALTY


def _solver_of(algorithm: str) -> type[Solver]:
    """Makes the solver class of an algorithm."""
    words = nlopt.opt(getattr(nlopt, algorithm), 2).get_algorithm_name()
    attributes = {
        "name": f"nlopt:{algorithm}",
        "algorithm": algorithm,
        "needs_gradient": algorithm[1] == "D",
        "most_numbers": _MOST_DENSE if any(word in algorithm for word in _DENSE) else None,
        "summary": words,
        "reference": "Johnson, NLopt, https://github.com/stevengj/nlopt",
        "__doc__": f"NLopt's {algorithm}: {words}.",
        "__module__": __name__,
    }
    return dataclass(frozen=True)(type(f"Nlopt{algorithm}", (NloptSolver,), attributes))


_ALGORITHMS = tuple(name for name in dir(nlopt) if name[:3] in ("LD_", "LN_", "GD_", "GN_"))
_SOLVERS = {algorithm: _solver_of(algorithm) for algorithm in _ALGORITHMS if algorithm[3:] not in _UNUSABLE}


def nlopt_solver(algorithm: str) -> type[Solver]:
    """The solver class of an NLopt algorithm.

    Args:
        algorithm: NLopt's name, such as LN_BOBYQA.

    Returns:
        A subclass of `NloptSolver`.

    Raises:
        SolverError: NLopt has no such algorithm, or it cannot be used here.
    """
    if algorithm not in _ALGORITHMS:
        hint = did_you_mean(algorithm, _SOLVERS)
        raise SolverError(f"NLopt has no algorithm {algorithm!r}; {hint}use one of {', '.join(_SOLVERS)}")
    if algorithm not in _SOLVERS:
        raise SolverError(
            f"NLopt's {algorithm} cannot be used: it {_UNUSABLE[algorithm[3:]]}; use one of {', '.join(_SOLVERS)}"
        )
    return _SOLVERS[algorithm]
