"""The picture's centre is not where the plate's axis is."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


class CameraOffset(Effect):
    """Everything is seen beside where it is."""

    name = "camera-offset"
    kind = "imaging"
    summary = "the plate's axis is not where the picture's centre is taken to be"
    physics = "Seen position = true position + shift, along one direction."
    reference = "translation of the image plane"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "shift", "m", 0.0, 0.03, 1.4e-3,
            "one pixel of the public release (723 px/m); its sample 7 of Fabric 3 lies 11 px off",
            summary="by which the cloth is seen beside its place",
        ),
        Parameter("direction", "deg", -360.0, 360.0, 0.0, "any", "direction", 0.0, "of the shift, in the picture"),
    )  # fmt: skip
    located = "direction"
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        import torch

        from cusick_bench.sim.effects.directions import unit

        shift = torch.nn.functional.pad(value["shift"] * unit(value["direction"]), (0, 1))

        def move(points: Tensor) -> Tensor:
            return points + shift.to(points)

        return setup.with_added(seen=move)
