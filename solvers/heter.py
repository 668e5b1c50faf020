"""Gradient fit of one stretch table a face and one bending table a hinge: 241,734 numbers on 2699 vertices.

One silhouette does not determine as many numbers, so the fit is a regularised one: tau = tau_0 + (smooth fields), with
tau_0 the best homogeneous cloth and a Gaussian prior on the fields (`smooth_field`), whose white coordinates z minimise

    J(z) = MODES loss(tau(z)) / FLOOR + |z|^2 / 2,

half the misfit of the silhouette's harmonics, each known as well as edges are drawn, plus minus the log prior. Every
table moves on its own, but neighbours move together over the prior's length, and nothing moves unless the silhouette
asks for it. The prior also preconditions: a gradient in z is a smoothed gradient in tau.

Stages: bending level by drape coefficient; a short homogeneous fit; then rounds of momentum steps of fixed length,
which cross the rough ground of folds that come and go, and of L-BFGS. From round to round the steps become shorter;
when they are short and a round gains nothing, the fit ends. After every round all state is saved, and a killed run
goes on from there.

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024 (the row HETER of Table 1).
    Lindgren, Rue, Lindstroem, J. Royal Statistical Society B 73(4), 2011. Liu, Nocedal, Math. Programming 45, 1989.
"""

import contextlib
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.problem import BudgetExceeded, DrapeProblem
from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE
from cusick_bench.solvers.base import Prediction, Progress, Solver, prediction_at
from cusick_bench.solvers.incumbent import PENALTY, Incumbent
from cusick_bench.solvers.level_search import match_bending_level
from cusick_bench.solvers.quasi_newton import Search, descend
from cusick_bench.solvers.smooth_field import StiffnessField

FLOOR = 5e-4  # MSE between two drawings of one edge: what a silhouette is known to
MODES = 20.0  # independent numbers in a silhouette, halved: harmonics 1 to 20, cosine and sine
SHORTENING = 0.6  # of the steps' length, from round to round
SHORTEST = 1 / 20  # of the first length: shorter steps are not worth their gradients
GAIN = 0.01  # relative decrease of J below which a round gained nothing

White = Float[np.ndarray, " white"]


class SharedIncumbent(Incumbent):
    """A search over homogeneous cloths in the heterogeneous space: all elements share one table of 24 + 15 numbers.

    Attributes:
        shared: The 39 numbers of the best cloth.
    """

    def __init__(self, start: Incumbent) -> None:
        super().__init__(start.problem)
        self.tau, self.loss = start.tau, start.loss
        self._faces = len(start.problem.simulator.mesh.faces)
        self.shared = self._first(start.tau)

    def _first(self, tau: np.ndarray) -> Float[np.ndarray, " 39"]:
        bending = STRETCH_SIZE * self._faces
        return np.concatenate([tau[:STRETCH_SIZE], tau[bending : bending + BENDING_SIZE]])

    def everywhere(self, shared: Float[np.ndarray, " 39"]) -> np.ndarray:
        """The vector tau of the cloth that has these numbers on every element."""
        hinges = len(self.problem.simulator.mesh.hinges)
        return np.concatenate([np.tile(shared[:STRETCH_SIZE], self._faces), np.tile(shared[STRETCH_SIZE:], hinges)])

    def shared_value_and_gradient(self, shared: Float[np.ndarray, " 39"]) -> tuple[float, np.ndarray]:
        """Loss and its gradient to the 39 numbers."""
        loss, gradient = self.value_and_gradient(self.everywhere(shared))
        cut = STRETCH_SIZE * self._faces
        sums = gradient[:cut].reshape(-1, STRETCH_SIZE).sum(0), gradient[cut:].reshape(-1, BENDING_SIZE).sum(0)
        return loss, np.concatenate(sums)


class RegularisedFit:
    """J(z) around a homogeneous cloth.

    Attributes:
        incumbent: Remembers the lowest loss, whatever J.
        field: Smooth deviations.
        mean: tau_0.
        precision: Weight of the loss.
    """

    def __init__(self, incumbent: Incumbent, field: StiffnessField, mean: np.ndarray, precision: float) -> None:
        self.incumbent, self.field, self.mean, self.precision = incumbent, field, mean, precision

    def __call__(self, z: White) -> tuple[float, White]:
        """J and its gradient; a failed drape counts as a loss of PENALTY."""
        loss, gradient = self.incumbent.value_and_gradient(self.mean + self.field.deviation(z))
        return self.precision * loss + 0.5 * float(z @ z), self.precision * self.field.pulled_back(gradient) + z

    def step(self, direction: White, size: float) -> White:
        """A step along a direction, of root mean square `size` in tau."""
        moved = np.sqrt(np.mean(self.field.deviation(direction) ** 2))
        return direction * (size / max(moved, 1e-300))


