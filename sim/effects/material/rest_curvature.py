"""The cloth curls by itself: without load, and alone, it would be a cylinder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from jaxtyping import Float

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


_LOCAL_HINGES = 4


@dataclass(frozen=True, eq=False)
class Curl:
    """Rest angles of a cylinder, one hinge at a time: the sheet is rolled up about that hinge's middle.

    Attributes:
        curvature: Towards the face [1/m].
        degrees: Material direction that curls, from the warp.
    """

    curvature: float | Tensor
    degrees: float | Tensor

    def __call__(self, mesh: Mesh) -> Float[Tensor, " hinges"]:
        import torch

        from cusick_bench.sim.cloth.shape import dihedral_angles

        corners = torch.from_numpy(mesh.hinge_corners)  # of the pattern: the grain's frame
        flat = torch.cat([corners[:, 0, :2], corners[:, :, 2]], dim=1)
        flat = flat - flat[:, :2].mean(1, keepdim=True)
        angle = torch.as_tensor(self.degrees, dtype=torch.float64) * (math.pi / 180)
        along = flat[..., 0] * torch.cos(angle) + flat[..., 1] * torch.sin(angle)
        across = flat[..., 1] * torch.cos(angle) - flat[..., 0] * torch.sin(angle)
        turn = torch.as_tensor(self.curvature, dtype=torch.float64) * along  # [rad]
        rolled = along * torch.sinc(turn / math.pi)
        height = 0.5 * along * turn * torch.sinc(turn / (2 * math.pi)) ** 2
        shape = torch.stack([rolled, across, height], dim=-1).reshape(-1, 3)
        return dihedral_angles(shape, torch.arange(len(shape)).reshape(-1, _LOCAL_HINGES).numpy())


class RestCurvature(Effect):
    """Natural curvature along one material direction."""

    name = "rest-curvature"
    kind = "material"
    summary = "the cloth curls by itself"
    physics = (
        "Bending moment B : (K - K0) with the rest curvature K0 = curvature n n^T, towards the face where it is "
        "positive, n the material direction that curls; the flat metric stays."
    )
    reference = "Grinspun, Hirani, Desbrun, Schroder. Discrete shells. SCA 2003, Section 2 (rest angles)."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "curvature", "1/m", -200.0, 200.0, 10.0,
            "residual curvature of woven cloth 0 to 0.3 per cm, of knits far more: a third of the woven range",
            summary="rest curvature, towards the face",
        ),
        Parameter("direction", "deg", -360.0, 360.0, 0.0, "warp", "direction", summary="that curls, from the warp"),
    )  # fmt: skip
    located = "direction"
    face_odd = True
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.with_added(rest_angles=Curl(value["curvature"], value["direction"]))
