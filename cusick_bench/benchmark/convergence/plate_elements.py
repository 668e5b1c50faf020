"""Discretisations of a plate side by side: what law `plate` was chosen from.

Each is used on the linear annulus (see `linear_plate`), whose exact deflection is known: clamped in position and slope
along the plate's edge, free at the rim, under its own weight. All have the deflections of vertices (or of control
points) as unknowns, one of them those of edges too:

- `hinges`: dihedral angles over edges, those on the clamp in their free half (the bending of law `paper`);
- `averaged normals`: constant curvature of each triangle from the slopes across the midpoints of its edges, those the
  means of the two adjacent triangles' (mid-edge normals without unknowns of their own);
- `edge unknowns`: the same with the slope across each edge as an unknown (Morley's triangle);
- `fitted slopes`: the same with slopes from a quadratic fitted to the two triangles of the edge and their neighbours
  (a rotation-free triangle); beside the clamp the quadratic is d^2 (a + b x + c y), d the distance from the plate;
- `Loop surface`: curvatures of the Loop subdivision surface at the midpoints of edges;
- `corrected Loop surface`: the same, made exact for quadratics on any mesh. Law `plate` is this one.

References:
    Grinspun, Hirani, Desbrun, Schroeder. Discrete shells. Symposium on Computer Animation, 2003.
    Grinspun, Gingold, Reisman, Zorin. Computing discrete shape operators on general meshes. Computer Graphics Forum
    25(3), 2006.
    Morley. The triangular equilibrium element in the solution of plate bending problems. Aeronautical Quarterly
    19, 1968.
    Flores, Onate. Improvements in the membrane behaviour of the three node rotation-free BST shell triangle. Computer
    Methods in Applied Mechanics and Engineering 194, 2005.
    Cirak, Ortiz, Schroeder. Subdivision surfaces. Int. J. Numerical Methods in Engineering 47, 2000.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse.linalg import spsolve

from cusick_bench.benchmark.convergence.linear_plate import exact_rim_deflection
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.shell.coefficients import outside_edges
from cusick_bench.sim.shell.control_mesh import control_mesh
from cusick_bench.sim.shell.loop_rows import midpoint_rows
from cusick_bench.sim.shell.stencils import shell_stencils

_ON_EDGE = 1e-9  # [m]
_FITTED = 8  # vertices of a fit at least
_SPREAD = 0.3  # squared distance, in edge lengths, at which a fitted point counts half as much


@dataclass(frozen=True)
class PlateElementRow:
    """One discretisation on one mesh.

    Attributes:
        element: Name of the discretisation.
        vertices: Mesh size.
        poisson: Poisson's ratio.
        ratio: Mean deflection of the rim over the exact one.
        uneven: Standard deviation of the rim's deflection over its mean.
        unknowns: Number of unknowns (of one direction of space).
        couplings: Unknowns that each is coupled with, itself among them, in the mean.
        solve_seconds: Time of the linear solve.
    """

    element: str
    vertices: int
    poisson: float
    ratio: float
    uneven: float
    unknowns: int
    couplings: float
    solve_seconds: float


@dataclass(frozen=True, eq=False)
class _Plate:
    """Curvature rows (three a point) with their areas, or a stiffness; load and rim by the unknowns."""

    rows: sparse.csr_array
    area: Float[ndarray, "points"]
    load: Float[ndarray, "unknowns"]
    rim: sparse.csr_array
    stiffness: sparse.csr_array | None = None


def compare_plate_elements(
    meshes: Sequence[Mesh], poisson: Sequence[float] = (0.0,), *, elements: Sequence[str] | None = None
) -> list[PlateElementRow]:
    """Deflection of the linear annulus by every discretisation on every mesh.

    Args:
        meshes: Discs of the standard's size with rings of vertices on the plate's edge and the rim.
        poisson: Poisson's ratios; `hinges` have their own and appear once.
        elements: Names of discretisations; all by default.

    Returns:
        A row for each.
    """
    found = []
    for name in ELEMENTS if elements is None else elements:
        for mesh in meshes:
            plate = ELEMENTS[name](mesh)
            found += [_row(name, mesh, plate, nu) for nu in (poisson if plate.stiffness is None else (-1 / 3,))]
    return found


def _row(name: str, mesh: Mesh, plate: _Plate, poisson: float) -> PlateElementRow:
    if plate.stiffness is None:
        per_area = np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, 0.5 * (1 - poisson)]])
        matrix = plate.rows.T @ sparse.kron(sparse.diags_array(plate.area), per_area) @ plate.rows
    else:
        matrix = plate.stiffness
    matrix = sparse.csc_array(matrix)
    clock = time.perf_counter()
    deflection = spsolve(matrix, plate.load)
    seconds = time.perf_counter() - clock
    rim = plate.rim @ deflection / CLOTH_RADIUS**4
    return PlateElementRow(
        name, mesh.vertices, poisson, float(rim.mean() / (exact_rim_deflection(poisson) / CLOTH_RADIUS)),
        float(rim.std() / rim.mean()), len(plate.load), matrix.nnz / len(plate.load), seconds,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Annulus:
    """The faces outside the plate, their edges, and which vertices the clamp holds."""

    points: Float[ndarray, "vertices 2"]
    faces: Int[ndarray, "faces 3"]
    area: Float[ndarray, "faces"]
    clamped: Bool[ndarray, "vertices"]
    free: Int[ndarray, "free"]
    edges: Int[ndarray, "edges 2"]
    edge_of: Int[ndarray, "faces 3"]

    @classmethod
    def of(cls, mesh: Mesh) -> "_Annulus":
        clamped = np.hypot(*mesh.material.T) <= PLATE_RADIUS + _ON_EDGE
        faces = mesh.faces[~clamped[mesh.faces].all(1)]
        sides = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]], axis=2)  # opposite to corner 0, 1, 2
        edges, inverse = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
        a, b = (mesh.material[faces[:, k]] - mesh.material[faces[:, 0]] for k in (1, 2))
        free = np.unique(faces[~clamped[faces]])
        area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        return cls(mesh.material, faces, area, clamped, free, edges, inverse.reshape(-1, 3))

    @property
    def held(self) -> Bool[ndarray, "edges"]:
        """Edges on the clamp."""
        return np.asarray(self.clamped[self.edges].all(1))

    def along(self, edge: int) -> tuple[ndarray, float]:
        """Unit vector from an edge's first end to its second, and the edge's length [m]."""
        way = self.points[self.edges[edge, 1]] - self.points[self.edges[edge, 0]]
        length = float(np.hypot(*way))
        return way / length, length

    def adjacent(self) -> list[list[int]]:
        """Faces of every edge."""
        found: list[list[int]] = [[] for _ in self.edges]
        for face, own in enumerate(self.edge_of):
            for edge in own:
                found[edge].append(face)
        return found

    def gradient(self, face: int) -> Float[ndarray, "3 2"]:
        """Gradient of a linear function by its values at a face's corners [1/m]."""
        p = self.points[self.faces[face]]
        opposite = np.roll(p, -2, axis=0) - np.roll(p, -1, axis=0)
        return np.column_stack([-opposite[:, 1], opposite[:, 0]]) / (2 * self.area[face])

    def load(self) -> Float[ndarray, "vertices"]:
        """A third of each adjacent face's area at every vertex [m2]."""
        return np.bincount(self.faces.ravel(), np.repeat(self.area / 3, 3), len(self.points))

    def at_rim(self) -> sparse.csr_array:
        """Chooses the rim's vertices among the free ones."""
        rim = np.flatnonzero(np.hypot(*self.points[self.free].T) > CLOTH_RADIUS - _ON_EDGE)
        return sparse.csr_array((np.ones(len(rim)), (np.arange(len(rim)), rim)), shape=(len(rim), len(self.free)))


