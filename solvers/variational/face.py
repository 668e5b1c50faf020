"""One face of a cloth: statistics of its samples, and the difference between simulated and expected statistics."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.problem.leading import Leading
from cusick_bench.problem.population.expected_statistics import shipped
from cusick_bench.solvers.variational.linear_correction import PAIRS, LinearCorrection, linear_correction, nearness

KNOWN = 30.0  # number of drapes that the scatter known beforehand counts for
UNSEEN = 4.0  # variance of the expected statistics before the first drape, for another law or plate [scatter's]


@dataclass(frozen=True)
class Drapes:
    """Drapes of specimens, whichever way up they lay.

    Attributes:
        leading: Gives leading directions of cloths.
        cloths: Parameters of their cloths, as they lay.
        levels: Levels of the specimens (`FieldSpace.levels`).
        statistics: Statistics of the drapes.
    """

    leading: Leading
    cloths: Float[ndarray, "drapes numbers"]
    levels: Float[ndarray, " drapes"]
    statistics: Float[ndarray, "drapes statistics"]

    @property
    def enough(self) -> bool:
        """Whether there are as many as a correction takes."""
        return len(self.cloths) >= PAIRS * len(self.leading.rows)


@dataclass(frozen=True)
class Scatter:
    """Scatter of specimens about the expected statistics of their cloth.

    Attributes:
        covariance: Of their statistics, beside what their level adds.
        of_specimens: Share of it that is of specimens; the regression misses the rest of cloths.
        slope: Derivative of the statistics by the level.
    """

    covariance: Float[ndarray, "statistics statistics"]
    of_specimens: float
    slope: Float[ndarray, " statistics"]


@dataclass
class Face:
    """One face of a cloth.

    Attributes:
        observed: Statistics of the samples that show it.
    """

    observed: Float[ndarray, "samples statistics"]
    _correction: LinearCorrection | None = None

    @property
    def mean(self) -> Float[ndarray, " statistics"]:
        """Mean of the samples."""
        return self.observed.mean(0)

    def learn(self, drapes: Drapes, middle: Float[ndarray, " numbers"]) -> Scatter:
        """Learns how far drapes near the samples differ from the expected statistics, if there are enough of them.

        Args:
            drapes: All so far.
            middle: Mean of what is known of the cloth, as it lies with this face up.

        Returns:
            The scatter of specimens there.
        """
        leading, expected = drapes.leading, shipped()
        place = leading(middle[None])
        known, slope = expected.scatter(place)[0], expected.slope(place)[0]
        if not drapes.enough:
            return Scatter(known, 1.0, slope)
        guess, before = expected.of(leading, drapes.cloths, drapes.levels), self._correction
        places = leading.scaled(drapes.cloths, drapes.levels)
        gap = guess - self.mean if before is None else guess + before(places)[0] - self.mean
        near = nearness(gap, known if before is None else before.scatter, PAIRS * len(leading.rows))
        found = self._correction = linear_correction(places, drapes.statistics - guess, near)
        covariance = (KNOWN * known + found.pairs * found.scatter) / (KNOWN + found.pairs)
        return Scatter(covariance, share_of_specimens(covariance, known), slope + leading.scaled_level @ found.slope)

    def gap(
        self, leading: Leading, cloths: Float[ndarray, "cloths numbers"]
    ) -> tuple[Float[ndarray, "cloths statistics"], Float[ndarray, " cloths"]]:
        """Difference between the samples' mean and that of cloths.

        Args:
            leading: Gives leading directions of the cloths.
            cloths: theta, as they lie with this face up.

        Returns:
            Observed less expected statistics, and the variance of what is expected, in units of the scatter.
        """
        missed, doubt = (
            (0.0, np.full(len(cloths), UNSEEN))
            if self._correction is None
            else self._correction(leading.scaled(cloths))
        )
        return self.mean - shipped().of(leading, cloths) - missed, doubt


def share_of_specimens(
    found: Float[ndarray, "statistics statistics"], known: Float[ndarray, "statistics statistics"]
) -> float:
    """Share of the scatter about a regression that is due to specimens, and so averages out over samples.

    The rest is what the regression misses of cloths.

    Args:
        found: Covariance about the regression.
        known: That of specimens of one cloth and level.

    Returns:
        The share of variance, mean over statistics.
    """
    return float(np.minimum(np.diag(known) / np.diag(found), 1.0).mean())
