"""Internal variables of a material law on the hinges and faces of a triangle mesh."""

from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.withheld.world.scene import Vertices


class InternalVariables:
    """Internal variables of one cloth during one drop."""

    def advance(
        self, x: Vertices, angle: Float[ndarray, "hinges"], p: Parameters, h: float
    ) -> tuple[Parameters, Vertices | None]:
        """Advances the internal variables by one step.

        Args:
            x: Positions [m].
            angle: Dihedral angles [rad].
            p: Parameters as the laws before this one left them.
            h: Step [s].

        Returns:
            Parameters for the next step, and further forces on the vertices [N], None for no forces.
        """
        raise NotImplementedError

    def carried_over(self, angle: Float[ndarray, "hinges"]) -> Float[ndarray, "hinges"] | None:
        """State that is carried over from this drop to the sample's next picture.

        Args:
            angle: Dihedral angles at the end of the drop [rad].

        Returns:
            A value for each hinge, or None where the cloth forgets everything.
        """
        return None
