"""Both material laws for a batch of cloths in torch: stiffness and stress from C (6 x 4), stiffness from B (3 x 5).

Stretch, with phi = (G00^2 / 2, G00 G11, G11^2 / 2, G01^2) and psi = sum_m k_m phi_m. Law `paper` has
k = sum_j W_j(G) C_j, so that with t_j = sum_m C_jm phi_m (held fixed) the stress d psi / d G has the extra term
sum_j t_j dW_j / dG. With I = G00^2 + 2 G01^2 + G11^2, s = 1 - (1 - q)^3, q = min(I / E^2, 1) and
p = (G00^2, 2 G01^2, G11^2) / I, W reads sum_j W_j t_j = 2 [(1 - s) t_0 + s D(p)], where D is quadratic in p, and

    d(sum_j W_j t_j) / d G00 = 4 G00 [s'(I) (D - t_0) + (s / I) (dD / dp_0 - 2 D)]

and alike for G11 with p_90 and, doubled, for G01 with p_45. Law `published` takes the secant stress (k held fixed).
Everything is a plain expression, so autograd can differentiate it once more for the adjoint.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Section 3.3.1.
"""

import itertools
import math
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.laws.tables import CURVATURE_STEP, STRAIN_SAMPLE

_TINY = 1e-300
_GRID = 10  # nodes of the published table along each strain

Strain = tuple[Tensor, Tensor, Tensor]
"""G00, G11, G01, each (members, faces)."""


def _paper(strain: Strain, table: Tensor) -> tuple[Tensor, Strain]:
    g00, g11, g01 = strain
    warp, bias, weft = g00**2, 2 * g01**2, g11**2
    invariant = warp + bias + weft
    divisor = torch.where(invariant > _TINY, invariant, 1.0)
    p0, p45, p90 = warp / divisor, bias / divisor, weft / divisor
    q = (invariant / STRAIN_SAMPLE**2).clamp(max=1)
    s = 1 - (1 - q) ** 3
    by_invariant = 3 * (1 - q) ** 2 / STRAIN_SAMPLE**2  # s'(I), 0 beyond the samples
    share = (3 - 3 * q + q**2) / invariant.clamp(min=STRAIN_SAMPLE**2)  # s / I, without dividing by 0
    directions = (p0**2, 2 * p0 * p45, p45**2 + 2 * p0 * p90, 2 * p45 * p90, p90**2)
    weights = 2 * torch.stack([1 - s, *(s * w for w in directions)], dim=2)
    k = torch.einsum("mfj,mfjc->mfc", weights, table)
    phi = torch.stack([warp / 2, g00 * g11, weft / 2, bias / 2], dim=2)
    t0, t1, t2, t3, t4, t5 = torch.einsum("mfjc,mfc->mfj", table, phi).unbind(2)
    by_p0, by_p45, by_p90 = p0 * t1 + p45 * t2 + p90 * t3, p0 * t2 + p45 * t3 + p90 * t4, p0 * t3 + p45 * t4 + p90 * t5
    d = p0 * by_p0 + p45 * by_p45 + p90 * by_p90  # the by_p are half the derivatives of D
    first = by_invariant * (d - t0)
    return k, (
        4 * g00 * (first + 2 * share * (by_p0 - d)),
        4 * g11 * (first + 2 * share * (by_p90 - d)),
        8 * g01 * (first + 2 * share * (by_p45 - d)),
    )


def _hat(position: Tensor, samples: int) -> Tensor:
    """Weights of linear interpolation between samples 0, 1, 2 ... at a position."""
    grid = torch.arange(samples, dtype=position.dtype, device=position.device)
    return (1 - (position[..., None] - grid).abs()).clamp(min=0)


@lru_cache(maxsize=4)
def _published_nodes(device: str) -> Float[Tensor, "nodes 6"]:
    """Weights of the samples of C, rest doubled in, at node 100 i + 10 j + k of the published grid."""
    i, j, k = torch.meshgrid(*[torch.arange(_GRID, dtype=torch.float64)] * 3, indexing="ij")
    a, b, c = 0.5 + 0.2 * i, 0.5 + 0.2 * j, 0.2 * k  # entries of the right Cauchy-Green tensor
    largest = (a + b + torch.sqrt(4 * c**2 + (a - b) ** 2)) / 2
    strain = (6 * (largest.sqrt() - 1)).clamp(0, 1)[..., None]
    on_axis = torch.where(i >= j, 0.0, 4.0).double()
    angle = torch.where(k == 0, on_axis, 8 * torch.atan2(c, largest - b).abs() / math.pi)  # in steps of 22.5 degrees
    return 2 * torch.cat([1 - strain, strain * _hat(angle, 5)], dim=3).reshape(-1, 6).to(device)


