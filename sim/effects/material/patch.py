"""Where a local effect acts on the cloth: a round patch with soft edges, in the cloth's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxtyping import Float

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.sim.effects.base import Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor


PLACE = (
    Parameter(
        "direction", "deg", -360.0, 360.0, 0.0, "any", "direction",
        summary="of the patch from the cloth's centre, counter-clockwise from the mark",
    ),
    Parameter(
        "radius", "m", 0.0, CLOTH_RADIUS, 0.125, "assumed: in the middle of the hanging part", "radius", 0.125,
        "distance of the patch from the cloth's centre",
    ),
    Parameter(
        "size", "m", 0.005, 0.1, 0.02, "assumed: a seam, stain or label of 4 cm", "size", 0.02,
        "radius at which the patch has fallen to exp(-1/2)",
    ),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Patch:
    """exp(-d^2 / (2 size^2)), d the distance from the patch's centre.

    Attributes:
        direction: [deg].
        radius: [m].
        size: [m].
    """

    direction: float | Tensor
    radius: float | Tensor
    size: float | Tensor

    @classmethod
    def of(cls, value: Values) -> Patch:
        """The patch that parameters `PLACE` tell.

        Args:
            value: Parameters by name.

        Returns:
            The patch.
        """
        return cls(value["direction"], value["radius"], value["size"])

    def __call__(self, points: Float[Tensor, "points 2"]) -> Float[Tensor, " points"]:
        """The patch at points about the cloth's centre [m]."""
        import torch

        angle = torch.as_tensor(self.direction, dtype=torch.float64) * (math.pi / 180)
        x, y = points[:, 0] - self.radius * torch.cos(angle), points[:, 1] - self.radius * torch.sin(angle)
        return torch.exp(-0.5 * (x**2 + y**2) / self.size**2)
