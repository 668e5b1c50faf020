"""The truth of one case: natural scenes of a fabric, what the case's effects change in them, and their pictures.

Unlike the model that diagnoses: finer meshes, shorter steps, another bending discretisation, hardening stretch, Matern
fields instead of Gaussian ones, drag, blur, noise and compression, and another law for every effect (`laws`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.system import DrapeSystem
from cusick_bench.withheld.world.drop import STEPS, drop
from cusick_bench.withheld.world.fabric import Fabric, fabric_of
from cusick_bench.withheld.world.fields import matern_field
from cusick_bench.withheld.world.laws import law
from cusick_bench.withheld.world.photograph import photograph, seen_from_above
from cusick_bench.withheld.world.scene import Scene, Vertices, sum_of_fields
from cusick_bench.withheld.world.scene_system import SceneSystems, cloth_points

CAPTURES = {1: "up", 2: "up", 3: "down", 4: "down"}
SAMPLES = 12
VERTICES = 1205
_FADE = 0.012  # [m] beyond the plate's edge over which the laid-down undulation begins


@dataclass(frozen=True)
class Picture:
    """One capture.

    Attributes:
        sample, capture: Numbers of sample and capture, from 1.
        levels: Grey levels, dark where the cloth is.
        vertices: Where the cloth's points seem to be in a parallel projection [m].
    """

    sample: int
    capture: int
    levels: UInt8[ndarray, "256 256"]
    vertices: Vertices


@dataclass(frozen=True)
class TrueCase:
    """A fabric with its samples and whatever acts on them.

    Attributes:
        seed: Seed of the case.
        causes: Effects and their parameters, in the names and units of the package.
        vertices: Mesh size.
        steps: Number of time steps of every drop.
        attempt: Number of the draw of the fabric.
    """

    seed: tuple[int, ...]
    causes: Mapping[str, Mapping[str, float]]
    vertices: int = VERTICES
    steps: int = STEPS
    attempt: int = 0

    @cached_property
    def fabric(self) -> Fabric:
        """The fabric that all samples are cut from."""
        return fabric_of(self.seed, self.attempt)

    @cached_property
    def _systems(self) -> SceneSystems:
        return SceneSystems(self.vertices, int(np.random.default_rng([*self.seed, 2]).integers(2**31)))

    def pictures(self, samples: int = SAMPLES) -> Iterator[Picture]:
        """Simulates all pictures, in order of sample and capture.

        Args:
            samples: Number of samples.

        Yields:
            The pictures.
        """
        for sample in range(1, samples + 1):
            carried_over: dict[str, ndarray] = {}
            for capture in CAPTURES:
                picture, kept = self._picture(replace(self.scene(sample, capture), carried_over=carried_over))
                carried_over = carried_over | kept
                yield picture

    def scene(self, sample: int, capture: int) -> Scene:
        """The circumstances of one picture: natural variability, then the causes in order.

        Args:
            sample: Number of the sample, from 1.
            capture: Number of the capture, from 1.

        Returns:
            The scene.
        """
        scene = self._natural(sample, capture)
        for name, value in self.causes.items():
            scene = law(name)(scene, value)
        return scene

    def _natural(self, sample: int, capture: int) -> Scene:
        spread = self.fabric.variability
        scene = Scene(self.seed, sample, capture, CAPTURES[capture], later=capture % 2 == 0)  # pyright: ignore[reportArgumentType]
        stiff = scene.random("specimen", "stiffness")
        bending, stretch = (matern_field(spread.stiffness, spread.stiffness_length, 1.5, stiff) for _ in range(2))
        rest = matern_field(spread.rest, spread.rest_length, 3.5, scene.random("specimen", "rest shape"))
        laid = matern_field(spread.laying, spread.laying_length, 3.0, scene.random("face", "laying"))
        change = matern_field(spread.repeat, spread.laying_length, 3.0, scene.random("capture", "laying again"))
        return replace(scene, log_bending=(bending,), log_stretch=(stretch,), rest=(rest,), laid=(laid, change))

    def _picture(self, scene: Scene) -> tuple[Picture, dict[str, ndarray]]:
        """One picture, and what laws keep of it for the sample's next one."""
        system = self._systems.system_of(scene)
        p = _parameters(self.fabric.material, system.mesh, scene)
        x, kept = drop(system, p, _laid(system, scene), scene, steps=self.steps)
        seen = seen_from_above(x, scene, self.fabric.variability)
        faces = system.mesh.faces if scene.side == "up" else system.mesh.faces[:, ::-1]
        levels = photograph(seen, np.ascontiguousarray(faces), scene)
        return Picture(scene.sample, scene.capture, levels, seen), kept


def _parameters(material: Material, mesh: Mesh, scene: Scene) -> Parameters:
    """Tables of every element, masses and rest angles."""
    centre = np.array(scene.centre)
    faces, hinges = face_centres(mesh) - centre, hinge_centres(mesh) - centre
    stretch = np.exp(sum_of_fields(scene.log_stretch, faces))[:, None, None] * material.stretch.numpy()
    bending = np.exp(sum_of_fields(scene.log_bending, hinges))[:, None, None] * material.bending.numpy()
    density = float(material.density) * np.exp(sum_of_fields(scene.log_mass, faces))
    mass = np.bincount(mesh.faces.ravel(), np.repeat(density * mesh.areas / 3, 3), mesh.vertices)
    return Parameters(stretch, bending, mass, _rest_angles(mesh, scene))


def _rest_angles(mesh: Mesh, scene: Scene) -> Float[ndarray, "hinges"]:
    """Stress-free dihedral angles in the simulated frame [rad]: of the mirror image where the face lies down."""
    points = cloth_points(mesh, scene)
    shapes = [np.column_stack([points, sum_of_fields(scene.rest, points)])]
    shapes += [surface(points) for surface in scene.surfaces]
    angles = [dihedral_angles(torch.from_numpy(shape), mesh.hinges).numpy() for shape in shapes]
    return scene.up * np.sum(angles, axis=0)


def _laid(system: DrapeSystem, scene: Scene) -> Vertices:
    """The cloth as laid down: flat on the plate, undulating beyond its edge."""
    mesh = system.mesh
    beyond = np.clip((np.hypot(*mesh.material.T) - scene.plate_radius) / _FADE, 0, 1)
    height = sum_of_fields(scene.laid, cloth_points(mesh, scene)) * np.sin(0.5 * np.pi * beyond) ** 2
    return np.column_stack([mesh.material, np.where(system.fixed, 0.0, height)])
