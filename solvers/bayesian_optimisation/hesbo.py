"""HeSBO: Bayesian optimisation of d numbers, each of which moves a random bin of coordinates, with random signs.

Where two coordinates that matter fall into one bin, the optimum may be out of reach; d = 2 d_e, twice the number of
coordinates expected to matter, makes that rarer.

References:
    Nayebi, Munteanu, Poloczek, A Framework for Bayesian Optimization in Embedded Subspaces, ICML 2019.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cusick_bench.solvers.base import require_at_least
from cusick_bench.solvers.bayesian_optimisation.embedding import hash_embedding, lifted
from cusick_bench.solvers.bayesian_optimisation.search import bayesian_search, check_initial
from cusick_bench.solvers.black_box.box import BoxSolver, Search


@dataclass(frozen=True)
class Hesbo(BoxSolver):
    """Bayesian optimisation in a hashed subspace.

    Attributes:
        embedded: Dimension d of the subspace.
        initial: Points of the first, quasi-random design.
    """

    embedded: int = 10
    initial: int = 20
    name: ClassVar[str] = "hesbo"
    summary: ClassVar[str] = "Bayesian optimisation in a hashed subspace"
    reference: ClassVar[str] = "Nayebi, Munteanu, Poloczek 2019"

    def __post_init__(self) -> None:
        check_initial(self.name, self.initial)
        require_at_least(self, 1, "embedded")

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Searches one hashed subspace."""
        embedding = hash_embedding(dimension, self.embedded, generator)
        return lifted(bayesian_search(self.embedded, self.initial, generator), embedding.lift)
