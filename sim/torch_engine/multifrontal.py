"""Batched multifrontal Cholesky factorisation in torch, on any device.

    linear = MultifrontalTorch(pattern, "cuda")
    factors = linear.factorise(blocks)       # (members, needed slots, 3, 3), in the order of linear.slots
    x = factors.solve(b)                     # (members, vertices, 3); factors.good says which members have a factor

Fronts of like size, of all members, go through batched dense kernels together. With own (o) and boundary (b) rows of a
front F: F_oo = L L^T, P = F_bo L^-T, and the update F_bb - P P^T is added into the parent. What is kept is L^-1 and P,
so that solving needs matrix products only, the fastest thing a GPU does. Nothing is added atomically here: on the CPU
results repeat bit by bit. On a GPU they repeat to rounding, since its libraries of matrix products promise no more.

References:
    J. W. H. Liu, "The multifrontal method for sparse matrix solution", SIAM Rev. 34 (1992).
"""

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear.dissection import dissect
from cusick_bench.sim.linear.elimination import analyse
from cusick_bench.sim.linear.interface import BLOCK, BlockPattern
from cusick_bench.sim.torch_engine.fronts import FrontGroup, FrontPlan, plan_fronts

LEAF = 16
"""Vertices of a piece that is not dissected further."""

_NUMBER = 8  # [bytes] of a float64


@lru_cache(maxsize=64)
def _unit(size: int, device: torch.device) -> Float[Tensor, "size size"]:
    return torch.eye(size, dtype=torch.float64, device=device)


class MultifrontalFactors:
    """L^-1 and P of every group of fronts, each (members, fronts, rows, own).

    Attributes:
        plan: The factorisation.
        panels: L^-1 and P of every group.
        good: Which members have a factor; the others' solutions are meaningless.
    """

    def __init__(self, plan: FrontPlan, panels: list[tuple[Tensor, Tensor]], good: Tensor) -> None:
        self.plan, self.panels, self.good = plan, panels, good

    def solve(self, right: Float[Tensor, "members vertices 3"]) -> Float[Tensor, "members vertices 3"]:
        """Solves A x = b, one right-hand side for each member, group by group, up the tree and down again.

        Args:
            right: Right-hand sides.

        Returns:
            Solutions.
        """
        b = torch.nn.functional.pad(right.flatten(1), (0, self.plan.unknowns - right[0].numel()))
        x = torch.zeros_like(b)
        halfway, updates = [], []
        for group, (inverse, below) in zip(self.plan.groups, self.panels, strict=True):
            front = b.new_zeros((len(b), group.fronts, group.own + group.beyond))
            front[:, :, : group.own] = b[:, group.unknowns]
            for come in group.passings:
                front.flatten(1)[:, come.rows_there] += updates[come.group].flatten(1)[:, come.rows]
            halfway.append(inverse @ front[:, :, : group.own, None])
            updates.append(front[:, :, group.own :] - (below @ halfway[-1]).squeeze(3))
        for group, (inverse, below), y in zip(self.plan.groups[::-1], self.panels[::-1], halfway[::-1], strict=True):
            solved = inverse.mT @ (y - below.mT @ x[:, group.known, None])
            x.index_copy_(1, group.unknowns.flatten(), solved.flatten(1))
        return x[:, : right[0].numel()].reshape(right.shape)


class MultifrontalTorch:
    """Factorises batches of one pattern of 3x3 blocks; building it is the analysis.

    Attributes:
        pattern: The coupled vertices.
        plan: The factorisation.
        slots: Slots of the pattern that are read, in the order in which `factorise` takes their blocks.
        factor_bytes: Memory of a member's factor [bytes].
        work_bytes: Memory of a member while it is factorised, besides the factor [bytes].
    """

    def __init__(self, pattern: BlockPattern, device: str, *, leaf: int = LEAF) -> None:
        self.pattern = pattern
        self.plan = plan_fronts(analyse(pattern, dissect(pattern, leaf), workers=1), device)
        self.slots = self.plan.slots
        groups = self.plan.groups
        self.factor_bytes = _NUMBER * sum(g.fronts * g.own * (g.own + g.beyond) for g in groups)
        self.work_bytes = _NUMBER * self._peak()

    def _peak(self) -> int:
        """Most numbers of fronts and updates alive at once: a group's matrices, two copies of them, and updates."""
        peak, alive = 0, {}
        for number, group in enumerate(self.plan.groups):
            alive[number] = group.fronts * group.beyond**2
            peak = max(peak, 3 * group.fronts * (group.own + group.beyond) ** 2 + sum(alive.values()))
            for child in self.plan.spent[number]:
                del alive[child]
        return peak

    def factorise(self, blocks: Float[Tensor, "members needed 3 3"]) -> MultifrontalFactors:
        """Factorises a batch of matrices group by group, from the leaves up.

        Args:
            blocks: Blocks in `slots`, for every matrix.

        Returns:
            The factors, and which matrices were positive definite.

        Raises:
            SimulationError: Blocks of another number or shape.
        """
        if blocks.ndim != 4 or blocks.shape[1:] != (len(self.slots), BLOCK, BLOCK):
            raise SimulationError(
                f"blocks must have shape (members, {len(self.slots)}, {BLOCK}, {BLOCK}), got {tuple(blocks.shape)}"
            )
        good = torch.ones(len(blocks), dtype=torch.bool, device=blocks.device)
        panels: list[tuple[Tensor, Tensor]] = []
        updates: dict[int, Tensor] = {}
        for number, group in enumerate(self.plan.groups):
            front = self._assemble(group, blocks[:, group.slots], updates)
            inverse, below, fine = self._eliminate(group, front)
            good &= fine
            panels.append((inverse, below))
            updates[number] = torch.baddbmm(
                front[:, :, group.own :, group.own :].flatten(0, 1),
                below.flatten(0, 1), below.flatten(0, 1).mT, alpha=-1,
            ).unflatten(0, below.shape[:2])  # fmt: skip
            for child in self.plan.spent[number]:
                del updates[child]
        return MultifrontalFactors(self.plan, panels, good)

    @staticmethod
    def _assemble(group: FrontGroup, blocks: Tensor, updates: dict[int, Tensor]) -> Tensor:
        """Fronts (members, fronts, height, height) with the matrix's blocks and the children's updates."""
        height = group.own + group.beyond
        flat = blocks.new_zeros((len(blocks), group.fronts * height * height))
        flat.index_copy_(1, group.filled, blocks.flatten(1))
        flat.index_fill_(1, group.units, 1.0)
        for come in group.passings:
            flat[:, come.numbers_there] += updates[come.group].flatten(1)[:, come.numbers]
        return flat.view(len(blocks), group.fronts, height, height)

    @staticmethod
    def _eliminate(group: FrontGroup, front: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """L^-1, P, and which members are positive definite so far."""
        lower, info = torch.linalg.cholesky_ex(front[:, :, : group.own, : group.own])
        unit = _unit(group.own, front.device).expand_as(lower)
        inverse = torch.linalg.solve_triangular(lower, unit, upper=False)
        finite = torch.isfinite(lower.diagonal(dim1=2, dim2=3)).all(2)  # not every LAPACK reports NaN
        return inverse, front[:, :, group.own :, : group.own] @ inverse.mT, ((info == 0) & finite).all(1)