_Slopes = list[dict[int, float]]
"""For every edge the slope across it, to the right of its direction, by the deflections of vertices [1/m]."""


def _normal(along: ndarray) -> ndarray:
    return np.array([along[1], -along[0]])


def _of_slopes(annulus: _Annulus, slopes: _Slopes | None) -> _Plate:
    """Constant curvatures of triangles from slopes across edges; where None is given, slopes are unknowns.

    By the divergence theorem the mean of w_,ab over a face is the sum over its edges of length times w_,a at the
    midpoint times the outward normal, over its area.
    """
    row, column, value = [], [], []
    vertices = len(annulus.points)
    for face, corners in enumerate(annulus.faces):
        for k in range(3):
            i, j = corners[(k + 1) % 3], corners[(k + 2) % 3]
            edge = annulus.edge_of[face, k]
            along, length = annulus.along(edge)
            sign = 1.0 if annulus.edges[edge, 0] == i else -1.0
            along, outward = sign * along, sign * _normal(along)
            across = {vertices + edge: 1.0} if slopes is None else slopes[edge]
            terms = [(j, along / length), (i, -along / length)]
            terms += [(node, sign * weight * outward) for node, weight in across.items()]
            for node, slope in terms:
                k11, k22 = outward * slope
                k12 = outward[0] * slope[1] + outward[1] * slope[0]
                for c, entry in enumerate((k11, k22, k12)):
                    row.append(3 * face + c)
                    column.append(node)
                    value.append(length / annulus.area[face] * entry)
    unknowns = np.zeros(vertices + (len(annulus.edges) if slopes is None else 0), bool)
    unknowns[annulus.free] = True
    if slopes is None:
        unknowns[vertices:] = ~annulus.held
    rows = sparse.csr_array((value, (row, column)), shape=(3 * len(annulus.faces), len(unknowns)))
    extra, at_rim = int(unknowns[vertices:].sum()), annulus.at_rim()
    load = np.concatenate([annulus.load()[annulus.free], np.zeros(extra)])
    rim = sparse.csr_array(sparse.hstack([at_rim, sparse.csr_array((len(at_rim.indptr) - 1, extra))]))
    return _Plate(sparse.csr_array(rows[:, np.flatnonzero(unknowns)]), annulus.area, load, rim)


