"""Numbers of a simulated cloth as the kernels take them, and the derivatives of a scalar to them."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray


@dataclass(frozen=True)
class Parameters:
    """Numbers of one simulated cloth, or of a batch (every array then has a leading axis), as the kernels take them.

    Attributes:
        stretch: C, one shared table (1, 6, 4) or one per face [N/m].
        bending: B, one shared table (1, 3, 5) or one per hinge [N m].
        mass: Vertex masses [kg].
        rest_angle: Stress-free dihedral angle of every hinge [rad]; of a shell's points the curvatures at rest [1/m].
        poisson: Poisson's ratio of bending, which law `plate` has (one number of each cloth).
    """

    stretch: Float[ndarray, "*members stretch_tables 6 4"]
    bending: Float[ndarray, "*members bending_tables 3 5"]
    mass: Float[ndarray, "*members vertices"]
    rest_angle: Float[ndarray, "*members rest_angles"]
    poisson: Float[ndarray, "*members"] = field(default_factory=lambda: np.zeros(()))

    def __post_init__(self) -> None:
        if self.poisson.shape != self.mass.shape[:-1]:
            object.__setattr__(self, "poisson", np.broadcast_to(self.poisson, self.mass.shape[:-1]).copy())

    def batch(self) -> "Parameters":
        """This cloth as a batch of one."""
        return Parameters(*(array[None] for array in vars(self).values()))

    def member(self, index: int) -> "Parameters":
        """One cloth of this batch.

        Args:
            index: Place of the cloth in the batch.

        Returns:
            Its parameters, in the same memory.
        """
        return Parameters(*(array[index, ...] for array in vars(self).values()))

    def part(self, members: slice) -> "Parameters":
        """Neighbouring cloths of this batch.

        Args:
            members: Their places in the batch.

        Returns:
            Their parameters, in the same memory.
        """
        return Parameters(*(array[members] for array in vars(self).values()))

    def take(self, members: Int[ndarray, "some"]) -> "Parameters":
        """Some cloths of this batch.

        Args:
            members: Places of the cloths in the batch, ascending.

        Returns:
            Their parameters.
        """
        if len(members) == len(self.mass):
            return self
        return Parameters(*(array[members] for array in vars(self).values()))


@dataclass(frozen=True)
class ParameterGradient:
    """Derivatives of a scalar to the parameters, per element even where one table is shared; batched as they are."""

    stretch: Float[ndarray, "*members faces 6 4"]
    bending: Float[ndarray, "*members hinges 3 5"]
    mass: Float[ndarray, "*members vertices"]
    rest_angle: Float[ndarray, "*members rest_angles"]
    poisson: Float[ndarray, "*members"] = field(default_factory=lambda: np.zeros(()))

    def batch(self) -> "ParameterGradient":
        """This gradient as that of a batch of one, in the same memory."""
        return ParameterGradient(*(array[None] for array in vars(self).values()))

    def member(self, index: int) -> "ParameterGradient":
        """One member's gradient.

        Args:
            index: Place of the cloth in the batch.

        Returns:
            Its gradient, in the same memory.
        """
        return ParameterGradient(*(array[index, ...] for array in vars(self).values()))

    def part(self, members: slice) -> "ParameterGradient":
        """Gradients of neighbouring members.

        Args:
            members: Their places in the batch.

        Returns:
            Their gradients, in the same memory.
        """
        return ParameterGradient(*(array[members] for array in vars(self).values()))

    def put(self, members: int | Int[ndarray, "some"], found: "ParameterGradient") -> None:
        """Sets the gradients of some members, in place.

        Args:
            members: Place or places in the batch.
            found: Their gradients.
        """
        for mine, theirs in zip(vars(self).values(), vars(found).values(), strict=True):
            mine[members] = theirs
