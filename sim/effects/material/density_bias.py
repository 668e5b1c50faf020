"""The cloth weighs something else than its table says."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class DensityBias(Effect):
    """Areal density that differs from its nominal value."""

    name = "density-bias"
    kind = "material"
    summary = "the cloth is heavier or lighter than stated"
    physics = "True areal density = nominal (1 + bias), all over the cloth."
    reference = "ISO 3801:1977, Textiles. Woven fabrics. Determination of mass per unit length and mass per unit area."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "bias", "1", -0.5, 1.0, 0.03, "coefficient of variation of areal density 1 to 3 %: its upper end",
            summary="relative error of the nominal density",
        ),
    )  # fmt: skip
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        density = setup.material.density * (1 + value["bias"])
        return replace(setup, material=replace(setup.material, density=density))
