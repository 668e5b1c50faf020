"""What drops, descents and their adjoints ask of a system; `DrapeSystem` (hinges) and `ShellSystem` have it.

Configurations are arrays over the mesh's vertices; what stands there is the system's (vertices, or the control points
of a shell).
"""

from typing import Protocol

from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.linear.interface import LinearSolver


class Evaluated(Protocol):
    """A batch's elements at its configurations; valid until the system's next evaluation."""

    @property
    def x(self) -> Float[ndarray, "members vertices 3"]:
        """Configurations [m]."""
        ...

    def force(self) -> Float[ndarray, "members vertices 3"]:
        """Net forces: elements, gravity and springs [N]."""
        ...

    def energy(self) -> Float[ndarray, "members"]:
        """Potential energies [J]."""
        ...

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
            diagonal: Added to the diagonal of every vertex [N/m].
            out: Used again where given.

        Returns:
            The blocks, in `out` where given.
        """
        ...


class Layout(Protocol):
    """Block sparsity of the free unknowns."""

    @property
    def indptr(self) -> Int[ndarray, "rows_plus_one"]:
        """Row pointers (CSR)."""
        ...

    @property
    def indices(self) -> Int[ndarray, "slots"]:
        """Column of every slot."""
        ...

    @property
    def diagonal(self) -> Int[ndarray, "rows"]:
        """Slot of every diagonal block."""
        ...


class ClothSystem(Protocol):
    """A cloth on its support, under gravity, with one material law."""

    @property
    def mesh(self) -> Mesh:
        """The cloth."""
        ...

    @property
    def law(self) -> str:
        """Name of the material law."""
        ...

    @property
    def gravity(self) -> float:
        """Acceleration along -z [m/s2]."""
        ...

    @property
    def fixed(self) -> Bool[ndarray, "vertices"]:
        """Vertices that never move."""
        ...

    @property
    def free(self) -> Int[ndarray, "rows"]:
        """Indices of the vertices that move."""
        ...

    @property
    def spring(self) -> Float[ndarray, "vertices"]:
        """Stiffness of the spring that ties each vertex to its anchor [N/m]."""
        ...

    @property
    def backend(self) -> str:
        """Name of the linear solver."""
        ...

    @property
    def layout(self) -> Layout:
        """Where element blocks go in the matrix of the free unknowns."""
        ...

    @property
    def linear(self) -> LinearSolver:
        """The analysed linear solver of the free unknowns."""
        ...

    @property
    def element_bytes(self) -> int:
        """What the evaluated elements of one cloth take [bytes]."""
        ...

    def require_energy(self, what: str) -> None:
        """Checks that the forces derive from an energy.

        Args:
            what: What needs it, for the message.

        Raises:
            SimulationError: They do not.
        """
        ...

    def evaluate(
        self, x: Float[ndarray, "members vertices 3"], anchor: Float[ndarray, "members vertices 3"], p: Parameters,
        *, exact: bool, everywhere: bool = False,
    ) -> Evaluated:  # fmt: skip
        """Evaluates the elements at the configurations of a batch.

        Args:
            x: Configurations [m].
            anchor: Where springs hold [m].
            p: A batch of cloths, as the system takes them.
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.
            everywhere: Also what adds a constant to the energy, and forces on fixed vertices.

        Returns:
            Forces, energy and matrix on demand; valid until the next evaluation.
        """
        ...

    def forces(
        self, x: Float[ndarray, "vertices 3"], anchor: Float[ndarray, "vertices 3"], p: Parameters, *, exact: bool
    ) -> tuple[Float[ndarray, "vertices 3"], Float[ndarray, "slots 3 3"], float]:
        """Forces, stiffness blocks and energy at one configuration.

        Args:
            x: Configuration [m].
            anchor: Where springs hold [m].
            p: The cloth, as the system takes it.
            exact: Hessian of the energy instead of the positive-semidefinite Gauss-Newton stiffness.

        Returns:
            Forces [N], stiffness blocks of the free unknowns in the layout's slots [N/m], and the potential energy [J].
        """
        ...

    def zero_gradient(self, *members: int) -> ParameterGradient:
        """A gradient to add to.

        Args:
            *members: Number of cloths, for a batch.

        Returns:
            Zeros.
        """
        ...

    def add_diagonal(
        self, blocks: Float[ndarray, "*members slots 3 3"], amount: Float[ndarray, "*members vertices"]
    ) -> None:
        """Adds amount[i] times the identity to the diagonal block of every free vertex, in place.

        Args:
            blocks: Blocks in the layout's slots [N/m]; changed.
            amount: A number for every vertex [N/m].
        """
        ...

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
            x: Configurations [m], of one cloth or of a batch.
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: One cloth or a batch, as `x`.
            gradient: dS/d(parameters) is added to it.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the Gauss-Newton stiffness.

        Returns:
            dS/dx and dS/d(anchor).
        """
        ...
