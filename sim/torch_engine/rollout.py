"""One group of drops, forward and back, and how a batch is split into groups that fit the memory.

Per step: (M + h^2 K) v' = M v + h F, x' = x + h v'. Back: with g = g_v' + h g_x' and (M + h^2 K) lambda = g, the older
gradients are g_v = M lambda and g_x = g_x' + dS/dx with S = h lambda . F - h^2 lambda . K v'; see `drop`.
"""

import itertools
import math
from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.torch_engine.batch_forces import BatchForces
from cusick_bench.sim.torch_engine.forces import BatchParameters
from cusick_bench.sim.torch_engine.multifrontal import MultifrontalFactors, MultifrontalTorch
from cusick_bench.sim.torch_engine.replay import replayed

_NUMBER = 8  # [bytes] of a float64
_VECTORS = 12  # vertex fields alive at once
_WORK = 1.5  # measured over computed memory of a factorisation at work: at most 1.4
_FAR = 20.0  # a cloth that moves farther than so many times its size has blown up, as in `drop`


@dataclass(frozen=True, eq=False)
class BatchPlan:
    """How a batch is run.

    Attributes:
        forces: Forces and stiffness.
        linear: Linear solver.
        steps: Number of steps.
        h: Step [s].
        groups: First and behind-last member of every group.
        factor_memory: Memory left for kept factors [bytes].
        graphs: GPU on which steps are launched as graphs, and then no factors are kept; None for no graphs.
    """

    forces: BatchForces
    linear: MultifrontalTorch
    steps: int
    h: float
    groups: list[tuple[int, int]]
    factor_memory: int
    graphs: torch.device | None

    def factorise(self, blocks: Float[Tensor, "members slots 3 3"], mass: Tensor) -> MultifrontalFactors:
        """Factor of M + h^2 K; takes over `blocks`.

        Args:
            blocks: K in the layout's slots [N/m]; changed.
            mass: Vertex masses (members, vertices) [kg].

        Returns:
            The factors.
        """
        blocks *= self.h**2
        self.forces.add_diagonal(blocks, mass)
        return self.linear.factorise(blocks)


@dataclass(frozen=True, eq=False)
class GroupRecord:
    """Data of one group for the adjoint, and the outcome of its members.

    Attributes:
        states: Positions x_0 .. x_n [m]; x_0 alone where there will be no adjoint.
        factors: Kept factors by step.
        good: Who is well.
        factored: Whose step matrices had a factor as long as they were well.
        steps: Steps that each member took well.
        force: Net force on the free vertices at the end, its Euclidean norm over all of them [N].
    """

    states: list[Float[Tensor, "members vertices 3"]]
    factors: dict[int, MultifrontalFactors]
    good: Bool[Tensor, "members"]
    factored: Bool[Tensor, "members"]
    steps: Int[Tensor, "members"]
    force: Float[Tensor, "members"]

    @classmethod
    def start(cls, x: Float[Tensor, "members vertices 3"]) -> "GroupRecord":
        """Before the first step everybody is well.

        Args:
            x: Positions in which the group is laid down [m].

        Returns:
            The record, with every member sound.
        """
        well = torch.ones(len(x), dtype=torch.bool, device=x.device)
        return cls([x], {}, well, well.clone(), well.new_zeros(len(x), dtype=torch.int64), x.new_zeros(len(x)))

    def update(self, factored: Bool[Tensor, "members"], near: Bool[Tensor, "members"]) -> None:
        """Notes how a step went; who was lost before stays as it was.

        Args:
            factored: Whose step matrix was positive definite.
            near: Who has not flown apart.
        """
        self.factored.logical_and_(factored | ~self.good)
        self.good.logical_and_(factored & near)
        self.steps.add_(self.good)


def member_bytes(forces: BatchForces, linear: MultifrontalTorch, steps: int, *, differentiate: bool) -> tuple[int, int]:
    """Memory of one member: what is kept till the end, and what it takes besides while its group runs [bytes].

    Args:
        forces: Forces and stiffness.
        linear: Linear solver.
        steps: Number of steps.
        differentiate: Whether there will be gradients.

    Returns:
        Bytes kept, and bytes used for a while.
    """
    field = 3 * _NUMBER * forces.system.mesh.vertices
    kept = field * (steps + 2 if differentiate else 1)
    matrix = 9 * _NUMBER * len(linear.slots) + linear.factor_bytes
    elements = _NUMBER * forces.numbers(differentiate=differentiate)
    return kept, matrix + max(elements, int(_WORK * linear.work_bytes)) + _VECTORS * field


