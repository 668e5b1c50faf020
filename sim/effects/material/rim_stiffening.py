"""The rim bends less easily: sealed, overlocked or frayed when it was cut."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from jaxtyping import Float

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.cloth.mesh import Mesh
    from cusick_bench.sim.setup import Setup


class RimStiffening(Effect):
    """Bending stiffness that is raised, or lowered, along the rim."""

    name = "rim-stiffening"
    kind = "material"
    summary = "the rim is stiffer"
    physics = "B is multiplied by exp(stiffening exp(-d / width)), d the distance from the rim."
    reference = "ISO 9073-9:2008, Textiles. Test methods for nonwovens. Part 9 (how specimens are cut)."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "stiffening", "1", -3.0, 3.0, math.log(3), "assumed: three times as stiff, as a sealed edge may be",
            summary="natural logarithm of the factor on B at the rim",
        ),
        Parameter(
            "width", "m", 0.002, 0.05, 0.01, "assumed: a cut edge's seal or overlock", "size", 0.01,
            "distance from the rim over which it fades by exp(-1)",
        ),
    )  # fmt: skip
    located = "ring"
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        import torch

        from cusick_bench.sim.cloth.warp import cloth_circle
        from cusick_bench.sim.setup import OnCloth

        stiffening, width = value["stiffening"], value["width"]

        def log_factor(mesh: Mesh, points: Float[Tensor, "points 2"]) -> Float[Tensor, " points"]:
            inward = (cloth_circle(mesh)[1] - torch.linalg.norm(points, dim=1)).clamp(min=0)
            return stiffening * torch.exp(-inward / width)

        return setup.with_added(log_bending=OnCloth(log_factor, setup.mesh))
