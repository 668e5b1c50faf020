"""Gradient fit of one stretch and one bending table to the training silhouette, in log space.

Three stages, each from the best point so far: the bending level by drape coefficient (`level_search`), Adam,
which crosses the rough ground of folds that slip in and out of phase, and L-BFGS, which finishes.

References:
    Kingma, Ba, Adam: A Method for Stochastic Optimization, ICLR 2015.
    Liu, Nocedal, On the Limited Memory BFGS Method for Large Scale Optimization, Math. Programming 45, 1989.
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024 (the row HOMO of
    Table 1).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.optimize import minimize

from cusick_bench.problem import BudgetExceeded, DrapeProblem
from cusick_bench.solvers.base import Prediction, Progress, Solver, prediction_at
from cusick_bench.solvers.incumbent import PENALTY, Incumbent
from cusick_bench.solvers.level_search import match_bending_level


def adam(incumbent: Incumbent, *, steps: int, rate: float) -> None:
    """Adam within the problem's box, from the incumbent; after a failed drape it returns there at half the rate.

    Args:
        incumbent: Search to go on with.
        steps: Gradients to spend.
        rate: Step length [prior standard deviations], falling to a tenth along a cosine.
    """
    tau, (lower, upper) = incumbent.tau.copy(), incumbent.problem.bounds
    mean, square, age = np.zeros_like(tau), np.zeros_like(tau), 0
    for index in range(steps):
        loss, gradient = incumbent.value_and_gradient(tau)
        if loss >= PENALTY:
            tau, rate, age = incumbent.tau.copy(), rate / 2, 0
            mean[:], square[:] = 0, 0
            continue
        age += 1
        mean += 0.1 * (gradient - mean)
        square += 0.01 * (gradient**2 - square)
        decay = 0.1 + 0.45 * (1 + math.cos(math.pi * index / steps))
        step = (mean / (1 - 0.9**age)) / (np.sqrt(square / (1 - 0.99**age)) + 1e-12)
        tau = np.clip(tau - rate * decay * step, lower, upper)


def lbfgs(incumbent: Incumbent, *, iterations: int) -> bool:
    """L-BFGS within the problem's box from the incumbent.

    Returns:
        Whether it converged.
    """
    lower, upper = incumbent.problem.bounds
    result = minimize(
        incumbent.value_and_gradient,
        np.clip(incumbent.tau, lower, upper),
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(lower, upper, strict=True)),
        options={"maxiter": iterations, "maxls": 10, "ftol": 1e-7, "gtol": 1e-8},
    )
    return bool(result.success)


@dataclass(frozen=True)
class Homo(Solver):
    """Level search, then Adam, then L-BFGS.

    Attributes:
        search: Most drapes for the bending level.
        adam_steps: Gradients for Adam.
        adam_rate: Its step length [prior standard deviations].
        lbfgs_iterations: Most iterations of L-BFGS.
    """

    search: int = 8
    adam_steps: int = 50
    adam_rate: float = 0.6
    lbfgs_iterations: int = 60
    name: ClassVar[str] = "homo"
    summary: ClassVar[str] = "gradient fit of one stretch and one bending table (Adam, then L-BFGS)"
    reference: ClassVar[str] = "Gong, Mao, Wang, CVPR 2024, Table 1 HOMO; Kingma, Ba 2015; Liu, Nocedal 1989"
    needs_gradient: ClassVar[bool] = True

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        incumbent = Incumbent(problem)
        finished = False
        with problem.meter.reserve(1):
            try:
                match_bending_level(incumbent, self.search)
                adam(incumbent, steps=self.adam_steps, rate=self.adam_rate)
                finished = lbfgs(incumbent, iterations=self.lbfgs_iterations)
            except BudgetExceeded:
                pass
        return prediction_at(problem, incumbent.tau, finished=finished)
