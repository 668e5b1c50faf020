"""The plate is not level."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


class PlateTilt(Effect):
    """A plate that slopes, with the cloth on it; gravity and camera stay vertical."""

    name = "plate-tilt"
    kind = "boundary"
    summary = "the plate slopes"
    physics = "Plate and cloth as laid down are turned by the angle about a horizontal axis through the plate's centre."
    reference = "rigid rotation (Rodrigues)"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("angle", "deg", 0.0, 20.0, 1.0, "assumed: a stand levelled by eye", summary="slope of the plate"),
        Parameter("direction", "deg", -360.0, 360.0, 0.0, "any", "direction", 0.0, "downhill, in the laboratory"),
    )
    located = "direction"
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        from cusick_bench.sim.effects.directions import leaned

        angle, downhill = value["angle"], setup.cloth_direction(value["direction"])

        def tilt(shape: Tensor) -> Tensor:
            return leaned(shape, angle, downhill)

        return setup.with_added(laid=tilt)