def plan_batch(
    forces: BatchForces,
    linear: MultifrontalTorch,
    members: int,
    *,
    steps: int,
    h: float,
    limit: int,
    differentiate: bool,
) -> BatchPlan:
    """Splits a batch into groups of members that fit the memory.

    Args:
        forces: Forces and stiffness.
        linear: Linear solver.
        members: Number of cloths.
        steps: Number of steps.
        h: Step [s].
        limit: Most memory to use [bytes].
        differentiate: Whether there will be gradients.

    Returns:
        The groups, and what they share.

    Raises:
        SimulationError: Not even a group of one fits.
    """
    kept, at_work = member_bytes(forces, linear, steps, differentiate=differentiate)
    available = limit - members * kept
    most = available // at_work
    if most < 1:
        raise SimulationError(
            f"{members} drops of {forces.system.mesh.vertices} vertices and {steps} steps need at least "
            f"{(members * kept + at_work) / 2**20:.0f} MiB, but memory_limit is {limit / 2**20:.0f} MiB; raise it, or "
            "drop fewer cloths at a time"
        )
    count = math.ceil(members / most)
    ends = [round(members * n / count) for n in range(count + 1)]
    groups, work, device = list(itertools.pairwise(ends)), math.ceil(members / count) * at_work, forces.flat.device
    if device.type == "cuda" and 3 * work <= available:  # a graph has memory of its own
        return BatchPlan(forces, linear, steps, h, groups, 0, device)
    left = available - work if differentiate else 0
    return BatchPlan(forces, linear, steps, h, groups, left, None)


def rollout(
    plan: BatchPlan, p: BatchParameters, anchor: Tensor, members: int, keep: int | None
) -> tuple[Tensor, GroupRecord]:
    """Drops one group of cloths from rest.

    Args:
        plan: How the batch is split into groups.
        p: Its cloths.
        anchor: Shapes in which they are laid down (members or 1, vertices, 3) [m].
        members: Number of cloths of the group.
        keep: Number of factors to keep for the adjoint; None if there will be none, then no states are kept either.

    Returns:
        Last positions, NaN for members that blew up [m], and the record for the adjoint.
    """
    h, free = plan.h, plan.forces.free
    x = anchor.expand(members, *anchor.shape[1:]).clone()
    v = torch.zeros_like(x)
    record, far = GroupRecord.start(x.clone()), _FAR * anchor.abs().amax((1, 2))

    def advance() -> MultifrontalFactors:
        force, blocks = plan.forces.evaluate(x, anchor, p)
        factor = plan.factorise(blocks, p.mass)
        solved = factor.solve((p.mass[:, :, None] * v + h * force)[:, free])
        v.index_copy_(1, free, solved)
        x.add_(h * v)
        record.update(factor.good, x.abs().amax((1, 2)) < far)  # NaN compares as false
        return factor

    with replayed(advance, plan.graphs) as next_step:
        for step in range(plan.steps):
            factor = next_step()
            if keep is not None:
                record.states.append(x.clone())
                if factor is not None and step < keep:
                    record.factors[step] = factor
            del factor  # or two are alive while the next is made
    force, _ = plan.forces.evaluate(x, anchor, p)
    record.force.copy_(torch.linalg.vector_norm(force[:, free].flatten(1), dim=1))
    record.good.logical_and_(torch.isfinite(record.force))
    return torch.where(record.good[:, None, None], x, torch.nan), record


def adjoint(
    plan: BatchPlan, p: BatchParameters, anchor: Tensor, record: GroupRecord, g_x: Tensor
) -> tuple[BatchParameters, Tensor]:
    """Walks one group back.

    Args:
        plan: As in `rollout`.
        p: As in `rollout`.
        anchor: As in `rollout`.
        record: What `rollout` returned.
        g_x: Derivative to the last positions.

    Returns:
        Gradient to the group's parameters, in their shapes, and to the anchor of every member.
    """
    h, free = plan.h, plan.forces.free
    good = record.good[:, None, None]

    def state(step: int) -> Tensor:  # members that blew up stand still, flat, and gather no gradient
        return torch.where(good, record.states[max(step, 0)], plan.forces.flat)

    gradient = BatchParameters(*(torch.zeros_like(getattr(p, field.name)) for field in fields(p)))
    g_x = torch.where(good, g_x, 0.0)
    g_v, g_anchor = torch.zeros_like(g_x), torch.zeros_like(g_x)
    x, x_new = state(plan.steps - 1), state(plan.steps)
    x_old = torch.empty_like(x)

    def retreat(factor: MultifrontalFactors | None = None) -> None:
        v, v_new = (x - x_old) / h, (x_new - x) / h
        if factor is None:
            factor = plan.factorise(plan.forces.evaluate(x, anchor, p)[1], p.mass)
        solved = torch.where(good, factor.solve((g_v + h * g_x)[:, free]), 0.0)
        del factor
        multiplier = torch.zeros_like(g_x).index_copy(1, free, solved)
        by_x, by_anchor, by = plan.forces.adjoint(x, multiplier, v_new, p, force_factor=h, stiffness_factor=h * h)
        for field in fields(p):
            getattr(gradient, field.name).add_(getattr(by, field.name))
        by_mass = (multiplier * (v - v_new)).sum(2)
        gradient.mass.add_(by_mass if len(p.mass) > 1 else by_mass.sum(0, keepdim=True))
        g_v.copy_(p.mass[:, :, None] * multiplier)
        g_x.add_(by_x)
        g_anchor.add_(by_anchor)
        x_new.copy_(x)
        x.copy_(x_old)

    with replayed(retreat, plan.graphs) as next_step:
        for step in reversed(range(plan.steps)):
            x_old.copy_(state(step - 1))
            if step in record.factors:
                retreat(record.factors[step])
            else:
                next_step()
    return gradient, g_x + g_anchor
