"""Directions in the horizontal plane and rotations about horizontal axes, differentiable; shared by several effects."""

import math

import torch
from jaxtyping import Float
from torch import Tensor


def unit(degrees: float | Tensor) -> Float[Tensor, "2"]:
    """The horizontal unit vector at an angle counter-clockwise from +x [deg].

    Args:
        degrees: Angle [deg].

    Returns:
        Cosine and sine.
    """
    angle = torch.as_tensor(degrees, dtype=torch.float64) * (math.pi / 180)
    return torch.stack([torch.cos(angle), torch.sin(angle)])


def leaned(
    points: Float[Tensor, "vertices 3"], degrees: float | Tensor, direction: float | Tensor
) -> Float[Tensor, "vertices 3"]:
    """Points turned about the horizontal axis through the origin that takes +z towards a direction.

    With u along the direction: u' = u cos a + z sin a, z' = z cos a - u sin a.

    Args:
        points: Positions [m].
        degrees: Angle a [deg].
        direction: Counter-clockwise from +x [deg].

    Returns:
        Positions [m].
    """
    cosine, sine = unit(degrees).to(points)
    along = unit(direction).to(points)
    u, z = points[:, :2] @ along, points[:, 2]
    moved = (u * (cosine - 1) + z * sine)[:, None] * along
    return torch.column_stack([points[:, :2] + moved, z * cosine - u * sine])