def momentum(search: Search, fit: RegularisedFit, *, steps: int, size: float) -> Search:
    """Steps along the running mean of the gradients, all as long, whether J rises or falls; returns the lowest point.

    Args:
        search: Where to begin.
        fit: What to minimise.
        steps: Gradients to spend.
        size: Root mean square change of tau a step, falling to a tenth [prior standard deviations].
    """
    best, point, mean = search, search.point, search.gradient
    for index in range(steps):
        point = point - fit.step(mean, size * (1 - 0.9 * index / steps))
        value, gradient = fit(point)
        if value < best.value:
            best = Search(point, value, gradient, search.steps[:0], search.changes[:0])
        if value >= fit.precision * PENALTY:  # the drape failed: on from the lowest point
            point, mean = best.point, best.gradient
        else:
            mean = 0.7 * mean + 0.3 * gradient
    return best


def polish(search: Search, fit: RegularisedFit, *, iterations: int, size: float) -> Search:
    """L-BFGS, until it gets no lower or gains less than a thousandth an iteration."""
    for _ in range(iterations):
        first = float(np.linalg.norm(fit.step(search.gradient, size)))
        found = descend(search, fit, first=first)
        if found is None:
            break
        gained, search = 1 - found.value / search.value, found
        if gained < 0.1 * GAIN:
            break
    return search


@dataclass(frozen=True)
class Heter(Solver):
    """Smooth fields of stiffness around the best homogeneous cloth.

    Attributes:
        search: Most drapes for the bending level.
        shared_iterations: L-BFGS iterations of the homogeneous start.
        momentum_steps: Gradients with momentum in a round.
        iterations: Most L-BFGS iterations in a round.
        rounds: Most rounds.
        step: First root mean square step of tau [prior standard deviations].
        amplitude: Prior standard deviation of the fields [prior standard deviations of a cloth's mean].
        length: Distance at which their correlation has fallen to 0.14 [m].
    """

    search: int = 8
    shared_iterations: int = 8
    momentum_steps: int = 16
    iterations: int = 25
    rounds: int = 30
    step: float = 0.02
    amplitude: float = 0.5
    length: float = 0.05
    name: ClassVar[str] = "heter"
    summary: ClassVar[str] = "gradient fit of one stretch table a face and one bending table a hinge, smooth fields"
    reference: ClassVar[str] = "Gong, Mao, Wang, CVPR 2024, Table 1 HETER; Lindgren, Rue, Lindstroem 2011"
    space: ClassVar[str | None] = "heter"
    needs_gradient: ClassVar[bool] = True

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        incumbent, finished = Incumbent(problem), False
        with problem.meter.reserve(1), contextlib.suppress(BudgetExceeded):
            finished = self._fit(problem, incumbent, progress)
        return prediction_at(problem, incumbent.tau, finished=finished)

    def _fit(self, problem: DrapeProblem, incumbent: Incumbent, progress: Progress) -> bool:
        """Whether the rounds ended by themselves."""
        field = StiffnessField(problem.simulator.mesh, self.amplitude, self.length)
        state = problem.restore()
        if state is None:
            mean = self._homogeneous(incumbent)
            fit = RegularisedFit(incumbent, field, mean, MODES / FLOOR)
            search, size, first = Search.at(np.zeros(field.dimension), fit), self.step, 0
        else:
            incumbent.tau, incumbent.loss = state["tau"], float(state["loss"])
            fit = RegularisedFit(incumbent, field, state["mean"], MODES / FLOOR)
            search = Search(state["point"], float(state["value"]), state["gradient"], state["steps"], state["changes"])
            size, first = float(state["size"]), int(state["round"])
        for index in range(first, self.rounds):
            self._keep(problem, fit, search, size, index)
            progress(f"round {index + 1}, loss {incumbent.loss:.4f}", problem.meter.share)
            before = search.value
            if size > SHORTEST * self.step:
                search = momentum(search, fit, steps=self.momentum_steps, size=size)
            search = polish(search, fit, iterations=self.iterations, size=size)
            if size <= SHORTEST * self.step and search.value > (1 - GAIN) * before:
                return True
            size *= SHORTENING
        return False

    def _homogeneous(self, incumbent: Incumbent) -> np.ndarray:
        """tau of the best homogeneous cloth: bending level, then L-BFGS on the shared tables."""
        match_bending_level(incumbent, self.search)
        shared = SharedIncumbent(incumbent)
        try:
            search = Search.at(shared.shared, shared.shared_value_and_gradient)
            for _ in range(self.shared_iterations):
                found = descend(search, shared.shared_value_and_gradient, first=0.5)
                if found is None:
                    break
                search = found
        finally:
            incumbent.tau, incumbent.loss = shared.tau, shared.loss
        return incumbent.tau

    @staticmethod
    def _keep(problem: DrapeProblem, fit: RegularisedFit, search: Search, size: float, index: int) -> None:
        """Saves what the next round begins with."""
        problem.save(
            tau=fit.incumbent.tau,
            loss=np.array(fit.incumbent.loss),
            mean=fit.mean,
            point=search.point,
            value=np.array(search.value),
            gradient=search.gradient,
            steps=search.steps,
            changes=search.changes,
            size=np.array(size),
            round=np.array(index),
        )
