"""From a material to a drape: the one entry point to the simulator, differentiable through torch.

simulator = DrapeSimulator(disc_mesh(2699), DrapeSettings())
drape = simulator.drape(uniform_material(density=0.192, bending=1e-5))
drape.vertices          # (vertices, 3) torch tensor, with gradients to every tensor given
"""

import time
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.drop import Rollout, drop, drop_adjoint
from cusick_bench.sim.equilibrium import FALLING, Equilibrium, equilibrium, equilibrium_adjoint
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.material import Material
from cusick_bench.sim.mesh import PLATE_RADIUS, Mesh
from cusick_bench.sim.shape import dihedral_angles, laid_down, smooth_field
from cusick_bench.sim.system import DrapeSystem, Law, ParameterGradient, Parameters

GRAVITY = 9.8  # [m/s2], the published program's
PLATE_SPRING = 1e3  # [N/m], the published program's
_EDGE = 1e-9  # [m] vertices on the plate's edge count as held
_DROP_AT_REST = 0.05  # a dropped cloth counts as at rest below this net force, as a fraction of its weight


@dataclass(frozen=True)
class DrapeSettings:
    """How a drape is simulated.

    Attributes:
        law: `paper` (derives from an energy) or `published` (the published program's, quirks included).
        mode: `drop` (implicit Euler from the laid-down cloth) or `equilibrium` (Newton to rest, from a drop's end or
            from a given drape).
        steps: Steps of a drop.
        step_seconds: Step of a drop [s].
        gravity: [m/s2].
        plate_radius: [m].
        support: `fixed` (plate vertices eliminated) or `springs` (held by 1 kN/m, as published; the plate's edge free).
        laying_amplitude: Standard deviation of the height in which the cloth is laid down [m].
        laying_length: Its correlation length [m].
        rest_amplitude: Standard deviation of the rest shape's height [m].
        rest_length: Its correlation length [m].
        seed: Seed of the laid-down and the rest shape.
        tolerance: Net force at which an equilibrium counts as reached, as a fraction of the weight.
        iterations: Most Newton steps of an equilibrium.
        backend: Linear solver.

    Raises:
        SimulationError: A value out of range.
    """

    law: Law = "paper"
    mode: Literal["drop", "equilibrium"] = "drop"
    steps: int = 100
    step_seconds: float = 0.05
    gravity: float = GRAVITY
    plate_radius: float = PLATE_RADIUS
    support: Literal["fixed", "springs"] = "fixed"
    laying_amplitude: float = 1e-3
    laying_length: float = 0.03
    rest_amplitude: float = 0.0
    rest_length: float = 0.03
    seed: int = 0
    tolerance: float = 1e-9
    iterations: int = 500
    backend: str = "auto"

    def __post_init__(self) -> None:
        for name, options in (("mode", ("drop", "equilibrium")), ("support", ("fixed", "springs"))):
            if getattr(self, name) not in options:
                raise SimulationError(f"{name} must be one of {', '.join(options)}, got {getattr(self, name)!r}")
        for name in ("steps", "step_seconds", "gravity", "plate_radius", "tolerance", "iterations"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SimulationError(f"{name} must be > 0 and finite, got {value}")
        if self.mode == "equilibrium" and self.law == "published":
            raise SimulationError(
                "law 'published' has no energy, so no equilibrium mode; use mode 'drop' or law 'paper'"
            )


@dataclass(frozen=True, eq=False)
class Drape:
    """A draped cloth.

    Attributes:
        vertices: Positions [m]; carries gradients to every tensor that was given with requires_grad.
        converged: Whether the cloth has come to rest.
        residual: Net force on the free cloth as a fraction of its weight.
        seconds: Wall time of the simulation [s].
        iterations: Steps of the drop, or Newton steps of the equilibrium.
    """

    vertices: Float[Tensor, "vertices 3"]
    converged: bool
    residual: float
    seconds: float
    iterations: int


@dataclass(frozen=True, eq=False)
class DrapeSimulator:
    """Drapes one mesh under one set of settings; the linear solver is analysed once and shared by all drapes."""

    mesh: Mesh
    settings: DrapeSettings = field(default_factory=DrapeSettings)
    system: DrapeSystem = field(init=False, repr=False)

    def __post_init__(self) -> None:
        s, radius = self.settings, np.hypot(*self.mesh.material.T)
        if s.support == "fixed":
            fixed, spring = radius <= s.plate_radius + _EDGE, np.zeros(self.mesh.vertices)
        else:
            fixed, spring = np.zeros(self.mesh.vertices, bool), np.where(radius < s.plate_radius, PLATE_SPRING, 0.0)
        if not (radius <= s.plate_radius + _EDGE).any():
            raise SimulationError(f"no vertex lies on the plate of radius {s.plate_radius} m: nothing holds the cloth")
        object.__setattr__(self, "system", DrapeSystem(self.mesh, s.law, s.gravity, fixed, spring, s.backend))

    def laid_down(self, seed: int | None = None) -> Float[ndarray, "vertices 3"]:
        """The shape in which the cloth is laid down, from the settings' seed or another one [m]."""
        s = self.settings
        generator = np.random.default_rng([s.seed if seed is None else seed, 0])
        return laid_down(self.mesh, smooth_field(s.laying_amplitude, s.laying_length, generator), s.plate_radius)

    def rest_angles(self, seed: int | None = None) -> Float[Tensor, "hinges"]:
        """Stress-free dihedral angles of the random rest shape, from the settings' seed or another one [rad]."""
        s = self.settings
        generator = np.random.default_rng([s.seed if seed is None else seed, 1])
        shape = self.mesh.flat.copy()
        shape[:, 2] = smooth_field(s.rest_amplitude, s.rest_length, generator)(self.mesh.material)
        return dihedral_angles(torch.from_numpy(shape), self.mesh.hinges)

    def drape(
        self,
        material: Material,
        *,
        initial: Float[Tensor, "vertices 3"] | None = None,
        rest_angle: Float[Tensor, "hinges"] | None = None,
        warm: Drape | None = None,
    ) -> Drape:
        """Simulates one drape.

        Args:
            material: The cloth; its tensors may require gradients.
            initial: Shape in which the cloth is laid down [m]; by default random, from the settings' seed.
            rest_angle: Stress-free dihedral angles [rad]; by default random, from the settings' seed.
            warm: In mode `equilibrium`, a drape of a similar cloth to start from: its branch is followed.

        Returns:
            The drape.

        Raises:
            SimulationError: Parameters of another mesh or not finite.
            DrapeDiverged: The cloth did not come to rest (mode `equilibrium`), or blew up.
        """
        material.check_fits(self.mesh)
        laid = torch.from_numpy(self.laid_down()) if initial is None else initial
        angle = self.rest_angles() if rest_angle is None else rest_angle
        for name, value, shape in (
            ("initial", laid, (self.mesh.vertices, 3)),
            ("rest_angle", angle, (len(self.mesh.hinges),)),
        ):
            if tuple(value.shape) != shape or not torch.isfinite(value).all():
                raise SimulationError(f"{name} must be finite with shape {shape}, got shape {tuple(value.shape)}")
        report: dict[str, Any] = {}
        clock = time.perf_counter()
        vertices = _DrapeFunction.apply(
            material.stretch.reshape(-1, 6, 4), material.bending.reshape(-1, 3, 5), material.vertex_mass(self.mesh),
            angle, laid, self, warm, report,
        )  # fmt: skip
        seconds = time.perf_counter() - clock
        return Drape(vertices, report["converged"], report["residual"], seconds, report["iterations"])


def _array(tensor: Tensor) -> ndarray:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float64)


