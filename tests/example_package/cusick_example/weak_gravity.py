"""A laboratory where gravity is not the nominal one."""

from dataclasses import replace
from typing import ClassVar

from cusick_bench.sim.effects import Effect, Parameter, Values
from cusick_bench.sim.setup import Setup


class WeakGravity(Effect):
    """The drape is made where gravity is not the nominal one."""

    name = "weak-gravity"
    kind = "boundary"
    summary = "gravity is not the nominal one"
    physics = "The load per mass is g (1 - loss) instead of g."
    reference = "International Gravity Formula 1980: 9.780 to 9.832 m/s2 at sea level"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="loss", unit="1", low=-0.5, high=0.5, typical=0.003,
            source="half of the range over latitudes", summary="share of gravity that is missing",
        ),
    )  # fmt: skip

    def _apply(self, setup: Setup, value: Values) -> Setup:
        gravity = setup.settings.gravity * (1 - float(value["loss"]))
        return replace(setup, settings=replace(setup.settings, gravity=gravity))
