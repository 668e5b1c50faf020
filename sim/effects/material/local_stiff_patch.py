"""A patch of the cloth bends less easily: a stain, a crease, a label."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values
from cusick_bench.sim.effects.material.patch import PLACE, Patch

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class LocalStiffPatch(Effect):
    """Bending stiffness that is raised, or lowered, around one point of the cloth."""

    name = "local-stiff-patch"
    kind = "material"
    summary = "one place of the cloth is stiffer"
    physics = "B is multiplied by exp(stiffening exp(-d^2 / (2 size^2))), d the distance from the patch's centre."
    reference = "ISO 9073-9:2008, Textiles. Test methods for nonwovens. Part 9 (specimens without creases)."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "stiffening", "1", -3.0, 3.0, math.log(3), "assumed: three times as stiff, as a coated place may be",
            summary="natural logarithm of the factor on B at the centre",
        ),
        *PLACE,
    )  # fmt: skip
    located = "patch"
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        patch, stiffening = Patch.of(value, setup), value["stiffening"]
        return setup.with_added(log_bending=lambda points: stiffening * patch(points))
