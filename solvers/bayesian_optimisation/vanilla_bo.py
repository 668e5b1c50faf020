"""Vanilla Bayesian optimisation: every coordinate is modelled, with length scales that grow with their number.

References:
    Hvarfner, Hellsten, Nardi, Vanilla Bayesian Optimization Performs Great in High Dimensions, ICML 2024.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cusick_bench.solvers.bayesian_optimisation.search import bayesian_search, check_initial
from cusick_bench.solvers.black_box.box import BoxSolver, Search


@dataclass(frozen=True)
class VanillaBo(BoxSolver):
    """Log expected improvement over the whole box.

    Attributes:
        initial: Points of the first, quasi-random design.
    """

    initial: int = 20
    name: ClassVar[str] = "vanilla-bo"
    summary: ClassVar[str] = "Bayesian optimisation of all coordinates, length-scale prior scaled with dimension"
    reference: ClassVar[str] = "Hvarfner, Hellsten, Nardi 2024"

    def __post_init__(self) -> None:
        check_initial(self.name, self.initial)

    def search(self, dimension: int, evaluations: int, generator: np.random.Generator) -> Search:
        """Searches the whole box."""
        return bayesian_search(dimension, self.initial, generator)
