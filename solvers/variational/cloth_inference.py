"""What drapes of drawn cloths tell of a fabric: draws from the posterior of its parameters, learned in rounds.

The statistics are those of `bdp_field`, which says why; this is the state of the inference.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float

from cusick_bench.problem import DrapeProblem
from cusick_bench.problem.field_space import DISCREPANCY, FieldSpace
from cusick_bench.problem.population.expected_statistics import shipped
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.variational.gaussian_posterior import INFERENCE, standard_normal
from cusick_bench.solvers.variational.linear_correction import PAIRS, LinearCorrection, linear_correction, nearness
from cusick_bench.solvers.variational.predictive import TOGETHER
from cusick_bench.solvers.variational.slice_sampling import slice_sample

LEVEL_SD = 0.5  # of the level of bending in the first round, when the search has found it [prior standard deviations]
CLOTHS = 1024  # draws from the posterior that are kept
STEPS = 60  # of the chains that end in them; twice as many change no quantile by more than their number does
DISCREPANT = np.array([DISCREPANCY.get(name, 0.0) for name in STATISTICS])
KNOWN = 30.0  # drapes that the scatter known before the first one counts for
UNSEEN = 4.0  # variance of what is expected before the first drape, in the scatter's: of another law or plate
_CHAINS = 2  # purpose of random numbers, beside those of `gaussian_posterior`


@dataclass
class ClothInference:
    """What is known of the cloth, and the drapes that it was learned from.

    Attributes:
        problem: The problem, whose simulator drapes.
        seed: Seed of the run.
        samples: Most training samples that are learned from; 0 for all.
        cloths: Draws of the cloth's parameters from what is known of them.
        seen: The drape that happened to be nearest to the training image.
    """

    problem: DrapeProblem
    seed: int
    samples: int = 0
    cloths: Float[np.ndarray, "cloths numbers"] = field(init=False)
    seen: Incumbent = field(init=False)
    _draped: list[np.ndarray] = field(default_factory=list)
    _levels: list[float] = field(default_factory=list)
    _statistics: list[np.ndarray] = field(default_factory=list)
    _tried: int = 0
    _correction: LinearCorrection | None = None

    def __post_init__(self) -> None:
        self.seen = Incumbent(self.problem)
        images = self.problem.train_images[: self.samples or None]
        self.observed = np.stack([self._measured(image) for image in images])
        self.cloths = self._prior_draws()

    def begin(self, level: float) -> None:
        """The prior, but for the level of bending, that a search has found.

        Args:
            level: Log factor on all bending stiffnesses of the prior median.
        """
        direction = self.problem.space.bending_level(math.e)[: self.problem.space.specimen_level.start]
        axis = direction / np.linalg.norm(direction)
        drawn = self._prior_draws()
        self.cloths = level * direction + drawn - (1 - LEVEL_SD) * np.outer(drawn @ axis, axis)

    @property
    def middle(self) -> Float[np.ndarray, " numbers"]:
        """Mean of what is known of the cloth."""
        return self.cloths.mean(0)

    def drape(self, count: int) -> None:
        """Drapes specimens of drawn cloths, and learns from all so far; from some of them where the budget ends.

        Args:
            count: Number of specimens.
        """
        specimens: list[np.ndarray] = []
        statistics: list[np.ndarray] = []
        try:
            end = self._tried + count
            while self._tried < end:
                taus = np.stack([self._drawn(i) for i in range(self._tried, min(self._tried + TOGETHER, end))])
                drapes = self.seen.observe_batch(taus)
                self._tried += len(drapes)
                for tau, seen in zip(taus, drapes, strict=False):  # fewer drapes where the budget ends
                    if seen is not None:
                        statistics.append(self._measured(seen.image))
                        specimens.append(tau)
        finally:
            self.take(specimens, statistics)

    def _drawn(self, index: int) -> Float[np.ndarray, " dimension"]:
        noise = standard_normal(self.seed, INFERENCE, index, self.problem.dimension)
        return drawn_specimen(self.cloths, index, noise)

    def take(self, specimens: list[np.ndarray], statistics: list[np.ndarray]) -> None:
        """Learns from drapes, and from all before.

        Args:
            specimens: Parameter vectors of specimens.
            statistics: Their statistics.
        """
        self._draped += [one[: self.cloths.shape[1]] for one in specimens]
        self._levels += [float(self._space.levels(one[None])[0]) for one in specimens]
        self._statistics += statistics
        self._learn()

    @property
    def _space(self) -> FieldSpace:
        assert isinstance(self.problem.space, FieldSpace)  # the solver's own
        return self.problem.space

    def _prior_draws(self) -> Float[np.ndarray, "cloths numbers"]:
        numbers = self.problem.space.specimen_level.start
        return np.random.default_rng([self.seed, _CHAINS, 0]).standard_normal((CLOTHS, numbers))

    def _measured(self, image: Float[np.ndarray, "size size"]) -> Float[np.ndarray, " statistics"]:
        return drape_statistics(torch.as_tensor(image), self.problem.protocol).numpy()

    def _learn(self) -> None:
        """Learns how far the drapes are from what was expected, and samples the posterior that it gives."""
        leading, expected = self._space.leading, shipped()
        observed, count = self.observed.mean(0), len(self.observed)
        middle = leading(self.middle[None])
        correction, scatter, slope = None, expected.scatter(middle)[0], expected.slope(middle)[0]
        least = PAIRS * len(leading.rows)
        if len(self._draped) >= least:
            draped, levels, statistics = (np.stack(each) for each in (self._draped, self._levels, self._statistics))
            guess, before = expected.of(leading, draped, levels), self._correction
            places = leading.scaled(draped, levels)
            gap = guess - observed if before is None else guess + before(places)[0] - observed
            weights = nearness(gap, scatter if before is None else before.scatter, least)
            correction = linear_correction(places, statistics - guess, weights)
            scatter = (KNOWN * scatter + correction.pairs * correction.scatter) / (KNOWN + correction.pairs)
            slope = slope + leading.scaled_level @ correction.slope
            self._correction = correction
        by_level = self._space.level_sd(self.middle) * slope
        share = share_of_specimens(scatter, expected.scatter(middle)[0])
        fixed = np.diag(DISCREPANT**2) + (1 + share * (1 / count - 1)) * scatter + np.outer(by_level, by_level) / count

        def log_likelihood(cloths: Float[np.ndarray, "chains numbers"]) -> Float[np.ndarray, " chains"]:
            left, doubt = (
                (0.0, np.full(len(cloths), UNSEEN)) if correction is None else correction(leading.scaled(cloths))
            )
            gap = (observed - expected.of(leading, cloths) - left)[..., None]
            covariance = fixed + doubt[:, None, None] * scatter
            squares = (gap * np.linalg.solve(covariance, gap)).sum((1, 2))
            return -0.5 * (squares + np.linalg.slogdet(covariance)[1])

        generator = np.random.default_rng([self.seed, _CHAINS, 1 + len(self._draped)])
        self.cloths = slice_sample(log_likelihood, self.cloths, STEPS, generator)


def share_of_specimens(
    found: Float[np.ndarray, "statistics statistics"], known: Float[np.ndarray, "statistics statistics"]
) -> float:
    """How much of the scatter about a regression is of specimens, and so averages out over samples.

    The rest is what the regression misses of cloths.

    Args:
        found: Covariance about the regression.
        known: That of specimens of one cloth and level.

    Returns:
        The share of variance, mean over statistics.
    """
    return float(np.minimum(np.diag(known) / np.diag(found), 1.0).mean())


def drawn_specimen(
    cloths: Float[np.ndarray, "cloths numbers"], index: int, noise: Float[np.ndarray, " dimension"]
) -> Float[np.ndarray, " dimension"]:
    """A drawn cloth, and the fields of a specimen of it.

    Args:
        cloths: Draws of the cloth.
        index: Which of them, counted around.
        noise: Numbers from N(0, 1), for the fields' weights.

    Returns:
        Parameter vector of the specimen.
    """
    return np.concatenate([cloths[index % len(cloths)], noise[cloths.shape[1] :]])
