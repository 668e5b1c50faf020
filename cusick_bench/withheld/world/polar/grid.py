"""The polar grid of a cloth on its plate: where its points of integration lie, and the splines' slopes there.

The material point in direction phi, at the share s of the way from the plate's edge to the cut, is

    X(s, phi) = (r_p + s (R(phi) - r_p)) e(phi),

r_p the plate's radius and R the distance of the cut from its axis. Displacements are splines in s and phi, without the
first two in s: position and slope at the plate's edge are exactly the plate's. Slopes are by Cartesian coordinates,

    grad B = J^-T (B_s, B_phi),    B_,XX = J^-T (B_,ss - sum_c (dB/dX_c) X_c,ss) J^-1,    J = dX/d(s, phi).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.withheld.world.fields import Outline
from cusick_bench.withheld.world.polar.outer_edge import outer_edge
from cusick_bench.withheld.world.polar.splines import clamped_splines, periodic_splines

HELD = 2
"""Splines in s that have a value or a slope at the plate's edge."""

_PLACES = np.array([-(3**-0.5), 0.0, 3**-0.5])  # of points of integration in an interval from -1 to 1
_CHOSEN = np.array([0, 2, 6, 8, 4])  # of their products: four for bending and weight, the middle one for stretching
_AREA = np.array([0.25, 0.25, 0.25, 0.25, 0.0])
STRETCH_SHARE = 0.05
"""Share of the stretching that is taken where the bending is. Taken there as a whole it would hold more strains at zero
than there are displacements, and folds would be too shallow (membrane locking); without any, some displacements would
have no energy (Belytschko et al. 1984)."""


@dataclass(frozen=True, eq=False)
class PolarGrid:
    """A grid and what is the same for all that lies on it.

    Attributes:
        radial: Intervals from the plate's edge to the cut.
        angular: Intervals around the cloth.
        unknowns: Number of the displacement of each of an interval's 16 splines; -1 for those that the plate holds.
        points: Material points of integration, about the plate's axis [m].
        weight: Area for which each point stands in bending and weight [m2].
        stretch_weight: Area for which it stands in stretching [m2].
        value: Splines at the points.
        slopes: Their derivatives by X1, X2, X1 X1, X2 X2, X1 X2.
    """

    radial: int
    angular: int
    unknowns: Int[ndarray, "intervals 16"]
    points: Float[ndarray, "intervals points 2"]
    weight: Float[ndarray, "intervals points"]
    stretch_weight: Float[ndarray, "intervals points"]
    value: Float[ndarray, "intervals points 16"]
    slopes: Float[ndarray, "intervals points 16 5"]

    @property
    def rows(self) -> int:
        """Free splines in the radial direction."""
        return self.radial + 3 - HELD


@dataclass(frozen=True)
class Disc:
    """A cloth on its plate.

    Attributes:
        radius, plate: Radii of cloth and plate [m].
        centre: Centre of the cloth, from the plate's axis [m].
        outlines: Factors on the radius of the cut.
    """

    radius: float
    plate: float
    centre: tuple[float, float] = (0.0, 0.0)
    outlines: Sequence[Outline] = ()

    def at(self, share: Float[ndarray, "points"], angle: Float[ndarray, "points"]) -> Float[ndarray, "6 points 2"]:
        """Material points, and their derivatives by share and direction.

        Args:
            share: Share s of the way from the plate's edge to the cut.
            angle: Direction phi [rad].

        Returns:
            X, X_s, X_phi, X_ss, X_phi_phi, X_s_phi [m].
        """
        edge, turn, bend = outer_edge(angle, self.radius, self.plate, np.array(self.centre), self.outlines)
        e = np.column_stack([np.cos(angle), np.sin(angle)])
        across = np.column_stack([-e[:, 1], e[:, 0]])
        far, far_turn, far_bend = self.plate + share * (edge - self.plate), share * turn, share * bend
        along = [far, edge - self.plate, far_turn, 0 * far, far_bend - far, turn]
        beside = [0 * far, 0 * far, far, 0 * far, 2 * far_turn, edge - self.plate]
        return np.stack([a[:, None] * e + b[:, None] * across for a, b in zip(along, beside, strict=True)])


