"""The cloth is cut larger or smaller than its nominal size."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class CutSize(Effect):
    """A cloth of another radius."""

    name = "cut-size"
    kind = "boundary"
    summary = "the cloth's radius is not the nominal one"
    physics = "The cloth is a disc of radius R + error about its centre; density and plate stay."
    reference = "ISO 9073-9:2008 (specimen of 30 cm; 24 or 36 cm as variants)"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "error", "m", -0.01, 0.01, 1e-3,
            "assumed: a cut along a template; some cloths of the public release exceed 15 cm",
            summary="of the cloth's radius",
        ),
    )  # fmt: skip
    located = "ring"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.moved(growth=float(value["error"]))
