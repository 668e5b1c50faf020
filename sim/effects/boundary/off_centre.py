"""The cloth's centre does not lie on the plate's axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class OffCentre(Effect):
    """A cloth laid down beside the plate's axis, always by as much and on the same side."""

    name = "off-centre"
    kind = "boundary"
    summary = "the cloth's centre lies beside the plate's axis"
    physics = "The overhang is R - r + s cos(phi - phi0), wider towards phi0; mass and metric of the cloth stay."
    reference = "ISO 9073-9:2008 (the specimen is centred on the supporting disc)"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "shift", "m", 0.0, 0.03, 2e-3, "assumed: a specimen centred by eye or by a pin hole",
            summary="distance of the cloth's centre from the plate's axis",
        ),
        Parameter(
            "direction", "deg", -360.0, 360.0, 0.0, "any", "direction", 0.0,
            "of the cloth's centre, in the laboratory",
        ),
    )  # fmt: skip
    located = "direction"
    version = 3  # 3: beside another cut, plate or shift the cloth lies as if all came at once

    def _apply(self, setup: Setup, value: Values) -> Setup:
        from cusick_bench.sim.effects.directions import unit

        x, y = (float(value["shift"]) * unit(setup.cloth_direction(float(value["direction"])))).tolist()
        return setup.moved(x=x, y=y)
