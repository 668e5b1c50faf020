"""Forces at a known shape due to an uneven rest shape and an uneven stiffness of the cloth, to first order.

Both are smooth Gaussian fields with covariance s^2 exp(-d^2 / (2 l^2)) over the flat cloth. A rest shape of height h
changes the hinges' stress-free angles by phi = D h, and df/dphi = M' grad theta; a field q of log stiffness changes the
forces of faces and hinges by q times themselves. The covariance of these forces has few modes, those of the field.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.force_basis import tables_of
from cusick_bench.sim.engine.triangles.system import DrapeSystem

_KEPT = 1 - 1e-3  # share of a field's variance that its modes keep


def field_modes(mesh: Mesh, length: float) -> Float[ndarray, "vertices modes"]:
    """Modes of a field of unit variance on the vertices: field = modes w, w ~ N(0, I).

    Args:
        mesh: The cloth.
        length: Length of the covariance exp(-d^2 / (2 length^2)) [m].

    Returns:
        One column for each mode.
    """
    square = np.square(mesh.material[:, None] - mesh.material[None]).sum(2)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * square / length**2))
    values, vectors = values[::-1], vectors[:, ::-1]
    count = 1 + int(np.searchsorted(np.cumsum(values), _KEPT * values.sum()))
    return vectors[:, :count] * np.sqrt(np.maximum(values[:count], 0))


def _means(corners: ndarray, vertices: int) -> sparse.csr_array:
    """Takes a vertex field to the mean over each element's corners."""
    count, each = corners.shape
    rows = np.repeat(np.arange(count), each)
    return sparse.csr_array((np.full(corners.size, 1 / each), (rows, corners.ravel())), shape=(count, vertices))


def _scattered(corners: ndarray, vectors: ndarray, vertices: int) -> sparse.csr_array:
    """Matrix with one column an element: its vectors (elements, corners, 3) at the coordinates of its corners."""
    rows = (3 * corners[:, :, None] + np.arange(3)).reshape(len(corners), -1)
    columns = np.repeat(np.arange(len(corners)), rows.shape[1])
    return sparse.csr_array((vectors.ravel(), (rows.ravel(), columns)), shape=(3 * vertices, len(corners)))


def uneven_forces(
    system: DrapeSystem,
    x: Float[ndarray, "vertices 3"],
    theta: Float[ndarray, " 39"],
    rest: Float[ndarray, "vertices rest_modes"],
    uneven: Float[ndarray, "vertices modes"],
) -> Float[ndarray, "coordinates all_modes"]:
    """Forces on the free vertices, a column a mode [N].

    Args:
        system: Cloth and support.
        x: Positions [m].
        theta: C and B in one row.
        rest: Modes of the rest shape's height [m].
        uneven: Modes of the logarithm of stiffness; stretch and bending stiffness have fields of their own.

    Returns:
        Columns of the rest shape, then those of stretch, then those of bending stiffness.
    """
    stretch, bending = tables_of(theta)
    mesh, none = system.mesh, np.zeros(len(system.elements.hinges))
    p = Parameters(stretch[None], bending[None], np.zeros(mesh.vertices), none).batch()
    hinges, exact = system.elements.hinges, system.law == "paper"
    flat = system.evaluate(mesh.flat[None], mesh.flat[None], p, exact=False, everywhere=True).work
    heights = flat.hinge_vector[0].reshape(-1, 4, 3)[:, :, 2].copy()  # of the flat cloth only heights bend hinges
    rows = np.repeat(np.arange(len(hinges)), 4)
    heights *= system.elements.hinge_share[:, None]  # of a clamp only the free half bends
    angles = sparse.csr_array((heights.ravel(), (rows, hinges.ravel())), shape=(len(hinges), mesh.vertices))
    work = system.evaluate(x[None], x[None], p, exact=exact, everywhere=True).work
    gradient = work.hinge_vector[0].reshape(-1, 4, 3)
    by_angle = _scattered(hinges, work.hinge_stiffness[0][:, None, None] * gradient, mesh.vertices)
    on_hinges = _scattered(hinges, work.hinge_moment[0][:, None, None] * gradient, mesh.vertices)
    on_faces = _scattered(mesh.faces, work.face_vector[0], mesh.vertices)
    columns = [
        by_angle @ (angles @ rest),
        on_faces @ (_means(mesh.faces, mesh.vertices) @ uneven),
        on_hinges @ (_means(hinges[:, :2], mesh.vertices) @ uneven),
    ]
    coordinates = (3 * system.free[:, None] + np.arange(3)).ravel()
    return np.concatenate(columns, axis=1)[coordinates]
