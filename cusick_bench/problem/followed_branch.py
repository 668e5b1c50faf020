"""The branch of equilibria that a fit follows: each drape starts from the best one so far."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.metering.journal import Entry
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine.statics.branch import follow

NUMERICS_VERSION = 2  # raised when drapes start from other shapes in mode `equilibrium`: see runner/numerics.py


@dataclass
class FollowedBranch:
    """The best drape so far.

    Attributes:
        loss: Its loss; inf before the first one.
        vertices: Its vertices [m].
    """

    loss: float = math.inf
    vertices: Float[Tensor, "vertices 3"] | None = None

    def keep(self, entry: Entry) -> None:
        """Goes on from a drape if it is better.

        Args:
            entry: An evaluation; without its vertices it is passed over.
        """
        if entry.evaluation.loss < self.loss and "vertices" in entry.arrays:
            self.loss = entry.evaluation.loss
            self.vertices = torch.tensor(entry.arrays["vertices"])  # a copy: a solver may write to what it observed

    def start(self, members: int) -> Float[Tensor, "members vertices 3"] | None:
        """Initial shape of drapes.

        Args:
            members: Number of drapes.

        Returns:
            Positions [m]; None before the first drape.
        """
        return None if self.vertices is None else self.vertices.expand(members, -1, -1)

    def left_by(self, mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"]) -> bool:
        """Whether a drape that started from here lies on another branch.

        Args:
            mesh: Mesh of both.
            vertices: The drape [m].

        Returns:
            Whether it does.
        """
        return self.vertices is not None and follow(mesh, self.vertices.numpy(), vertices).changed
