"""BAxUS: Bayesian optimisation in nested subspaces, the first of very few dimensions, each containing the last.

A trust region searches a hashed subspace. When it is exhausted, every bin is split and the search goes on in the finer
subspace, with all that was evaluated before. The failures that a region tolerates are set so that, with the budget,
the subspaces reach all coordinates: the share of the d_i-dimensional one is b m d_i / (d_0 ((b + 1)^(n + 1) - 1)) of m
evaluations, for n splits of every bin into b + 1, to be spent on the k halvings that exhaust a region.

References:
    Papenmeier, Nardi, Poloczek, Increasing the Scope as You Learn: Adaptive Bayesian Optimization in Nested Subspaces,
    NeurIPS 2022 (Sec. 3.2, 3.3).
"""

import math
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from cusick_bench.solvers.base import SolverError, require_at_least
from cusick_bench.solvers.bayesian_optimisation.embedding import balanced_embedding, lifted, split
from cusick_bench.solvers.bayesian_optimisation.search import check_initial, design
from cusick_bench.solvers.bayesian_optimisation.trust_region import FIRST, SHORTEST, TrustRegion, local_search
from cusick_bench.solvers.black_box.box import BoxSolver, Search

_HALVINGS = math.floor(math.log2(FIRST / SHORTEST))  # k


@dataclass(frozen=True)
class Nesting:
    """How the subspaces grow.

    Attributes:
        first: d_0, dimensions of the first subspace.
        splits: n, splits after which all coordinates are apart.
        parts: b + 1, bins that a split makes of one.
    """

    first: int
    splits: int
    parts: int

    def tolerance(self, embedded: int, evaluations: int) -> int:
        """Failures in a row that halve the trust region of a d_i-dimensional subspace.

        Args:
            embedded: Dimension d_i of the subspace.
            evaluations: Evaluations m of the whole search.

        Returns:
            Number of failures, at least 1.
        """
        whole = self.first * (self.parts ** (self.splits + 1) - 1)
        share = round((self.parts - 1) * evaluations * embedded / whole)
        return min(embedded, max(1, share // _HALVINGS))


def nesting(dimension: int, parts: int) -> Nesting:
    """The nesting whose last subspace is nearest to D = `dimension`.

    Args:
        dimension: Number of coordinates D.
        parts: Bins that a split makes of one.

    Returns:
        First dimension and number of splits.
    """
    least = int(math.log(dimension, parts))
    first, splits = min(
        product(range(1, parts), (least, least + 1)), key=lambda pair: abs(pair[0] * parts ** pair[1] - dimension)
    )
    return Nesting(first, splits, parts)


@dataclass(frozen=True)
class Baxus(BoxSolver):
    """Nested subspaces, each searched by a trust region.

    Attributes:
        initial: Points of the quasi-random design in the first subspace.
        parts: Bins that a split makes of one.
        candidates: Most points a Thompson sample chooses from.
    """

    initial: int = 10
    parts: int = 4
    candidates: int = 2000
    name: ClassVar[str] = "baxus"
    summary: ClassVar[str] = "Bayesian optimisation in nested hashed subspaces"
    reference: ClassVar[str] = "Papenmeier, Nardi, Poloczek 2022"

    def __post_init__(self) -> None:
        check_initial(self.name, self.initial)
        require_at_least(self, 1, "candidates")
        if self.parts < 2:
            raise SolverError(f"baxus splits a bin into at least 2, got parts={self.parts}")

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Searches nested subspaces one after the other, and begins anew when all coordinates are apart."""
        plan = nesting(dimension, self.parts)
        while True:
            embedding = balanced_embedding(dimension, plan.first, generator)
            points, losses = yield from lifted(design(plan.first, self.initial, generator), embedding.lift)
            while True:
                # where all coordinates are apart the budget sets no end, as in TuRBO
                whole = embedding.embedded == dimension
                region = TrustRegion(dimension if whole else plan.tolerance(embedding.embedded, evaluations))
                inner = local_search(points, losses, region, self.candidates, generator)
                points, losses = yield from lifted(inner, embedding.lift)
                if whole:
                    break
                embedding, parents = split(embedding, self.parts, generator)
                points = points[:, parents]
