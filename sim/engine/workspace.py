"""Buffers for what the kernels return of every element, used again from evaluation to evaluation."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.elements import Elements


@dataclass(frozen=True, eq=False)
class Workspace:
    """Element results of a batch; see `face_kernels` and `hinge_kernels` for shapes and units."""

    face_energy: ndarray
    face_vector: ndarray
    face_blocks: ndarray
    hinge_energy: ndarray
    hinge_vector: ndarray
    hinge_moment: ndarray
    hinge_stiffness: ndarray
    ones: ndarray
    no_blocks: ndarray
    _exact: list[ndarray]

    @classmethod
    def of(cls, elements: Elements, members: int) -> "Workspace":
        """Buffers for the elements of a mesh.

        Args:
            elements: Faces and hinges.
            members: Number of cloths.

        Returns:
            The buffers, zero.
        """
        faces, hinges = (members, len(elements.faces)), (members, len(elements.hinges))
        return cls(
            np.zeros(faces), np.zeros((*faces, 3, 3)), np.zeros((*faces, 6, 9)), np.zeros(hinges),
            np.zeros((*hinges, 12)), np.zeros(hinges), np.zeros(hinges), np.ones(hinges), np.zeros((0, 0, 10, 9)), [],
        )  # fmt: skip

    def exact_blocks(self) -> Float[ndarray, "members hinges 10 9"]:
        """Hinge blocks of the exact Hessian, made when first asked for."""
        if not self._exact:
            self._exact.append(np.zeros((*self.hinge_energy.shape, 10, 9)))
        return self._exact[0]
