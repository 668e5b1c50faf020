"""Where a local effect acts on the cloth: a round patch with soft edges, in the cloth's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxtyping import Float

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.sim.effects.base import Parameter, Values
from cusick_bench.sim.errors import SimulationError

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


_BEYOND = 1e-3  # [m] by which a patch's centre may lie beyond the rim: cloths are cut so exactly

PLACE = (
    Parameter(
        "direction", "deg", -360.0, 360.0, 0.0, "any", "direction",
        summary="of the patch from the cloth's centre, counter-clockwise from the mark",
    ),
    Parameter(
        "radius", "m", 0.0, CLOTH_RADIUS, 0.125, "assumed: in the middle of the standard's hanging part", "radius",
        0.125,
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
    def of(cls, value: Values, setup: Setup) -> Patch:
        """The patch that parameters `PLACE` tell.

        Args:
            value: Parameters by name.
            setup: The drape that it is for.

        Returns:
            The patch.

        Raises:
            SimulationError: Its centre lies beyond the rim of the cloth, as it is without effects.
        """
        import torch

        from cusick_bench.sim.cloth.warp import cloth_circle

        made = setup.mesh if setup.placing is None else setup.placing.made
        reach, radius = cloth_circle(made)[1], float(torch.as_tensor(value["radius"]).detach())
        if radius > reach + _BEYOND:
            raise SimulationError(
                f"a patch must lie on the cloth, whose radius is {reach:.4g} m, got one centred {radius:.4g} m from "
                f"the cloth's centre; give it a smaller radius, such as radius={(setup.held + reach) / 2:.3g}"
            )
        return cls(value["direction"], value["radius"], value["size"])

    def __call__(self, points: Float[Tensor, "points 2"]) -> Float[Tensor, " points"]:
        """The patch at points about the cloth's centre [m]."""
        import torch

        angle = torch.as_tensor(self.direction, dtype=torch.float64) * (math.pi / 180)
        x, y = points[:, 0] - self.radius * torch.cos(angle), points[:, 1] - self.radius * torch.sin(angle)
        return torch.exp(-0.5 * (x**2 + y**2) / self.size**2)
