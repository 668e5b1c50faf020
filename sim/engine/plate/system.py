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
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.plate import adjoint_kernels, kernels
from cusick_bench.sim.engine.plate.layout import MatrixTerms, PointNodes, ShellLayout, shell_layout
from cusick_bench.sim.engine.plate.placement import Placement
from cusick_bench.sim.engine.plate.workspace import Workspace
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear.interface import BlockPattern, LinearSolver, solver
from cusick_bench.sim.shell.grain import along_grain
from cusick_bench.sim.shell.stencils import ShellStencils, shell_stencils
from cusick_bench.sim.threads import check_fork, thread_pool

EDGE_SHARE = 0.002
"""Share of the membrane energy at the edges. Measured on the reference drapes: it matters where folds are hardly wider
than the mesh (ln_bending -6.6, 1205 vertices: .001 to .007 change the drape coefficient by .5 points), not elsewhere.
"""


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
        sheet: The mesh in the directions of its grain, in which strains and curvatures are taken.
        rest_shear: Shear x_,1 . x_,2 at which the quadrature points are free of shear stress.
    """

    mesh: Mesh
    gravity: float
    fixed: Bool[ndarray, "vertices"]
    plate_radius: float
    backend: str = "auto"
    stencils: ShellStencils = field(init=False, repr=False)
    sheet: Mesh = field(init=False, repr=False)
    rest_shear: Float[ndarray, "points"] = field(init=False, repr=False)

    law = "plate"

    def __post_init__(self) -> None:
        thread_pool()
        if self.fixed.all():
            raise SimulationError("every vertex is fixed: nothing can drape; is the plate larger than the cloth?")
        object.__setattr__(self, "sheet", along_grain(self.mesh))
        object.__setattr__(self, "stencils", shell_stencils(self.sheet, self.fixed, self.plate_radius))
        object.__setattr__(self, "rest_shear", np.zeros(self.points))

    def require_energy(self, what: str) -> None:
        """Checks that the forces derive from an energy, as those of a shell do."""

    def with_mesh(self, mesh: Mesh) -> "ShellSystem":
        """A copy of the system with other material points; it shares the analysis of this one where it can.

        Args:
            mesh: The same faces over other material points.

        Returns:
            A system of the given mesh.

        Raises:
            SimulationError: Other faces.
        """
        if not np.array_equal(mesh.faces, self.mesh.faces):
            raise SimulationError("an analysis is shared by meshes of the same faces only; make a new system")
        sheet = along_grain(mesh)
        stencils = shell_stencils(sheet, self.fixed, self.plate_radius)
        same = all(
            np.array_equal(getattr(stencils, name), getattr(self.stencils, name))
            for name in ("edge_nodes", "edge_counts", "vertex_nodes", "vertex_counts")
        )
        if not same:
            return ShellSystem(mesh, self.gravity, self.fixed, self.plate_radius, self.backend)
        _ = self.linear, self._terms, self._buffers
        other = copy.copy(self)
        for name in ("placement", "nodes"):
            other.__dict__.pop(name, None)
        object.__setattr__(other, "mesh", mesh)
        object.__setattr__(other, "sheet", sheet)
        object.__setattr__(other, "stencils", stencils)
        return other

    def with_rest_shear(self, rest: Float[ndarray, "points"]) -> "ShellSystem":
        """A copy of the system with other points free of shear stress; it shares the analysis of this one.

        Args:
            rest: x_,1 . x_,2 without shear stress, edges first. Adjoints are those of no rest shear.

        Returns:
            The other system.
        """
        _ = self.linear, self._terms, self._buffers, self.placement, self.nodes
        other = copy.copy(self)
        object.__setattr__(other, "rest_shear", rest)
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
    def nodes(self) -> PointNodes:
        """Nodes of all points."""
        return PointNodes.of(self.stencils)

    @cached_property
    def layout(self) -> ShellLayout:
        """Places of the points' stiffness in the matrix of the free control points."""
        return shell_layout(self.nodes, len(self.free))

    @cached_property
    def linear(self) -> LinearSolver:
        """The analysed linear solver of the free control points."""
        pattern = BlockPattern(self.layout.indptr, self.layout.indices, self.stencils.control_material)
        return solver(pattern, self.backend)

    @cached_property
    def _terms(self) -> MatrixTerms:
        return MatrixTerms.of(self.nodes, self.layout, self.linear.needed_slots)

    @cached_property
    def _buffers(self) -> list[Workspace]:
        return []

    def _work(self, members: int) -> Workspace:
        """Buffers of as many members, used again at every evaluation of as many or fewer."""
        if not self._buffers or len(self._buffers[0].energy) < members:
            self._buffers[:] = [Workspace.of(members, self.nodes, self.edges)]
        return self._buffers[0].first(members)

    @cached_property
    def element_bytes(self) -> int:
        """Memory of the evaluated points and nodes of one cloth [bytes]."""
        return sum(array.nbytes for array in vars(Workspace.of(1, self.nodes, self.edges)).values())

    @cached_property
    def placement(self) -> Placement:
        """Placement of the undeformed cloth on the plate."""
        return Placement.of(self.sheet.material[self.fixed], self.stencils.control_material)

    def frame(self, x: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members 3 3"]:
        """Frame of the plate: x_,1 and x_,2 of the undeformed cloth on it, and its material origin.

        Args:
            x: Positions; those of the fixed vertices count [m].

        Returns:
            Rows x_,1, x_,2 and origin [m].
        """
        return self.placement.frame(x[:, self.fixed])

    def displacement(self, x: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members rows 3"]:
        """Displacements of the free control points from the undeformed cloth on the plate [m].

        Args:
            x: Positions of control points and fixed vertices [m].

        Returns:
            Displacements.
        """
        return np.ascontiguousarray(x[:, self.free] - self.placement.undeformed(self.frame(x)))

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
        s, nodes, work = self.stencils, self.nodes, self._work(len(x))
        base = np.ascontiguousarray(self.frame(x)[:, :2])
        u = self.displacement(x)
        kernels.edge_stiffness(
            exact, nodes.start, nodes.nodes, nodes.weights, s.edge_area, EDGE_SHARE, base, u, p.stretch,
            self.rest_shear, p.bending, _curvatures(p.rest_angle), p.poisson, work.energy, work.vector, work.edge_block,
            work.slope,
        )  # fmt: skip
        kernels.vertex_stiffness(
            exact, nodes.start, nodes.nodes, nodes.weights, s.vertex_area, 1.0 - EDGE_SHARE, self.edges, base, u,
            p.stretch, self.rest_shear, work.energy, work.vector, work.vertex_block,
        )  # fmt: skip
        return ShellEvaluation(self, work, x, p, exact)

    def curvature(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "edges 3"]:
        """Curvatures (k11, k22, 2 k12) of one cloth at the edges [1/m].

        Args:
            x: Positions of control points and fixed vertices [m].

        Returns:
            Curvatures, negative where the cloth is convex seen from its face.
        """
        nodes, found = self.nodes, np.empty((1, self.edges, 3))
        base = np.ascontiguousarray(self.frame(x[None])[:, :2])
        kernels.shell_curvatures(nodes.start, nodes.nodes, nodes.weights, base, self.displacement(x[None]), found)
        return found[0]

    def shear(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "points"]:
        """Shear x_,1 . x_,2 of one cloth at the quadrature points, edges first.

        Args:
            x: Positions of control points and fixed vertices [m].

        Returns:
            Shears, without unit.
        """
        s, base, u = self.stencils, self.frame(x[None])[0, :2], self.displacement(x[None])[0]
        slopes = [
            base + np.einsum("prn,pna->pra", weights[:, :2], u[nodes])  # padded nodes have no weight
            for nodes, weights in ((s.edge_nodes, s.edge_weights), (s.vertex_nodes, s.vertex_weights))
        ]
        return np.concatenate([(own[:, 0] * own[:, 1]).sum(1) for own in slopes])

    def forces(
        self, x: Float[ndarray, "vertices 3"], anchor: Float[ndarray, "vertices 3"], p: Parameters, *, exact: bool
    ) -> tuple[Float[ndarray, "vertices 3"], Float[ndarray, "slots 3 3"], float]:
        """Forces, stiffness blocks and energy at one configuration.

        Args:
            x: Positions of control points and fixed vertices [m].
            anchor: Not used; there are no springs.
            p: The cloth, by quadrature points.
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.

        Returns:
            Forces on the control points [N], stiffness blocks of the free ones in the layout's slots [N/m] (filled
            where the linear solver reads), and the potential energy [J].
        """
        state = self.evaluate(x[None], anchor[None], p.batch(), exact=exact)
        return state.force()[0], state.matrix(diagonal=self.spring[None])[0], float(state.energy()[0])

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
        self, blocks: Float[ndarray, "*members slots 3 3"], amount: Float[ndarray, "*#members vertices"]
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
        s, nodes, work, edges, free = self.stencils, self.nodes, self._work(len(x)), self.edges, self.free
        base = np.ascontiguousarray(self.frame(x)[:, :2])
        u, along, across = self.displacement(x), multiplier[:, free], velocity[:, free]
        g_base, g_poisson = np.empty((len(x), self.points, 2, 3)), np.empty((len(x), edges))
        adjoint_kernels.edge_adjoint(
            force_factor, stiffness_factor, nodes.start, nodes.nodes, nodes.weights, s.edge_area, EDGE_SHARE, base, u,
            along, across, p.stretch, p.bending, _curvatures(p.rest_angle), p.poisson, work.vector, g_base,
            gradient.stretch, gradient.bending, _curvatures(gradient.rest_angle), g_poisson,
        )  # fmt: skip
        adjoint_kernels.vertex_adjoint(
            force_factor, stiffness_factor, nodes.start, nodes.nodes, nodes.weights, s.vertex_area, 1.0 - EDGE_SHARE,
            edges, base, u, along, across, p.stretch, work.vector, g_base, gradient.stretch,
        )  # fmt: skip
        gradient.poisson[...] += g_poisson.sum(1)
        gradient.mass[:] -= force_factor * self.gravity * multiplier[..., 2]
        by_u = self.gather(work.vector)
        by_x = np.zeros_like(x)
        by_x[:, free] = by_u
        by_x[:, self.fixed] = self.placement.adjoint(by_u, g_base.sum(1))
        return by_x, np.zeros_like(x)

    def gather(self, vectors: Float[ndarray, "members places 3"]) -> Float[ndarray, "members rows 3"]:
        """Sums the points' vectors at the free control points.

        Args:
            vectors: Vectors of all nodes of all points.

        Returns:
            Sums.
        """
        found = np.empty((len(vectors), len(self.free), 3))
        kernels.gather_vectors(self.layout.row_start, self.layout.row_places, vectors, found)
        return found


def _curvatures(rest: Float[ndarray, "members triples"]) -> Float[ndarray, "members edges 3"]:
    return rest.reshape(len(rest), -1, 3)


@dataclass(frozen=True, eq=False)
class ShellEvaluation:
    """All quadrature points of a batch, evaluated; sums are made on demand. Valid until the next evaluation."""

    system: ShellSystem
    work: Workspace
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
        system, work, layout = self.system, self.work, self.system.layout
        nodes, terms = system.nodes, system._terms
        blocks = np.zeros((len(self.x), len(layout.indices), 3, 3)) if out is None else out
        kernels.gather_stiffness(
            self.exact, scale, layout.row_start, layout.row_places, nodes.point, system.edges, terms.start,
            terms.other, terms.slots, layout.indptr, layout.diagonal, system.free,
            np.broadcast_to(diagonal, (len(self.x), system.mesh.vertices)), nodes.weights, work.edge_block,
            work.vertex_block, work.slope, blocks.reshape(*blocks.shape[:2], 9),
        )  # fmt: skip
        return blocks
