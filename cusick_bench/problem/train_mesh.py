"""The training drape in three dimensions, for methods that fit shapes instead of silhouettes.

Forces need to know how the cloth was before it was draped: the material coordinates of every vertex. A mesh file does
not hold them. They are known where its triangles are those of a known flat mesh, one by one; a mesh of thousands of
triangles does not agree with another one by chance.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cusick_bench.sim.cloth.mesh import Mesh


@dataclass(frozen=True, eq=False)
class TrainMesh:
    """A drape's surface.

    Attributes:
        vertices: Positions, the plate's axis along z and its top at z = 0 [m].
        faces: Triangles, counter-clockwise seen from above where the cloth lies flat.
        material: Flat coordinates of the vertices [m], warp along x; None where no flat mesh is known.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    material: Float[np.ndarray, "vertices 2"] | None = None


def with_reference(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], known: Iterable[Mesh]
) -> TrainMesh:
    """Looks for the flat mesh that a draped one was made from.

    Args:
        vertices: Positions [m].
        faces: Vertex indices of each triangle.
        known: Flat meshes to compare with. A cloth that was turned over about y has their triangles the other way
            round; it is then returned as its mirror image x -> -x, which hangs from the same forces.

    Returns:
        The mesh, with material coordinates where its triangles are those of a known mesh.
    """
    vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    for flat in known:
        if flat.vertices == len(vertices) and np.array_equal(flat.faces, faces):
            return TrainMesh(vertices, faces, flat.material)
        if flat.vertices == len(vertices) and np.array_equal(flat.faces, faces[:, ::-1]):
            return TrainMesh(vertices * [-1, 1, 1], flat.faces, flat.material)
    return TrainMesh(vertices, faces)
