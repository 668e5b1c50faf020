"""One drape about to be made: a piece of cloth, how it is laid down, its support, its history, and how it is seen.

A `Setup` is what effects (`cusick_bench.sim.effects`) change. Its parts are functions of the cloth's material points
and maps of positions, so they mean the same on every mesh and in any order; maps of what is seen act one after the
other. Everything until the drape is in the frame of the simulated cloth: material coordinates (warp = +x), z up. A
cloth that lies face down is simulated in its mirror image z -> -z, in the same material coordinates, and turned over
about y for the camera (material x -> -x); maps of positions after the drape (`finish`, `seen`) are in the camera's
frame.

    setup = parse("plate-tilt:angle=2,direction=90").apply(Setup(mesh, settings, material, laying=...))
    (positions,) = drape_setups([setup])      # as the camera sees them: project in parallel
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles, fade_in
from cusick_bench.sim.cloth.warp import Placing, about_centre, moved
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.history import StateLaw, drop_with_history

Field = Callable[[Tensor], Tensor]
"""From material points (n, 2), about the cloth's centre [m], to values (n,)."""

PositionMap = Callable[[Tensor], Tensor]
"""From positions (vertices, 3) [m] to positions."""

MeshField = Callable[[Mesh, Tensor], Tensor]
"""From a mesh and material points (n, 2), about the cloth's centre [m], to values (n,)."""

RestAngle = Callable[[Mesh], Tensor]
"""From a mesh to dihedral angles (hinges,) [rad], positive where the cloth is convex seen from its face."""

Side = Literal["up", "down"]


@dataclass(frozen=True, eq=False)
class OnCloth:
    """A field that lies where it does by the cloth's rim: that of the mesh which is draped, so that effects may come in
    any order.

    Attributes:
        field: The field on any mesh.
        mesh: The mesh so far; `Setup.cloth` takes the last one.
    """

    field: MeshField
    mesh: Mesh

    def __call__(self, points: Tensor) -> Tensor:
        return self.field(self.mesh, points)


