"""Drops of a cloth whose law has internal variables: friction, creep, stiffness that depends on the sign of curvature.

Between the steps of a drop a `StateLaw` looks at where the cloth is and sets its parameters for the next step. An
elastic-plastic element in series form is exact in this way: a spring of stiffness k whose rest state follows the
motion beyond a threshold. Not differentiated: gradients to such effects are differences with common random numbers.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.material import Material
from cusick_bench.sim.system import DrapeSystem, Parameters


class StateLaw(ABC):
    """Internal variables of a cloth."""

    @abstractmethod
    def start(self, system: DrapeSystem, parameters: Parameters) -> "State":
        """The state of a cloth that lies flat, unloaded.

        Args:
            system: Cloth and support.
            parameters: One cloth, not a batch, as it is without this law.
        """


class State(ABC):
    """Internal variables of one cloth during one drop; changes as the cloth moves."""

    @abstractmethod
    def advance(
        self, system: DrapeSystem, parameters: Parameters, x: Float[np.ndarray, "vertices 3"], share: float
    ) -> tuple[DrapeSystem, Parameters]:
        """System and parameters for the next step.

        Args:
            system: As the laws before this one left it.
            parameters: As they left them.
            x: Where the cloth is [m].
            share: How much of the drop is over, in [0, 1).
        """


def drop_with_history(
    simulator: DrapeSimulator,
    material: Material,
    initial: Float[Tensor, "vertices 3"],
    rest_angle: Float[Tensor, "hinges"],
    laws: Sequence[StateLaw],
) -> Float[Tensor, "vertices 3"]:
    """Drops one cloth whose laws have internal variables.

    Args:
        simulator: Mesh and settings.
        material: The cloth without these laws.
        initial: Shape in which it is laid down [m].
        rest_angle: Stress-free dihedral angles [rad].
        laws: Internal variables.

    Returns:
        Positions [m], without gradients.

    Raises:
        DrapeDiverged: The cloth flies apart.
    """
    raise NotImplementedError