def _averaged(mesh: Mesh) -> _Plate:
    annulus = _Annulus.of(mesh)
    slopes: _Slopes = []
    for edge, faces in enumerate(annulus.adjacent()):
        across = _normal(annulus.along(edge)[0])
        own: dict[int, float] = {}
        for face in () if annulus.held[edge] else faces:
            for node, weight in zip(annulus.faces[face], annulus.gradient(face) @ across, strict=True):
                own[node] = own.get(node, 0.0) + weight / len(faces)
        slopes.append(own)
    return _of_slopes(annulus, slopes)


def _edge_unknowns(mesh: Mesh) -> _Plate:
    return _of_slopes(_Annulus.of(mesh), None)


def _fitted(mesh: Mesh) -> _Plate:
    annulus = _Annulus.of(mesh)
    adjacent = annulus.adjacent()
    slopes: _Slopes = []
    for edge, faces in enumerate(adjacent):
        if annulus.held[edge]:
            slopes.append({})
            continue
        around, nodes = set(faces), np.zeros(0, int)
        while len(nodes) < _FITTED:  # beside the rim the neighbours are too few
            around = {other for face in around for side in annulus.edge_of[face] for other in adjacent[side]}
            nodes = np.unique(annulus.faces[sorted(around)])
        along, length = annulus.along(edge)
        frame = np.stack([along, _normal(along)], axis=1)
        middle = annulus.points[annulus.edges[edge]].mean(0)
        if annulus.clamped[nodes].any():
            nodes = nodes[~annulus.clamped[nodes]]
            weights = _beside_the_clamp(annulus.points[nodes], middle, frame, length)
        else:
            x, y = ((annulus.points[nodes] - middle) @ frame / length).T
            weights = _least_squares(np.stack([x**0, x, y, x * x, x * y, y * y], axis=1), x, y)[2] / length
        slopes.append(dict(zip(nodes.tolist(), weights.tolist(), strict=True)))
    return _of_slopes(annulus, slopes)


