"""The control mesh of the cloth outside the plate, extended across the clamp and across the rim.

The mid-surface is the limit of Loop's subdivision. Its boundary conditions are those of the control points beyond:

- clamp: the faces that touch the plate's edge are mirrored in it (r -> 2 R - r), the images move as their originals
  (an even displacement has no slope across the edge), and the control points on the edge move against their outer
  neighbours so that the limit surface stays where it is;
- free rim: one control point beyond every rim edge, a + b - c with the edge's ends a, b and the face's third vertex c,
  and a face between the control points of consecutive rim edges.

The control points' material places are such that the limit surface of the flat cloth carries every mesh vertex at its
own material point.

References:
    C. Loop. Smooth subdivision surfaces based on triangles. Master's thesis, University of Utah (1987).
    F. Cirak, M. Ortiz, P. Schroeder. Subdivision surfaces: a new paradigm for thin-shell finite-element analysis.
    International Journal for Numerical Methods in Engineering 47 (2000), Sections 3.3 and 3.6.
    F. Cirak, M. Ortiz. Fully C1-conforming subdivision elements for finite deformation thin-shell analysis.
    International Journal for Numerical Methods in Engineering 51 (2001).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.shell.padded import entries

_CLAMP_TOLERANCE = 0.02  # mean edges; how far a vertex of the clamp may lie from the plate's circle
_RELAXATION = 1.3  # of the fixed-point iteration for control points; the masks' eigenvalues lie in [0.2, 1]
_SWEEPS = 300
_RELATIVE_TOLERANCE = 1e-13


@dataclass(frozen=True, eq=False)
class ControlMesh:
    """Control points: the mesh's vertices, then mirror images, then one control point a rim edge.

    Attributes:
        mesh: The cloth.
        outside: The mesh's faces outside the plate (with at least one free vertex).
        free: Vertices that carry unknowns, ascending.
        clamp: Fixed vertices of the faces outside, ascending.
        faces: Faces of the extended control mesh; the first are those of `outside`, in their order.
        material: Material places of the control points [m].
        neighbours: Which control points share an edge; shape (controls, controls), ones.
        limit: Limit positions of the mesh's vertices by control points; rows inside the plate are empty.
        extension: Displacements of the control points by those of the free vertices; shape (controls, free).
    """

    mesh: Mesh
    outside: Int[ndarray, "outside"]
    free: Int[ndarray, "free"]
    clamp: Int[ndarray, "clamp"]
    faces: Int[ndarray, "all_faces 3"]
    material: Float[ndarray, "controls 2"]
    neighbours: sparse.csr_array
    limit: sparse.csr_array
    extension: sparse.csr_array

    @property
    def controls(self) -> int:
        """Number of control points."""
        return len(self.material)

    @cached_property
    def vertices_outside(self) -> Int[ndarray, "vertices_outside"]:
        """Free vertices and those on the clamp, ascending."""
        return np.sort(np.concatenate([self.free, self.clamp]))

    @cached_property
    def valence(self) -> Int[ndarray, "controls"]:
        """Number of neighbours of every control point."""
        return np.diff(self.neighbours.indptr)

    @cached_property
    def quadratics(self) -> Float[ndarray, "controls 3"]:
        """Control values of x x, x y and y y [m2]: their limit has the right value at every vertex outside.

        Beyond the clamp and the rim the control points are as far from the function as their neighbours on average.
        """
        vertices = self.mesh.vertices
        seen = np.zeros(self.controls)
        seen[self.vertices_outside] = 1
        average = self.neighbours[vertices:] * seen[None, :]
        average = sparse.csr_array(average / average.sum(1)[:, None])[:, :vertices]
        target, values = _products(self.mesh.material), _products(self.material)
        ghosts = values[vertices:].copy()

        def extended(values: ndarray) -> None:
            offset = _products(self.material[:vertices]) - values[:vertices]
            values[vertices:] = ghosts - average @ offset

        return _interpolating(self.limit, values, target, self.vertices_outside, extended)

    @cached_property
    def _sides(self) -> tuple[ndarray, ndarray]:
        """Keys of the directed sides, ascending, and the vertex opposite to each."""
        sides = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]])
        opposite = np.concatenate([self.faces[:, 2], self.faces[:, 0], self.faces[:, 1]])
        keys = sides[:, 0] * self.controls + sides[:, 1]
        order = np.argsort(keys, kind="stable")
        return keys[order], opposite[order]

    def opposite(self, start: Int[ndarray, "sides"], end: Int[ndarray, "sides"]) -> Int[ndarray, "sides"]:
        """Third vertices of the faces that hold directed sides.

        Args:
            start, end: Ends of the sides, which must exist.

        Returns:
            The control points opposite.
        """
        keys, opposite = self._sides
        return opposite[np.searchsorted(keys, start * self.controls + end)]


def loop_beta(valence: Int[ndarray, "points"]) -> Float[ndarray, "points"]:
    """Weight of every neighbour in Loop's rule for an old vertex (Loop 1987, Section 3).

    Args:
        valence: Number of neighbours n.

    Returns:
        (5/8 - (3/8 + cos(2 pi / n) / 4)^2) / n.
    """
    return (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / valence)) ** 2) / valence


def limit_weight(valence: Int[ndarray, "points"]) -> Float[ndarray, "points"]:
    """Weight of every neighbour in the limit position of a vertex.

    Args:
        valence: Number of neighbours n.

    Returns:
        1 / (n + 3 / (8 beta)); the vertex itself has what is left to one.
    """
    return 1 / (valence + 0.375 / loop_beta(valence))


def control_mesh(mesh: Mesh, fixed: Bool[ndarray, "vertices"], plate_radius: float) -> ControlMesh:
    """Extends the part of a mesh outside the plate to a control mesh of a clamped plate with a free rim.

    Args:
        mesh: The cloth about the plate's axis, with a ring of vertices on the plate's edge.
        fixed: Vertices that lie on the plate or its edge.
        plate_radius: Radius of the plate [m].

    Returns:
        The control mesh.

    Raises:
        SimulationError: Seams, no free vertex, no ring of vertices on the plate's edge, or the rim comes to the plate.
    """
    if mesh.pattern is not None:
        raise SimulationError("law plate needs cloth of one piece, but the mesh has a pattern (seams); use law paper")
    free = np.flatnonzero(~fixed)
    if not len(free):
        raise SimulationError("all vertices of the cloth are fixed; take a smaller plate or a larger cloth")
    outside = np.flatnonzero(~fixed[mesh.faces].all(1))
    faces = mesh.faces[outside]
    on_clamp = np.zeros(mesh.vertices, bool)
    on_clamp[faces] = True
    on_clamp &= fixed
    clamp = np.flatnonzero(on_clamp)
    _check_clamp(mesh, faces, clamp, plate_radius)
    mirrored, originals = _mirrored(faces, on_clamp, mesh.vertices)
    rim = _rim(faces, on_clamp)
    first_ghost = mesh.vertices + len(originals)
    controls = first_ghost + len(rim)
    extended = np.concatenate([faces, mirrored, _rim_faces(rim, first_ghost)])
    neighbours = _neighbours(extended, controls)
    used = np.sort(np.concatenate([free, clamp]))
    _check_fans(extended, neighbours, used)
    limit = _limit(neighbours, used, mesh.vertices)
    material = _material(mesh, limit, used, originals, rim, plate_radius)
    extension = _extension(neighbours, free, clamp, originals, rim)
    return ControlMesh(mesh, outside, free, clamp, extended, material, neighbours, limit, extension)


def _open_sides(faces: ndarray) -> tuple[ndarray, ndarray]:
    """Directed sides without a face on the other side, and the vertex opposite to each."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    count = int(faces.max()) + 1
    alone = ~np.isin(sides[:, 0] * count + sides[:, 1], sides[:, 1] * count + sides[:, 0])
    return sides[alone], opposite[alone]


