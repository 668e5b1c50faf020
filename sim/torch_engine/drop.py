"""Many drops of one mesh at once, in torch on any device, with exact adjoint gradients.

The same linearly implicit Euler steps and the same discrete adjoint as `drop`, for a batch of cloths that differ in
stiffness, mass, rest shape or the shape in which they are laid down:

    dropped = drop_members(system, BatchParameters(stretch, bending, mass, rest_angle), initial,
                           steps=100, step_seconds=0.05, device="cuda")
    dropped.positions[dropped.good].mean().backward()

Of the forward pass only positions are kept, with as many factors as fit the memory; the other factors are computed
again. Members run in groups that fit the memory too. A member whose step matrix is not positive definite, whose forces
are no longer finite, or that flies apart ends as NaN with a gradient of 0 and leaves the others alone.

References:
    Baraff, Witkin. Large steps in cloth simulation. SIGGRAPH 1998.
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3.
"""

import math
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.first_derivatives import first_derivatives
from cusick_bench.sim.linear.interface import BlockPattern
from cusick_bench.sim.torch_engine.batch_forces import BatchForces
from cusick_bench.sim.torch_engine.forces import BatchParameters, TorchForces
from cusick_bench.sim.torch_engine.multifrontal import MultifrontalTorch
from cusick_bench.sim.torch_engine.rollout import BatchPlan, adjoint, plan_batch, rollout
from cusick_bench.sim.torch_engine.shell_forces import TorchShell

CPU_MEMORY = 4 * 2**30  # [bytes] memory limit of a batch on the CPU
_FREE_SHARE = 0.8  # of a GPU's free memory that a batch may take
_REPORT = ("good", "factored", "steps", "force")  # what a group's record says of its members


@dataclass(frozen=True, eq=False)
class DroppedMembers:
    """A batch after its drop, on the device.

    Attributes:
        positions: Last positions, NaN for members that blew up [m]; carry gradients.
        good: Whether each member is sound.
        factored: Whether each member's step matrices were positive definite, as long as they were sound.
        steps: Steps that each member took soundly.
        force: Net force on the free vertices, its Euclidean norm over all of them [N].
    """

    positions: Float[Tensor, "members vertices 3"]
    good: Bool[Tensor, "members"]
    factored: Bool[Tensor, "members"]
    steps: Int[Tensor, "members"]
    force: Float[Tensor, "members"]


@lru_cache(maxsize=8)
def prepared(system: DrapeSystem | ShellSystem, device: str) -> tuple[BatchForces, MultifrontalTorch]:
    """Analysis of a system for one device; systems are compared by identity.

    Args:
        system: Cloth and support.
        device: Torch device.

    Returns:
        Forces and the analysed linear solver.
    """
    layout = system.layout
    at = system.mesh.material[system.free] if isinstance(system, DrapeSystem) else system.stencils.control_material
    solver = MultifrontalTorch(BlockPattern(layout.indptr, layout.indices, at), device)
    if isinstance(system, DrapeSystem):
        return TorchForces(system, device, solver.slots), solver
    return TorchShell(system, device, solver.slots), solver


