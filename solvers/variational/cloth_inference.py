"""State of the inference of `bdp_field`: draws from the posterior of a cloth's parameters, learned in rounds of drapes.

The method is described in `bdp_field`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float

from cusick_bench.problem import DrapeProblem
from cusick_bench.problem.cloth_prior import DISCREPANCY
from cusick_bench.problem.field_space import FieldSpace
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.variational.face import Drapes, Face, Scatter
from cusick_bench.solvers.variational.gaussian_posterior import INFERENCE, standard_normal
from cusick_bench.solvers.variational.predictive import TOGETHER
from cusick_bench.solvers.variational.slice_sampling import slice_sample

LEVEL_SD = 0.5  # standard deviation of the bending level after the level search [prior standard deviations]
CLOTHS = 1024  # draws from the posterior that are kept
FEW = 128  # draws where only an interval is needed
STEPS = 60  # steps of each chain; with twice as many, quantiles change by no more than their sampling error
DISCREPANT = np.array([DISCREPANCY.get(name, 0.0) for name in STATISTICS])
_CHAINS = 2  # purpose of random numbers, beside those of `gaussian_posterior`


@dataclass
class ClothInference:
    """Posterior of the cloth, and the drapes from which it was learned.

    Attributes:
        problem: The problem, whose simulator drapes.
        seed: Seed of the run.
        samples: Most training samples that each face is learned from; 0 for all.
        faces: The fitted face, and the other one if training samples show it.
        cloths: Draws of the cloth's parameters from the present posterior.
        seen: The drape nearest to the training image so far.
    """

    problem: DrapeProblem
    seed: int
    samples: int = 0
    faces: list[Face] = field(init=False)
    cloths: Float[np.ndarray, "cloths numbers"] = field(init=False)
    seen: Incumbent = field(init=False)
    _draped: list[np.ndarray] = field(default_factory=list)
    _levels: list[float] = field(default_factory=list)
    _statistics: list[np.ndarray] = field(default_factory=list)
    _tried: int = 0

    def __post_init__(self) -> None:
        self.seen = Incumbent(self.problem)
        shown = self.problem.train_images, self.problem.other_face_images
        observed = [[self._measured(image) for image in images[: self.samples or None]] for images in shown]
        self.faces = [Face(np.stack(one)) for one in observed if one]
        self.cloths = self._prior_draws()

    def begin(self, level: float) -> None:
        """Starts from the prior, with the bending level that a search has found.

        Args:
            level: Log factor on all bending stiffnesses of the prior median.
        """
        direction = self.problem.space.bending_level(math.e)[: self.problem.space.specimen_level.start]
        axis = direction / np.linalg.norm(direction)
        drawn = self._prior_draws()
        self.cloths = level * direction + drawn - (1 - LEVEL_SD) * np.outer(drawn @ axis, axis)
        if len(self.faces) > 1:  # of which drawn cloths would seldom be near both
            self.cloths = self._learned(self.cloths)

    def before_drapes(self) -> Float[np.ndarray, "cloths numbers"]:
        """Posterior before the first drape, from the expected statistics, which are of law `plate` whatever the law.

        Returns:
            Draws of the cloth's parameters.
        """
        return self._learned(self.cloths[:FEW])

    @property
    def middle(self) -> Float[np.ndarray, " numbers"]:
        """Mean of the present posterior."""
        return self.cloths.mean(0)

    def drape(self, count: int) -> None:
        """Drapes specimens of drawn cloths, fewer where the budget ends, and learns from all drapes so far.

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
        """A specimen of a drawn cloth; of two faces odd numbers lie the other way up."""
        noise = standard_normal(self.seed, INFERENCE, index, self.problem.dimension)
        specimen = drawn_specimen(self.cloths, index, noise)
        return self._space.turned(specimen) if index % len(self.faces) else specimen

    def _lying(self, cloths: Float[np.ndarray, "*batch numbers"], face: int) -> Float[np.ndarray, "*batch numbers"]:
        """Cloths as the drapes of a face show them: a scene knows which way up the fitted face lies."""
        scene = self.problem.scene
        face_down = scene is not None and scene.side == "down"
        return self._space.turned(cloths) if bool(face) != face_down else cloths

    def take(self, specimens: list[np.ndarray], statistics: list[np.ndarray]) -> None:
        """Adds drapes to those before, and learns from all of them.

        Args:
            specimens: Parameter vectors of specimens, as they were draped.
            statistics: Their statistics.
        """
        self._draped += [self._lying(one[: self.cloths.shape[1]], 0) for one in specimens]
        self._levels += [float(self._space.levels(one[None])[0]) for one in specimens]
        self._statistics += statistics
        self.cloths = self._learned(self.cloths)

    @property
    def _space(self) -> FieldSpace:
        assert isinstance(self.problem.space, FieldSpace)  # the solver's own
        return self.problem.space

    def _prior_draws(self) -> Float[np.ndarray, "cloths numbers"]:
        numbers = self.problem.space.specimen_level.start
        return np.random.default_rng([self.seed, _CHAINS, 0]).standard_normal((CLOTHS, numbers))

    def _measured(self, image: Float[np.ndarray, "size size"]) -> Float[np.ndarray, " statistics"]:
        return drape_statistics(torch.as_tensor(image), self.problem.protocol).numpy()

    def _learned(self, start: Float[np.ndarray, "chains numbers"]) -> Float[np.ndarray, "chains numbers"]:
        """Learns how far the drapes are from what was expected, and samples the posterior that it gives."""
        leading, numbers = self._space.leading, self.cloths.shape[1]
        drapes = Drapes(
            leading,
            np.reshape(self._draped, (-1, numbers)),
            np.array(self._levels),
            np.reshape(self._statistics, (-1, len(STATISTICS))),
        )
        scatters = [face.learn(drapes, self._lying(self.middle, place)) for place, face in enumerate(self.faces)]
        noise = mean_covariance(
            scatters, [len(face.observed) for face in self.faces], self._space.level_sd(self.middle)
        )

        def log_likelihood(cloths: Float[np.ndarray, "chains numbers"]) -> Float[np.ndarray, " chains"]:
            covariance = np.tile(noise, (len(cloths), 1, 1))
            gaps: list[np.ndarray] = []
            for place, (face, scatter) in enumerate(zip(self.faces, scatters, strict=True)):
                gap, doubt = face.gap(leading, self._lying(cloths, place))
                own = slice(place * len(STATISTICS), (place + 1) * len(STATISTICS))
                covariance[:, own, own] += doubt[:, None, None] * scatter.covariance
                gaps.append(gap)
            gap = np.concatenate(gaps, 1)[..., None]
            squares = (gap * np.linalg.solve(covariance, gap)).sum((1, 2))
            return -0.5 * (squares + np.linalg.slogdet(covariance)[1])

        generator = np.random.default_rng([self.seed, _CHAINS, 1 + len(self._draped)])
        return slice_sample(log_likelihood, start, STEPS, generator)


def mean_covariance(
    scatters: Sequence[Scatter], samples: Sequence[int], level_sd: float
) -> Float[np.ndarray, "rows rows"]:
    """Covariance of the mean statistics of a cloth's samples, face by face, about what is expected.

    The part that comes from the samples' level of stiffness is common to both faces, which are assumed to be those of
    the same samples. All other differences between samples, and the distance of real cloth from the nearest simulated
    one, are independent from face to face.

    Args:
        scatters: Scatter of specimens, one a face.
        samples: Number of samples that show it, one a face.
        level_sd: Standard deviation of the level between specimens [log].

    Returns:
        The covariance, without the doubt of what is expected; a row for each face and statistic.
    """
    size = len(STATISTICS)
    covariance = np.empty((len(scatters) * size,) * 2)
    for i, one in enumerate(scatters):
        for j, other in enumerate(scatters):
            block = np.outer(level_sd * one.slope, level_sd * other.slope) / max(samples[i], samples[j])
            if i == j:
                specimens = (1 + one.of_specimens * (1 / samples[i] - 1)) * one.covariance
                block = np.diag(DISCREPANT**2) + specimens + block
            covariance[i * size : (i + 1) * size, j * size : (j + 1) * size] = block
    return covariance


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
