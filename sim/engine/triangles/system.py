"""The mechanical system of one drape: a mesh on its support, under gravity, with one material law.

`DrapeSystem` turns positions into forces and stiffness of the free vertices and turns adjoint vectors into parameter
gradients. `dynamics.drop` and `statics.equilibrium` are two ways to a drape on top of it.
"""

import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import Law
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.triangles import assembly, face_kernels, hinge_kernels
from cusick_bench.sim.engine.triangles.elements import Elements, elements_of
from cusick_bench.sim.engine.triangles.layout import BlockLayout, GatherTables, block_layout, gather_tables
from cusick_bench.sim.engine.triangles.workspace import Workspace
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.laws import tables
from cusick_bench.sim.linear.interface import BlockPattern, LinearSolver, solver
from cusick_bench.sim.threads import check_fork, thread_pool

_VERTEX_MEMORY = 1400  # [bytes] of the elements of a cloth, for each of its vertices
_LAWS = {"published": tables.PUBLISHED, "paper": tables.PAPER}


@dataclass(frozen=True, eq=False)
class DrapeSystem:
    """A cloth mesh on its support.

    Attributes:
        mesh: The cloth.
        law: Material law; `paper` derives from an energy, `published` is the published program's.
        gravity: Acceleration along -z [m/s2].
        fixed: Vertices that never move (their degrees of freedom are eliminated).
        spring: Stiffness of the spring that ties each vertex to its anchor [N/m], 0 for none.
        backend: Linear solver, see `cusick_bench.sim.linear.interface.solver`.
        half_hinges: Whether of a hinge between fixed and free cloth the free half alone bends (see `elements_of`).
    """

    mesh: Mesh
    law: Law
    gravity: float
    fixed: Bool[ndarray, "vertices"]
    spring: Float[ndarray, "vertices"]
    backend: str = "auto"
    half_hinges: bool = False
    elements: Elements = field(init=False, repr=False)

    def __post_init__(self) -> None:
        thread_pool()
        if self.law not in _LAWS:
            raise SimulationError(f"law must be one of plate, {', '.join(_LAWS)}, got {self.law!r}")
        if self.fixed.all():
            raise SimulationError("every vertex is fixed: nothing can drape; is the plate larger than the cloth?")
        object.__setattr__(self, "elements", elements_of(self.mesh, self._clamped))

    def require_energy(self, what: str) -> None:
        """Checks that the forces derive from an energy.

        Args:
            what: What needs it, for the message.

        Raises:
            SimulationError: They do not.
        """
        if self.law != "paper":
            raise SimulationError(
                f"{what} needs a law that derives from an energy, got {self.law!r}; use law 'paper', or mode 'drop'"
            )

    def with_elements(self, elements: Elements) -> "DrapeSystem":
        """A copy of the system with other constants of its faces and hinges; it shares the analysis of this one.

        Args:
            elements: Elements of the same faces and hinges.

        Returns:
            The other system.
        """
        _ = self.linear, self._tables, self._chosen, self._workspaces  # made here, so that there is one of each
        other = copy.copy(self)
        object.__setattr__(other, "elements", elements)
        return other

    def with_mesh(self, mesh: Mesh) -> "DrapeSystem":
        """A copy of the system with other material points; it shares the analysis of this one.

        Args:
            mesh: The same faces over other material points.

        Returns:
            A system whose elements are those of the given mesh.

        Raises:
            SimulationError: Other faces.
        """
        if not np.array_equal(mesh.faces, self.mesh.faces):
            raise SimulationError("an analysis is shared by meshes of the same faces only; make a new system")
        other = self.with_elements(elements_of(mesh, self._clamped))
        object.__setattr__(other, "mesh", mesh)
        return other

    @property
    def _clamped(self) -> ndarray | None:
        return self.fixed if self.half_hinges else None

    @cached_property
    def free(self) -> ndarray:
        """Indices of the vertices that move."""
        return np.flatnonzero(~self.fixed)

    @cached_property
    def sprung(self) -> bool:
        """Whether any vertex is held by a spring."""
        return bool(self.spring.any())

    @cached_property
    def layout(self) -> BlockLayout:
        """Places of element blocks in the matrix of the free vertices."""
        return block_layout(self.elements, self.free, self.mesh.vertices)

    @cached_property
    def linear(self) -> LinearSolver:
        """The analysed linear solver of the free vertices."""
        pattern = BlockPattern(self.layout.indptr, self.layout.indices, self.mesh.material[self.free])
        return solver(pattern, self.backend)

    @cached_property
    def _tables(self) -> GatherTables:
        return gather_tables(self.elements, self.layout, self.linear.needed_slots, self.free, self.mesh.vertices)

    @cached_property
    def _chosen(self) -> dict[bool, tuple[ndarray, ndarray, ndarray]]:
        """Faces, hinges and vertices to evaluate: all of them, or the free vertices and what touches them."""
        faces, hinges = self.elements.faces, self.elements.hinges
        loose = (np.flatnonzero(~self.fixed[faces].all(1)), np.flatnonzero(~self.fixed[hinges].all(1)), self.free)
        return {True: (np.arange(len(faces)), np.arange(len(hinges)), np.arange(self.mesh.vertices)), False: loose}

    @property
    def element_bytes(self) -> int:
        """Memory of the evaluated elements of one cloth [bytes]."""
        return _VERTEX_MEMORY * self.mesh.vertices

    def _work(self, members: int, everywhere: bool = False) -> Workspace:
        """Element buffers, used again at every evaluation of as many members or fewer."""
        made = self._workspaces.get(everywhere)
        if made is None or len(made.face_energy) < members:
            made = self._workspaces[everywhere] = Workspace.of(self.elements, members)
        return made.first(members)

    @cached_property
    def _workspaces(self) -> dict[bool, Workspace]:
        return {}

    def evaluate(
        self, x: Float[ndarray, "members vertices 3"], anchor: Float[ndarray, "members vertices 3"], p: Parameters,
        *, exact: bool, everywhere: bool = False,
    ) -> "Evaluation":  # fmt: skip
        """Evaluates the elements at the configurations of a batch.

        Args:
            x: Positions [m].
            anchor: Where the springs hold [m].
            p: A batch of cloths.
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.
            everywhere: Also elements without a free vertex, which add a constant to the energy, and forces on fixed
                vertices; they are zero otherwise.

        Returns:
            Forces, energy and matrix on demand; valid until the next evaluation.
        """
        check_fork()
        el, law, work = self.elements, _LAWS[self.law], self._work(len(x), everywhere)
        faces, hinges, _ = self._chosen[everywhere]
        face_kernels.face_stiffness(
            law, exact, faces, el.faces, el.face_u, el.face_v, el.face_area, x, p.stretch,
            work.face_energy, work.face_vector, work.face_blocks,
        )  # fmt: skip
        hinge_kernels.hinge_stiffness(
            law, exact, hinges, el.hinges, el.hinge_scale, el.hinge_weight, el.direction_low, el.direction_fraction, x,
            p.rest_angle, p.bending, work.hinge_energy, work.hinge_vector, work.hinge_moment, work.hinge_stiffness,
            work.exact_blocks() if exact else work.no_blocks,
        )  # fmt: skip
        return Evaluation(self, work, x, anchor, p, exact, everywhere)

    def bent(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "hinges"]:
        """Dihedral angles of one cloth [rad], positive where it is convex seen from its face.

        Args:
            x: Positions [m].

        Returns:
            Angles, in the order of the hinges.
        """
        angle = np.empty(len(self.elements.hinges))
        hinge_kernels.hinge_angles(self.elements.hinges, x, angle)
        return angle

    def secant_bending(self, angle: Float[ndarray, "hinges"], p: Parameters) -> Float[ndarray, "hinges"]:
        """B of one cloth's hinges at their angles [N m].

        Args:
            angle: Dihedral angles [rad].
            p: The cloth.

        Returns:
            Stiffness, in the order of the hinges.
        """
        el, secant = self.elements, np.empty(len(angle))
        hinge_kernels.hinge_secants(
            _LAWS[self.law], el.hinge_scale, el.direction_low, el.direction_fraction, angle - p.rest_angle, p.bending,
            secant,
        )  # fmt: skip
        return secant

    def forces(
        self, x: Float[ndarray, "vertices 3"], anchor: Float[ndarray, "vertices 3"], p: Parameters, *, exact: bool
    ) -> tuple[Float[ndarray, "vertices 3"], Float[ndarray, "slots 3 3"], float]:
        """Forces, stiffness blocks and energy at one configuration.

        Args:
            x: Positions [m].
            anchor: Where the springs hold [m].
            p: The cloth.
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.

        Returns:
            Forces on all vertices [N], stiffness blocks of the free vertices in the layout's slots [N/m] (filled where
            the linear solver reads), and the potential energy [J] (only meaningful where `exact`).
        """
        state = self.evaluate(x[None], anchor[None], p.batch(), exact=exact, everywhere=True)
        return state.force()[0], state.matrix(diagonal=self.spring[None])[0], float(state.energy()[0])

    def zero_gradient(self, *members: int) -> ParameterGradient:
        """A gradient to add to.

        Args:
            *members: Number of cloths, for a batch.

        Returns:
            Zeros for every face, hinge and vertex.
        """
        faces, hinges = len(self.elements.faces), len(self.elements.hinges)
        shapes = ((faces, 6, 4), (hinges, 3, 5), (self.mesh.vertices,), (hinges,), ())
        return ParameterGradient(*(np.zeros((*members, *shape)) for shape in shapes))

    def gather(
        self, face_vector: ndarray, hinge_vector: ndarray, factor: ndarray, everywhere: bool = True
    ) -> Float[ndarray, "members vertices 3"]:
        """Sums corner vectors into vertices, or into the free ones; `factor` is each hinge's.

        Args:
            face_vector: Vectors at the corners of every face (members, faces, 3, 3).
            hinge_vector: Vectors at the corners of every hinge (members, hinges, 12).
            factor: Factor of every hinge's vectors (members, hinges).
            everywhere: Whether fixed vertices get their sums too; they are zero otherwise.

        Returns:
            Sums.
        """
        t = self._tables
        out = np.zeros((len(factor), self.mesh.vertices, 3))
        assembly.gather_vertices(
            self._chosen[everywhere][2], t.face_corner_start, t.face_corners, t.hinge_corner_start, t.hinge_corners,
            face_vector, hinge_vector, factor, out,
        )  # fmt: skip
        return out

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
            x: Positions [m], of one cloth or of a batch.
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: One cloth or a batch, as `x`.
            gradient: dS/d(stretch, bending, rest angle) and the gravity part of dS/d(mass) are added to it.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the Gauss-Newton stiffness.

        Returns:
            dS/dx and dS/d(anchor).
        """
        if x.ndim == 2:
            by_x, pull = self.adjoint(
                x[None], multiplier[None], velocity[None], p.batch(), gradient.batch(),
                force_factor=force_factor, stiffness_factor=stiffness_factor,
            )  # fmt: skip
            return by_x[0], pull[0]
        el, law, work = self.elements, _LAWS[self.law], self._work(len(x))
        faces, hinges, _ = self._chosen[False]  # at the others lambda is zero
        face_kernels.face_adjoint(
            law, force_factor, stiffness_factor, faces, el.faces, el.face_u, el.face_v, el.face_area, x, multiplier,
            velocity, p.stretch, work.face_vector, gradient.stretch,
        )  # fmt: skip
        hinge_kernels.hinge_adjoint(
            law, force_factor, stiffness_factor, hinges, el.hinges, el.hinge_scale, el.hinge_weight, el.direction_low,
            el.direction_fraction, x, p.rest_angle, multiplier, velocity, p.bending, work.hinge_vector,
            gradient.bending, gradient.rest_angle,
        )  # fmt: skip
        gradient.mass[:] -= force_factor * self.gravity * multiplier[..., 2]
        pull = force_factor * self.spring[:, None] * multiplier
        return self.gather(work.face_vector, work.hinge_vector, work.ones) - pull, pull


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All elements of a batch, evaluated; sums are made on demand. Valid until the system's next evaluation."""

    system: DrapeSystem
    work: Workspace
    x: Float[ndarray, "members vertices 3"]
    anchor: Float[ndarray, "members vertices 3"]
    p: Parameters
    exact: bool
    everywhere: bool

    def force(self) -> Float[ndarray, "members vertices 3"]:
        """Net forces: elements, gravity and springs [N]; those on fixed vertices only where evaluated everywhere."""
        system, work = self.system, self.work
        force = system.gather(work.face_vector, work.hinge_vector, work.hinge_moment, self.everywhere)
        force[..., 2] -= system.gravity * self.p.mass
        if system.sprung:
            force -= system.spring[:, None] * (self.x - self.anchor)
        return force

    def energy(self) -> Float[ndarray, "members"]:
        """Potential energies [J]; only meaningful where `exact`."""
        system, work = self.system, self.work
        energy = work.face_energy.sum(1) + work.hinge_energy.sum(1)
        energy += system.gravity * (self.p.mass * self.x[..., 2]).sum(1)
        return energy + 0.5 * (system.spring * ((self.x - self.anchor) ** 2).sum(-1)).sum(-1)

    def matrix(
        self,
        *,
        scale: float = 1.0,
        diagonal: Float[ndarray, "members vertices"],
        out: Float[ndarray, "members slots 3 3"] | None = None,
    ) -> Float[ndarray, "members slots 3 3"]:
        """scale * K + diagonal, K the elements' stiffness, in the layout's slots; filled where the solver reads.

        Args:
            scale: Factor of the stiffness.
            diagonal: Added to the diagonal of every vertex (springs are not in K).
            out: Used again where given.

        Returns:
            The blocks, in `out` where given.
        """
        system, work, t = self.system, self.work, self.system._tables
        blocks = np.zeros((len(self.x), len(system.layout.indices), 3, 3)) if out is None else out
        assembly.assemble_blocks(
            t.slots, t.vertex, t.face_start, t.face_terms, t.hinge_start, t.hinge_terms, self.exact, scale, diagonal,
            work.face_blocks, work.hinge_vector, work.hinge_stiffness,
            work.exact_blocks() if self.exact else work.no_blocks, blocks,
        )  # fmt: skip
        return blocks
