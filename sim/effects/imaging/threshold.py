"""The picture was cut into cloth and background at another grey level."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


_BINS = 240  # of angle about the centre, 1.5 deg each
_SAMPLES = 8  # points on each edge of the mesh
_HARMONICS = 24  # of the outline; finer detail is the mesh's


class Threshold(Effect):
    """An outline that lies farther out or in, everywhere by as much."""

    name = "threshold"
    kind = "imaging"
    summary = "the outline lies farther out or in, from the grey level that tells cloth from background"
    physics = "Over a blurred edge, another grey level moves the outline r(phi) along its normal by the shift."
    reference = "offset of a plane curve; normal of a polar curve, e_r - (r'/r) e_phi"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "shift", "m", -0.005, 0.005, 0.7e-3, "half a pixel of the public release (723 px/m)",
            summary="of the outline, outwards",
        ),
    )  # fmt: skip
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        import torch

        shift, edges = value["shift"], setup.mesh.edges

        def offset(points: Tensor) -> Tensor:
            flat = points[:, :2]
            return torch.cat([flat + shift * _normals(flat, edges), points[:, 2:]], dim=1)

        return setup.with_added(seen=offset)


def _normals(points: Float[Tensor, "vertices 2"], edges: Int[ndarray, "edges 2"]) -> Float[Tensor, "vertices 2"]:
    """Outward normal of the outline at every point's angle; it fades to 0 from halfway in to the centre."""
    import torch

    constant, cosine, sine = _harmonics(_outline(points, edges))
    order = torch.arange(1, _HARMONICS + 1).to(points)
    distance = torch.linalg.norm(points, dim=1).clamp_min(1e-12)
    angle = torch.atan2(points[:, 1], points[:, 0])
    wave, turned = torch.cos(angle[:, None] * order), torch.sin(angle[:, None] * order)
    radius = constant + wave @ cosine + turned @ sine
    slope = (wave @ (order * sine) - turned @ (order * cosine)) / radius
    outward = points / distance[:, None]
    along = torch.stack([-outward[:, 1], outward[:, 0]], dim=1)
    ramp = (2 * distance / radius).clamp(0, 1)
    normal = (outward - slope[:, None] * along) / torch.sqrt(1 + slope**2)[:, None]
    return (ramp * ramp * (3 - 2 * ramp))[:, None] * normal


def _outline(points: Float[Tensor, "vertices 2"], edges: Int[ndarray, "edges 2"]) -> Float[Tensor, " bins"]:
    """Farthest distance from the centre in each bin of angle, over points on all edges."""
    import torch

    share = np.linspace(0, 1, _SAMPLES, endpoint=False)[:, None, None]
    at = points.detach().cpu().numpy()
    first, second = at[edges[:, 0]], at[edges[:, 1]]
    on_edges = (first + share * (second - first)).reshape(-1, 2)
    distance = np.hypot(*on_edges.T)
    place = np.floor(np.arctan2(on_edges[:, 1], on_edges[:, 0]) * (_BINS / (2 * math.pi))).astype(np.int64) % _BINS
    order = np.argsort(distance, kind="stable")
    farthest = np.full(_BINS, -1)
    farthest[place[order]] = order  # the last assignment of a bin stays
    filled = np.flatnonzero(farthest >= 0)
    apart = np.abs(np.arange(_BINS)[:, None] - filled)
    chosen = farthest[filled[np.minimum(apart, _BINS - apart).argmin(1)]]
    weight = torch.from_numpy(share[chosen // len(edges), 0]).to(points)
    ends = points[edges[chosen % len(edges)]]
    return torch.linalg.norm(ends[:, 0] + weight * (ends[:, 1] - ends[:, 0]), dim=1)


def _harmonics(radius: Float[Tensor, " bins"]) -> tuple[Tensor, Tensor, Tensor]:
    """Mean, cosine and sine coefficients of a function of angle given at the bins' middles."""
    import torch

    angle = (torch.arange(_BINS, dtype=torch.float64) + 0.5) * (2 * math.pi / _BINS)
    phase = torch.arange(1, _HARMONICS + 1, dtype=torch.float64)[:, None] * angle
    cosine, sine = torch.cos(phase).to(radius), torch.sin(phase).to(radius)
    return radius.mean(), cosine @ radius * (2 / _BINS), sine @ radius * (2 / _BINS)
