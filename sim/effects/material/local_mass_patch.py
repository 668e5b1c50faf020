"""A patch of the cloth is heavier: a label, a stain, a second layer."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values
from cusick_bench.sim.effects.material.patch import PLACE, Patch

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class LocalMassPatch(Effect):
    """Areal density that is raised, or lowered, around one point of the cloth."""

    name = "local-mass-patch"
    kind = "material"
    summary = "one place of the cloth is heavier"
    physics = (
        "Areal density = nominal (1 + mass exp(-d^2 / (2 size^2))), d the distance from the patch's centre; in all "
        "2 pi size^2 mass times the nominal density is added, less what of the patch lies beyond the rim: 12 % at the "
        "usual place."
    )
    reference = "ISO 3801:1977, Textiles. Woven fabrics. Determination of mass per unit length and mass per unit area."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "mass", "1", -0.9, 20.0, 1.0, "assumed: a second layer of the same cloth",
            summary="added density at the centre, relative to the nominal one",
        ),
        *PLACE,
    )  # fmt: skip
    located = "patch"
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        import torch

        patch, mass = Patch.of(value, setup), value["mass"]
        return setup.with_added(log_mass=lambda points: torch.log1p(mass * patch(points)))
