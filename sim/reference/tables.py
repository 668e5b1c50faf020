"""The stiffness tables of both material laws in plain torch: the independent check of the compiled `tables`.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Section 3.3.1.
"""

import itertools
import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

STRETCH_SAMPLE = 1 + 1 / 6  # stretch at samples 1..5 of C
CURVATURE_STEP = 10.0  # [1/m] between the columns of B
_TINY = 1e-300


def weights_stretch_paper(strain: Float[Tensor, "faces 2 2"]) -> Float[Tensor, "faces 6"]:
    """Weights W_j of the samples in k = sum_j W_j C_j under law `paper`.

    k = 2 [(1 - s) C_0 + s sum_j w_j C_j] with I = G00^2 + 2 G01^2 + G11^2, q = min(I / E^2, 1), s = 1 - (1 - q)^3,
    E the Green strain of a stretch of 1 + 1/6; w_1..w_5 are the terms of (p0 + p45 + p90)^2 sorted by direction,
    where (p0, p45, p90) = (G00^2, 2 G01^2, G11^2) / I.

    Args:
        strain: Green strain G.

    Returns:
        Weights of C_0 .. C_5.
    """
    warp, bias, weft = strain[:, 0, 0] ** 2, 2 * strain[:, 0, 1] ** 2, strain[:, 1, 1] ** 2
    invariant = warp + bias + weft
    sample = (STRETCH_SAMPLE**2 - 1) / 2
    s = 1 - (1 - (invariant / sample**2).clamp(max=1)) ** 3
    divisor = torch.where(invariant > _TINY, invariant, 1.0)
    p0, p45, p90 = warp / divisor, bias / divisor, weft / divisor
    directions = (p0**2, 2 * p0 * p45, p45**2 + 2 * p0 * p90, 2 * p45 * p90, p90**2)
    return 2 * torch.stack([1 - s, *(s * w for w in directions)], dim=1)


def hat(position: Tensor, samples: int) -> Tensor:
    """Weights of linear interpolation between samples 0, 1, 2 ... at a position.

    Args:
        position: Positions (any shape), in units of the samples' distance.
        samples: Number of samples.

    Returns:
        Weights (any shape, samples); they sum to 1 between the first and the last sample.
    """
    grid = torch.arange(samples, dtype=position.dtype, device=position.device)
    return (1 - (position[..., None] - grid).abs()).clamp(min=0)


def _published_node(node: Int[Tensor, "faces 3"]) -> Float[Tensor, "faces 6"]:
    """Weights of the samples at node (i, j, k) of the published 10 x 10 x 10 grid over (G00, G11, |G01|)."""
    i, j, k = node.double().unbind(1)
    a, b, c = 0.5 + 0.2 * i, 0.5 + 0.2 * j, 0.2 * k  # entries of the right Cauchy-Green tensor
    largest = (a + b + torch.sqrt(4 * c**2 + (a - b) ** 2)) / 2
    strain = (6 * (largest.sqrt() - 1)).clamp(0, 1)
    on_axis = torch.where(i >= j, 0.0, 4.0).double()
    angle = torch.where(k == 0, on_axis, 8 * torch.atan2(c, largest - b).abs() / math.pi)  # in steps of 22.5 degrees
    return torch.cat([(1 - strain)[:, None], strain[:, None] * hat(angle, 5)], dim=1)


def _bspline(offset: Tensor) -> Tensor:
    """Uniform quadratic B-spline of unit knot spacing."""
    tail = 0.5 * (1.5 - offset.abs()).clamp(min=0) ** 2
    return torch.where(offset.abs() <= 0.5, 0.75 - offset**2, tail)


def weights_bending_paper(curvature: Float[Tensor, "*any"]) -> Float[Tensor, "*any 5"]:
    """Weights of the samples at 0, 10, 20, 30, 40 per metre: quadratic B-spline, mirrored at 0, constant beyond 45.

    Args:
        curvature: Curvatures [1/m].

    Returns:
        Weights of the five samples; they sum to 1.
    """
    position = (curvature / CURVATURE_STEP).clamp(-4.5, 4.5)
    columns: list[Tensor] = [torch.zeros_like(position) for _ in range(5)]
    for knot in range(-6, 7):
        columns[min(abs(knot), 4)] = columns[min(abs(knot), 4)] + _bspline(position - knot)
    return torch.stack(columns, dim=-1)


def stretch_published(
    strain: Float[Tensor, "faces 2 2"], table: Float[Tensor, "tables 6 4"]
) -> Float[Tensor, "faces 4"]:
    """k0..k3 of law `published`: trilinear over (G00, G11, |G01|) between nodes, each the table's rectified value.

    Args:
        strain: Green strain G.
        table: C, shared or one for each face [N/m].

    Returns:
        Stiffness [N/m].
    """
    scaled = torch.stack([strain[:, 0, 0] + 0.25, strain[:, 1, 1] + 0.25, strain[:, 0, 1].abs()], dim=1)
    position = (10 * scaled).clamp(0, 9)
    low = position.detach().floor().clamp(max=8).long()
    fraction = position - low
    k = torch.zeros((len(strain), 4), dtype=strain.dtype, device=strain.device)
    for corner in itertools.product((0, 1), repeat=3):
        upper = torch.tensor(corner, device=strain.device)
        share = torch.where(upper == 1, fraction, 1 - fraction).prod(1)
        node = (2 * _published_node(low + upper)[:, :, None] * table).sum(1).relu()
        k = k + share[:, None] * node
    return k
