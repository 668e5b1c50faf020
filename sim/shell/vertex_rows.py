"""Slopes at the mesh's vertices, for the membrane: the rows of least norm that differentiate quadratics exactly.

A stencil is the vertex and its neighbours in the extended control mesh, and their neighbours too where these are fewer
than five or lie near a conic, on which six functions are not determined: rows of large norm would stiffen the membrane.
"""

import numpy as np
import scipy.sparse as sparse
from numpy import ndarray

from cusick_bench.sim.shell.control_mesh import ControlMesh
from cusick_bench.sim.shell.loop_rows import gram_inverse, local_quadratics
from cusick_bench.sim.shell.padded import Padded, accumulated, entries

_FEWEST_NEIGHBOURS = 5
_LARGEST = 2.5  # norm of a vertex' rows times a stencil's size; 0.8 is usual, up to 1.7 on meshes of good quality
_SIZE = 1.1  # of a stencil, in square roots of the mean area of a vertex
_NEAR = 0.3  # squared distance, in that size, within which nodes of a wide stencil weigh alike


def vertex_rows(control: ControlMesh, length: float) -> Padded:
    """Rows u_,1 and u_,2 [1/m] at the vertices outside the plate and on the clamp.

    Args:
        control: The extended control mesh.
        length: Square root of the mean area of a vertex [m].

    Returns:
        Weights of the control points.
    """
    vertices = control.vertices_outside
    around = sparse.csr_array(control.neighbours + sparse.eye_array(control.controls, format="csr"))
    wide = control.valence[vertices] < _FEWEST_NEIGHBOURS
    enough = np.flatnonzero(~wide)
    narrow_rows = _slopes(control, vertices[enough], sparse.csr_array(around[vertices[enough]]), _SIZE * length, False)
    norm = length * np.sqrt((narrow_rows.weights**2).sum((1, 2)))
    wide[enough[norm > _LARGEST]] = True
    if not wide.any():
        return narrow_rows
    second = sparse.csr_array(around[vertices[wide]] @ around)
    wide_rows = _slopes(control, vertices[wide], second, _SIZE * length, True)
    return _merged(len(vertices), (enough, narrow_rows, norm <= _LARGEST), (np.flatnonzero(wide), wide_rows, None))


def _slopes(control: ControlMesh, vertices: ndarray, around: sparse.csr_array, unit: float, weighted: bool) -> Padded:
    """Rows on the given stencils; where weighted, near nodes are preferred to far ones."""
    point, node = entries(around)
    stencil = accumulated(point, node, [np.zeros(len(point))], len(vertices))
    units = np.full(len(vertices), unit)
    basis = local_quadratics(control, stencil.nodes, stencil.used, control.mesh.material[vertices], units)
    distance = (basis[:, :, 1:3] ** 2).sum(2)
    weight = 1 / (_NEAR + distance) if weighted else np.ones_like(distance)
    inverse = gram_inverse(np.sqrt(weight)[:, :, None] * basis, stencil.counts)
    functions = np.ascontiguousarray((weight[:, :, None] * basis).transpose(0, 2, 1))
    return Padded(stencil.nodes, stencil.counts, inverse[:, 1:3] @ functions / unit)  # of the functions x and y


def _merged(points: int, *parts: tuple[ndarray, Padded, ndarray | None]) -> Padded:
    """Rows of several sets of points in one array; of each set only those that are marked."""
    point, node, weights = [], [], []
    for own, rows, marked in parts:
        used = rows.used if marked is None else rows.used & marked[:, None]
        point.append(np.repeat(own, used.sum(1)))
        node.append(rows.nodes[used])
        weights.append(rows.weights.transpose(0, 2, 1)[used])
    columns = np.concatenate(weights).T
    return accumulated(np.concatenate(point), np.concatenate(node), list(columns), points)