class _Drops(torch.autograd.Function):
    """The rollout of all groups as one differentiable operation."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any,
        stretch: Tensor,
        bending: Tensor,
        mass: Tensor,
        rest_angle: Tensor,
        poisson: Tensor,
        initial: Tensor,
        plan: BatchPlan,
    ) -> tuple[Tensor, ...]:
        p = BatchParameters(stretch, bending, mass, rest_angle, poisson)
        differentiate, budget = any(ctx.needs_input_grad), plan.factor_memory
        last, records = [], []
        for first, end in plan.groups:
            size = (end - first) * plan.linear.factor_bytes
            keep = min(budget // size, plan.steps)
            positions, record = rollout(
                plan, p.member(first, end), _members(initial, first, end), end - first, keep if differentiate else None
            )
            budget -= keep * size
            last.append(positions)
            records.append(record)
        ctx.plan, ctx.records = plan, records if differentiate else []
        ctx.save_for_backward(stretch, bending, mass, rest_angle, poisson, initial)
        report = [torch.cat([getattr(record, name) for record in records]) for name in _REPORT]
        ctx.mark_non_differentiable(*report)
        return torch.cat(last), *report

    @staticmethod
    @first_derivatives("a drape")
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, *grad_outputs: Tensor
    ) -> tuple[Tensor | None, ...]:
        *tensors, initial = ctx.saved_tensors
        p = BatchParameters(*tensors)
        total = BatchParameters(*(tensor.new_zeros(tensor.shape) for tensor in tensors))
        g_initial = initial.new_zeros(initial.shape)
        for (first, end), record in zip(ctx.plan.groups, ctx.records, strict=True):
            anchor = _members(initial, first, end)
            gradient, by_initial = adjoint(ctx.plan, p.member(first, end), anchor, record, grad_outputs[0][first:end])
            there = total.member(first, end)
            for field in fields(total):
                getattr(there, field.name).add_(getattr(gradient, field.name))
            _members(g_initial, first, end).add_(by_initial if len(initial) > 1 else by_initial.sum(0, keepdim=True))
        return (total.stretch, total.bending, total.mass, total.rest_angle, total.poisson, g_initial, None)


def _members(tensor: Tensor, first: int, end: int) -> Tensor:
    return tensor if len(tensor) == 1 else tensor[first:end]


def _checked(forces: BatchForces, given: dict[str, Tensor], device: str) -> tuple[list[Tensor], int]:
    """The tensors on the device, and the number of members."""
    shapes = forces.shapes | {"initial": tuple(forces.flat.shape)}
    members = max(1, *(len(tensor) for name, tensor in given.items() if tensor.ndim == 1 + len(shapes[name])))
    for name, tensor in given.items():
        expected = (tuple({members, 1}), *shapes[name])
        sizes = [size if isinstance(size, tuple) else (size,) for size in expected]
        if tensor.ndim != len(sizes) or any(n not in size for n, size in zip(tensor.shape, sizes, strict=True)):
            wanted = ", ".join(" or ".join(map(str, sorted(size, reverse=True))) for size in sizes)
            raise SimulationError(f"{name} of {members} drops must have shape ({wanted}), got {tuple(tensor.shape)}")
        if not torch.isfinite(tensor).all():
            raise SimulationError(f"{name} must be finite, got NaN or infinity; check the material tables")
    mass = given["mass"][:, forces.free.to(given["mass"].device)]
    if not (mass > 0).all():
        raise SimulationError(f"vertex masses must be > 0 kg, got {float(mass.min()):g}; check the density")
    return [tensor.to(device, torch.float64) for tensor in given.values()], members


def free_memory(device: str) -> int:
    """Memory that a batch may take by default: most of what a GPU has left, or `CPU_MEMORY` [bytes].

    Args:
        device: Torch device.

    Returns:
        Number of bytes.
    """
    if torch.device(device).type != "cuda":
        return CPU_MEMORY
    cached = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return int(_FREE_SHARE * (torch.cuda.mem_get_info(device)[0] + cached))


def drop_members(
    system: DrapeSystem | ShellSystem,
    p: BatchParameters,
    initial: Float[Tensor, "#members vertices 3"],
    *,
    steps: int,
    step_seconds: float,
    device: str = "cpu",
    memory_limit: int | None = None,
) -> DroppedMembers:
    """Drops a batch of cloths from rest; differentiable in all tensors, which may be shared by all members.

    Args:
        system: Cloth and support.
        p: The cloths; under law `plate` by its points (`ShellMaps.parameters`).
        initial: Shapes in which the cloths are laid down, under law `plate` their control points [m]; springs and fixed
            vertices hold on to them.
        steps: Number of steps.
        step_seconds: Step h [s].
        device: Where to compute; tensors elsewhere are copied there.
        memory_limit: Most memory to use [bytes]; by default `free_memory`.

    Returns:
        Last positions and how the members fared.

    Raises:
        SimulationError: Shapes that don't fit, values that are not finite, or a memory limit that is too small.
    """
    if steps < 1 or not (math.isfinite(step_seconds) and step_seconds > 0):
        raise SimulationError(f"steps must be >= 1 and step_seconds > 0, got {steps} and {step_seconds}")
    given = {field.name: getattr(p, field.name) for field in fields(p)} | {"initial": initial}
    forces, solver = prepared(system, device)
    tensors, members = _checked(forces, given, device)
    differentiate = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
    limit = free_memory(device) if memory_limit is None else memory_limit
    plan = plan_batch(forces, solver, members, steps=steps, h=step_seconds, limit=limit, differentiate=differentiate)
    return DroppedMembers(*_Drops.apply(*tensors, plan))  # pyright: ignore[reportGeneralTypeIssues]