@dataclass(frozen=True, eq=False)
class Setup:
    """One drape about to be made.

    Attributes:
        mesh: The cloth; `material` is where its vertices lie when it is laid flat, about the plate's axis [m].
        settings: How it is draped; amplitudes and seed of its random shapes are not used.
        material: Mean tables, or tables per element.
        side: Which face lies up.
        capture: Number of the picture in the order in which a sample's pictures are taken, from 1.
        later: Whether an earlier picture of the same face lies before this one.
        laying: Height in which the cloth is laid down [m], as a function of places about the plate's axis [m] or per
            vertex; it fades in from the plate's edge.
        rest: Height of the rest shape towards the face [m].
        log_bending, log_stretch, log_mass: Logarithms of factors over the cloth.
        rest_angles: Further stress-free angles, added.
        laid: Maps of the cloth as laid down, plate included.
        finish: Maps of the draped cloth, in the camera's frame.
        seen: Maps to where points seem to be, such that a parallel projection of them is the picture.
        states: Laws with internal variables.
        self_contact: Thickness within which the cloth keeps off itself [m], 0 for none.
        specimen_seed: Whatever is random about this piece of cloth follows from it.
        laying_seed: Whatever is random about this laying of it follows from it.
        placing: How the cloth lies compared with the mesh as it was made, where it was moved.
    """

    mesh: Mesh
    settings: DrapeSettings
    material: Material
    side: Side = "up"
    capture: int = 1
    later: bool = False
    laying: Field | Float[Tensor, "vertices"] | None = None
    rest: Field | None = None
    log_bending: tuple[Field, ...] = ()
    log_stretch: tuple[Field, ...] = ()
    log_mass: tuple[Field, ...] = ()
    rest_angles: tuple[RestAngle, ...] = ()
    laid: tuple[PositionMap, ...] = ()
    finish: tuple[PositionMap, ...] = ()
    seen: tuple[PositionMap, ...] = ()
    states: tuple[StateLaw, ...] = ()
    self_contact: float = 0.0
    specimen_seed: tuple[int, ...] = (0,)
    laying_seed: tuple[int, ...] = (0,)
    placing: Placing | None = None

    def with_added(self, **added: object) -> "Setup":
        """This setup with one more field, map or law in each of the named tuples."""
        return replace(self, **{name: (*getattr(self, name), item) for name, item in added.items()})

    def moved(self, *, x: float = 0.0, y: float = 0.0, growth: float = 0.0, plate_growth: float = 0.0) -> "Setup":
        """This setup with the cloth elsewhere, of another size or on another plate, whatever was moved before.

        Args:
            x, y: By how much the cloth's centre moves, in the frame of the simulated cloth [m].
            growth: Growth of the cloth's radius [m].
            plate_growth: Growth of the plate's radius [m].

        Returns:
            Another setup, with another mesh.

        Raises:
            SimulationError: The cloth would not reach beyond the plate's edge everywhere.
        """
        before = self.placing
        if before is None or not before.is_of(self.mesh, self.held):
            before = Placing(self.mesh, self.held, self.held)
        after = replace(
            before,
            plate=before.plate + plate_growth,
            x=before.x + x,
            y=before.y + y,
            growth=before.growth + growth,
        )
        settings = replace(self.settings, plate_radius=after.plate)
        return replace(self, mesh=moved(self.mesh, before, after), settings=settings, placing=after)

    def cloth_direction(self, degrees: float | Tensor) -> float | Tensor:
        """A direction of the laboratory, counter-clockwise from +x, in the frame of the simulated cloth [deg].

        Args:
            degrees: Direction in the laboratory [deg].

        Returns:
            Direction in the cloth's frame, mirrored where the face lies down.
        """
        return degrees if self.side == "up" else 180.0 - degrees

    @property
    def held(self) -> float:
        """Radius of the plate [m]."""
        return self.settings.plate_radius

    @property
    def simulated_settings(self) -> DrapeSettings:
        """The settings that it is simulated with: contact of the cloth with itself is known at rest only."""
        thickness = float(self.self_contact)
        return replace(self.settings, mode="equilibrium", self_contact=thickness) if thickness else self.settings

    def cloth(self) -> Material:
        """The material with its fields, element by element."""
        mesh, material = self.mesh, self.material
        stretch, bending, density = material.stretch, material.bending, material.density
        if self.log_stretch:
            stretch = stretch * _factor(self.log_stretch, mesh, face_centres(mesh))[:, None, None]
        if self.log_bending:
            bending = bending * _factor(self.log_bending, mesh, hinge_centres(mesh))[:, None, None]
        if self.log_mass:
            density = density * _factor(self.log_mass, mesh, face_centres(mesh))
        return Material(stretch, bending, density, material.poisson)

    def rest_angle(self) -> Float[Tensor, "hinges"]:
        """Stress-free dihedral angles in the simulated frame [rad]: of the mirror image where the face lies down."""
        mesh = self.mesh
        angle = torch.zeros(len(mesh.hinges), dtype=torch.float64)
        if self.rest is not None:
            flat = torch.from_numpy(about_centre(mesh, mesh.material))
            angle = angle + dihedral_angles(torch.column_stack([flat, self.rest(flat)]), mesh.hinges)
        for added in self.rest_angles:
            angle = angle + added(mesh)
        return angle if self.side == "up" else -angle

    def initial(self) -> Float[Tensor, "vertices 3"]:
        """The cloth as laid down [m]."""
        flat = torch.from_numpy(self.mesh.material)
        height = torch.zeros(self.mesh.vertices, dtype=torch.float64)
        if self.laying is not None:
            height = self.laying if isinstance(self.laying, Tensor) else self.laying(flat)
        shape = torch.column_stack([flat, height * torch.from_numpy(fade_in(self.mesh, self.held))])
        for change in self.laid:
            shape = change(shape)
        return shape

    def to_camera(self, vertices: Float[Tensor, "vertices 3"]) -> Float[Tensor, "vertices 3"]:
        """Apparent positions of the simulated cloth's points, for a parallel projection [m].

        Args:
            vertices: Positions of the simulated cloth [m].

        Returns:
            Positions in the camera's frame.
        """
        if self.side == "down":
            vertices = vertices * torch.tensor([-1.0, 1.0, 1.0]).to(vertices)
        for change in (*self.finish, *self.seen):
            vertices = change(vertices)
        return vertices

    @property
    def faces(self) -> np.ndarray:
        """Triangles, counter-clockwise seen from above where the cloth lies flat."""
        return self.mesh.faces if self.side == "up" else self.mesh.faces[:, ::-1]


