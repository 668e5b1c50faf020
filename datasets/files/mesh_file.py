"""A drape's mesh from its file; a fault is told as the data layer tells it."""

from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.datasets.errors import BadMesh
from cusick_bench.sim.cloth.obj import read_obj
from cusick_bench.sim.errors import BadMeshFile

_REMEDY = "replace it by a triangle mesh in OBJ form, or remove it"


@dataclass(frozen=True, eq=False)
class DrapeMesh:
    """A triangle mesh as it is in its file.

    Attributes:
        vertices: Positions [m].
        faces: Zero-based triangles; polygons are cut into fans.
    """

    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]


def read_mesh(path: Path) -> DrapeMesh:
    """Reads vertices and faces; everything else in the file is ignored.

    Args:
        path: OBJ file, plain or gzipped.

    Returns:
        The triangle mesh.

    Raises:
        BadMesh: Missing, not permitted, too large, not OBJ, without faces, with coordinates that are not finite or
            faces that refer to vertices that are not there.
    """
    try:
        return DrapeMesh(*read_obj(path))
    except BadMeshFile as error:
        raise BadMesh(error.what, where=path, remedy=_REMEDY, kind=error.kind) from error
