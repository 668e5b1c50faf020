"""The undeformed cloth on a flat plate that may slope: where its control points are, from the fixed vertices."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class Placement:
    """Linear maps from fixed vertices to the plate's frame, and from there to control points.

    Attributes:
        from_fixed: Least squares from the positions of the fixed vertices to x_,1, x_,2 and the origin of the plate's
            plane.
        to_rows: Weights of x_,1, x_,2 and the origin in the control points of the undeformed cloth.
    """

    from_fixed: Float[ndarray, "3 fixed"]
    to_rows: Float[ndarray, "rows 3"]

    @classmethod
    def of(cls, fixed: Float[ndarray, "fixed 2"], rows: Float[ndarray, "rows 2"]) -> "Placement":
        """Makes the maps.

        Args:
            fixed: Material points of the fixed vertices [m].
            rows: Material points of the free control points [m].

        Returns:
            The maps.
        """
        return cls(
            np.linalg.pinv(np.column_stack([fixed, np.ones(len(fixed))])), np.column_stack([rows, np.ones(len(rows))])
        )

    def frame(self, fixed: Float[ndarray, "members fixed 3"]) -> Float[ndarray, "members 3 3"]:
        """Position of the plate.

        Args:
            fixed: Positions of the fixed vertices [m].

        Returns:
            Rows x_,1, x_,2 and origin [m].
        """
        return self.from_fixed @ fixed

    def undeformed(self, frame: Float[ndarray, "members 3 3"]) -> Float[ndarray, "members rows 3"]:
        """Control points of the undeformed cloth.

        Args:
            frame: Where the plate is.

        Returns:
            Positions [m].
        """
        return self.to_rows @ frame

    def adjoint(
        self, by_displacement: Float[ndarray, "members rows 3"], by_slopes: Float[ndarray, "members 2 3"]
    ) -> Float[ndarray, "members fixed 3"]:
        """Derivatives of a scalar to the fixed vertices.

        Args:
            by_displacement: Its derivatives to the displacements from the undeformed cloth.
            by_slopes: Its derivatives to x_,1 and x_,2 of the undeformed cloth, the displacements being the same.

        Returns:
            Its derivatives to the positions of the fixed vertices.
        """
        by_frame = -(self.to_rows.T @ by_displacement)
        by_frame[:, :2] += by_slopes
        return self.from_fixed.T @ by_frame