@dataclass(eq=False)
class Simulators:
    """Simulators by mesh and settings, made once: their analysis is shared by all drapes on them.

    Attributes:
        most: How many are kept; the least recently used goes first.
    """

    most: int = 8
    _kept: dict[tuple[int, DrapeSettings], DrapeSimulator] = field(default_factory=dict)

    def get(self, mesh: Mesh, settings: DrapeSettings) -> DrapeSimulator:
        """The simulator of a mesh.

        Args:
            mesh: The cloth; meshes are compared by identity.
            settings: How it is draped.

        Returns:
            The simulator, kept or new.
        """
        key = (id(mesh), settings)
        found = self._kept.pop(key, None)
        if found is None or found.mesh is not mesh:
            found = DrapeSimulator(mesh, settings)
        self._kept[key] = found
        while len(self._kept) > self.most:
            self._kept.pop(next(iter(self._kept)))
        return found


def drape_setups(
    setups: Sequence[Setup], simulators: Simulators | None = None
) -> list[Float[Tensor, "vertices 3"] | None]:
    """Drapes all of them, those on one mesh together.

    Args:
        setups: The drapes to make.
        simulators: Where simulators are kept from call to call.

    Returns:
        Positions as the camera sees them [m] (see `Setup.to_camera`), with gradients to all tensors in the setups
        without internal variables; None for a drape that diverged.

    Raises:
        SimulationError: A setup that cannot be simulated as asked.
    """
    kept = Simulators() if simulators is None else simulators
    groups: dict[tuple[int, DrapeSettings], list[int]] = {}
    for index, setup in enumerate(setups):
        groups.setdefault((id(setup.mesh), setup.simulated_settings), []).append(index)
    found: list[Tensor | None] = [None] * len(setups)
    for (_, settings), members in groups.items():
        simulator = kept.get(setups[members[0]].mesh, settings)
        plain = [index for index in members if not setups[index].states]
        if plain:
            batch = simulator.drape_batch(
                _expanded([setups[index].cloth() for index in plain], setups[plain[0]].mesh),
                initial=torch.stack([setups[index].initial() for index in plain]),
                rest_angle=torch.stack([setups[index].rest_angle() for index in plain]),
            )
            for place, index in enumerate(plain):
                if batch.failures[place] is None:
                    found[index] = setups[index].to_camera(batch.vertices[place])
        for index in (index for index in members if setups[index].states):
            one = setups[index]
            try:
                dropped = drop_with_history(simulator, one.cloth(), one.initial(), one.rest_angle(), one.states)
            except DrapeDiverged:
                continue
            found[index] = one.to_camera(dropped)
    return found


def turned(shape: Float[Tensor, "vertices 3"], degrees: float | Tensor) -> Float[Tensor, "vertices 3"]:
    """Positions turned counter-clockwise about z.

    Args:
        shape: Positions [m].
        degrees: Angle [deg].

    Returns:
        Positions [m], differentiable by both.
    """
    angle = torch.as_tensor(degrees, dtype=torch.float64) * (math.pi / 180)
    cosine, sine = torch.cos(angle), torch.sin(angle)
    x, y, z = shape.unbind(-1)
    return torch.stack([cosine * x - sine * y, sine * x + cosine * y, z], dim=-1)


def _factor(logs: Sequence[Field], mesh: Mesh, points: np.ndarray) -> Tensor:
    at = torch.from_numpy(about_centre(mesh, points))
    total = torch.zeros(len(points), dtype=torch.float64)
    for log in logs:
        total = total + (log.field(mesh, at) if isinstance(log, OnCloth) else log(at))
    return total.exp()


def _expanded(cloths: list[Material], mesh: Mesh) -> list[Material]:
    """Tables of one kind for all cloths: shared ones are repeated if another cloth has one for each element."""
    per_face, per_hinge = (any(getattr(c, name).ndim > 2 for c in cloths) for name in ("stretch", "bending"))
    faces, hinges = len(mesh.faces), len(mesh.hinges)
    return [
        Material(
            c.stretch.expand(faces, 6, 4) if per_face and c.stretch.ndim == 2 else c.stretch,
            c.bending.expand(hinges, 3, 5) if per_hinge and c.bending.ndim == 2 else c.bending,
            c.density,
            c.poisson,
        )
        for c in cloths
    ]
