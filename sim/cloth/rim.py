"""The rim of a draped disc as a smooth closed curve, from which lengths are read to a fraction of an edge.

A polygon through the rim's vertices lies inside the curve by an eighth of spacing^2 / radius, .3 mm on a mesh of 300
vertices; a periodic cubic spline through them is off by the fourth power of the spacing.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_POINTS = 7200  # a twentieth of a degree: the polygon through them is within 1e-7 m of the curve


@dataclass(frozen=True, eq=False)
class RimCurve:
    """A closed curve in space, sampled densely and evenly over the material's angle.

    Attributes:
        points: Points in counter-clockwise order, the first not repeated [m].
    """

    points: Float[ndarray, "points 3"]

    @property
    def radii(self) -> Float[ndarray, "points"]:
        """Distances from the plate's axis [m]."""
        return np.hypot(self.points[:, 0], self.points[:, 1])

    @property
    def heights(self) -> Float[ndarray, "points"]:
        """Heights above the plate [m]."""
        return self.points[:, 2]

    def drape_coefficient(self, *, cloth_radius: float = CLOTH_RADIUS, plate_radius: float = PLATE_RADIUS) -> float:
        """Share of the annulus that the area within the projected curve covers.

        Args:
            cloth_radius: Radius of the flat cloth [m].
            plate_radius: Radius of the plate [m].

        Returns:
            0 for a cloth that hangs vertically, 1 for one that stays flat.
        """
        x, y = self.points[:, 0], self.points[:, 1]
        area = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
        return (area / np.pi - plate_radius**2) / (cloth_radius**2 - plate_radius**2)


def rim_curve(mesh: Mesh, positions: Float[ndarray, "vertices 3"]) -> RimCurve:
    """The rim as a periodic cubic spline through its vertices, over their angle in the material.

    Args:
        mesh: The cloth, a disc about the origin.
        positions: Positions of its vertices [m].

    Returns:
        The curve.
    """
    from scipy.interpolate import CubicSpline  # here: it takes a fifth of a second to import

    loop = mesh.boundary
    angle = np.unwrap(np.arctan2(mesh.material[loop, 1], mesh.material[loop, 0]))
    around = np.append(angle, angle[0] + 2 * np.pi)
    spline = CubicSpline(around, positions[np.append(loop, loop[0])], bc_type="periodic")
    return RimCurve(spline(angle[0] + 2 * np.pi * np.arange(_POINTS) / _POINTS))
