"""Buffers for the kernels' results at a shell's points and nodes, reused from evaluation to evaluation."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.plate.kernels import EDGE_BLOCKS, NODE_SLOPES, VERTEX_BLOCKS
from cusick_bench.sim.engine.plate.layout import PointNodes


@dataclass(frozen=True, eq=False)
class Workspace:
    """Results of a batch at its points and nodes; see `kernels` for shapes and units."""

    energy: Float[ndarray, "members points"]
    vector: Float[ndarray, "members places 3"]
    edge_block: Float[ndarray, "members edges edge_numbers"]
    vertex_block: Float[ndarray, "members vertices vertex_numbers"]
    slope: Float[ndarray, "members edge_places slope_numbers"]

    @classmethod
    def of(cls, members: int, nodes: PointNodes, edges: int) -> "Workspace":
        """Makes room.

        Args:
            members: Number of cloths.
            nodes: Nodes of the shell's points.
            edges: Number of its edge points.

        Returns:
            Zeros.
        """
        points = len(nodes.start) - 1
        shapes = (
            (points,), (len(nodes.nodes), 3), (edges, EDGE_BLOCKS),
            (points - edges, VERTEX_BLOCKS), (nodes.start[edges], NODE_SLOPES),
        )  # fmt: skip
        return cls(*(np.zeros((members, *shape)) for shape in shapes))

    def first(self, members: int) -> "Workspace":
        """Part of these buffers for a smaller batch.

        Args:
            members: Number of cloths.

        Returns:
            The buffers of the first so many.
        """
        if members == len(self.energy):
            return self
        arrays = (self.energy, self.vector, self.edge_block, self.vertex_block, self.slope)
        return Workspace(*(array[:members] for array in arrays))