def _check_clamp(mesh: Mesh, faces: ndarray, clamp: ndarray, plate_radius: float) -> None:
    remedy = "use disc_mesh, ring_mesh, or conformed(mesh, plate_radius)"
    rule = "law plate needs a closed ring of vertices on the plate's edge"
    if not len(clamp):
        raise SimulationError(f"{rule}, but no fixed vertex touches the free cloth; {remedy}")
    edge = np.linalg.norm(np.diff(mesh.material[mesh.edges], axis=1), axis=2).mean()
    gap = np.abs(np.hypot(*mesh.material[clamp].T) - plate_radius)
    worst = int(np.argmax(gap))
    if gap[worst] > _CLAMP_TOLERANCE * edge:
        raise SimulationError(
            f"{rule} of radius {plate_radius:g} m, but vertex {clamp[worst]} is {1e3 * gap[worst]:.3g} mm off "
            f"(more than {_CLAMP_TOLERANCE:.0%} of the mean edge, {1e3 * edge:.3g} mm); {remedy}"
        )
    sides, _ = _open_sides(faces)
    mixed = np.isin(sides, clamp).sum(1) == 1
    if mixed.any():
        vertex = int(np.intersect1d(sides[mixed], clamp)[0])
        raise SimulationError(f"the rim of the cloth meets the plate's edge at vertex {vertex}; take a smaller plate")
    ring = sides[np.isin(sides, clamp).all(1)]
    if any(not np.array_equal(np.sort(ring[:, end]), clamp) for end in (0, 1)):
        raise SimulationError(f"{rule}, but the edges between its {len(clamp)} vertices are no closed ring; {remedy}")


