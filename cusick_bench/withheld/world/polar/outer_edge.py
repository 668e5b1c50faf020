"""Where the cut of a cloth runs, seen from the plate's axis: its distance in every direction, and two derivatives."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.interpolate import CubicSpline

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.fields import Outline

_DIRECTIONS = 720
_ROUNDS = 30


def outer_edge(
    angle: Float[ndarray, "points"],
    radius: float,
    plate: float,
    centre: Float[ndarray, "2"],
    outlines: Sequence[Outline],
) -> Float[ndarray, "3 points"]:
    """Distance of the cut from the plate's axis.

    Args:
        angle: Directions from the axis [rad].
        radius: Nominal radius of the cloth [m].
        plate: Radius of the plate [m].
        centre: Centre of the cloth, from the axis [m].
        outlines: Factors on the radius of the cut, around the cloth's centre; their product counts.

    Returns:
        The distance and its first and second derivative by the direction [m].

    Raises:
        WithheldError: The plate would stick out of the cloth.
    """
    if np.hypot(*centre) + plate > 0.97 * radius:
        raise WithheldError(
            f"a cloth of {radius} m cannot lie {np.hypot(*centre):.3g} m beside the axis of a plate of {plate} m; "
            "take a smaller shift"
        )
    direction = np.linspace(0, 2 * np.pi, _DIRECTIONS + 1)
    unit = np.stack([np.cos(direction), np.sin(direction)])
    beside = centre[0] * unit[1] - centre[1] * unit[0]
    distance = np.full_like(direction, radius)
    for _ in range(_ROUNDS):  # |distance e - centre| = radius * outline(its direction)
        x, y = distance * unit - centre[:, None]
        cut = radius * np.prod([outline(np.arctan2(y, x)) for outline in outlines], axis=0)
        distance = centre @ unit + np.sqrt(cut**2 - beside**2)
    distance[-1] = distance[0]
    curve = CubicSpline(direction, distance, bc_type="periodic")
    return np.stack([curve(angle, order) for order in range(3)])
