"""Cloths of triangles: parameters of their elements, laid down and dropped."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.withheld.world.fabric import Fabric
from cusick_bench.withheld.world.scene import Scene, laid_height, sum_of_fields
from cusick_bench.withheld.world.triangles import contact, history
from cusick_bench.withheld.world.triangles.drop import Stepping, drop
from cusick_bench.withheld.world.triangles.systems import SceneSystems, cloth_points
from cusick_bench.withheld.world.world import Drape

LAWS = history.LAWS | contact.LAWS
"""Laws of effects that depend on hinges and faces."""


@dataclass(frozen=True, eq=False)
class TriangleCloths:
    """All cloths of a case; see `Cloths`.

    Attributes:
        systems: Their mechanical systems.
        stepping: Time steps and damping.
    """

    systems: SceneSystems
    stepping: Stepping

    def drape(self, fabric: Fabric, scene: Scene, steps: int) -> Drape:
        """Drapes one cloth; see `Cloths.drape`."""
        system = self.systems.system_of(scene)
        p = parameters_of(fabric.material, system.mesh, scene)
        laid = np.column_stack([system.mesh.material, laid_height(scene, system.mesh.material)])
        x, kept = drop(system, p, laid, scene, self.stepping, steps)
        return Drape(x, system.mesh.faces, kept)


def parameters_of(material: Material, mesh: Mesh, scene: Scene) -> Parameters:
    """Tables of every element, masses and rest angles.

    Args:
        material: Mean tables.
        mesh: The cloth.
        scene: Fields over it.

    Returns:
        The parameters.
    """
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
