"""The camera is near: what lies lower is seen smaller."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values
from cusick_bench.sim.errors import SimulationError

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


class Perspective(Effect):
    """An eye at a finite height over the plate, in place of a parallel projection."""

    name = "perspective"
    kind = "imaging"
    summary = "the camera is near, so the hanging rim is seen smaller"
    physics = "A point at height z is seen scaled by 1 / (1 - k z), k the inverse height of the eye over the plate."
    reference = "pinhole camera with the plate's level in focus, see `camera.PinholeCamera`"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "inverse_height", "1/m", 0.0, 2.5, 0.7,
            "assumed: half of the 1.43 /m of the published scripts' camera, whose eye is 0.7 m over the plate",
            summary="inverse height of the eye over the plate",
        ),
    )  # fmt: skip
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        import torch

        inverse = value["inverse_height"]

        def project(points: Tensor) -> Tensor:
            depth = 1 - inverse * points[:, 2:]
            if bool((depth <= 0).any()):
                raise SimulationError(
                    f"effect perspective: every point must lie below the eye at {1 / float(inverse):.3g} m, but one is "
                    f"at {float(points[:, 2].max()):.3g} m; lower inverse_height"
                )
            return torch.cat([points[:, :2] / depth, points[:, 2:]], dim=1)

        return setup.with_added(seen=project)