def places_around(angular: int) -> Int[ndarray, "angular"]:
    """Places of the directions in the order of unknowns: the circle is folded, 0, n - 1, 1, n - 2, ...

    So neighbours three apart are at most six places apart, across the end of the circle too.

    Args:
        angular: Intervals around the cloth.

    Returns:
        The place of each.
    """
    around = np.arange(angular)
    return np.where(around < (angular + 1) // 2, 2 * around, 2 * (angular - 1 - around) + 1)


def unknowns_of(radial: int, angular: int) -> Int[ndarray, "intervals 16"]:
    """Numbers of the displacements of each interval's 16 splines.

    Args:
        radial: Intervals in the radial direction.
        angular: Intervals around the cloth.

    Returns:
        The numbers; -1 for splines that the plate holds.
    """
    rows, place = radial + 3 - HELD, places_around(angular)
    a, b = np.divmod(np.arange(radial * angular), angular)
    i = a[:, None] + np.repeat(np.arange(4), 4) - HELD
    j = (b[:, None] + np.tile(np.arange(4), 4)) % angular
    return np.where(i >= 0, place[j] * rows + i, -1)


def polar_grid(radial: int, angular: int, disc: Disc) -> PolarGrid:
    """Makes a grid.

    Args:
        radial: Intervals from the plate's edge to the cut.
        angular: Intervals around the cloth.
        disc: The cloth on its plate.

    Returns:
        The grid.
    """
    s = ((np.arange(radial)[:, None] + 0.5 + 0.5 * _PLACES) / radial).ravel()
    phi = ((np.arange(angular)[:, None] + 0.5 + 0.5 * _PLACES) * (2 * np.pi / angular)).ravel()
    outward, around = clamped_splines(radial, s).value, periodic_splines(angular, phi).value

    def by_interval(values: ndarray) -> ndarray:
        """From (radial points, angular points, ...) to (intervals, points, ...)."""
        more = values.shape[2:]
        shaped = values.reshape(radial, len(_PLACES), angular, len(_PLACES), *more).swapaxes(1, 2)
        return shaped.reshape(radial * angular, len(_PLACES) ** 2, *more)[:, _CHOSEN]

    def products(i: int, j: int) -> ndarray:
        return by_interval((outward[:, None, i, :, None] * around[None, :, j, None, :]).reshape(len(s), len(phi), 16))

    share, angle = (values.ravel() for values in np.meshgrid(s, phi, indexing="ij"))
    x, x_s, x_p, x_ss, x_pp, x_sp = (
        by_interval(values.reshape(len(s), len(phi), 2)) for values in disc.at(share, angle)
    )
    jacobian = x_s[..., 0] * x_p[..., 1] - x_s[..., 1] * x_p[..., 0]
    area = jacobian * (2 * np.pi / (radial * angular))
    inverse = np.stack([x_p[..., 1], -x_p[..., 0], -x_s[..., 1], x_s[..., 0]], -1) / jacobian[..., None]
    inverse = inverse.reshape(*jacobian.shape, 2, 2)  # d(s, phi) / dX
    gradient = np.einsum("epka,epaX->epkX", np.stack([products(1, 0), products(0, 1)], -1), inverse)
    second = np.stack([products(2, 0), products(1, 1), products(1, 1), products(0, 2)], -1)
    curved = np.stack([x_ss, x_sp, x_sp, x_pp], -1)
    hessian = (second - gradient @ curved).reshape(*gradient.shape, 2)
    hessian = np.einsum("epkab,epaX,epbY->epkXY", hessian, inverse, inverse)
    slopes = np.stack([*np.moveaxis(gradient, -1, 0), hessian[..., 0, 0], hessian[..., 1, 1], hessian[..., 0, 1]], -1)
    return PolarGrid(
        radial,
        angular,
        unknowns_of(radial, angular),
        x,
        area * _AREA,
        area * (STRETCH_SHARE * _AREA + (1 - STRETCH_SHARE) * (_AREA == 0)),
        products(0, 0),
        np.ascontiguousarray(slopes),
    )
