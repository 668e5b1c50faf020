"""Curvature at edges from stress-free dihedral angles.

A surface z = (k11 x^2 + k22 y^2 + 2 k12 x y) / 2 over a mesh has, to first order in z, the dihedral angle

    theta = -(grad z in face 0 - grad z in face 1) . n

at a hinge, n the unit normal of the hinge in the plane that points into face 0: linear in (k11, k22, 2 k12). The
curvature at an edge is the least-squares solution over the hinges around it, hence exact for quadratic rest shapes.
Angles are positive where the cloth is convex seen from its face, curvatures where it is concave.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.shell.coefficients import OutsideEdges
from cusick_bench.sim.shell.padded import entries

_WELL_POSED = 1e-3  # smallest over largest eigenvalue of the normal equations
_WIDENINGS = 4


def rest_curvature(mesh: Mesh, edges: OutsideEdges) -> sparse.csr_array:
    """Curvatures (k11, k22, 2 k12) [1/m] at edges by the stress-free dihedral angles of the mesh's hinges [rad].

    Args:
        mesh: The cloth.
        edges: The edges outside the plate.

    Returns:
        Matrix of shape (3 edges, hinges).

    Raises:
        SimulationError: The mesh has too few hinges around an edge.
    """
    angles = _angles_of_curvature(mesh)
    corners = sparse.csr_array(
        (np.ones(mesh.faces.size), (np.repeat(np.arange(len(mesh.faces)), 3), mesh.faces.ravel())),
        shape=(len(mesh.faces), mesh.vertices),
    )
    left, around = np.arange(len(edges.ends)), edges.faces
    rows, columns, values = [], [], []
    for _ in range(_WIDENINGS):
        point, hinge = entries(sparse.csr_array(around @ edges.hinges_of_face))
        row, column, value, good = _least_squares(point, hinge, angles, len(left))
        rows.append(3 * left[row // 3] + row % 3)
        columns.append(column)
        values.append(value)
        left, around = left[~good], sparse.csr_array(around[~good])
        if not len(left):
            break
        around = sparse.csr_array(around @ corners @ corners.T)
    else:
        ends = edges.ends[left[0]]
        raise SimulationError(f"too few hinges around edge {ends[0]}-{ends[1]} for a curvature; refine the mesh there")
    place = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array((np.concatenate(values), place), shape=(3 * len(edges.ends), len(mesh.hinges)))


def _least_squares(point: ndarray, hinge: ndarray, angles: ndarray, points: int) -> tuple:
    """Entries (row, column, value) of the well-posed points' least-squares solutions, and which points these are."""
    order = np.lexsort((hinge, point))
    point, hinge = point[order], hinge[order]
    normal = np.zeros((points, 3, 3))
    np.add.at(normal, point, angles[hinge, :, None] * angles[hinge, None, :])
    eigenvalues = np.linalg.eigvalsh(normal)
    good = eigenvalues[:, 0] > _WELL_POSED * eigenvalues[:, 2]
    normal[~good] = np.eye(3)
    solution = np.einsum("eij,ej->ei", np.linalg.inv(normal)[point], angles[hinge])
    kept = good[point]
    row = (3 * point[kept, None] + np.arange(3)).ravel()
    return row, np.repeat(hinge[kept], 3), solution[kept].ravel(), good


def _angles_of_curvature(mesh: Mesh) -> Float[ndarray, "hinges 3"]:
    """Dihedral angles of the surfaces x^2 / 2, y^2 / 2 and x y / 2 [m] at the hinges, to first order."""
    first, second, *opposite = (mesh.material[vertex] for vertex in mesh.hinges.T)
    side = second - first
    length = np.hypot(*side.T)
    tangent = side / length[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    heights, start = _monomials(second) - _monomials(first), _monomials(first)
    angle = np.zeros((len(side), 3))
    for sign, third in zip((-1, 1), opposite, strict=True):
        arm = third - first
        along, across = (arm * tangent).sum(1), (arm * normal).sum(1)
        slope = (_monomials(third) - start - heights * (along / length)[:, None]) / across[:, None]
        angle += sign * slope
    return angle


def _monomials(points: ndarray) -> ndarray:
    x, y = points.T
    return np.column_stack([x * x, y * y, x * y]) / 2
