"""What drops of batches ask of a cloth's forces on a device: `TorchForces` (hinges) and `TorchShell` offer it."""

from typing import Protocol, runtime_checkable

from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.torch_engine.forces import BatchParameters


@runtime_checkable
class MeshedSystem(Protocol):
    """A cloth on its support."""

    @property
    def mesh(self) -> Mesh:
        """The cloth."""
        ...


@runtime_checkable
class BatchForces(Protocol):
    """Forces, step stiffness and adjoint products of many cloths on one mesh.

    Attributes:
        slots: Slots of the layout that `evaluate` fills, in its order.
        free: Vertices that move.
        flat: The undeformed cloth [m].
    """

    slots: Int[ndarray, "slots"]
    free: Int[Tensor, "free"]
    flat: Float[Tensor, "vertices 3"]

    @property
    def system(self) -> MeshedSystem:
        """Mesh and support."""
        ...

    @property
    def shapes(self) -> dict[str, tuple[tuple[int, ...] | int, ...]]:
        """Shapes of a member's parameters; alternatives in a tuple."""
        ...

    def numbers(self, *, differentiate: bool) -> int:
        """Numbers of one member that are alive at once during an evaluation.

        Args:
            differentiate: Whether there will be gradients.

        Returns:
            Their count.
        """
        ...

    def evaluate(
        self, x: Float[Tensor, "members vertices 3"], anchor: Float[Tensor, "#members vertices 3"], p: BatchParameters
    ) -> tuple[Float[Tensor, "members vertices 3"], Float[Tensor, "members slots 3 3"]]:
        """Forces [N] and step stiffness [N/m].

        Args:
            x: Positions [m].
            anchor: Where springs hold [m].
            p: The cloths.

        Returns:
            Forces on the vertices, and blocks in the wanted slots.
        """
        ...

    def add_diagonal(
        self, blocks: Float[Tensor, "members slots 3 3"], amount: Float[Tensor, "#members vertices"]
    ) -> None:
        """Adds amount[i] times the identity to every free vertex's diagonal block, in place.

        Args:
            blocks: Blocks in the wanted slots [N/m]; changed.
            amount: A number for every vertex [N/m].
        """
        ...

    def adjoint(
        self,
        x: Float[Tensor, "members vertices 3"],
        multiplier: Float[Tensor, "members vertices 3"],
        velocity: Float[Tensor, "members vertices 3"],
        p: BatchParameters,
        *,
        force_factor: float,
        stiffness_factor: float,
    ) -> tuple[Float[Tensor, "members vertices 3"], Float[Tensor, "members vertices 3"], BatchParameters]:
        """Derivatives of force_factor lambda . F - stiffness_factor lambda . K v at fixed lambda and v.

        Args:
            x: Positions [m].
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: The cloths.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the step stiffness.

        Returns:
            By positions, by anchors, and by the parameters.
        """
        ...