class _DrapeFunction(torch.autograd.Function):
    """The compiled simulator as one differentiable torch operation (CPU; tensors elsewhere are copied)."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any,
        stretch: Tensor,
        bending: Tensor,
        mass: Tensor,
        rest_angle: Tensor,
        initial: Tensor,
        simulator: DrapeSimulator,
        warm: Drape | None,
        report: dict[str, Any],
    ) -> Tensor:
        parameters = Parameters(_array(stretch), _array(bending), _array(mass), _array(rest_angle))
        laid = _array(initial)
        run = _dropped if simulator.settings.mode == "drop" else _rested
        state, positions = run(simulator, parameters, laid, warm, any(ctx.needs_input_grad), report)
        ctx.drape = (simulator, parameters, state)
        ctx.tables = (len(stretch), len(bending))
        return torch.from_numpy(positions).to(initial.device)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        simulator, parameters, state = ctx.drape
        g_x, device = _array(grad_outputs[0]), grad_outputs[0].device
        if isinstance(state, Rollout):
            h = simulator.settings.step_seconds
            gradient, g_initial = drop_adjoint(simulator.system, parameters, state, g_x, step_seconds=h)
        else:
            gradient, g_initial = equilibrium_adjoint(simulator.system, parameters, state, g_x)
        g_stretch, g_bending = _shared(gradient, *ctx.tables)
        arrays = (g_stretch, g_bending, gradient.mass, gradient.rest_angle, g_initial)
        return (*(torch.from_numpy(array).to(device) for array in arrays), None, None, None)


def _shared(gradient: ParameterGradient, stretch_tables: int, bending_tables: int) -> tuple[ndarray, ndarray]:
    """Sums per-element gradients where one table is shared by all elements."""
    stretch = gradient.stretch if stretch_tables > 1 else gradient.stretch.sum(0, keepdims=True)
    bending = gradient.bending if bending_tables > 1 else gradient.bending.sum(0, keepdims=True)
    return stretch, bending


def _dropped(
    simulator: DrapeSimulator,
    parameters: Parameters,
    laid: ndarray,
    warm: Drape | None,
    differentiate: bool,
    report: dict[str, Any],
) -> tuple[Rollout, ndarray]:
    s, system = simulator.settings, simulator.system
    if warm is not None:
        raise SimulationError("a drop starts from the laid-down cloth; warm starts are for mode 'equilibrium'")
    rollout = drop(system, parameters, laid, steps=s.steps, step_seconds=s.step_seconds, keep_factors=differentiate)
    force, _, _ = system.forces(rollout.positions[-1], laid, parameters, exact=False)
    residual = float(np.linalg.norm(force[system.free]) / (s.gravity * parameters.mass.sum()))
    if not np.isfinite(residual):
        raise DrapeDiverged(f"forces are not finite after {s.steps} steps; use a shorter step than {s.step_seconds} s")
    report.update(converged=residual <= _DROP_AT_REST, residual=residual, iterations=s.steps)
    return rollout, rollout.positions[-1].copy()


def _rested(
    simulator: DrapeSimulator,
    parameters: Parameters,
    laid: ndarray,
    warm: Drape | None,
    differentiate: bool,
    report: dict[str, Any],
) -> tuple[Equilibrium, ndarray]:
    s, system = simulator.settings, simulator.system
    if warm is None:  # the drop decides which of its many rests the cloth finds
        fallen = drop(system, parameters, laid, steps=s.steps, step_seconds=s.step_seconds)
        start, mu = fallen.positions[-1].copy(), FALLING
    else:
        start, mu = _array(warm.vertices).copy(), 0.0
    start[system.fixed] = laid[system.fixed]
    rest = equilibrium(system, parameters, start, laid, tolerance=s.tolerance, iterations=s.iterations, mu=mu)
    if not rest.converged:
        raise DrapeDiverged(
            f"the drape did not come to rest: net force {rest.residual:.2g} of the weight after {rest.iterations} "
            f"Newton steps (tolerance {s.tolerance:g}); raise `iterations`, or use mode 'drop'"
        )
    report.update(converged=True, residual=rest.residual, iterations=rest.iterations)
    return rest, rest.positions
