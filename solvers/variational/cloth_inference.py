"""What drapes of drawn cloths tell of a fabric: a Gaussian over its parameters, learned in rounds.

The statistics and the regression are those of `bdp_field`, which says why; this is the state of the inference.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float

from cusick_bench.problem import DrapeProblem
from cusick_bench.problem.field_space import DISCREPANCY, Trait
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.variational.gaussian_posterior import INFERENCE, standard_normal
from cusick_bench.solvers.variational.linearisation import PAIRS, LinearModel, Normal, linearise

LEVEL_SD = 0.5  # of the level of bending in the first round, when the search has found it [prior standard deviations]
AREA = STATISTICS.index("area_log_odds")
_DISCREPANCY = [DISCREPANCY.get(name, Trait(0.0, 0.0)) for name in STATISTICS]
DISCREPANT_BY = np.array([one.mean for one in _DISCREPANCY])
DISCREPANT_SD = np.array([one.sd for one in _DISCREPANCY])


@dataclass
class ClothInference:
    """The distribution q of the cloth, and the drapes that it was learned from.

    Attributes:
        problem: The problem, whose simulator drapes.
        seed: Seed of the run.
        q: What is known of the cloth.
        seen: The drape that happened to be nearest to the training image.
        cloths: Parameters of the cloths draped so far.
        statistics: Statistics of their drapes.
        slopes: Derivatives of the area by the cloth, of the drapes that have adjoints.
    """

    problem: DrapeProblem
    seed: int
    q: Normal = field(init=False)
    seen: Incumbent = field(init=False)
    cloths: list[np.ndarray] = field(default_factory=list)
    statistics: list[np.ndarray] = field(default_factory=list)
    slopes: list[np.ndarray] = field(default_factory=list)
    _axis: np.ndarray | None = None
    _tried: int = 0
    _model: LinearModel | None = None

    def __post_init__(self) -> None:
        cloth = self.problem.space.specimen_level.start
        self.q = Normal(np.zeros(cloth), np.eye(cloth))
        self.seen = Incumbent(self.problem)

    def begin(self, level: float) -> None:
        """The prior, but for the level of bending, that a search has found.

        Args:
            level: Log factor on all bending stiffnesses of the prior median.
        """
        direction = self.problem.space.bending_level(math.e)[: len(self.q.mean)]
        self._axis = direction / np.linalg.norm(direction)
        narrowed = np.eye(len(direction)) - (1 - LEVEL_SD) * np.outer(self._axis, self._axis)
        self.q = Normal(level * direction, narrowed)

    def drape(self, count: int, *, adjoints: bool) -> None:
        """Drapes specimens of cloths from q, and learns from all so far; from some of them where the budget ends.

        Args:
            count: Number of specimens.
            adjoints: Whether the slope of the area is taken of each as well.
        """
        try:
            for _ in range(count):
                tau = drawn_specimen(self.q, standard_normal(self.seed, INFERENCE, self._tried, self.problem.dimension))
                self._tried += 1
                try:
                    self._keep(tau, adjoints)
                except DrapeDiverged:
                    continue
        finally:
            self._learn()

    def _keep(self, tau: Float[np.ndarray, " dimension"], adjoint: bool) -> None:
        """Drapes one specimen."""
        cloth = len(self.q.mean)
        if adjoint:
            seen, slope = self.seen.observe_slope(
                tau, lambda image: drape_statistics(image, self.problem.protocol)[AREA]
            )
            self.slopes.append(slope[:cloth])
        else:
            seen = self.seen.observe(tau)
        self.cloths.append(tau[:cloth])
        self.statistics.append(self._statistics(seen.image))

    def _statistics(self, image: Float[np.ndarray, "size size"]) -> Float[np.ndarray, " statistics"]:
        return drape_statistics(torch.as_tensor(image), self.problem.protocol).numpy()

    def _learn(self) -> None:
        if len(self.cloths) < PAIRS * len(self.q.mean):
            return
        observed = self._statistics(self.problem.train_image) - DISCREPANT_BY
        cloths, statistics = np.stack(self.cloths), np.stack(self.statistics)
        weights = np.ones(len(cloths)) if self._model is None else self._model.nearness(cloths, observed)
        known = {AREA: np.median(self.slopes, axis=0)} if self.slopes else {}
        self._model = linearise(cloths, statistics, weights, self._axis, known)
        self.q = replace(self._model, scatter=self._model.scatter + np.diag(DISCREPANT_SD**2)).posterior(observed)


def drawn_specimen(q: Normal, noise: Float[np.ndarray, " dimension"]) -> Float[np.ndarray, " dimension"]:
    """Draws a cloth, and the fields of a specimen of it.

    Args:
        q: Distribution of the cloth.
        noise: Numbers from N(0, 1), for the cloth and for the fields' weights.

    Returns:
        Parameter vector of the specimen.
    """
    cloth = len(q.mean)
    return np.concatenate([q.draw(noise[:cloth]), noise[cloth:]])
