"""The camera does not look straight down."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


class CameraTilt(Effect):
    """A camera whose axis leans, still aimed at the plate's centre."""

    name = "camera-tilt"
    kind = "imaging"
    summary = "the camera's axis leans from the vertical"
    physics = "Along the direction that the axis leans to, u' = u cos a + z sin a; across it nothing changes."
    reference = "rigid rotation (Rodrigues), then parallel projection"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "angle", "deg", 0.0, 30.0, 2.0, "assumed: a camera on a stand, aimed by eye", summary="of the axis"
        ),
        Parameter("direction", "deg", -360.0, 360.0, 0.0, "any", "direction", 0.0, "that the axis leans to"),
    )  # fmt: skip
    located = "direction"
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        from cusick_bench.sim.effects.directions import leaned

        angle, direction = value["angle"], value["direction"]

        def tilt(points: Tensor) -> Tensor:
            return leaned(points, angle, direction)

        return setup.with_added(seen=tilt)
