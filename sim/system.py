"""The mechanical system of one drape: a mesh on its support, under gravity, with one material law.

`DrapeSystem` turns positions into forces and stiffness of the free vertices and turns adjoint vectors into parameter
gradients. `drop` and `equilibrium` are two ways to a drape on top of it.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.sim import assembly, face_kernels, hinge_kernels, tables
from cusick_bench.sim.elements import BlockLayout, Elements, block_layout, elements_of
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear import BlockPattern, LinearSolver, solver
from cusick_bench.sim.mesh import Mesh

Law = Literal["paper", "published"]
_LAWS = {"published": tables.PUBLISHED, "paper": tables.PAPER}


@dataclass(frozen=True)
class Parameters:
    """Numbers of one simulated cloth, as the kernels take them.

    Attributes:
        stretch: C, one shared table (1, 6, 4) or one per face [N/m].
        bending: B, one shared table (1, 3, 5) or one per hinge [N m].
        mass: Vertex masses [kg].
        rest_angle: Stress-free dihedral angle of every hinge [rad].
    """

    stretch: Float[ndarray, "stretch_tables 6 4"]
    bending: Float[ndarray, "bending_tables 3 5"]
    mass: Float[ndarray, "vertices"]
    rest_angle: Float[ndarray, "hinges"]


@dataclass(frozen=True)
class ParameterGradient:
    """Derivatives of a scalar to the parameters, per element even where one table is shared."""

    stretch: Float[ndarray, "faces 6 4"]
    bending: Float[ndarray, "hinges 3 5"]
    mass: Float[ndarray, "vertices"]
    rest_angle: Float[ndarray, "hinges"]

    @classmethod
    def zeros(cls, system: "DrapeSystem") -> "ParameterGradient":
        """A gradient to add to."""
        faces, hinges = len(system.elements.faces), len(system.elements.hinges)
        return cls(np.zeros((faces, 6, 4)), np.zeros((hinges, 3, 5)), np.zeros(system.mesh.vertices), np.zeros(hinges))


@dataclass(frozen=True, eq=False)
class DrapeSystem:
    """A cloth mesh on its support.

    Attributes:
        mesh: The cloth.
        law: Material law; `paper` derives from an energy, `published` is the published program's.
        gravity: Acceleration along -z [m/s2].
        fixed: Vertices that never move (their degrees of freedom are eliminated).
        spring: Stiffness of the spring that ties each vertex to its anchor [N/m], 0 for none.
        backend: Linear solver, see `cusick_bench.sim.linear.solver`.
    """

    mesh: Mesh
    law: Law
    gravity: float
    fixed: Bool[ndarray, "vertices"]
    spring: Float[ndarray, "vertices"]
    backend: str = "auto"
    elements: Elements = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.law not in _LAWS:
            raise SimulationError(f"law must be one of {', '.join(_LAWS)}, got {self.law!r}")
        if self.fixed.all():
            raise SimulationError("every vertex is fixed: nothing can drape; is the plate larger than the cloth?")
        object.__setattr__(self, "elements", elements_of(self.mesh))

    @cached_property
    def free(self) -> ndarray:
        """Indices of the vertices that move."""
        return np.flatnonzero(~self.fixed)

    @cached_property
    def layout(self) -> BlockLayout:
        """Where element blocks go in the matrix of the free vertices."""
        return block_layout(self.elements, self.free, self.mesh.vertices)

    @cached_property
    def linear(self) -> LinearSolver:
        """The analysed linear solver of the free vertices."""
        pattern = BlockPattern(self.layout.indptr, self.layout.indices, self.mesh.material[self.free])
        return solver(pattern, self.backend)

    @cached_property
    def _corners(self) -> tuple[ndarray, ndarray]:
        """Face and hinge corners of every vertex, for `gather_vertices`."""
        corner = np.concatenate([self.elements.faces.ravel(), self.elements.hinges.ravel()])
        order = np.argsort(corner, kind="stable")
        return np.searchsorted(corner[order], np.arange(self.mesh.vertices + 1)), order

    @cached_property
    def _work(self) -> dict[str, ndarray]:
        """Element buffers, used again at every evaluation."""
        faces, hinges = len(self.elements.faces), len(self.elements.hinges)
        return {
            "face_energy": np.zeros(faces),
            "face_vector": np.zeros((faces, 3, 3)),
            "face_blocks": np.zeros((faces, 9, 3, 3)),
            "hinge_energy": np.zeros(hinges),
            "hinge_vector": np.zeros((hinges, 4, 3)),
            "hinge_blocks": np.zeros((hinges, 16, 3, 3)),
        }

    def _gather(self) -> ndarray:
        out = np.empty((self.mesh.vertices, 3))
        work = self._work
        assembly.gather_vertices(
            *self._corners, len(self.elements.faces), work["face_vector"], work["hinge_vector"], out
        )
        return out

    def forces(
        self, x: Float[ndarray, "vertices 3"], anchor: Float[ndarray, "vertices 3"], p: Parameters, *, exact: bool
    ) -> tuple[Float[ndarray, "vertices 3"], Float[ndarray, "slots 3 3"], float]:
        """Forces, stiffness blocks and energy at a configuration.

        Args:
            x: Positions [m].
            anchor: Where the springs hold [m].
            p: The cloth.
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.

        Returns:
            Forces on all vertices [N], stiffness blocks of the free vertices in the layout's slots [N/m] (filled where
            the linear solver reads), and the potential energy [J] (only meaningful where `exact`).
        """
        el, work, law = self.elements, self._work, _LAWS[self.law]
        face_kernels.face_stiffness(
            law, exact, el.faces, el.face_u, el.face_v, el.face_area, x, p.stretch,
            work["face_energy"], work["face_vector"], work["face_blocks"],
        )  # fmt: skip
        hinge_kernels.hinge_stiffness(
            law, exact, el.hinges, el.hinge_scale, el.hinge_weight, el.direction_low, el.direction_fraction, x,
            p.rest_angle, p.bending, work["hinge_energy"], work["hinge_vector"], work["hinge_blocks"],
        )  # fmt: skip
        force = self._gather()
        force[:, 2] -= self.gravity * p.mass
        stretched = x - anchor
        force -= self.spring[:, None] * stretched
        blocks = np.zeros((len(self.layout.indices), 3, 3))
        assembly.assemble_blocks(
            self.layout.contribution_ptr, self.layout.contributions, self.linear.needed_slots, len(el.faces),
            work["face_blocks"], work["hinge_blocks"], blocks,
        )  # fmt: skip
        self.add_diagonal(blocks, self.spring)
        energy = work["face_energy"].sum() + work["hinge_energy"].sum()
        energy += self.gravity * (p.mass @ x[:, 2]) + 0.5 * (self.spring * (stretched**2).sum(1)).sum()
        return force, blocks, float(energy)

    def add_diagonal(self, blocks: Float[ndarray, "slots 3 3"], amount: Float[ndarray, "vertices"]) -> None:
        """Adds amount[i] times the identity to the diagonal block of every free vertex, in place."""
        for axis in range(3):
            blocks[self.layout.diagonal, axis, axis] += amount[self.free]

    def adjoint(
        self,
        x: Float[ndarray, "vertices 3"],
        multiplier: Float[ndarray, "vertices 3"],
        velocity: Float[ndarray, "vertices 3"],
        p: Parameters,
        gradient: ParameterGradient,
        *,
        force_factor: float,
        stiffness_factor: float,
    ) -> tuple[Float[ndarray, "vertices 3"], Float[ndarray, "vertices 3"]]:
        """Derivatives of S = force_factor * lambda . F - stiffness_factor * lambda . K v at fixed lambda and v.

        Args:
            x: Positions [m].
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: The cloth.
            gradient: dS/d(stretch, bending, rest angle) and the gravity part of dS/d(mass) are added to it.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the Gauss-Newton stiffness.

        Returns:
            dS/dx and dS/d(anchor).
        """
        el, work, law = self.elements, self._work, _LAWS[self.law]
        face_kernels.face_adjoint(
            law, force_factor, stiffness_factor, el.faces, el.face_u, el.face_v, el.face_area, x, multiplier, velocity,
            p.stretch, work["face_vector"], gradient.stretch,
        )  # fmt: skip
        hinge_kernels.hinge_adjoint(
            law, force_factor, stiffness_factor, el.hinges, el.hinge_scale, el.hinge_weight, el.direction_low,
            el.direction_fraction, x, p.rest_angle, multiplier, velocity, p.bending, work["hinge_vector"],
            gradient.bending, gradient.rest_angle,
        )  # fmt: skip
        gradient.mass[:] -= force_factor * self.gravity * multiplier[:, 2]
        pull = force_factor * self.spring[:, None] * multiplier
        return self._gather() - pull, pull
