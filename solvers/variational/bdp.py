"""The paper's Bayesian fit: a Gaussian over the stiffness of every element, learned from one silhouette.

Negative ELBO (Eq. 6-8), with D the training image and L x L its pixels:

    KL(q(tau) || p(tau)) + E_q[ sum_ij (I_ij - D_ij)^2 / (2 sigma^2) ]

`reduction=sum` takes the sums of the text; `mean` divides the first term by the number of parameters and the second by
that of pixels, as the published scripts do, which weighs the prior about four times less at the paper's size (241,680
parameters, 65,536 pixels). The number of pixels is that of the release, 256 x 256 of 1.4 mm, as for the loss `mse`,
whatever the image's resolution: errors of neighbouring pixels come from the same error of the outline, and a finer
image of it tells no more about the cloth.
Parameters are whitened logarithms of stiffness (see `cusick_bench.problem.priors`), so every draw is admissible, and
the fixed Gaussian prior is that of measured fabrics. The divergence is exact instead of sampled. As in the published
scripts one Gaussian serves each of the 39 numbers and every element draws from it alone (`shared=True`); `shared=False`
learns one for every number of every element.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Sec. 4.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.problem import BudgetExceeded
from cusick_bench.solvers.base import (
    Prediction,
    Progress,
    Solver,
    SolverError,
    prediction_at,
    require_at_least,
    require_positive,
)
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.level_search import match_bending_level
from cusick_bench.solvers.variational.gaussian_posterior import (
    INFERENCE,
    PREDICTION,
    Gaussian,
    standard_normal,
)
from cusick_bench.solvers.variational.predictive import predictive_draws, with_draws

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem
    from cusick_bench.solvers.adam import Adam


REDUCTIONS = ("sum", "mean")
PIXELS = RELEASE.image_size_px**2  # that the loss `mse` is a mean of, whatever the image's resolution
SQUARE_DECAY = 0.95  # Adam's beta_2; gradients of few samples are noisy, and their size changes as q narrows

_RUNNING, _OUT_OF_BUDGET, _COMPLETE = range(3)


@dataclass(frozen=True)
class Bdp(Solver):
    """Level search, variational inference, posterior-predictive draws.

    Attributes:
        draws: Posterior-predictive drapes, outside the budget.
        steps: Most steps of the inference.
        samples: Cloths drawn at each step.
        rate: Step length [prior standard deviations].
        sigma: Standard deviation of the error of a pixel of 1.4 mm (of a cloth of 0.3 m).
        reduction: "sum" (the paper's text) or "mean" (the published scripts).
        shared: One Gaussian for all elements, or one an element.
        search: Most drapes for the bending level.
        scale: Standard deviations that q begins with.
    """

    draws: int = 200
    steps: int = 40
    samples: int = 4
    rate: float = 0.15
    sigma: float = 0.01
    reduction: str = "sum"
    shared: bool = True
    search: int = 8
    scale: float = 0.3
    name: ClassVar[str] = "bdp"
    summary: ClassVar[str] = "variational inference over every element's stiffness, from one image"
    reference: ClassVar[str] = "Gong, Mao, Wang, CVPR 2024, Eq. 6-10; Kingma, Welling 2014; Blundell et al. 2015"
    space: ClassVar[str | None] = "heter"
    needs_gradient: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.reduction not in REDUCTIONS:
            raise SolverError(f"reduction must be one of {', '.join(REDUCTIONS)}, got {self.reduction!r}")
        require_at_least(self, 0, "search")
        require_positive(self, "draws", "steps", "samples", "rate", "sigma", "scale")

    @property
    def drapes_of_prediction(self) -> int:
        return self.draws

    @property
    def draws_asked_for(self) -> int:
        return self.draws

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        if problem.loss != "mse":
            raise SolverError(f"bdp's likelihood is Gaussian in the pixels: use loss=mse, not {problem.loss}")
        seed = int(generator.integers(2**63))
        fit = _Fit.restored(self, problem, seed) or _Fit.begun(self, problem, seed)
        fit.run()
        best = prediction_at(problem, fit.incumbent.tau, finished=fit.ended == _COMPLETE)
        posterior = {"mean": fit.q.mean, "scale": fit.q.scale, "seed": np.array(seed)}
        seen = predictive_draws(problem, lambda index: self.redraw(problem, posterior, index), self.draws, progress)
        return with_draws(best, seen, posterior)

    def redraw(
        self, problem: DrapeProblem, posterior: dict[str, np.ndarray], index: int
    ) -> Float[np.ndarray, " dimension"]:
        """Draws one stiffness for every element."""
        tie = _tie(problem, self.shared)
        noise = standard_normal(int(posterior["seed"]), PREDICTION, index, problem.dimension)
        return posterior["mean"][tie] + posterior["scale"][tie] * noise


def _tie(problem: DrapeProblem, shared: bool) -> np.ndarray:
    from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE

    if not shared:
        return np.arange(problem.dimension)
    mesh = problem.space.mesh
    bending = STRETCH_SIZE + np.tile(np.arange(BENDING_SIZE), len(mesh.hinges))
    return np.concatenate([np.tile(np.arange(STRETCH_SIZE), len(mesh.faces)), bending])


@dataclass
class _Fit:
    """State of the inference, which is saved so that a killed run goes on; gradients are too long for the journal."""

    solver: Bdp
    problem: DrapeProblem
    seed: int
    incumbent: Incumbent
    q: Gaussian
    adam: Adam
    ended: int = _RUNNING

    @classmethod
    def begun(cls, solver: Bdp, problem: DrapeProblem, seed: int) -> _Fit:
        """Starts from the bending level with the training image's drape coefficient."""
        from cusick_bench.solvers.adam import Adam

        incumbent, tie = Incumbent(problem), _tie(problem, solver.shared)
        with problem.meter.reserve(1):
            try:
                start = problem.space.bending_level(math.exp(match_bending_level(incumbent, solver.search)))
            except BudgetExceeded:
                start = incumbent.tau
        mean = np.zeros(tie.max() + 1)
        mean[tie] = start
        q = Gaussian.around(mean, solver.scale, tie)
        fit = cls(solver, problem, seed, incumbent, q, Adam(q.arrays, square_decay=SQUARE_DECAY))
        fit._save()
        return fit

    @classmethod
    def restored(cls, solver: Bdp, problem: DrapeProblem, seed: int) -> _Fit | None:
        from cusick_bench.solvers.adam import Adam

        state = problem.restore()
        if state is None:
            return None
        incumbent = Incumbent(problem)
        incumbent.tau, incumbent.loss = state["best"], float(state["best_loss"])
        q = Gaussian(state["q_mean"], state["q_raw"], _tie(problem, solver.shared))
        adam = Adam(q.arrays, square_decay=SQUARE_DECAY, memory=state)
        return cls(solver, problem, seed, incumbent, q, adam, int(state["ended"]))

    def run(self) -> None:
        """Takes the steps that are left, as far as the budget goes."""
        with self.problem.meter.reserve(1):
            while self.ended == _RUNNING:
                try:
                    self._step()
                    self.ended = _COMPLETE if self.adam.steps >= self.solver.steps else _RUNNING
                except BudgetExceeded:
                    self.ended = _OUT_OF_BUDGET
                self._save()

    def _step(self) -> None:
        from cusick_bench.solvers.adam import cosine_rate

        samples, size = self.solver.samples, self.problem.dimension
        first = self.adam.steps * samples
        noise = np.stack([standard_normal(self.seed, INFERENCE, first + i, size) for i in range(samples)])
        taus = self.q.draw(noise)
        losses, gradients = self.problem.evaluate_and_gradient_batch(taus)
        good = np.isfinite(losses)
        if losses[best := int(np.argmin(losses))] < self.incumbent.loss:
            self.incumbent.tau, self.incumbent.loss = taus[best], float(losses[best])
        sums = self.solver.reduction == "sum"
        likelihood = (PIXELS if sums else 1) / (2 * self.solver.sigma**2) / max(good.sum(), 1)
        prior = 1 if sums else 1 / size
        _, kl_mean, kl_scale = self.q.divergence()
        by_mean, by_scale = self.q.pull_back(likelihood * gradients[good], noise[good])
        slopes = self.q.slopes(by_mean + prior * kl_mean, by_scale + prior * kl_scale)
        self.adam.step(slopes, cosine_rate(self.solver.rate, self.adam.steps, self.solver.steps))

    def _save(self) -> None:
        state = {"best": self.incumbent.tau, "best_loss": np.array(self.incumbent.loss), "ended": np.array(self.ended)}
        self.problem.save(**state, q_mean=self.q.mean, q_raw=self.q.raw, **self.adam.memory())
