"""Which entries of the stiffness tables belong to an edge or a vertex: bending stands at hinges, stretch at faces."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.shell.padded import entries


@dataclass(frozen=True, eq=False)
class OutsideEdges:
    """The edges of the faces outside the plate.

    Attributes:
        ends: Their ends, smaller index first, in ascending order.
        area: One third of the area of their faces outside [m2].
        faces: Faces outside at every edge; ones in a matrix of shape (edges, faces).
        hinge: Index of the mesh's hinge at every edge, -1 at the rim.
        hinges_of_face: Hinges of all faces of the mesh; ones in a matrix of shape (faces, hinges).
        hinges: Number of the mesh's hinges.
    """

    ends: Int[ndarray, "edges 2"]
    area: Float[ndarray, "edges"]
    faces: sparse.csr_array
    hinge: Int[ndarray, "edges"]
    hinges_of_face: sparse.csr_array
    hinges: int


def outside_edges(mesh: Mesh, outside: Int[ndarray, "outside"]) -> OutsideEdges:
    """Collects the edges of the faces outside the plate.

    Args:
        mesh: The cloth.
        outside: Its faces outside the plate.

    Returns:
        The edges.
    """
    keys, edge = np.unique(_side_keys(mesh, mesh.faces[outside]), return_inverse=True)
    face = np.repeat(outside, 3)
    touching = sparse.csr_array((np.ones(len(edge)), (edge, face)), shape=(len(keys), len(mesh.faces)))
    of_hinge = mesh.hinges[:, :2].min(1) * mesh.vertices + mesh.hinges[:, :2].max(1)
    sides = _places(of_hinge, _side_keys(mesh, mesh.faces))
    found = sides >= 0
    hinges_of_face = sparse.csr_array(
        (np.ones(found.sum()), (np.repeat(np.arange(len(mesh.faces)), 3)[found], sides[found])),
        shape=(len(mesh.faces), len(mesh.hinges)),
    )
    ends = np.column_stack(np.divmod(keys, mesh.vertices))
    return OutsideEdges(
        ends, touching @ mesh.areas / 3, touching, _places(of_hinge, keys), hinges_of_face, len(of_hinge)
    )


def bending_of_edge(edges: OutsideEdges) -> sparse.csr_array:
    """Means of hinges for every edge: its own, or at the rim those of the other edges of its face.

    Args:
        edges: The edges outside.

    Returns:
        Matrix of shape (edges, hinges) whose rows sum to one.

    Raises:
        SimulationError: A face outside has no hinge at all.
    """
    alone = np.flatnonzero(edges.hinge < 0)
    inner = np.flatnonzero(edges.hinge >= 0)
    row, hinge = entries(sparse.csr_array(edges.faces[alone] @ edges.hinges_of_face))
    number = np.bincount(row, minlength=len(alone))
    if (number == 0).any():
        ends = edges.ends[alone[np.argmin(number)]]
        raise SimulationError(
            f"the face at the rim edge {ends[0]}-{ends[1]} has no neighbour, hence no bending stiffness; remove it"
        )
    return sparse.csr_array(
        (
            np.concatenate([np.ones(len(inner)), 1 / number[row]]),
            (np.concatenate([inner, alone[row]]), np.concatenate([edges.hinge[inner], hinge])),
        ),
        shape=(len(edges.ends), edges.hinges),
    )


def area_means(touching: sparse.csr_array, areas: Float[ndarray, "faces"]) -> sparse.csr_array:
    """Area-weighted means over faces.

    Args:
        touching: Ones where a face counts; shape (points, faces).
        areas: Areas of the faces [m2].

    Returns:
        Matrix of the same shape whose rows sum to one.
    """
    weighted = sparse.csr_array(touching * areas[None, :])
    return sparse.csr_array(weighted / weighted.sum(1)[:, None])


def _side_keys(mesh: Mesh, faces: ndarray) -> ndarray:
    """Keys of the faces' undirected sides, three a face."""
    following = np.roll(faces, -1, axis=1)
    return (np.minimum(faces, following) * mesh.vertices + np.maximum(faces, following)).ravel()


def _places(keys: ndarray, wanted: ndarray) -> ndarray:
    """Places of the wanted keys, -1 where there is none."""
    if not len(keys):
        return np.full(len(wanted), -1)
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)
    return np.where(keys[order[place]] == wanted, order[place], -1)