def _mirrored(faces: ndarray, on_clamp: ndarray, vertices: int) -> tuple[ndarray, ndarray]:
    """Mirror images of the faces at the clamp, and the vertices whose images they need."""
    touching = faces[on_clamp[faces].any(1)]
    originals = np.unique(touching[~on_clamp[touching]])
    image = np.where(on_clamp, np.arange(len(on_clamp)), -1)
    image[originals] = vertices + np.arange(len(originals))
    return image[touching][:, ::-1], originals


def _rim(faces: ndarray, on_clamp: ndarray) -> ndarray:
    """Rim edges with the third vertex of their face, (a, b, c)."""
    sides, opposite = _open_sides(faces)
    rim = ~on_clamp[sides].all(1)
    found = np.column_stack([sides[rim], opposite[rim]])
    if len(np.unique(found[:, 0])) < len(found):
        raise SimulationError("the rim of the cloth meets itself in a vertex; mend the mesh (no bow ties)")
    return found[np.argsort(found[:, 0])]


def _rim_faces(rim: ndarray, first: int) -> ndarray:
    """Faces between the rim's edges and their control points beyond, and between consecutive ones of these."""
    ghost = first + np.arange(len(rim))
    before = np.empty(len(rim), np.int64)  # the edge that ends where an edge starts
    before[np.searchsorted(rim[:, 0], rim[:, 1])] = ghost
    beyond = np.column_stack([rim[:, 1], rim[:, 0], ghost])
    fans = np.column_stack([rim[:, 0], before, ghost])
    return np.concatenate([beyond, fans])


def _neighbours(faces: ndarray, controls: int) -> sparse.csr_array:
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keys = np.unique(np.concatenate([start * controls + end, end * controls + start]))
    row, column = np.divmod(keys, controls)
    starts = np.append(0, np.cumsum(np.bincount(row, minlength=controls)))
    return sparse.csr_array((np.ones(len(keys)), column, starts), shape=(controls, controls))


