"""The mechanical system of a drape under law `plate`: a shell whose unknowns are the control points of its surface.

It offers what `DrapeSystem` offers to drops, descents and adjoints; its configurations are positions of control points
(`ShellUnknowns` turns them into points of the cloth and back), and its parameters those of its quadrature points.
Fixed vertices lie on the plate, which is flat and may slope: their positions say where it is.
"""

import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine import shell_kernels
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear.interface import BlockPattern, LinearSolver, solver
from cusick_bench.sim.shell.stencils import ShellStencils, shell_stencils
from cusick_bench.sim.threads import check_fork, thread_pool

EDGE_SHARE = 0.002
"""Share of the membrane energy at the edges. Measured on the reference drapes: it matters where folds are hardly wider
than the mesh (ln_bending -6.6, 1205 vertices: .001 to .007 change the drape coefficient by .5 points), not elsewhere."""


@dataclass(frozen=True, eq=False)
class ShellLayout:
    """Sparsity of the free control points, and what adds up where; names are those of `BlockLayout`.

    Attributes:
        indptr: Row pointers of the full symmetric block pattern (CSR).
        indices: Column of every slot, sorted within a row.
        diagonal: Slot of every diagonal block.
        contribution_ptr: Start of every slot's contributions.
        contributions: 2 b + t for block b of the points, transposed where t = 1.
        first_node, first_block: Where every point's vectors and blocks begin, edges first.
        row_ptr, row_vectors: Vectors of the points that belong to every row.
    """

    indptr: Int[ndarray, "rows_plus_one"]
    indices: Int[ndarray, "slots"]
    diagonal: Int[ndarray, "rows"]
    contribution_ptr: Int[ndarray, "slots_plus_one"]
    contributions: Int[ndarray, "contributions"]
    first_node: Int[ndarray, "points"]
    first_block: Int[ndarray, "points"]
    row_ptr: Int[ndarray, "rows_plus_one"]
    row_vectors: Int[ndarray, "vectors"]


def _starts(counts: ndarray) -> ndarray:
    return np.concatenate([[0], np.cumsum(counts)])


