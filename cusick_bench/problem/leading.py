"""Leading directions: the few combinations of a cloth's parameters on which its expected statistics depend."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

LEADING = ("bending", "bias", "grain", "stretch", "shear", "hardening", "curl", "laying")
"""Numbers on which the expected statistics of a cloth depend: logarithms of the bending stiffness (mean over
curvatures, warp and weft), of the ratio of the bias to it, of the ratio of warp to weft, of the stretch stiffness at
rest, and of the ratio of the shear stiffness to that; rise of bending stiffness with curvature; curl; logarithm of the
laid shape's correlation length."""
ALONG_LEVEL = np.isin(LEADING, ("bending", "stretch")).astype(np.float64)
"""Derivative of these by a specimen's level, which multiplies all bending and stretch stiffnesses by one factor."""
Levels = Float[np.ndarray, " cloths"] | float


@dataclass(frozen=True)
class Leading:
    """Leading directions of cloths: x = origin + rows theta, for a cloth of reference weight and size.

    Attributes:
        rows: Derivatives by theta.
        origin: Values for the median cloth.
    """

    rows: Float[np.ndarray, "leading cloth"]
    origin: Float[np.ndarray, " leading"]

    def __call__(
        self, cloths: Float[np.ndarray, "cloths numbers"], levels: Levels = 0.0
    ) -> Float[np.ndarray, "cloths leading"]:
        """Leading directions x of cloths theta, or of specimens of them.

        Args:
            cloths: theta, one a row.
            levels: Log stiffness of each specimen beside its cloth's (`FieldSpace.levels`); 0 for the cloths.

        Returns:
            One row a cloth.
        """
        return self.origin + self._moved(cloths, levels)

    def rest(self, cloths: Float[np.ndarray, "cloths numbers"]) -> Float[np.ndarray, "cloths numbers"]:
        """Properties of cloths that change none of the leading directions.

        Args:
            cloths: theta, one a row.

        Returns:
            Their projections.
        """
        return cloths - (cloths @ self.rows.T) @ np.linalg.pinv(self.rows).T

    def scaled(
        self, cloths: Float[np.ndarray, "cloths numbers"], levels: Levels = 0.0
    ) -> Float[np.ndarray, "cloths leading"]:
        """Leading directions about those of the median cloth, in standard deviations of the prior.

        Args:
            cloths: theta, one a row.
            levels: Log stiffness of each specimen beside its cloth's; 0 for the cloths.

        Returns:
            One row a cloth.
        """
        return self._moved(cloths, levels) / np.linalg.norm(self.rows, axis=1)

    @property
    def scaled_level(self) -> Float[np.ndarray, " leading"]:
        """How `scaled` moves with a specimen's level."""
        return ALONG_LEVEL / np.linalg.norm(self.rows, axis=1)

    def _moved(
        self, cloths: Float[np.ndarray, "cloths numbers"], levels: Levels
    ) -> Float[np.ndarray, "cloths leading"]:
        return cloths @ self.rows.T + np.multiply.outer(levels, ALONG_LEVEL)
