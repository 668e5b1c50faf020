"""The body that wears the skirt: a body of revolution over which cloth slides without friction.

Its radius rises from the waist to the hips by half a cosine and stays there. A vertex that would end the step inside
is pressed back by a linear spring along the surface's normal n, implicitly: f = k (d - h n . w), where d is the depth
at the start of the step and w the change of velocity. The test uses the predicted position at the end of the step, so
that a falling cloth stops at the surface and is not thrown back out of it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.garment.errors import GarmentError

_OWN_DEPTH = 1e-5  # [m] depth to which a vertex is pressed in by its own weight; it sets the spring's stiffness


@dataclass(frozen=True)
class Body:
    """A body of revolution about the z axis.

    Attributes:
        waist: Radius at z = 0 [m].
        hip: Radius from the hips down [m].
        hip_depth: How far below the waist the hips are [m].

    Raises:
        GarmentError: A measure that is not positive, or hips narrower than the waist.
    """

    waist: float = 0.11
    hip: float = 0.13
    hip_depth: float = 0.18

    def __post_init__(self) -> None:
        if not (0 < self.waist <= self.hip < np.inf and 0 < self.hip_depth < np.inf):
            raise GarmentError(
                f"a body needs 0 < waist <= hip and a positive hip depth, got waist {self.waist} m, hip {self.hip} m, "
                f"depth {self.hip_depth} m; for a skirt without a body give a hip of 0"
            )

    def radius(self, height: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
        """Radius of the body at some heights.

        Args:
            height: Height above the waist [m].

        Returns:
            The radius [m].
        """
        along = np.clip(-np.asarray(height) / self.hip_depth, 0, 1)
        return self.waist + (self.hip - self.waist) * 0.5 * (1 - np.cos(np.pi * along))

    def depth(self, x: Float[ndarray, "*batch 3"]) -> tuple[Float[ndarray, "*batch"], Float[ndarray, "*batch 3"]]:
        """Depth of points below the surface.

        Args:
            x: Positions in the body's frame [m].

        Returns:
            Depths [m], negative outside, and outward unit normals.
        """
        distance = np.hypot(x[..., 0], x[..., 1])
        along = np.clip(-x[..., 2] / self.hip_depth, 0, 1)
        slope = -(self.hip - self.waist) * 0.5 * np.pi * np.sin(np.pi * along) / self.hip_depth  # dr/dz
        steep = np.sqrt(1 + slope**2)
        radial = x[..., :2] / np.maximum(distance, 1e-12)[..., None]
        normal = np.concatenate([radial, -slope[..., None]], axis=-1) / steep[..., None]
        return (self.radius(x[..., 2]) - distance) / steep, normal


def contact_stiffness(mass: Float[ndarray, "*batch"], gravity: float) -> Float[ndarray, "*batch"]:
    """Stiffness of the spring that presses vertices out of the body.

    Args:
        mass: Masses of the vertices [kg].
        gravity: Acceleration of gravity [m/s2].

    Returns:
        The stiffness [N/m].
    """
    return mass * gravity / _OWN_DEPTH