def shell_layout(stencils: ShellStencils) -> ShellLayout:
    """Lays out the block matrix of a shell.

    Args:
        stencils: Its quadrature points.

    Returns:
        The pattern, and where every point's blocks and vectors go.
    """
    rows = len(stencils.free)
    first, second, vectors = [], [], []
    for nodes, counts in ((stencils.edge_nodes, stencils.edge_counts), (stencils.vertex_nodes, stencils.vertex_counts)):
        width = nodes.shape[1]
        i, j = np.triu_indices(width)
        kept = j[None, :] < counts[:, None]
        first.append(np.broadcast_to(nodes[:, i], kept.shape)[kept])
        second.append(np.broadcast_to(nodes[:, j], kept.shape)[kept])
        vectors.append(nodes[np.arange(width)[None, :] < counts[:, None]])
    a, b, owner = np.concatenate(first), np.concatenate(second), np.concatenate(vectors)
    counts = np.concatenate([stencils.edge_counts, stencils.vertex_counts])
    block, across = np.arange(len(a)), a != b
    row, column = np.concatenate([a, b[across]]), np.concatenate([b, a[across]])
    term = np.concatenate([2 * block, 2 * block[across] + 1])
    unique, slot = np.unique(row * rows + column, return_inverse=True)
    order, by_row = np.argsort(slot, kind="stable"), np.argsort(owner, kind="stable")
    slot_row, slot_column = np.divmod(unique, rows)
    return ShellLayout(
        indptr=np.searchsorted(slot_row, np.arange(rows + 1)),
        indices=slot_column,
        diagonal=np.flatnonzero(slot_row == slot_column),
        contribution_ptr=np.searchsorted(slot[order], np.arange(len(unique) + 1)),
        contributions=term[order],
        first_node=_starts(counts)[:-1],
        first_block=_starts(counts * (counts + 1) // 2)[:-1],
        row_ptr=np.searchsorted(owner[by_row], np.arange(rows + 1)),
        row_vectors=by_row,
    )


@dataclass(frozen=True, eq=False)
class _Needed:
    """Contributions of the slots that the linear solver reads."""

    slots: ndarray
    vertex: ndarray
    start: ndarray
    terms: ndarray


@dataclass(frozen=True, eq=False)
class _Buffers:
    """What the kernels return of every point, used again from evaluation to evaluation."""

    energy: Float[ndarray, "members points"]
    vector: Float[ndarray, "members nodes 3"]
    blocks: Float[ndarray, "members pairs 9"]


@dataclass(frozen=True, eq=False)
class ShellSystem:
    """A cloth clamped on its plate, under law `plate`.

    Attributes:
        mesh: The cloth; its vertices name the control points.
        gravity: Acceleration along -z [m/s2].
        fixed: Vertices on the plate, which never move.
        plate_radius: [m].
        backend: Linear solver, see `cusick_bench.sim.linear.interface.solver`.
        stencils: Its quadrature points; made from the mesh by default.
    """

    mesh: Mesh
    gravity: float
    fixed: Bool[ndarray, "vertices"]
    plate_radius: float
    backend: str = "auto"
    stencils: ShellStencils = field(init=False, repr=False)

    law = "plate"

    def __post_init__(self) -> None:
        thread_pool()
        if self.fixed.all():
            raise SimulationError("every vertex is fixed: nothing can drape; is the plate larger than the cloth?")
        object.__setattr__(self, "stencils", shell_stencils(self.mesh, self.fixed, self.plate_radius))

    def require_energy(self, what: str) -> None:
        """Checks that the forces derive from an energy, as those of a shell do."""

    def with_mesh(self, mesh: Mesh) -> "ShellSystem":
        """This system with its material points elsewhere; it shares the analysis of this one where it can.

        Args:
            mesh: The same faces over other material points.

        Returns:
            A system of the given mesh.

        Raises:
            SimulationError: Other faces.
        """
        if not np.array_equal(mesh.faces, self.mesh.faces):
            raise SimulationError("an analysis is shared by meshes of the same faces only; make a new system")
        stencils = shell_stencils(mesh, self.fixed, self.plate_radius)
        same = all(
            np.array_equal(getattr(stencils, name), getattr(self.stencils, name))
            for name in ("edge_nodes", "edge_counts", "vertex_nodes", "vertex_counts")
        )
        if not same:
            return ShellSystem(mesh, self.gravity, self.fixed, self.plate_radius, self.backend)
        _ = self.linear, self._needed, self._buffers
        other = copy.copy(self)
        for name in ("_plate_frame", "_plate_row"):
            other.__dict__.pop(name, None)
        object.__setattr__(other, "mesh", mesh)
        object.__setattr__(other, "stencils", stencils)
        return other

    @property
    def free(self) -> Int[ndarray, "rows"]:
        """Vertices whose control points move."""
        return self.stencils.free

    @cached_property
    def spring(self) -> Float[ndarray, "vertices"]:
        """No vertex is held by a spring [N/m]."""
        return np.zeros(self.mesh.vertices)

    @property
    def sprung(self) -> bool:
        """Whether any vertex is held by a spring."""
        return False

    @property
    def edges(self) -> int:
        """Number of edge points, which come before the vertex points."""
        return len(self.stencils.edge_area)

    @property
    def points(self) -> int:
        """Number of quadrature points."""
        return self.edges + len(self.stencils.vertex_area)

    @cached_property
    def layout(self) -> ShellLayout:
        """Where the points' blocks go in the matrix of the free control points."""
        return shell_layout(self.stencils)

    @cached_property
    def linear(self) -> LinearSolver:
        """The analysed linear solver of the free control points."""
        pattern = BlockPattern(self.layout.indptr, self.layout.indices, self.stencils.control_material)
        return solver(pattern, self.backend)

    @cached_property
    def _needed(self) -> _Needed:
        layout, needed = self.layout, self.linear.needed_slots
        counts = np.diff(layout.contribution_ptr)[needed]
        start = _starts(counts)
        shift = np.repeat(layout.contribution_ptr[needed] - start[:-1], counts)
        vertex = np.full(len(layout.indices), -1)
        vertex[layout.diagonal] = self.free
        return _Needed(needed, vertex[needed], start, layout.contributions[np.arange(start[-1]) + shift])

    @cached_property
    def _buffers(self) -> dict[int, _Buffers]:
        return {}

    def _work(self, members: int) -> _Buffers:
        """Buffers of as many members, those of the last evaluation where they fit."""
        if members not in self._buffers:
            self._buffers.clear()
            counts = np.concatenate([self.stencils.edge_counts, self.stencils.vertex_counts])
            self._buffers[members] = _Buffers(
                np.zeros((members, self.points)), np.zeros((members, counts.sum(), 3)),
                np.zeros((members, (counts * (counts + 1) // 2).sum(), 9)),
            )  # fmt: skip
        return self._buffers[members]

    @cached_property
    def _plate_frame(self) -> Float[ndarray, "3 fixed"]:
        """Least squares from the positions of the fixed vertices to x_,1, x_,2 and the origin of the plate's plane."""
        at = self.mesh.material[self.fixed]
        return np.linalg.pinv(np.column_stack([at, np.ones(len(at))]))

    @cached_property
    def _plate_row(self) -> Float[ndarray, "rows 3"]:
        """Weights of x_,1, x_,2 and the origin in the control points of the undeformed cloth."""
        at = self.stencils.control_material
        return np.column_stack([at, np.ones(len(at))])

    def frame(self, x: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members 3 3"]:
        """Where the plate is: x_,1 and x_,2 of the undeformed cloth on it, and its material origin.

        Args:
            x: Positions; those of the fixed vertices count [m].

        Returns:
            Rows x_,1, x_,2 and origin [m].
        """
        return self._plate_frame @ x[:, self.fixed]

    def displacement(self, x: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members rows 3"]:
        """Displacements of the free control points from the undeformed cloth on the plate [m].

        Args:
            x: Positions of control points and fixed vertices [m].

        Returns:
            Displacements.
        """
        return np.ascontiguousarray(x[:, self.free] - self._plate_row @ self.frame(x))

    def evaluate(
        self, x: Float[ndarray, "members vertices 3"], anchor: Float[ndarray, "members vertices 3"], p: Parameters,
        *, exact: bool, everywhere: bool = False,
    ) -> "ShellEvaluation":  # fmt: skip
        """Evaluates the quadrature points at the configurations of a batch.

        Args:
            x: Positions of control points and fixed vertices [m].
            anchor: Not used; there are no springs.
            p: A batch of cloths, by quadrature points (see `ShellUnknowns.parameters`).
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.
            everywhere: Not used: forces on fixed vertices are zero.

        Returns:
            Forces, energy and matrix on demand; valid until the next evaluation.
        """
        check_fork()
        s, work, layout, edges = self.stencils, self._work(len(x)), self.layout, self.edges
        base = np.ascontiguousarray(self.frame(x)[:, :2])
        u = self.displacement(x)
        shell_kernels.edge_stiffness(
            exact, s.edge_nodes, s.edge_counts, s.edge_weights, s.edge_area, EDGE_SHARE, layout.first_node[:edges],
            layout.first_block[:edges], base, u, p.stretch, p.bending, _curvatures(p.rest_angle), p.poisson,
            work.energy, work.vector, work.blocks,
        )  # fmt: skip
        shell_kernels.vertex_stiffness(
            exact, s.vertex_nodes, s.vertex_counts, s.vertex_weights, s.vertex_area, 1.0 - EDGE_SHARE,
            layout.first_node[edges:], layout.first_block[edges:], base, u, p.stretch, edges,
            work.energy, work.vector, work.blocks,
        )  # fmt: skip
        return ShellEvaluation(self, work, x, p, exact)

    def curvature(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "edges 3"]:
        """Curvatures (k11, k22, 2 k12) of one cloth at the edges [1/m].

        Args:
            x: Positions of control points and fixed vertices [m].

        Returns:
            Curvatures, negative where the cloth is convex seen from its face.
        """
        s, found = self.stencils, np.empty((1, self.edges, 3))
        base = np.ascontiguousarray(self.frame(x[None])[:, :2])
        shell_kernels.shell_curvatures(
            s.edge_nodes, s.edge_counts, s.edge_weights, base, self.displacement(x[None]), found
        )
        return found[0]

    def zero_gradient(self, *members: int) -> ParameterGradient:
        """A gradient to add to.

        Args:
            *members: Number of cloths, for a batch.

        Returns:
            Zeros for every point and vertex.
        """
        shapes = ((self.points, 6, 4), (self.edges, 3, 5), (self.mesh.vertices,), (3 * self.edges,), ())
        return ParameterGradient(*(np.zeros((*members, *shape)) for shape in shapes))

    def add_diagonal(
        self, blocks: Float[ndarray, "*members slots 3 3"], amount: Float[ndarray, "*members vertices"]
    ) -> None:
        """Adds amount[i] times the identity to the diagonal block of every free vertex, in place.

        Args:
            blocks: Blocks in the layout's slots [N/m]; changed.
            amount: A number for every vertex [N/m].
        """
        for axis in range(3):
            blocks[..., self.layout.diagonal, axis, axis] += amount[..., self.free]

    def adjoint(
        self,
        x: Float[ndarray, "*members vertices 3"],
        multiplier: Float[ndarray, "*members vertices 3"],
        velocity: Float[ndarray, "*members vertices 3"],
        p: Parameters,
        gradient: ParameterGradient,
        *,
        force_factor: float,
        stiffness_factor: float,
    ) -> tuple[Float[ndarray, "*members vertices 3"], Float[ndarray, "*members vertices 3"]]:
        """Derivatives of S = force_factor * lambda . F - stiffness_factor * lambda . K v at fixed lambda and v.

        Args:
            x: Positions of control points and fixed vertices [m], of one cloth or of a batch.
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: One cloth or a batch, as `x`.
            gradient: dS/d(parameters) is added to it, of the mass only gravity's part.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the Gauss-Newton stiffness.

        Returns:
            dS/dx, and zeros for the anchors.
        """
        if x.ndim == 2:
            by_x, pull = self.adjoint(
                x[None], multiplier[None], velocity[None], p.batch(), gradient.batch(),
                force_factor=force_factor, stiffness_factor=stiffness_factor,
            )  # fmt: skip
            return by_x[0], pull[0]
        s, work, layout, edges, free = self.stencils, self._work(len(x)), self.layout, self.edges, self.free
        base = np.ascontiguousarray(self.frame(x)[:, :2])
        u, along, across = self.displacement(x), multiplier[:, free], velocity[:, free]
        g_base, g_poisson = np.empty((len(x), self.points, 2, 3)), np.empty((len(x), edges))
        shell_kernels.edge_adjoint(
            force_factor, stiffness_factor, s.edge_nodes, s.edge_counts, s.edge_weights, s.edge_area, EDGE_SHARE,
            layout.first_node[:edges], base, u, along, across, p.stretch, p.bending, _curvatures(p.rest_angle),
            p.poisson, work.vector, g_base, gradient.stretch, gradient.bending, _curvatures(gradient.rest_angle),
            g_poisson,
        )  # fmt: skip
        shell_kernels.vertex_adjoint(
            force_factor, stiffness_factor, s.vertex_nodes, s.vertex_counts, s.vertex_weights, s.vertex_area,
            1.0 - EDGE_SHARE, layout.first_node[edges:], base, u, along, across, p.stretch, edges, work.vector, g_base,
            gradient.stretch,
        )  # fmt: skip
        gradient.poisson[...] += g_poisson.sum(1)
        gradient.mass[:] -= force_factor * self.gravity * multiplier[..., 2]
        by_u = self.gather(work.vector)
        by_x = np.zeros_like(x)
        by_x[:, free] = by_u
        by_frame = -(self._plate_row.T @ by_u)
        by_frame[:, :2] += g_base.sum(1)
        by_x[:, self.fixed] = self._plate_frame.T @ by_frame
        return by_x, np.zeros_like(x)

    def gather(self, vectors: Float[ndarray, "members nodes 3"]) -> Float[ndarray, "members rows 3"]:
        """Sums the points' vectors at the free control points.

        Args:
            vectors: Vectors of all nodes of all points.

        Returns:
            Sums.
        """
        found = np.empty((len(vectors), len(self.free), 3))
        shell_kernels.gather_vectors(self.layout.row_ptr, self.layout.row_vectors, vectors, found)
        return found


def _curvatures(rest: Float[ndarray, "members triples"]) -> Float[ndarray, "members edges 3"]:
    return rest.reshape(len(rest), -1, 3)


@dataclass(frozen=True, eq=False)
class ShellEvaluation:
    """All quadrature points of a batch, evaluated; sums are made on demand. Valid until the next evaluation."""

    system: ShellSystem
    work: _Buffers
    x: Float[ndarray, "members vertices 3"]
    p: Parameters
    exact: bool

    def force(self) -> Float[ndarray, "members vertices 3"]:
        """Net forces on the control points: shell and gravity [N]; zero at fixed vertices."""
        system = self.system
        force = np.zeros_like(self.x)
        force[:, system.free] = system.gather(self.work.vector)
        force[:, system.free, 2] -= system.gravity * self.p.mass[:, system.free]
        return force

    def energy(self) -> Float[ndarray, "members"]:
        """Potential energies [J]."""
        free = self.system.free
        height = (self.p.mass[:, free] * self.x[:, free, 2]).sum(1)
        return self.work.energy.sum(1) + self.system.gravity * height

    def matrix(
        self,
        *,
        scale: float = 1.0,
        diagonal: Float[ndarray, "members vertices"],
        out: Float[ndarray, "members slots 3 3"] | None = None,
    ) -> Float[ndarray, "members slots 3 3"]:
        """scale * K + diagonal, K the shell's stiffness, in the layout's slots; filled where the solver reads.

        Args:
            scale: Factor of the stiffness.
            diagonal: Added to the diagonal of every vertex.
            out: Used again where given.

        Returns:
            The blocks, in `out` where given.
        """
        system, needed = self.system, self.system._needed
        blocks = np.zeros((len(self.x), len(system.layout.indices), 3, 3)) if out is None else out
        shell_kernels.gather_blocks(
            needed.slots, needed.vertex, needed.start, needed.terms, scale,
            np.broadcast_to(diagonal, (len(self.x), system.mesh.vertices)), self.work.blocks, blocks,
        )  # fmt: skip
        return blocks
