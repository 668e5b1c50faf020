"""What the benchmark drapes: one cotton-like cloth on a mesh of a given size, and the cases timed on it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.constants import Law
from cusick_bench.sim.drape import Drape, DrapeSimulator
from cusick_bench.sim.engine.cloth_system import ClothSystem, Evaluated
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.linear.interface import Factor, LinearSolver, available_backends, solver
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render

DENSITY, BENDING = 0.192, 1.4e-5  # [kg/m2], [N m]: drapes as the data's cotton_blue does
STEPS = 100
FLOOR_SHARE = 10  # a floor is timed over so many times fewer steps
CHANGE = 0.1  # standard deviation of log parameters between a warm start and its drape

LOCKSTEP = ", lockstep"
"""Ends the names of batches that run in lockstep."""

CASES = (
    "drop",
    "drop+gradient",
    "drop+gradient, checkpointed",
    "equilibrium, warm, +gradient",
    "silhouette+gradient",
)
"""What is timed on every mesh, beside floors and batches."""


def floor_backends() -> list[str]:
    """Linear solvers of single matrices; `lockstep` leaves these to `multifrontal`."""
    return [name for name in available_backends() if name != "lockstep"]


def cloth(mesh: Mesh, *, spread: float = 0.0, seed: int = 0, track: bool = False) -> Material:
    """The benchmark's cloth, heterogeneous: one table an element.

    Args:
        mesh: Its mesh.
        spread: Standard deviation of the logarithm of every number.
        seed: Seed of the draw.
        track: Whether gradients to its numbers are wanted.

    Returns:
        The cloth.
    """
    base = uniform_material(density=DENSITY, bending=BENDING)
    generator = np.random.default_rng(seed)

    def spread_out(value: Tensor, *shape: int) -> Tensor:
        drawn = value * torch.from_numpy(np.exp(spread * generator.normal(size=shape)))
        return drawn.requires_grad_(track)

    faces, hinges = len(mesh.faces), len(mesh.hinges)
    return Material(
        spread_out(base.stretch, faces, 6, 4), spread_out(base.bending, hinges, 3, 5), spread_out(base.density, faces)
    )


@dataclass(frozen=True, eq=False)
class Workload:
    """Everything that is timed on one mesh.

    Attributes:
        vertices: Mesh size.
        support: As in `DrapeSettings`.
        law: Material law.
    """

    vertices: int
    support: str = "fixed"
    law: Law = "paper"

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh."""
        return disc_mesh(self.vertices)

    @cached_property
    def dropping(self) -> DrapeSimulator:
        """Simulator in mode `drop`."""
        return DrapeSimulator(self.mesh, DrapeSettings(law=self.law, support=self.support, steps=STEPS))  # pyright: ignore[reportArgumentType]

    @cached_property
    def resting(self) -> DrapeSimulator:
        """Simulator in mode `equilibrium`."""
        settings = replace(self.dropping.settings, mode="equilibrium")
        return DrapeSimulator(self.mesh, settings)

    @cached_property
    def plain(self) -> Material:
        """The cloth, homogeneous, without gradients."""
        return uniform_material(density=DENSITY, bending=BENDING)

    @cached_property
    def draped(self) -> Drape:
        """The cloth at rest."""
        return self.resting.drape(cloth(self.mesh))

    @cached_property
    def step_system(self) -> tuple[ClothSystem, np.ndarray, np.ndarray]:
        """System, step matrix and right-hand side of a step from the rest: what the bare linear algebra is given."""
        system, h, p = self.dropping.system, self.dropping.settings.step_seconds, self.parameters.batch()
        state = system.evaluate(*self.at_rest, p, exact=False)
        blocks = state.matrix(scale=h * h, diagonal=p.mass + h * h * system.spring)
        return system, blocks[0], h * state.force()[0, system.free]

    @cached_property
    def at_rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Configurations of the cloth at rest and of the flat cloth, in the law's unknowns; batches of one [m]."""
        unknowns, x = self.dropping.unknowns, self.draped.vertices.detach().numpy()
        return unknowns.configuration(x[None]), unknowns.configuration(self.mesh.flat[None])

    @cached_property
    def parameters(self) -> Parameters:
        """The cloth as the kernels take it."""
        material, angles = self.plain, self.dropping.rest_angles()
        arrays = (
            material.stretch[None], material.bending[None], material.vertex_mass(self.mesh), angles, material.poisson
        )  # fmt: skip
        p = Parameters(*(array.numpy() for array in arrays))
        return self.dropping.unknowns.parameters(p.batch()).member(0)

    def drop(self) -> Drape:
        """Forward drop, no gradient."""
        return self.dropping.drape(self.plain)

    def drop_gradient(self, *, keep: bool = True) -> None:
        """Forward drop and its adjoint, to all numbers of all elements; factors kept, or computed again.

        Args:
            keep: Whether factors are kept for the way back.
        """
        simulator = self.dropping if keep else self._checkpointed
        for table in (self._tracked.stretch, self._tracked.bending, self._tracked.density):
            table.grad = None
        simulator.drape(self._tracked).vertices.sum().backward()

    @cached_property
    def _tracked(self) -> Material:
        """The cloth, heterogeneous, with gradients; drawn once, as its numbers take longer than some steps."""
        return cloth(self.mesh, track=True)

    @cached_property
    def _checkpointed(self) -> DrapeSimulator:
        return DrapeSimulator(self.mesh, self.dropping.settings, factor_memory=0)

    def warm_gradient(self, seed: int) -> Drape:
        """Equilibrium of a cloth whose every number differs by 10 %, from a warm start, and its gradient.

        Args:
            seed: Seed of the cloth's change.

        Returns:
            The drape.
        """
        changed = cloth(self.mesh, spread=CHANGE, seed=seed, track=True)
        drape = self.resting.drape(changed, warm=self.draped)
        drape.vertices.sum().backward()
        return drape

    @cached_property
    def in_lockstep(self) -> DrapeSimulator:
        """Simulator in mode `drop` whose batches run in lockstep."""
        return DrapeSimulator(self.mesh, replace(self.dropping.settings, backend="lockstep"))

    def batch(self, members: int, *, lockstep: bool = False) -> None:
        """Forward drops of several cloths at once.

        Args:
            members: Cloths at once.
            lockstep: Whether their matrices are factorised in lockstep.
        """
        simulator = self.in_lockstep if lockstep else self.dropping
        simulator.drape_batch([self.plain] * members, initial=self._laid(members))

    def _laid(self, members: int) -> Tensor:
        return torch.stack([torch.from_numpy(self.dropping.laid_down(seed)) for seed in range(members)])

    def silhouette(self) -> None:
        """Silhouette of 256 x 256 pixels and its gradient to all positions."""
        vertices = self.draped.vertices.detach().requires_grad_()
        render(vertices, self.mesh.faces, ParallelCamera()).square().mean().backward()

    def floor(self, backend: str) -> Callable[[], None]:
        """A tenth of a drop's bare linear algebra: numeric factorisations and solves, with the analysis done.

        Args:
            backend: Name of the linear solver.

        Returns:
            What to time.
        """
        system, blocks, right = self.step_system
        linear: LinearSolver = solver(system.linear.pattern, backend)
        factor: list[Factor | None] = [None]

        def run() -> None:
            for _ in range(STEPS // FLOOR_SHARE):
                factor[0] = linear.factorise(blocks, out=factor[0])
                factor[0].solve(right)

        return run

    def cases(self, batches: list[int]) -> dict[str, Callable[[], object]]:
        """Bare linear algebra and whole drapes, by name.

        Args:
            batches: Cloths at once, one or more numbers.

        Returns:
            What to time, by name.
        """
        return {f"floor:{name}": self.floor(name) for name in floor_backends()} | self.drapes(batches)

    def drapes(self, batches: list[int]) -> dict[str, Callable[[], object]]:
        """Whole drapes, by name; none is made yet, so that drops by a law without rests can be chosen.

        Args:
            batches: Cloths at once, one or more numbers.

        Returns:
            What to time, by name.
        """
        seeds = iter(range(1_000_000))
        made = (
            self.drop,
            self.drop_gradient,
            lambda: self.drop_gradient(keep=False),
            lambda: self.warm_gradient(next(seeds)),
            self.silhouette,
        )
        found: dict[str, Callable[[], object]] = dict(zip(CASES, made, strict=True))
        for members in batches:
            found[f"batch of {members}"] = lambda members=members: self.batch(members)
            found[f"batch of {members}{LOCKSTEP}"] = lambda members=members: self.batch(members, lockstep=True)
        return found

    def phases(self) -> dict[str, Callable[[], object]]:
        """Parts of a step, by name."""
        system, blocks, right = self.step_system
        (x, flat), p = self.at_rest, self.parameters.batch()
        diagonal, storage = p.mass, np.zeros((1, *blocks.shape))
        factor = system.linear.factorise(blocks)
        multiplier, gradient = np.zeros_like(x), system.zero_gradient(1)
        multiplier[:, system.free] = 1e-3

        def forces(exact: bool) -> Evaluated:
            state = system.evaluate(x, flat, p, exact=exact)
            state.force()
            return state

        evaluated = forces(False)
        return {
            "forces": lambda: forces(False),
            "forces, exact Hessian": lambda: forces(True),
            "assembly": lambda: evaluated.matrix(scale=0.0025, diagonal=diagonal, out=storage),
            "factorisation": lambda: system.linear.factorise(blocks, out=factor),
            "solve": lambda: factor.solve(right),
            "adjoint of forces": lambda: system.adjoint(
                x, multiplier, multiplier, p, gradient, force_factor=0.05, stiffness_factor=0.0025
            ),
        }
