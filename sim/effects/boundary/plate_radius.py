"""The plate is larger or smaller than its nominal size."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class PlateRadius(Effect):
    """A plate of another radius under the same cloth."""

    name = "plate-radius"
    kind = "boundary"
    summary = "the plate's radius is not the nominal one"
    physics = "The cloth is held within r + error instead of r; its own radius stays, so the overhang narrows."
    reference = "ISO 9073-9:2008 (supporting disc of 18 cm; 12 cm as a variant)"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "error", "m", -0.01, 0.01, 1e-3, "assumed: a rounded or worn edge, or a plate measured with a ruler",
            summary="of the plate's radius",
        ),
    )  # fmt: skip
    located = "ring"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.moved(plate_growth=float(value["error"]))
