"""Slopes at the mesh's vertices, for the membrane: the rows of least norm that differentiate quadratics exactly.

A stencil is the vertex and its neighbours in the extended control mesh, and their neighbours too where these are fewer
than five, so that six functions are determined.
"""

import numpy as np
import scipy.sparse as sparse

from cusick_bench.sim.shell.control_mesh import ControlMesh
from cusick_bench.sim.shell.loop_rows import gram_inverse, local_quadratics
from cusick_bench.sim.shell.padded import Padded, accumulated, entries

_FEWEST_NEIGHBOURS = 5
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
    small = control.valence[vertices] < _FEWEST_NEIGHBOURS
    around = sparse.csr_array(control.neighbours + sparse.eye_array(control.controls, format="csr"))
    near = entries(sparse.csr_array(around[vertices[~small]]))
    wide = entries(sparse.csr_array(around[vertices[small]] @ around))
    point = np.concatenate([np.flatnonzero(~small)[near[0]], np.flatnonzero(small)[wide[0]]])
    node = np.concatenate([near[1], wide[1]])
    stencil = accumulated(point, node, [np.zeros(len(point))], len(vertices))
    unit = np.full(len(vertices), _SIZE * length)
    basis = local_quadratics(control, stencil.nodes, stencil.used, control.mesh.material[vertices], unit)
    distance = (basis[:, :, 1:3] ** 2).sum(2)
    weight = np.where(small[:, None], 1 / (_NEAR + distance), 1.0)
    root = np.sqrt(weight)[:, :, None] * basis
    factors = gram_inverse(root, stencil.counts)[:, 1:3]  # of the functions x and y
    rows = np.einsum("pkf,pnf->pkn", factors, weight[:, :, None] * basis) / unit[:, None, None]
    return Padded(stencil.nodes, stencil.counts, rows)
