"""Meshes of a cloth whose centre does not lie on the plate's axis.

A Moebius map of the unit disc, f(z) = (z + a) / (1 + conj(a) z), keeps the rim and turns circles into circles, and
angles stay. So a mesh with one ring of vertices on the rim and one on the plate's edge stays so, wherever the plate
is. With the hyperbolic distance artanh, the circle |z| = rho goes where its ends on the axis go,
artanh(c + p) = artanh(a) + artanh(rho) and artanh(c - p) = artanh(a) - artanh(rho), c and p its centre and radius.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.fields import Outline

_EDGE = 1e-9  # [m]


def on_plate(mesh: Mesh, plate: float) -> ndarray:
    """Which vertices of a centred mesh lie on the plate.

    Args:
        mesh: A disc about the plate's axis.
        plate: Radius of the plate [m].

    Returns:
        True for each vertex within that radius.
    """
    return np.hypot(*mesh.material.T) <= plate + _EDGE


def placed(
    mesh: Mesh, radius: float, plate: float, centre: Float[ndarray, "2"], outlines: Sequence[Outline] = ()
) -> Mesh:
    """The cloth beside the plate's axis.

    Args:
        mesh: A centred disc with vertices on the plate's edge.
        radius: Radius of the cloth [m].
        plate: Radius of the plate [m].
        centre: Centre of the cloth, from the plate's axis [m].
        outlines: Factors on the cut's radius; their product counts.

    Returns:
        The same triangles; material coordinates are about the plate's axis.

    Raises:
        WithheldError: The plate would stick out of the cloth.
    """
    if np.hypot(*centre) + plate > 0.97 * radius:
        raise WithheldError(
            f"a cloth of {radius} m cannot lie {np.hypot(*centre):.3g} m beside the axis of a plate of {plate} m; "
            "take a smaller shift"
        )
    points = _moved(mesh.material[:, 0] + 1j * mesh.material[:, 1], radius, plate, -complex(*centre))
    factor, direction = np.ones(mesh.vertices), np.angle(points)
    for outline in outlines:
        factor = factor * outline(direction)
    beyond = np.clip((np.hypot(*mesh.material.T) - plate) / (radius - plate), 0, 1)
    points = points * (1 + beyond * (factor - 1))
    return Mesh(np.column_stack([points.real, points.imag]) + centre, mesh.faces)


def _moved(points: ndarray, radius: float, plate: float, target: complex) -> ndarray:
    """Points of a centred disc, moved such that the plate's circle is centred at the target [m]."""
    if target == 0:
        return points
    axis, c, p = target / abs(target), abs(target) / radius, plate / radius
    far, near = np.arctanh(c + p), np.arctanh(c - p)
    a, rho = np.tanh((far + near) / 2) * axis, np.tanh((far - near) / 2)
    inside = np.abs(points) <= plate + _EDGE
    share = np.where(inside, 1.0, (radius - np.abs(points)) / (radius - plate))
    unit = points / radius * (1 + share * (rho / p - 1))
    return radius * (unit + a) / (1 + np.conj(a) * unit)
