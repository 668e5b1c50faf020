"""The best point of a search, and finite losses for optimisers where drapes fail."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets.files.silhouette import drape_coefficient_of

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem, Observation


# What an optimiser is told instead of infinity where a drape fails: worse than any loss of a silhouette (MSE
# <= 1).
PENALTY = 10.0

Vector = Float[np.ndarray, " dimension"]


class Incumbent:
    """Evaluates the problem, and keeps the best point.

    Attributes:
        tau: Best parameters so far; the prior median before the first success.
        loss: Their loss.
    """

    def __init__(self, problem: DrapeProblem) -> None:
        self.problem = problem
        self.tau: Vector = np.zeros(problem.dimension)
        self.loss = math.inf

    def _keep(self, tau: Vector, loss: float) -> None:
        if loss < self.loss:
            self.tau, self.loss = np.array(tau), loss

    def value(self, tau: Vector, *, as_laid: bool = False) -> float:
        """Loss at tau, PENALTY where the drape fails.

        Args:
            tau: Parameter vector.
            as_laid: Whether the drape starts from the cloth as laid down, whatever was followed before.

        Returns:
            The loss.
        """
        loss = self.problem.evaluate_as_laid(tau) if as_laid else self.problem.evaluate(tau)
        self._keep(tau, loss)
        return min(loss, PENALTY)

    def value_and_gradient(self, tau: Vector) -> tuple[float, Vector]:
        """Loss and gradient at tau, (PENALTY, 0) where the drape fails.

        Args:
            tau: Parameter vector.

        Returns:
            The loss and its derivatives by tau.
        """
        loss, gradient = self.problem.evaluate_and_gradient(tau)
        self._keep(tau, loss)
        return min(loss, PENALTY), gradient

    def observe(self, tau: Vector) -> Observation:
        """The drape at tau and how it is seen.

        Args:
            tau: Parameter vector.

        Returns:
            Vertices, image and loss.

        Raises:
            DrapeDiverged: The drape fails.
        """
        seen = self.problem.observe(tau)
        self._keep(tau, seen.loss)
        return seen

    def observe_batch(self, taus: Float[np.ndarray, "members dimension"]) -> list[Observation | None]:
        """Drapes of several cloths and how they are seen, as `DrapeProblem.observe_batch` has them.

        Args:
            taus: Parameter vectors.

        Returns:
            One observation for each affordable vector; None where the drape fails.
        """
        drapes = self.problem.observe_batch(taus)
        for tau, seen in zip(taus, drapes, strict=False):
            if seen is not None:
                self._keep(tau, seen.loss)
        return drapes

    def drape_coefficient(self, tau: Vector) -> float:
        """Drape coefficient at tau.

        Args:
            tau: Parameter vector.

        Returns:
            Drape coefficient [1].

        Raises:
            DrapeDiverged: The drape fails.
        """
        return drape_coefficient_of(self.observe(tau).image, self.problem.protocol)
