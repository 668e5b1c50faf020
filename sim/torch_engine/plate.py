"""Bending of law `plate` for a batch of cloths in torch: D and its slope by the squared curvature from B (3 x 5).

With S = k11^2 + k22^2 + 2 k12^2 in squares of 10 1/m and p = sqrt(S), the means of the rows are sum_s W_s(S) B_s with

    W = 2 / S int_0^p w(t) t dt,   W' = (w(p) - W) / S.

w are quadratic splines with knots a = .5, 1.5 .. 4.5: w(p) = w_0(p) + sum_a J_a / 2 (p - a)+^2, w_0 that of the first
piece. Hence, with z = (p - a)+,

    W = (3/4 - S/2, 1/4 + S/2, 0, 0, 0) + sum_a J_a (z^4 / 4 + a z^3 / 3) / S   up to S = 4.5^2,

and beyond, where w is 1 for the last sample, the mean of that and of W(4.5^2). D is made of these means as in
`cusick_bench.sim.laws.plate`. Everything is a plain expression, so autograd can differentiate it for the adjoint.

References:
    Timoshenko, Woinowsky-Krieger. Theory of Plates and Shells, 2nd edition, 1959, Sections 85 and 86 (orthotropy).
"""

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

_LEAST = 0.05  # of sqrt(D11 D22): what D33 never falls below
_FIRST, _LAST = 0.25, 20.25  # S at the first and at the last knot
_SECOND = (  # second derivatives of w on the pieces around samples 0 .. 4, and beyond
    (-2.0, 2.0, 0.0, 0.0, 0.0), (1.0, -2.0, 1.0, 0.0, 0.0), (0.0, 1.0, -2.0, 1.0, 0.0), (0.0, 0.0, 1.0, -2.0, 1.0),
    (0.0, 0.0, 0.0, 1.0, -1.0),
)  # fmt: skip

Entries = tuple[Tensor, Tensor, Tensor, Tensor]
"""D11, D22, D12, D33, each (members, edges)."""


@lru_cache(maxsize=4)
def _spline(device: torch.device) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Jumps J (knots, 5) at the knots within, knots, W at S = 0, its slope there, and the last sample's unit row."""
    second = torch.tensor(_SECOND, dtype=torch.float64)
    start, slope, last = torch.zeros((3, 5), dtype=torch.float64)
    start[0], start[1], slope[0], slope[1], last[4] = 0.75, 0.25, -0.5, 0.5, 1.0
    knots = torch.arange(4, dtype=torch.float64) + 0.5
    tensors = (second[1:] - second[:-1], knots, start, slope, last)
    found = tuple(tensor.to(device) for tensor in tensors)
    return found[0], found[1], found[2], found[3], found[4]


def mean_shares(
    square: Float[Tensor, "members edges"],
) -> tuple[Float[Tensor, "members edges 5"], Float[Tensor, "members edges 5"]]:
    """Weights W of the five samples in the mean stiffness, and their slopes by S.

    Args:
        square: S, the squared curvature in squares of 10 1/m.

    Returns:
        Weights, which sum to 1, and slopes.
    """
    jumps, knots, start, slope, last = _spline(square.device)
    size = square.clamp(min=_FIRST)[..., None]  # S, where a term with z > 0 can be
    within = size.clamp(max=_LAST)
    z = (within.sqrt() - knots).relu()
    primitive = (z**4 / 4 + knots * z**3 / 3) / within
    inner = start + slope * square.clamp(max=_LAST)[..., None] + primitive @ jumps
    share = within / size
    weights = share * inner + (1 - share) * last
    slopes = slope + ((z**2 / 2 - primitive) / within) @ jumps
    return weights, torch.where(size <= _LAST, slopes, (last - weights) / size)


def plate_stiffness(
    square: Float[Tensor, "members edges"], table: Float[Tensor, "#members #edges 3 5"],
    poisson: Float[Tensor, "#members"],
) -> tuple[Entries, Entries]:  # fmt: skip
    """D of every edge and dD/dS.

    Args:
        square: S, the squared curvature in squares of 10 1/m.
        table: B [N m].
        poisson: nu.

    Returns:
        D and dD/dS [N m], as (11, 22, 12, 33).
    """
    weights, slopes = mean_shares(square)
    warp, bias, weft = (table * weights.unsqueeze(2)).sum(3).unbind(2)
    warp1, bias1, weft1 = (table * slopes.unsqueeze(2)).sum(3).unbind(2)
    mean = (warp * weft).sqrt()
    mean1 = (warp1 * weft + warp * weft1) / (2 * mean)
    both, both1 = poisson[:, None] * mean, poisson[:, None] * mean1
    twist, twist1 = bias - (warp + weft) / 4 - both / 2, bias1 - (warp1 + weft1) / 4 - both1 / 2
    least, least1 = _LEAST * mean, _LEAST * mean1
    t = twist / least
    phi, rise = _floor(t)
    return (weft, warp, both, least * phi), (weft1, warp1, both1, least1 * phi + rise * (twist1 - t * least1))


def _floor(t: Tensor) -> tuple[Tensor, Tensor]:
    """phi(t) = t from 2 on, smooth and at least 1 below; and its slope."""
    y = (2 - t).relu()
    per = 1 / (4 + y**2)
    return torch.where(t >= 2, t, 2 - 4 * y * per), torch.where(t >= 2, 1.0, 4 * (4 - y**2) * per**2)


def bending_matrix(d: Entries) -> Float[Tensor, "members edges 3 3"]:
    """D as matrices over (k11, k22, 2 k12).

    Args:
        d: Its entries.

    Returns:
        Symmetric matrices.
    """
    d11, d22, d12, d33 = d
    none = torch.zeros_like(d11)
    rows = ((d11, d12, none), (d12, d22, none), (none, none, d33))
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
