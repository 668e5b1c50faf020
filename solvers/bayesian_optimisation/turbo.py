"""TuRBO-1: Bayesian optimisation within one trust region, begun anew elsewhere when it has shrunk away.

References:
    Eriksson, Pearce, Gardner, Turner, Poloczek, Scalable Global Optimization via Local Bayesian Optimization,
    NeurIPS 2019.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cusick_bench.solvers.base import require_at_least
from cusick_bench.solvers.bayesian_optimisation.search import check_initial, design
from cusick_bench.solvers.bayesian_optimisation.trust_region import TrustRegion, local_search
from cusick_bench.solvers.black_box.box import BoxSolver, Search


@dataclass(frozen=True)
class Turbo(BoxSolver):
    """One trust region at a time, over all coordinates.

    Attributes:
        initial: Points of the quasi-random design that each region begins with.
        candidates: Most points a Thompson sample chooses from, in time that grows with their cube (paper: 5000).
    """

    initial: int = 20
    candidates: int = 2000
    name: ClassVar[str] = "turbo"
    summary: ClassVar[str] = "Bayesian optimisation within a trust region (TuRBO-1)"
    reference: ClassVar[str] = "Eriksson, Pearce, Gardner, Turner, Poloczek 2019"

    def __post_init__(self) -> None:
        check_initial(self.name, self.initial)
        require_at_least(self, 1, "candidates")

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Searches one trust region after the other."""
        while True:
            points, losses = yield from design(dimension, self.initial, generator)
            region = TrustRegion(tolerance=max(4, dimension))
            yield from local_search(points, losses, region, self.candidates, generator)
