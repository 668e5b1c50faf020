"""Buffers for the kernels' results for every element, reused from evaluation to evaluation."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.triangles.elements import Elements


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

    def first(self, members: int) -> "Workspace":
        """Views of these buffers for fewer cloths.

        Args:
            members: Number of cloths.

        Returns:
            The first part of every buffer.
        """
        if members == len(self.face_energy):
            return self
        return Workspace(
            self.face_energy[:members], self.face_vector[:members], self.face_blocks[:members],
            self.hinge_energy[:members], self.hinge_vector[:members], self.hinge_moment[:members],
            self.hinge_stiffness[:members], self.ones[:members], self.no_blocks, self._exact,
        )  # fmt: skip

    def exact_blocks(self) -> Float[ndarray, "members hinges 10 9"]:
        """Hinge blocks of the exact Hessian, made when first asked for."""
        members, hinges = self.hinge_energy.shape
        if not self._exact or len(self._exact[0]) < members:
            self._exact[:] = [np.zeros((members, hinges, 10, 9))]
        return self._exact[0][:members]