def _least_squares(basis: ndarray, x: ndarray, y: ndarray) -> ndarray:
    """Coefficients by values at the points, nearer ones counting more."""
    root = 1 / (_SPREAD + x * x + y * y)
    return np.linalg.pinv(basis * root[:, None], rcond=1e-8) * root


def _beside_the_clamp(points: ndarray, middle: ndarray, frame: ndarray, length: float) -> ndarray:
    """Slope at `middle` of d^2 (a + b x + c y) through values at the points, d the distance from the plate's edge."""
    x, y = ((points - middle) @ frame / length).T
    distance = (np.hypot(*points.T) - PLATE_RADIUS) / length
    coefficients = _least_squares(distance[:, None] ** 2 * np.stack([x**0, x, y], axis=1), x, y)
    radius = np.hypot(*middle)
    here, outward = (radius - PLATE_RADIUS) / length, middle @ frame[:, 1] / radius
    return (2 * here * outward * coefficients[0] + here**2 * coefficients[2]) / length


def _hinges(mesh: Mesh) -> _Plate:
    annulus = _Annulus.of(mesh)
    row, column, value, weight = [], [], [], []
    for edge, faces in enumerate(annulus.adjacent()):
        if len(faces) == 1 and not annulus.held[edge]:
            continue  # the rim
        along, length = annulus.along(edge)
        for side, face in enumerate(faces):
            for node, slope in zip(annulus.faces[face], annulus.gradient(face) @ _normal(along), strict=True):
                row.append(len(weight))
                column.append(node)
                value.append(slope if side == 0 else -slope)
        weight.append(length**2 / annulus.area[faces].sum())
    angles = sparse.csr_array((value, (row, column)), shape=(len(weight), len(annulus.points)))[:, annulus.free]
    stiffness = sparse.csr_array(angles.T @ sparse.diags_array(weight) @ angles)
    nothing = sparse.csr_array((0, len(annulus.free)))
    return _Plate(nothing, np.zeros(0), annulus.load()[annulus.free], annulus.at_rim(), stiffness)


def _loop(mesh: Mesh) -> _Plate:
    """Law `plate`'s points with curvatures as the subdivision surface has them."""
    fixed = np.hypot(*mesh.material.T) <= PLATE_RADIUS + _ON_EDGE
    control = control_mesh(mesh, fixed, PLATE_RADIUS)
    _, rows, _ = midpoint_rows(control, outside_edges(mesh, control.outside).ends)
    own = rows.extended(control.extension)
    return _of_shell(mesh, own.nodes, own.weights)


def _corrected_loop(mesh: Mesh) -> _Plate:
    return _of_shell(mesh, None, None)


def _of_shell(mesh: Mesh, nodes: ndarray | None, weights: ndarray | None) -> _Plate:
    fixed = np.hypot(*mesh.material.T) <= PLATE_RADIUS + _ON_EDGE
    stencils = shell_stencils(mesh, fixed, PLATE_RADIUS)
    nodes = stencils.edge_nodes if nodes is None else nodes
    weights = stencils.edge_weights if weights is None else weights
    edges, width = nodes.shape
    row = np.broadcast_to(3 * np.arange(edges)[:, None, None] + np.arange(3)[None, :, None], (edges, 3, width))
    column = np.broadcast_to(nodes[:, None, :], (edges, 3, width))
    rows = sparse.csr_array(
        (weights[:, 2:].ravel(), (row.ravel(), column.ravel())), shape=(3 * edges, len(stencils.free))
    )
    rim = stencils.surface[np.hypot(*mesh.material.T) > CLOTH_RADIUS - _ON_EDGE]
    return _Plate(rows, stencils.edge_area, stencils.load @ mesh.vertex_areas, sparse.csr_array(rim))


ELEMENTS: Mapping[str, Callable[[Mesh], _Plate]] = {
    "hinges": _hinges,
    "averaged normals": _averaged,
    "edge unknowns": _edge_unknowns,
    "fitted slopes": _fitted,
    "Loop surface": _loop,
    "corrected Loop surface": _corrected_loop,
}
"""Discretisations by name."""