def _check_fans(faces: ndarray, neighbours: sparse.csr_array, used: ndarray) -> None:
    """Every vertex outside must have as many faces as neighbours, each directed side one face."""
    valence = np.diff(neighbours.indptr)
    around = np.bincount(faces.ravel(), minlength=len(valence))
    sides = faces.ravel() * len(valence) + np.roll(faces, -1, axis=1).ravel()
    odd = used[around[used] != valence[used]]
    if len(odd) or len(np.unique(sides)) < len(sides):
        where = f"vertex {odd[0]}" if len(odd) else "an edge between vertices of the plate's edge"
        raise SimulationError(
            f"the faces outside the plate and their mirror images are no manifold at {where}; "
            "mend the mesh at the plate's edge, or use disc_mesh or ring_mesh"
        )


def _limit(neighbours: sparse.csr_array, used: ndarray, vertices: int) -> sparse.csr_array:
    row, column = entries(sparse.csr_array(neighbours[used]))
    valence = np.diff(neighbours.indptr)
    weight = limit_weight(valence[used])
    values = np.concatenate([weight[row], 1 - valence[used] * weight])
    place = (np.concatenate([used[row], used]), np.concatenate([column, used]))
    return sparse.csr_array((values, place), shape=(vertices, len(valence)))


def _interpolating(limit: sparse.csr_array, values: ndarray, target: ndarray, used: ndarray, extended) -> ndarray:
    """Control values whose limit at the used vertices is the target; `extended` sets those beyond the mesh."""
    rows, goal = limit[used], target[used]
    tolerance = _RELATIVE_TOLERANCE * np.abs(goal).max()
    for _ in range(_SWEEPS):
        extended(values)
        error = goal - rows @ values
        if np.abs(error).max() <= tolerance:
            return values
        values[used] += _RELAXATION * error
    raise SimulationError(
        "no control points give a limit surface through the mesh's vertices; "
        "its triangles are too distorted: use disc_mesh or ring_mesh"
    )


def _material(
    mesh: Mesh, limit: sparse.csr_array, used: ndarray, originals: ndarray, rim: ndarray, plate_radius: float
) -> ndarray:
    images = slice(mesh.vertices, mesh.vertices + len(originals))
    material = np.zeros((images.stop + len(rim), 2))
    material[: mesh.vertices] = mesh.material

    def extended(material: ndarray) -> None:
        distance = np.hypot(*material[originals].T)
        material[images] = material[originals] * ((2 * plate_radius - distance) / distance)[:, None]
        material[images.stop :] = material[rim[:, 0]] + material[rim[:, 1]] - material[rim[:, 2]]

    return _interpolating(limit, material, mesh.material, used, extended)


def _extension(
    neighbours: sparse.csr_array, free: ndarray, clamp: ndarray, originals: ndarray, rim: ndarray
) -> sparse.csr_array:
    """Displacements of all control points by those of the free vertices.

    A clamp vertex with k outer neighbours of limit weight w moves by -2 w / (1 - 2 k w) times their sum: with the
    images, and clamp vertices beside it that move alike, its limit displacement is zero.
    """
    valence = np.diff(neighbours.indptr)
    vertices = len(valence) - len(originals) - len(rim)
    column = np.full(vertices, -1)
    column[free] = np.arange(len(free))
    row, outer = entries(sparse.csr_array(neighbours[clamp][:, free]))
    weight = limit_weight(valence[clamp])
    share = -2 * weight / (1 - 2 * weight * np.bincount(row, minlength=len(clamp)))
    image = vertices + np.arange(len(originals))
    inner = sparse.csr_array(
        (
            np.concatenate([np.ones(len(free) + len(originals)), share[row]]),
            (
                np.concatenate([free, image, clamp[row]]),
                np.concatenate([np.arange(len(free)), column[originals], outer]),
            ),
        ),
        shape=(vertices + len(originals), len(free)),
    )
    beyond = inner[rim[:, 0]] + inner[rim[:, 1]] - inner[rim[:, 2]]
    return sparse.csr_array(sparse.vstack([inner, beyond], format="csr"))


def _products(points: ndarray) -> ndarray:
    x, y = points.T
    return np.column_stack([x * x, x * y, y * y])
