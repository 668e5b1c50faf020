"""REMBO: Bayesian optimisation of d numbers that move all coordinates along random Gaussian directions.

Whether an embedding holds a good point is luck, so several are searched in turn, each with a process of its own.

References:
    Wang, Hutter, Zoghi, Matheson, de Freitas, Bayesian Optimization in a Billion Dimensions via Random Embeddings,
    JAIR 55, 2016 (Algorithm 2; Sec. 3.1 for interleaved runs).
"""

from dataclasses import dataclass
from itertools import cycle
from typing import ClassVar

import numpy as np

from cusick_bench.solvers.base import SolverError, require_at_least
from cusick_bench.solvers.bayesian_optimisation.embedding import gaussian_embedding, lifted
from cusick_bench.solvers.bayesian_optimisation.search import bayesian_search, check_initial
from cusick_bench.solvers.black_box.box import BoxSolver, Search


@dataclass(frozen=True)
class Rembo(BoxSolver):
    """Bayesian optimisation in random linear subspaces.

    Attributes:
        embedded: Dimension d of each subspace.
        embeddings: Independent embeddings, searched in turn.
        initial: Points of the first, quasi-random design in each.
    """

    embedded: int = 5
    embeddings: int = 4
    initial: int = 2
    name: ClassVar[str] = "rembo"
    summary: ClassVar[str] = "Bayesian optimisation in random linear subspaces"
    reference: ClassVar[str] = "Wang, Hutter, Zoghi, Matheson, de Freitas 2016"

    def __post_init__(self) -> None:
        check_initial(self.name, self.initial)
        require_at_least(self, 1, "embedded")
        if self.embeddings < 1:
            raise SolverError(f"rembo searches at least one embedding, got embeddings={self.embeddings}")

    @property
    def drapes_of_design(self) -> int:
        return self.embeddings * self.initial

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Searches several linear subspaces in turn."""
        return in_turn([self._one(dimension, child) for child in generator.spawn(self.embeddings)])

    def _one(self, dimension: int, generator: np.random.Generator) -> Search:
        embedding = gaussian_embedding(dimension, self.embedded, generator)
        return lifted(bayesian_search(self.embedded, self.initial, generator), embedding.lift)


def in_turn(searches: list[Search]) -> Search:
    """Asks several endless searches in turn; each is told its loss when it is next asked, and not before.

    Args:
        searches: Searches of the same box.

    Yields:
        Points of the first search, of the second, ..., and of the first again.
    """
    losses: list[float | None] = [None] * len(searches)
    for turn in cycle(range(len(searches))):
        point = searches[turn].send(losses[turn])  # pyright: ignore[reportArgumentType]
        losses[turn] = yield point
