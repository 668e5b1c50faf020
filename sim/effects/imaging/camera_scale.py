"""The picture's scale is not the nominal one."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


class CameraScale(Effect):
    """Everything is seen larger or smaller than it is."""

    name = "camera-scale"
    kind = "imaging"
    summary = "the picture's scale is not the nominal one"
    physics = "Seen size = (1 + error) true size, about the plate's axis."
    reference = "similarity of the image plane"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "error", "1", -0.2, 0.2, 0.02,
            "half of the 4 % by which the absolute scale of the public release is uncertain",
            summary="relative error of the scale",
        ),
    )  # fmt: skip
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        scale = 1 + value["error"]

        def magnify(points: Tensor) -> Tensor:
            return scale * points  # z as well, so that this map and rotations can be exchanged

        return setup.with_added(seen=magnify)
