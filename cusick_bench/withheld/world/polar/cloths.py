"""Cloths of splines: laid down, dropped, and cut into small triangles for the camera."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.fabric import Fabric
from cusick_bench.withheld.world.polar.drop import Displacements, PolarPlate, drop, projected
from cusick_bench.withheld.world.polar.grid import HELD, Disc, PolarGrid, places_around, polar_grid
from cusick_bench.withheld.world.polar.material import material_of
from cusick_bench.withheld.world.polar.splines import clamped_splines, periodic_splines
from cusick_bench.withheld.world.scene import Scene, Vertices, laid_height, sum_of_fields
from cusick_bench.withheld.world.world import Drape

_FINER = 3  # triangles of the picture in each direction of an interval
_ASPECT = 9  # intervals around the cloth for each in the radial direction: 8 mm by 9 to 13 mm
_FEWEST = 12 * 3


def intervals(vertices: int) -> tuple[int, int]:
    """Number of intervals in the radial direction and around the cloth.

    Args:
        vertices: Their product, about.

    Returns:
        The numbers.

    Raises:
        WithheldError: Too few.
    """
    if vertices < _FEWEST:
        raise WithheldError(f"a polar grid needs at least {_FEWEST} intervals, got {vertices}; raise --vertices")
    radial = max(3, round(np.sqrt(vertices / _ASPECT)))
    return radial, round(vertices / radial)


@dataclass(frozen=True, eq=False)
class PolarCloths:
    """All cloths of a case; see `Cloths`.

    Attributes:
        radial: Intervals from the plate's edge to the cut.
        angular: Intervals around the cloth.
    """

    radial: int
    angular: int
    _centred: dict[tuple[float, float], PolarGrid] = field(default_factory=dict, init=False, repr=False)

    def drape(self, fabric: Fabric, scene: Scene, steps: int) -> Drape:
        """Drapes one cloth; see `Cloths.drape`."""
        disc = Disc(scene.radius, scene.plate_radius, scene.centre, scene.outlines)
        grid = self._grid(disc)
        points, shape = grid.points.reshape(-1, 2), grid.weight.shape
        density = float(fabric.material.density) * np.exp(sum_of_fields(scene.log_mass, points - np.array(disc.centre)))
        plate = PolarPlate(grid, material_of(fabric, grid, scene), density.reshape(shape) * grid.weight, scene)
        u, kept = drop(plate, projected(grid, laid_height(scene, points).reshape(shape)), steps)
        return Drape(self._surface(disc, u), self._faces, kept)

    def _grid(self, disc: Disc) -> PolarGrid:
        if any(disc.centre) or disc.outlines:
            return polar_grid(self.radial, self.angular, disc)
        key = disc.radius, disc.plate
        if key not in self._centred:
            self._centred[key] = polar_grid(self.radial, self.angular, disc)
        return self._centred[key]

    @cached_property
    def _places(self) -> tuple[Float[ndarray, "rings"], Float[ndarray, "directions"]]:
        """Shares of the way and directions of the picture's vertices."""
        around = self.angular * _FINER
        return np.linspace(0, 1, self.radial * _FINER + 1), np.arange(around) * (2 * np.pi / around)

    def _surface(self, disc: Disc, u: Displacements) -> Vertices:
        """The plate's middle, then rings from its edge to the cut."""
        share, angle = self._places
        moved = displacement(self.radial, self.angular, u, share, angle)
        s, phi = (values.ravel() for values in np.meshgrid(share, angle, indexing="ij"))
        points = disc.at(s, phi)[0]
        return np.vstack([np.zeros(3), np.column_stack([points, np.zeros(len(points))]) + moved.reshape(-1, 3)])

    @cached_property
    def _faces(self) -> Int[ndarray, "faces 3"]:
        rings, around = (len(values) for values in self._places)
        here, there = np.arange(around), (np.arange(around) + 1) % around
        faces = [np.column_stack([np.zeros_like(here), 1 + here, 1 + there])]
        for ring in range(rings - 1):
            a, b = 1 + ring * around, 1 + (ring + 1) * around
            faces += [
                np.column_stack([a + here, b + here, b + there]),
                np.column_stack([a + here, b + there, a + there]),
            ]
        return np.concatenate(faces)


def displacement(
    radial: int, angular: int, u: Displacements, share: Float[ndarray, "rings"], angle: Float[ndarray, "directions"]
) -> Float[ndarray, "rings directions 3"]:
    """Displacements at shares of the way from the plate's edge to the cut, and directions.

    Args:
        radial: Intervals in the radial direction.
        angular: Intervals around the cloth.
        u: Displacements of the splines [m].
        share: Shares s.
        angle: Directions [rad].

    Returns:
        The displacements [m].
    """
    rows = radial + 3 - HELD
    control = np.zeros((rows + HELD, angular, 3))
    control[HELD:] = u.reshape(angular, rows, 3)[places_around(angular)].swapaxes(0, 1)
    outward, around = clamped_splines(radial, share), periodic_splines(angular, angle)
    i = outward.first[:, None] + np.arange(4)
    j = (around.first[:, None] + np.arange(4)) % angular
    chosen = control[i[:, :, None, None], j[None, None]]
    return np.einsum("ra,db,radbc->rdc", outward.value[:, 0], around.value[:, 0], chosen)