def _within(position: Tensor, last: float) -> Tensor:
    """Position clamped to [0, last], with slope 0 at both ends."""
    return last - torch.relu(last - torch.relu(position))


def _published(strain: Strain, table: Tensor) -> Tensor:
    g00, g11, g01 = strain
    nodes = _published_nodes(str(table.device))
    position = [_within(10 * scaled, _GRID - 1.0) for scaled in (g00 + 0.25, g11 + 0.25, g01.abs())]
    low = [p.detach().floor().clamp(0, _GRID - 2) for p in position]
    low = [torch.nan_to_num(whole).long() for whole in low]  # a member that blew up must not read elsewhere
    fraction = [p - whole for p, whole in zip(position, low, strict=True)]
    k = table.new_zeros(1)
    for corner in itertools.product((0, 1), repeat=3):
        i, j, l = (whole + upper for whole, upper in zip(low, corner, strict=True))
        u, v, w = (f if upper else 1 - f for f, upper in zip(fraction, corner, strict=True))
        value = torch.einsum("mfj,mfjc->mfc", nodes[(i * _GRID + j) * _GRID + l], table).relu()
        k = k + (u * v * w)[:, :, None] * value
    return k


def stretch(law: str, strain: Strain, table: Float[Tensor, "#members #faces 6 4"]) -> tuple[Tensor, Strain]:
    """Stiffness and stress of every face.

    Args:
        law: `paper` or `published`.
        strain: Green strain G00, G11, G01, each (members, faces) [1].
        table: C [N/m].

    Returns:
        k0..k3 (members, faces, 4) [N/m], and the stress conjugate to G00, G11, G01 [N/m].
    """
    g00, g11, g01 = strain
    if law == "paper":
        k, more = _paper(strain, table)
    else:
        k, more = _published(strain, table), (0.0, 0.0, 0.0)
    k0, k1, k2, k3 = k.unbind(2)
    return k, (k0 * g00 + k1 * g11 + more[0], k2 * g11 + k1 * g00 + more[1], 2 * k3 * g01 + more[2])


def tension(law: str, k: Float[Tensor, "members faces 4"], strain: Strain) -> tuple[Tensor, Tensor]:
    """Geometric stiffness g_uu and g_vv of every face in the implicit step, from stretched directions only [N/m].

    A negative k1 can make them negative under law `paper`, and the step's matrix indefinite: they are then 0.

    Args:
        law: `paper` or `published`.
        k: Stiffness k0..k3 [N/m].
        strain: Strain of the faces.

    Returns:
        g_uu and g_vv (members, faces).
    """
    k0, k1, k2, _ = k.unbind(2)
    plus0, plus1 = strain[0].relu(), strain[1].relu()
    g_uu, g_vv = k0 * plus0 + k1 * plus1, k2 * plus1 + k1 * plus0
    return (_not_negative(g_uu), _not_negative(g_vv)) if law == "paper" else (g_uu, g_vv)


def _not_negative(value: Tensor) -> Tensor:
    """max(value, 0) with slope 1 at 0: where c12 = 0 nothing is cut off yet, and its gradient has to tell."""
    return torch.where(value >= 0, value, 0.0)


def _bspline(offset: Tensor) -> Tensor:
    """Uniform quadratic B-spline of unit knot spacing."""
    distance = offset.abs()
    return 0.5 * torch.relu(1.5 - distance) ** 2 - 1.5 * torch.relu(0.5 - distance) ** 2


def bending(
    law: str, curvature: Float[Tensor, "members hinges"], rows: Float[Tensor, "#members hinges 5"]
) -> Float[Tensor, "members hinges"]:
    """Secant bending stiffness of every hinge [N m].

    Args:
        law: `paper` (quadratic B-spline, even, constant beyond the samples) or `published` (linear, rectified; sample 0
            for the curvatures that its program counts as negative).
        curvature: [1/m].
        rows: B at the hinge's direction, samples at 0, 10, 20, 30, 40 per metre [N m].

    Returns:
        Stiffness.
    """
    if law == "paper":
        at = (curvature.abs() / CURVATURE_STEP).clamp(max=4.5)
        mirrored, beyond = _bspline(at + 1), _bspline(at - 5)
        weights = [_bspline(at), _bspline(at - 1) + mirrored, _bspline(at - 2), _bspline(at - 3)]
        weights.append(_bspline(at - 4) + beyond)
    else:
        at = _within(-curvature / CURVATURE_STEP, 4.0)
        weights = [torch.relu(1 - (at - sample).abs()) for sample in range(5)]
    stiffness = (torch.stack(weights, dim=2) * rows).sum(2)
    return stiffness if law == "paper" else stiffness.relu()
