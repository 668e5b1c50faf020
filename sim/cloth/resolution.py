"""The kind of mesh for each material law; nothing else chooses it.

Law `plate` uses rings of vertices (`ring_mesh`), on which its error falls smoothly with the number of vertices; the
laws with hinges use `disc_mesh`, whose edges run in all directions. The numbers of vertices for each purpose, and the
errors that they have, are in `cusick_bench.sim.constants`.
"""

from cusick_bench.sim.cloth.conform import conformed
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError

_MESHES = {"plate": ring_mesh, "paper": disc_mesh, "published": disc_mesh}


def cloth_mesh(
    law: str, vertices: int, *, seed: int = 0, radius: float = CLOTH_RADIUS, plate_radius: float = PLATE_RADIUS
) -> Mesh:
    """The mesh of a cloth disc on which a law does best.

    Args:
        law: Material law: `plate` gets rings, the others triangles of all directions.
        vertices: Number of vertices of the mesh, met exactly; at least 60.
        seed: Another seed gives another mesh of the same quality.
        radius: Cloth radius [m].
        plate_radius: Plate radius [m].

    Returns:
        The mesh; one and the same object for the same arguments, as long as it is kept.

    Raises:
        SimulationError: Another law, too few vertices, or radii out of order.
    """
    if law not in _MESHES:
        raise SimulationError(f"law must be one of {', '.join(_MESHES)}, got {law!r}")
    return _MESHES[law](vertices, seed=seed, radius=radius, plate_radius=plate_radius)


def fitted_to(law: str, mesh: Mesh, plate_radius: float = PLATE_RADIUS) -> Mesh:
    """A mesh from elsewhere as a law can take it: law `plate` needs vertices on the plate's edge.

    Args:
        law: Material law.
        mesh: The cloth.
        plate_radius: Plate radius [m].

    Returns:
        The mesh itself, or for law `plate` the mesh with its nearest ring of vertices moved onto the plate's edge.

    Raises:
        SimulationError: It has seams, or no ring of edges near the plate's edge.
    """
    return conformed(mesh, plate_radius) if law == "plate" else mesh
