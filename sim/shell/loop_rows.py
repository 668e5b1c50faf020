"""Derivatives of the Loop limit surface at the midpoints of edges, corrected to be exact for quadratics.

One step of subdivision makes the edge's midpoint a vertex with six neighbours (the two ends and four midpoints around),
where the limit surface is a quartic box spline: its value and its first and second derivatives are combinations of
these seven points, hence of the control points around the edge's two ends. The chain rule with the control points'
material places turns derivatives by the spline's parameters into derivatives by material coordinates.

Loop surfaces reproduce quadratics on regular meshes only. On others the rows get the change of least norm that makes
them exact for the control values of quadratics; without it the plate converges to a wrong deflection.

References:
    C. Loop. Smooth subdivision surfaces based on triangles. Master's thesis, University of Utah (1987), Section 3.
    F. Cirak, M. Ortiz, P. Schroeder. International Journal for Numerical Methods in Engineering 47 (2000), Appendix A.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.shell.control_mesh import ControlMesh, loop_beta
from cusick_bench.sim.shell.padded import Padded, entries, pattern

_EDGE_RULE = (0.375, 0.375, 0.125, 0.125)  # ends of the edge, then the vertices opposite (Loop 1987)
_ANGLES = np.arange(6) * np.pi / 3  # of the six neighbours in the spline's parameters
_DERIVATIVES = np.array(  # of 1, x, y, xx, xy, yy by x, y, xx, yy, twice xy
    [[0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 2, 0, 0], [0, 0, 0, 0, 0, 2], [0, 0, 0, 0, 2, 0]], dtype=float
)
_ORDER = np.array([1, 1, 2, 2, 2])  # of the derivatives
_SINGULAR = 1e-9  # relative to the largest eigenvalue of the six functions' Gram matrix
_LARGEST = 5.0  # norm of a row's free part over that of the shortest exact row; below 3 on meshes of good quality
_FEW_NODES = 8  # stencils with fewer may not determine six functions


def midpoint_rows(
    control: ControlMesh, edges: Int[ndarray, "edges 2"]
) -> tuple[Padded, Padded, Float[ndarray, "edges 2"]]:
    """Limit values and derivatives at the midpoints of edges.

    Args:
        control: The extended control mesh.
        edges: Edges of faces outside the plate.

    Returns:
        Weights of the control points for the limit value (one row); for the derivatives u_,1 u_,2 [1/m] and u_,11
        u_,22 2 u_,12 [1/m2], before correction; and the material coordinates of the midpoints [m].
    """
    nodes, counts, points = _subdivided(control, edges)
    limit = 0.5 * points[0] + points[1:].sum(0) / 12
    by_u = np.tensordot(np.cos(_ANGLES) / 3, points[1:], axes=1)
    by_v = np.tensordot(np.sin(_ANGLES) / 3, points[1:], axes=1)
    along = [points[1 + axis] - 2 * points[0] + points[4 + axis] for axis in range(3)]
    by_uu = along[0]
    by_vv = 2 / 3 * (along[1] + along[2]) - along[0] / 3
    by_uv = (along[1] - along[2]) / np.sqrt(3)
    material = control.material[nodes]
    first = np.stack([by_u, by_v], axis=1)
    inverse = np.linalg.inv(first @ material)
    gradient = inverse @ first
    second = np.stack([by_uu, by_uv, by_uv, by_vv], axis=1)
    second = (second - (second @ material) @ gradient).reshape(len(edges), 2, 2, -1)
    hessian = np.einsum("pia,pjb,pabn->pijn", inverse, inverse, second, optimize=True)
    rows = [gradient[:, 0], gradient[:, 1], hessian[:, 0, 0], hessian[:, 1, 1], 2 * hessian[:, 0, 1]]
    value = Padded(nodes, counts, limit[:, None])
    return value, Padded(nodes, counts, np.stack(rows, axis=1)), np.einsum("pn,pnx->px", limit, material)


def corrected(
    control: ControlMesh, rows: Padded, centre: Float[ndarray, "points 2"], length: Float[ndarray, "points"]
) -> Padded:
    """The nearest rows, in the sum of squares of their weights, that differentiate quadratics exactly.

    Exact rows are the shortest exact ones plus a part that vanishes for quadratics. Where triangles are so distorted
    that the spline's parameters fold, this part is without bounds; it is then shortened, which keeps the rows exact.

    Args:
        control: The extended control mesh.
        rows: Derivatives by x, y, xx, yy, twice xy (or the first of these) by control points.
        centre: Material points where the derivatives are taken [m].
        length: Size of a stencil there [m], for scaling.

    Returns:
        The corrected rows.
    """
    kinds = rows.weights.shape[1]
    basis = local_quadratics(control, rows.nodes, rows.used, centre, length)
    scale = length[:, None] ** _ORDER[:kinds]
    scaled = rows.weights * scale[:, :, None]
    functions, inverse = np.ascontiguousarray(basis.transpose(0, 2, 1)), gram_inverse(basis, rows.counts)
    least, free = np.zeros_like(scaled), scaled
    for _ in range(2):  # the second time for the digits that the Gram matrix loses
        least = least + ((_DERIVATIVES[:kinds] - least @ basis) @ inverse) @ functions
        free = free - ((free @ basis) @ inverse) @ functions
    size = np.sqrt((free**2).sum((1, 2)) / (least**2).sum((1, 2)))
    scaled = least + free * np.minimum(1, _LARGEST / np.maximum(size, _LARGEST))[:, None, None]
    return Padded(rows.nodes, rows.counts, scaled / scale[:, :, None])


def local_quadratics(
    control: ControlMesh,
    nodes: Int[ndarray, "points width"],
    used: ndarray,
    centre: Float[ndarray, "points 2"],
    length: Float[ndarray, "points"],
) -> Float[ndarray, "points width 6"]:
    """Control values of 1, x, y, xx, xy, yy about a centre, in units of a length; zero in the padding.

    Args:
        control: The extended control mesh.
        nodes: Control points of every stencil.
        used: Whether a place holds a node.
        centre: Origin of the coordinates [m].
        length: Unit of the coordinates [m].

    Returns:
        The values.
    """
    x, y = np.moveaxis(control.material[nodes], 2, 0)
    xx, xy, yy = np.moveaxis(control.quadratics[nodes], 2, 0)
    x0, y0 = centre.T[:, :, None]
    unit = length[:, None]
    values = [
        np.ones_like(x),
        (x - x0) / unit,
        (y - y0) / unit,
        (xx - 2 * x0 * x + x0**2) / unit**2,
        (xy - x0 * y - y0 * x + x0 * y0) / unit**2,
        (yy - 2 * y0 * y + y0**2) / unit**2,
    ]
    return np.stack(values, axis=2) * used[:, :, None]


def gram_inverse(basis: Float[ndarray, "points width 6"], counts: Int[ndarray, "points"]) -> ndarray:
    """Inverses of B^T B; pseudoinverses where a stencil of few nodes does not determine six functions.

    Args:
        basis: Values B of the functions at the nodes.
        counts: Number of nodes.

    Returns:
        The inverses, shape (points, 6, 6).
    """
    gram = basis.transpose(0, 2, 1) @ basis
    few = counts < _FEW_NODES
    inverse = np.empty_like(gram)
    inverse[~few] = np.linalg.inv(gram[~few])
    inverse[few] = np.linalg.pinv(gram[few], rcond=_SINGULAR, hermitian=True)
    return inverse


def _subdivided(control: ControlMesh, edges: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """The edge's midpoint and its six neighbours after one subdivision: nodes, counts, weights (7, edges, width)."""
    a, b = edges.T
    c, d = control.opposite(a, b), control.opposite(b, a)
    rules = [  # counter-clockwise from the edge's second end
        _edge_rule(a, b, c, d),
        _vertex_rule(control, b),
        _edge_rule(b, c, a, control.opposite(c, b)),
        _edge_rule(c, a, b, control.opposite(a, c)),
        _vertex_rule(control, a),
        _edge_rule(a, d, b, control.opposite(d, a)),
        _edge_rule(d, b, a, control.opposite(b, d)),
    ]
    point = np.concatenate([rule[0] for rule in rules])
    node = np.concatenate([rule[1] for rule in rules])
    nodes, counts, slot = pattern(point, node, len(edges))
    ends = np.cumsum([len(rule[0]) for rule in rules])
    points = [
        np.bincount(slot[end - len(rule[0]) : end], rule[2], nodes.size).reshape(nodes.shape)
        for rule, end in zip(rules, ends, strict=True)
    ]
    return nodes, counts, np.stack(points)


def _edge_rule(*nodes: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """Point, node and weight of Loop's new vertex on an edge: the edge's ends and the vertices opposite."""
    points = len(nodes[0])
    return np.tile(np.arange(points), 4), np.concatenate(nodes), np.repeat(_EDGE_RULE, points)


def _vertex_rule(control: ControlMesh, vertex: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """Point, node and weight of Loop's rule for an old vertex: its neighbours, then itself."""
    beta = loop_beta(control.valence[vertex])
    point, node = entries(sparse.csr_array(control.neighbours[vertex]))
    points = np.arange(len(vertex))
    weight = np.concatenate([beta[point], 1 - control.valence[vertex] * beta])
    return np.concatenate([point, points]), np.concatenate([node, vertex]), weight
