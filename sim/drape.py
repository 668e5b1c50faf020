"""From a material to a drape: the entry point to the simulator, differentiable through torch.

simulator = DrapeSimulator(disc_mesh(2699), DrapeSettings())
drape = simulator.drape(uniform_material(density=0.192, bending=1e-5))
drape.vertices          # (vertices, 3) torch tensor, with gradients to every tensor given
many = simulator.drape_batch(cloths)   # faster than one by one; a cloth that diverges spoils no other

On a GPU, DrapeSimulator(mesh, settings, device="cuda") drops batches of hundreds; positions stay there.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numba import get_num_threads
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.membrane import softened
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles, laid_down, smooth_field
from cusick_bench.sim.cloth.warp import about_centre
from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.dynamics.drop import FACTOR_MEMORY
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns, VertexUnknowns
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.branch import Branch, follow
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.first_derivatives import first_derivatives
from cusick_bench.sim.outcome import Outcome
from cusick_bench.sim.torch_engine.drop import CPU_MEMORY
from cusick_bench.sim.torch_engine.engine import COMPILED, TorchEngine, torch_device
from cusick_bench.sim.torch_engine.forces import BatchParameters

PLATE_SPRING = 1e3  # [N/m], the published program's
_EDGE = 1e-3  # of the spacing; vertices nearer to the plate's edge (rounded in a file) lie on it: held, on springs free
_MOST_COMPILED, _MOST_ON_DEVICE = 16, 256  # cloths dropped at once; larger batches are hardly faster
_VERTEX_MEMORY = 6_000  # [bytes] of a compiled batch, for each vertex of each cloth (measured: 3500 to 5200)


@dataclass(frozen=True, eq=False)
class Drape:
    """A draped cloth.

    Attributes:
        vertices: Positions [m]; carries gradients to every tensor that was given with requires_grad.
        converged: Whether the cloth has come to rest.
        residual: Net force on the free cloth as a fraction of its weight.
        seconds: Wall time of the simulation [s].
        iterations: Steps of the drop, or Newton steps of the equilibrium.
        branch: From a warm start, whether its branch of rests was kept; gradients tell nothing of a jump.
        halvings: How often the step of a drop was halved, because the cloth flew apart in longer ones.
    """

    vertices: Float[Tensor, "vertices 3"]
    converged: bool
    residual: float
    seconds: float
    iterations: int
    branch: Branch | None = None
    halvings: int = 0


@dataclass(frozen=True, eq=False)
class DrapeBatch:
    """Drapes of several cloths on one mesh.

    Attributes:
        vertices: Positions [m], with gradients; NaN for a cloth that diverged.
        failures: Why a cloth diverged, or None.
        converged: Whether each has come to rest.
        residual: Net forces as fractions of the weights; NaN where diverged.
        iterations: Steps of the drop, or Newton steps.
        halvings: How often the step of a drop was halved, because the cloth flew apart in longer ones: such a cloth
            took twice, or four times, the steps of the settings, and its gradient is that of these steps.
        seconds: Wall time of all [s].
    """

    vertices: Float[Tensor, "members vertices 3"]
    failures: list[str | None]
    converged: Bool[ndarray, "members"]
    residual: Float[ndarray, "members"]
    iterations: Int[ndarray, "members"]
    halvings: Int[ndarray, "members"]
    seconds: float

    def member(self, index: int) -> Drape:
        """The drape of one cloth; its time is its share.

        Args:
            index: Place of the cloth in the batch.

        Returns:
            Its drape, with gradients.

        Raises:
            DrapeDiverged: It has none.
        """
        failure = self.failures[index]
        if failure is not None:
            raise DrapeDiverged(failure)
        return Drape(
            self.vertices[index], bool(self.converged[index]), float(self.residual[index]),
            self.seconds / len(self.failures), int(self.iterations[index]), halvings=int(self.halvings[index]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class DrapeSimulator:
    """Drapes one mesh under one set of settings; the linear solver is analysed once and shared by all drapes.

    Attributes:
        mesh: The cloth.
        settings: How it is draped.
        factor_memory: Most memory for the factors that gradients of a drop keep [bytes]; what does not fit is computed
            again on the way back (about 1.5 times the time; 0 keeps none), and memory then grows with the states only.
        device: Where drapes are computed, and their positions lie: `cpu`, or the name of another device in mode `drop`
            (see `torch_engine`); of a `torch.device` its name is kept.
        device_memory: Most memory of a batch on another device [bytes], gradients included; by default most of what
            it has left. A batch that does not fit runs in groups.
    """

    mesh: Mesh
    settings: DrapeSettings = field(default_factory=DrapeSettings)
    factor_memory: int = FACTOR_MEMORY
    device: str | torch.device = COMPILED
    device_memory: int | None = None
    system: ClothSystem = field(init=False, repr=False)
    unknowns: VertexUnknowns | ShellUnknowns = field(init=False, repr=False)
    engine: TorchEngine | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        s, radius, device = self.settings, np.hypot(*self.mesh.material.T), str(self.device)
        edge = _EDGE * np.sqrt(self.mesh.squared_spacing)
        object.__setattr__(self, "device", device)
        if s.support == "fixed":
            fixed, spring = radius <= s.plate_radius + edge, np.zeros(self.mesh.vertices)
        else:
            inside = radius < s.plate_radius - edge
            fixed, spring = np.zeros(self.mesh.vertices, bool), np.where(inside, PLATE_SPRING, 0.0)
        if not (fixed | (spring > 0)).any():
            where = "on" if s.support == "fixed" else "within the edge of"
            raise SimulationError(
                f"no vertex lies {where} the plate of radius {s.plate_radius} m: nothing holds the cloth"
            )
        elsewhere = torch_device(device) is not None
        if s.law == "plate":
            system = ShellSystem(self.mesh, s.gravity, fixed, s.plate_radius, s.backend)
            object.__setattr__(self, "unknowns", ShellUnknowns(system))
        else:
            system = DrapeSystem(self.mesh, s.law, s.gravity, fixed, spring, s.backend, s.half_hinges)
            object.__setattr__(self, "unknowns", VertexUnknowns())
        object.__setattr__(self, "system", system)
        engine = TorchEngine(system, self.unknowns, s, device, self.device_memory) if elsewhere else None
        object.__setattr__(self, "engine", engine)

    @property
    def hinge_system(self) -> DrapeSystem:
        """The system of a law that bends at hinges, for what looks into its elements.

        Raises:
            SimulationError: Law `plate`, which has none.
        """
        if not isinstance(self.system, DrapeSystem):
            raise SimulationError("law 'plate' has no hinges and no forces of faces at vertices; use law 'paper'")
        return self.system

    def laid_down(self, seed: int | None = None) -> Float[ndarray, "vertices 3"]:
        """The shape in which the cloth is laid down, from the settings' seed or another one [m].

        Args:
            seed: Seed of the laying; None for that of the settings.

        Returns:
            Positions [m].
        """
        if seed is None:
            return self._laid.copy()
        s = self.settings
        generator = np.random.default_rng([seed, 0])
        return laid_down(self.mesh, smooth_field(s.laying_amplitude, s.laying_length, generator), s.plate_radius)

    def rest_angles(self, seed: int | None = None) -> Float[Tensor, "hinges"]:
        """Stress-free dihedral angles of the random rest shape, from the settings' seed or another one [rad].

        The shape is the cloth's: it lies about its centre, wherever that is on the plate.

        Args:
            seed: Seed of the rest shape; None for that of the settings.

        Returns:
            Angles, in the order of `mesh.hinges`.
        """
        if seed is None:
            return self._rest.clone()
        s = self.settings
        generator = np.random.default_rng([seed, 1])
        shape = self.mesh.flat.copy()
        if s.rest_amplitude > 0:
            field = smooth_field(s.rest_amplitude, s.rest_length, generator)
            shape[:, 2] = field(about_centre(self.mesh, self.mesh.material))
        return dihedral_angles(torch.from_numpy(shape), self.mesh.hinges)

    @property
    def hinge_share(self) -> Float[ndarray, "hinges"]:
        """Share of every hinge's stress-free angle that its bending part takes: 1 but on the clamp of law `paper`."""
        if isinstance(self.system, DrapeSystem):
            return self.system.elements.hinge_share
        return np.ones(len(self.mesh.hinges))

    @cached_property
    def _laid(self) -> Float[ndarray, "vertices 3"]:
        return self.laid_down(self.settings.seed)

    @cached_property
    def _rest(self) -> Float[Tensor, "hinges"]:
        return self.rest_angles(self.settings.seed)

    def drape(
        self,
        material: Material,
        *,
        initial: Float[Tensor, "vertices 3"] | Float[ndarray, "vertices 3"] | None = None,
        rest_angle: Float[Tensor, "hinges"] | Float[ndarray, "hinges"] | None = None,
        warm: Drape | None = None,
    ) -> Drape:
        """Simulates one drape.

        Args:
            material: The cloth; its tensors may require gradients.
            initial: Shape in which the cloth is laid down [m], as from `laid_down`; by default random, from the
                settings' seed.
            rest_angle: Stress-free dihedral angles of whole hinges [rad]; by default random, from the settings' seed.
            warm: In mode `equilibrium`, a drape of a similar cloth to start from: its branch is followed.

        Returns:
            The drape.

        Raises:
            SimulationError: Parameters of another mesh or not finite.
            DrapeDiverged: The cloth did not come to rest (mode `equilibrium`), or blew up.
        """
        laid, angle = _tensor(initial), _tensor(rest_angle)
        self._check_arrays(initial=laid, rest_angle=angle, warm=None if warm is None else warm.vertices)
        batch = self.drape_batch(
            [material],
            initial=None if laid is None else laid[None],
            rest_angle=None if angle is None else angle[None],
            warm=None if warm is None else warm.vertices[None],
        )
        drape = batch.member(0)
        if warm is None:
            return drape
        return replace(drape, branch=follow(self.mesh, _array(warm.vertices), _array(drape.vertices)))

    def drape_batch(
        self,
        materials: Sequence[Material],
        *,
        initial: Float[Tensor, "members vertices 3"] | Float[ndarray, "members vertices 3"] | None = None,
        rest_angle: Float[Tensor, "members hinges"] | Float[ndarray, "members hinges"] | None = None,
        warm: Float[Tensor, "members vertices 3"] | Float[ndarray, "members vertices 3"] | None = None,
    ) -> DrapeBatch:
        """Simulates drapes of several cloths, faster than one by one.

        Args:
            materials: The cloths; their tensors may require gradients. Either all or none have tables per element.
            initial: Shapes in which they are laid down [m]; by default all from the settings' seed.
            rest_angle: Stress-free dihedral angles of whole hinges [rad]; by default all from the settings' seed.
            warm: In mode `equilibrium`, drapes of similar cloths to start from [m].

        Returns:
            The drapes; a cloth that diverges is reported in `failures` and spoils no other.

        Raises:
            SimulationError: No cloths, parameters of another mesh or not finite.
        """
        members = len(materials)
        if members == 0:
            raise SimulationError("there must be at least one cloth to drape, got none")
        for material in materials:
            material.check_fits(self.mesh)
        materials = [self.as_draped(material) for material in materials]
        if warm is not None and self.settings.mode == "drop":
            raise SimulationError("a drop starts from the laid-down cloth; warm starts are for mode 'equilibrium'")
        initial, rest_angle, warm = _tensor(initial), _tensor(rest_angle), _tensor(warm)
        laid = torch.from_numpy(self.laid_down()).expand(members, -1, -1) if initial is None else initial
        angle = self.rest_angles().expand(members, -1) if rest_angle is None else rest_angle
        self._check_arrays(members, initial=laid, rest_angle=angle, warm=warm)
        angle = angle * torch.from_numpy(self.hinge_share).to(angle.device)
        laid = laid if torch.is_grad_enabled() else laid.detach()
        clock = time.perf_counter()
        stretch = _stacked([m.stretch for m in materials], 6, 4)
        bending = _stacked([m.bending for m in materials], 3, 5)
        mass = torch.stack([m.vertex_mass(self.mesh) for m in materials])
        poisson = torch.stack([m.poisson for m in materials])
        if self.engine is not None:
            vertices, outcome = self.engine.drape(BatchParameters(stretch, bending, mass, angle, poisson), laid)
        else:
            outcome = Outcome(
                self.system, self.unknowns, self.settings, self.factor_memory, None if warm is None else _array(warm)
            )
            vertices = _DrapeFunction.apply(stretch, bending, mass, angle, poisson, laid, outcome)
        return DrapeBatch(
            vertices, outcome.failures, outcome.residual <= outcome.at_rest, outcome.residual, outcome.iterations,
            outcome.halvings, time.perf_counter() - clock,
        )  # fmt: skip

    def as_draped(self, material: Material) -> Material:
        """The cloth that is simulated for a cloth: with the membrane that the mesh can bend, where settings say so.

        Args:
            material: The cloth.

        Returns:
            The cloth itself, or one with a softer membrane.
        """
        return softened(material, self.mesh) if self.settings.softens_membrane else material

    def at_once(self) -> int:
        """A good number of cloths for `drape_batch` where there are many: as many as help and fit the memory."""
        if self.engine is not None:
            return min(_MOST_ON_DEVICE, self.engine.at_once())
        together = max(_MOST_COMPILED, self.system.linear.width * get_num_threads())
        return max(1, min(together, CPU_MEMORY // (_VERTEX_MEMORY * self.mesh.vertices)))

    def _check_arrays(self, *members: int, **arrays: Tensor | None) -> None:
        """Checks arrays of one cloth, or of so many."""
        shapes = {"rest_angle": (*members, len(self.mesh.hinges))}
        for name, value in arrays.items():
            shape = shapes.get(name, (*members, self.mesh.vertices, 3))
            if value is None or (tuple(value.shape) == shape and torch.isfinite(value).all()):
                continue
            found = f"shape {tuple(value.shape)}" if tuple(value.shape) != shape else "NaN or infinity"
            raise SimulationError(f"{name} must be finite with shape {shape}, got {found}")


def _tensor(values: Tensor | ndarray | None) -> Tensor | None:
    """What was given as a tensor; an array, such as `laid_down` returns, is copied."""
    return values if values is None or isinstance(values, Tensor) else torch.from_numpy(np.array(values, np.float64))


def _array(tensor: Tensor) -> ndarray:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float64)


def _stacked(tables: list[Tensor], rows: int, columns: int) -> Tensor:
    """Tables of all cloths, (members, tables, rows, columns)."""
    tables = [table.reshape(-1, rows, columns) for table in tables]
    if len({len(table) for table in tables}) > 1:
        raise SimulationError("either all cloths of a batch have tables per element, or none; expand the shared ones")
    return torch.stack(tables)


class _DrapeFunction(torch.autograd.Function):
    """The compiled simulator as one differentiable torch operation (CPU; tensors elsewhere are copied)."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any,
        stretch: Tensor,
        bending: Tensor,
        mass: Tensor,
        rest_angle: Tensor,
        poisson: Tensor,
        initial: Tensor,
        outcome: Outcome,
    ) -> Tensor:
        parameters = Parameters(_array(stretch), _array(bending), _array(mass), _array(rest_angle), _array(poisson))
        positions, ctx.back = outcome.run(parameters, _array(initial), any(ctx.needs_input_grad))
        ctx.tables = (stretch.shape[1], bending.shape[1])
        ctx.devices = [tensor.device for tensor in (stretch, bending, mass, rest_angle, poisson, initial)]
        ctx.save_for_backward(stretch, bending, mass, rest_angle, poisson, initial)
        return torch.from_numpy(positions).to(initial.device)

    @staticmethod
    @first_derivatives("a drape")
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        gradient, g_initial = ctx.back(_array(grad_outputs[0]))
        stretch, bending = (
            table if tables > 1 else table.sum(1, keepdims=True)
            for table, tables in zip((gradient.stretch, gradient.bending), ctx.tables, strict=True)
        )
        arrays = (stretch, bending, gradient.mass, gradient.rest_angle, gradient.poisson, g_initial)
        pairs = zip(arrays, ctx.devices, strict=True)
        return (*(torch.from_numpy(array).to(device) for array, device in pairs), None)
