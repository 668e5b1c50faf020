"""Answers of solvers to the toy problem."""

import numpy as np
from toy_problem import toy_problem

from cusick_bench.problem import DrapeProblem
from cusick_bench.solvers.base import HeldOut, Oracle, Prediction
from cusick_bench.solvers.registry import make_solver


def posed(name: str, **settings) -> DrapeProblem:
    """The toy problem in the space that a solver is about, at rest where it needs the drape's shape."""
    solver = make_solver(name)
    mode = "equilibrium" if solver.needs_mesh else "drop"
    return toy_problem(space=solver.space or "homo", mode=mode, **settings)


def answer_of(text: str, problem: DrapeProblem, heldout: HeldOut | None = None, seed: int = 0) -> Prediction:
    solver = make_solver(text)
    if isinstance(solver, Oracle) and heldout is not None:
        solver = solver.revealing(heldout)
    return solver.solve(problem, np.random.default_rng(seed))
