"""The mechanical systems of true scenes on triangle meshes.

Law `paper` bends in another way than in the package: a hinge with edge length l between two triangles bends over the
distance L between their circumcentres (the dual edge): curvature = (2/3) angle / L and stiffness (2/3) B l / L, which
on equilateral triangles are angle l / (A1 + A2) and B l^2 / (A1 + A2), the simulator's own. Nearly cocircular triangles
have L -> 0, so L is kept above a part of l. Law `published` is unchanged, quirks and springs included.

References:
    Desbrun, Hirani, Leok, Marsden. Discrete exterior calculus, 2005 (circumcentric duals).
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.irregular import jittered_mesh
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.engine.triangles.elements import Elements
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.withheld.world.scene import Scene, sum_of_fields, unit_vector
from cusick_bench.withheld.world.triangles.placed_disc import on_plate, placed

_SHORTEST_DUAL = 0.3  # as a part of the edge; on equilateral triangles it is 0.58
_SPRING = 1e3  # [N/m] of the published program's support
_JITTER = 0.2  # of the spacing, by which vertices lie beside those of the package's mesher


@dataclass(frozen=True, eq=False)
class SceneSystems:
    """Mechanical systems of the scenes of one case; scenes of a sample and of the same radii share their analysis.

    Every sample has a mesh of its own: one that all share prefers directions, which shows as an effect of the
    laboratory where there is none.

    Attributes:
        vertices: Mesh size.
        seed: Seed of the meshes.
        law: Material law. `paper` bends over dual edges and is clamped; `published` hangs on springs.
    """

    vertices: int
    seed: int
    law: Literal["paper", "published"]
    _centred: dict[tuple[int, float, float], DrapeSystem] = field(default_factory=dict, init=False, repr=False)

    def system_of(self, scene: Scene) -> DrapeSystem:
        """The cloth of a scene on its plate; without gravity, which is a load.

        Args:
            scene: The circumstances of one picture.

        Returns:
            The system, with material points about the plate's axis.
        """
        centred = self._centred_system(scene.sample, scene.radius, scene.plate_radius)
        mesh = placed(centred.mesh, scene.radius, scene.plate_radius, np.array(scene.centre), scene.outlines)
        system = centred.with_mesh(mesh)
        elements = _dual(system.elements, mesh) if self.law == "paper" else system.elements
        return system.with_elements(_grown(_turned(elements, mesh, scene.skew), mesh, scene))

    def _centred_system(self, sample: int, radius: float, plate: float) -> DrapeSystem:
        """A sample's disc of that radius [m] in the middle of a plate of that radius [m], analysed once."""
        key = (sample, radius, plate)
        if key not in self._centred:
            for other in [known for known in self._centred if known[0] != sample]:
                del self._centred[other]  # samples are draped one after the other
            seed = int(np.random.default_rng([self.seed, sample]).integers(2**31))
            mesh = disc_mesh(self.vertices, seed=seed, radius=radius, plate_radius=plate)
            none = np.zeros(mesh.vertices, dtype=bool)
            if self.law == "published":
                mesh = jittered_mesh(mesh, _JITTER, seed=seed, plate_radius=plate)
                fixed, spring = none, _SPRING * on_plate(mesh, plate)
            else:
                fixed, spring = on_plate(mesh, plate), np.zeros(mesh.vertices)
            self._centred[key] = DrapeSystem(mesh, self.law, 0.0, fixed, spring)
        return self._centred[key]


def cloth_points(mesh: Mesh, scene: Scene) -> Float[ndarray, "vertices 2"]:
    """Material points about the cloth's centre.

    Args:
        mesh: The cloth, with material points about the plate's axis.
        scene: Where the cloth's centre lies.

    Returns:
        The points [m].
    """
    return mesh.material - np.array(scene.centre)


def _dual(elements: Elements, mesh: Mesh) -> Elements:
    """Hinges over the distance of the circumcentres, on average as stiff as the given ones."""
    corner = mesh.material[elements.hinges]
    length = np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1)
    dual = 0.5 * length * (_cotangent(corner, 2) + _cotangent(corner, 3))
    per_length = (2 / 3) / np.maximum(dual, _SHORTEST_DUAL * length)
    weight = length * per_length
    weight *= elements.hinge_weight.mean() / weight.mean()
    return replace(elements, hinge_scale=per_length, hinge_weight=weight)


def _cotangent(corner: Float[ndarray, "hinges 4 2"], opposite: int) -> Float[ndarray, "hinges"]:
    """Cotangent of the angle at an outer corner."""
    a, b = corner[:, 0] - corner[:, opposite], corner[:, 1] - corner[:, opposite]
    return (a * b).sum(1) / np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _turned(elements: Elements, mesh: Mesh, skew: tuple[float, float]) -> Elements:
    """Warp and weft of the bending tables at their own angles; the membrane's axes are turned by their mean."""
    if skew == (0.0, 0.0):
        return elements
    warp, weft = unit_vector(skew[0]), unit_vector(90 + skew[1])
    edge = np.diff(mesh.material[elements.hinges[:, :2]], axis=1)[:, 0]
    along = np.linalg.solve(np.column_stack([warp, weft]), edge.T)  # oblique coordinates
    direction = 4 / np.pi * np.arctan2(np.abs(along[1]), np.abs(along[0]))
    low = np.minimum(direction.astype(np.int64), 1)
    cosine, sine = unit_vector(sum(skew) / 2)
    return replace(
        elements,
        direction_low=low,
        direction_fraction=direction - low,
        face_u=cosine * elements.face_u + sine * elements.face_v,
        face_v=cosine * elements.face_v - sine * elements.face_u,
    )


def _grown(elements: Elements, mesh: Mesh, scene: Scene) -> Elements:
    """Rest lengths longer by the scene's growth."""
    if not scene.growth:
        return elements
    longer = np.exp(sum_of_fields(scene.growth, cloth_points(mesh, scene)[elements.faces].mean(1)))[:, None]
    return replace(elements, face_u=elements.face_u / longer, face_v=elements.face_v / longer)
