"""Stiffness, rest strain and rest curvature of a plate at its points of integration.

With warp and weft along 1 and 2, D11 and D22 are the bending stiffnesses of the fabric's table along them, D12 =
nu sqrt(D11 D22), and the twisting stiffness D33 follows from the one at 45 degrees, 4 D45 = D11 + D22 + 2 D12 + 4 D33.
Strains and curvatures are in the order 11, 22, 2 x 12.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.withheld.world.fabric import Fabric
from cusick_bench.withheld.world.polar.grid import PolarGrid
from cusick_bench.withheld.world.scene import Scene, Surface, sum_of_fields, unit_vector

_UPPER = np.triu_indices(3)
_LEAST_TWIST = 0.1  # D33 over the mean of D11 and D22
_DIFFERENCE = 0.0025  # [m] of the central differences of rest shapes


@dataclass(frozen=True)
class PlateMaterial:
    """Material of a plate at its points of integration; symmetric tables are 11, 12, 13, 22, 23, 33.

    Attributes:
        stretch: C [N/m].
        rest_strain: E0.
        bending: D at rest [N m].
        rest_curvature: k0 [1/m].
        growth: What D has more at 40 /m, over D.
    """

    stretch: Float[ndarray, "intervals points 6"]
    rest_strain: Float[ndarray, "intervals points 3"]
    bending: Float[ndarray, "intervals points 6"]
    rest_curvature: Float[ndarray, "intervals points 3"]
    growth: float


def material_of(fabric: Fabric, grid: PolarGrid, scene: Scene) -> PlateMaterial:
    """The material of a cloth.

    Args:
        fabric: Its mean tables.
        grid: Its points.
        scene: Fields over it, skew, rest shapes.

    Returns:
        The material.
    """
    points = grid.points.reshape(-1, 2) - np.array(scene.centre)
    stretch = np.exp(sum_of_fields(scene.log_stretch, points))[:, None] * _stretch_table(fabric, scene.skew)[_UPPER]
    bending = np.exp(sum_of_fields(scene.log_bending, points))[:, None] * _bending_table(fabric, scene.skew)[_UPPER]
    longer = np.exp(2 * sum_of_fields(scene.growth, points))
    rest_strain = 0.5 * (longer - 1)[:, None] * np.array([1.0, 1.0, 0.0])
    curvature = scene.up * rest_curvature(scene, points)
    shape = grid.weight.shape
    stretch, rest_strain, bending, curvature = (
        values.reshape(*shape, -1) for values in (stretch, rest_strain, bending, curvature)
    )
    table = fabric.material.bending.numpy()
    return PlateMaterial(stretch, rest_strain, bending, curvature, float(table[0, 4] / table[0, 0] - 1))


def rest_curvature(scene: Scene, points: Float[ndarray, "points 2"]) -> Float[ndarray, "points 3"]:
    """Curvatures of the rest shapes, seen from the face, by central differences.

    Args:
        scene: Its rest shapes.
        points: Material points about the cloth's centre [m].

    Returns:
        n . S_11, n . S_22 and 2 n . S_12 of a shape S with normal n, summed over the shapes [1/m].
    """

    def plain(at: Float[ndarray, "points 2"]) -> Float[ndarray, "points 3"]:
        return np.column_stack([at, sum_of_fields(scene.rest, at)])

    return np.sum([_curvature(shape, points) for shape in (plain, *scene.surfaces)], axis=0)


def _curvature(shape: Surface, points: Float[ndarray, "points 2"]) -> Float[ndarray, "points 3"]:
    d = _DIFFERENCE

    def at(i: int, j: int) -> ndarray:
        return shape(points + d * np.array([i, j]))

    east, west, north, south = at(1, 0), at(-1, 0), at(0, 1), at(0, -1)
    normal = np.cross(east - west, north - south)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    middle = at(0, 0)
    second = east + west - 2 * middle, north + south - 2 * middle, 0.5 * (at(1, 1) + at(-1, -1) - at(1, -1) - at(-1, 1))
    return np.stack([(normal * derivative).sum(1) / d**2 for derivative in second], 1)


def _stretch_table(fabric: Fabric, skew: tuple[float, float]) -> Float[ndarray, "3 3"]:
    """C in Cartesian axes; the fabric's table holds half of it, but the whole shear stiffness."""
    warp, cross, weft, shear = fabric.material.stretch.numpy()[0]
    plain = np.array([[2 * warp, 2 * cross, 0], [2 * cross, 2 * weft, 0], [0, 0, shear]])
    return _oblique(plain, skew)


def _bending_table(fabric: Fabric, skew: tuple[float, float]) -> Float[ndarray, "3 3"]:
    """D in Cartesian axes, at rest."""
    warp, bias, weft = fabric.material.bending.numpy()[:, 0]
    cross = fabric.poisson * np.sqrt(warp * weft)
    twist = max(bias - 0.25 * (warp + weft + 2 * cross), _LEAST_TWIST * 0.5 * (warp + weft))
    return _oblique(np.array([[warp, cross, 0], [cross, weft, 0], [0, 0, twist]]), skew)


def _oblique(plain: Float[ndarray, "3 3"], skew: tuple[float, float]) -> Float[ndarray, "3 3"]:
    """A table for yarns that run askew: what each has alone goes with it, the rest turns by the mean angle."""
    total = np.zeros((3, 3))
    for alone, degrees in ((plain[0, 0] - plain[0, 1], skew[0]), (plain[1, 1] - plain[0, 1], 90 + skew[1])):
        c, s = unit_vector(degrees)
        along = np.array([c * c, s * s, c * s])  # strain along the yarn
        total += alone * np.outer(along, along)
    c, s = unit_vector(sum(skew) / 2)
    shear = np.array([-2 * c * s, 2 * c * s, c * c - s * s])
    both = np.array([1.0, 1.0, 0.0])
    return total + plain[0, 1] * np.outer(both, both) + plain[2, 2] * np.outer(shear, shear)
