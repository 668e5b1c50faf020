"""Strains for laws with internal variables: of hinges and faces, or of the quadrature points of a shell.

A cloth's bending is measured as `Parameters.rest_angle` is: the dihedral angles of hinges [rad], or the curvatures
(k11, k22, 2 k12) of a shell's edge points [1/m], one behind another. Its size at a shell's point is the norm of the
curvature tensor, q^2 = k11^2 + k22^2 + 2 k12^2, which for a cylinder is its curvature, however it lies in the cloth.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.secants import secant_plates
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.triangles.elements import Elements
from cusick_bench.sim.engine.triangles.system import DrapeSystem

HINGE_SHARE = 1 / (1 / 3 + 2 * math.sqrt(3) / math.pi)
"""Size of a cylinder's curvature over the sum of its hinges'. Rolled up to a curvature k in the direction phi, a
lattice of equilateral triangles bends its three families of hinges by k (1 + 2 cos 2 (phi - phi_i)) / 3. Their squares
add up to k^2, so elasticity knows no direction, but their magnitudes to between k and 5/3 k, on the mean over all
directions k (1/3 + 2 sqrt(3) / pi) = 1.436 k."""

_TINY = 1e-300


@runtime_checkable
class Strains(Protocol):
    """Bending and shear of one cloth, element by element."""

    @property
    def bending_share(self) -> float:
        """A cylinder's curvature over the sum of its elements' sizes of bending, on the mean over all directions."""
        ...

    def bending(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "bendings"]:
        """Bending in a configuration.

        Args:
            x: Configuration of the system [m].

        Returns:
            As `Parameters.rest_angle`: [rad], or [1/m].
        """
        ...

    def drawn_along(
        self, slid: Float[ndarray, "bendings"], bending: Float[ndarray, "bendings"], reach: float
    ) -> Float[ndarray, "bendings"]:
        """Bending that follows another one at a distance: the nearest to where it was within a reach of the other.

        Args:
            slid: The bending that follows.
            bending: The bending that leads.
            reach: Largest difference of the two [1/m].

        Returns:
            Where it is now.
        """
        ...

    def convexity(self, bending: Float[ndarray, "bendings"]) -> Float[ndarray, "elements"]:
        """Side to which the elements are bent: 1 where convex seen from the cloth's face, -1 where concave.

        Args:
            bending: Bending from the rest shape.

        Returns:
            Sides, in [-1, 1].
        """
        ...

    def at_secant(self, bending: Float[ndarray, "bendings"], p: Parameters) -> Parameters:
        """The linear law that has the same moments at a bending, with the stiffness B of that curvature.

        Args:
            bending: Where the moments are the same.
            p: The cloth.

        Returns:
            Constant tables per element, and the rest that gives them the moments.
        """
        ...

    def shear(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "elements"]:
        """Shear x_u . x_v of the elements that stretch.

        Args:
            x: Configuration of the system [m].

        Returns:
            Shears, without unit.
        """
        ...

    def with_rest_shear(
        self, x: Float[ndarray, "vertices 3"], rest: Float[ndarray, "elements"]
    ) -> DrapeSystem | ShellSystem:
        """The system with its elements free of shear stress elsewhere.

        Args:
            x: Configuration of the system [m].
            rest: Shears without stress.

        Returns:
            Another system for the next step; it shares the analysis of this one.
        """
        ...


def strains(system: ClothSystem) -> Strains:
    """Strains of a cloth under its law.

    Args:
        system: Cloth and support.

    Returns:
        How it bends and shears.
    """
    if isinstance(system, ShellSystem):
        return ShellStrains(system)
    assert isinstance(system, DrapeSystem)
    return HingeStrains(system)


@dataclass(frozen=True, eq=False)
class HingeStrains:
    """Dihedral angles of hinges, and shears of faces; see `Strains`."""

    system: DrapeSystem
    bending_share = HINGE_SHARE

    def bending(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "hinges"]:
        """Dihedral angles [rad]."""
        return self.system.bent(x)

    def drawn_along(
        self, slid: Float[ndarray, "hinges"], bending: Float[ndarray, "hinges"], reach: float
    ) -> Float[ndarray, "hinges"]:
        """Each hinge by itself."""
        angle = reach / self.system.elements.hinge_scale
        return np.clip(slid, bending - angle, bending + angle)

    def convexity(self, bending: Float[ndarray, "hinges"]) -> Float[ndarray, "hinges"]:
        """The angle's sign."""
        return np.sign(bending)

    def at_secant(self, bending: Float[ndarray, "hinges"], p: Parameters) -> Parameters:
        """B of every hinge; its moment is B times the angle from rest."""
        stiffness = self.system.secant_bending(bending, p)
        return replace(p, bending=np.broadcast_to(stiffness[:, None, None], (len(bending), 3, 5)).copy())

    def shear(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "faces"]:
        """Shear of every face."""
        return _metric(self.system.elements, x)[2]

    def with_rest_shear(self, x: Float[ndarray, "vertices 3"], rest: Float[ndarray, "faces"]) -> DrapeSystem:
        """A frame a x_u + b x_v for s_v in which every face, as it is now, lacks the rest shear."""
        elements = self.system.elements
        uu, vv, uv = _metric(elements, x)
        wanted = uv - rest
        b = np.sqrt((uu * vv - wanted**2) / (uu * vv - uv**2))
        a = (wanted - b * uv) / uu
        face_v = np.ascontiguousarray(a[:, None] * elements.face_u + b[:, None] * elements.face_v)
        return self.system.with_elements(replace(elements, face_v=face_v))


def _metric(elements: Elements, x: Float[ndarray, "vertices 3"]) -> tuple[ndarray, ndarray, ndarray]:
    """x_u . x_u, x_v . x_v and x_u . x_v of every face."""
    corners = x[elements.faces]
    u = (elements.face_u[:, :, None] * corners).sum(1)
    v = (elements.face_v[:, :, None] * corners).sum(1)
    return (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)


@dataclass(frozen=True, eq=False)
class ShellStrains:
    """Curvatures of a shell's edge points, and shears of all its points; see `Strains`."""

    system: ShellSystem
    bending_share = 1.0

    def bending(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "triples"]:
        """Curvatures, three of every edge point [1/m]."""
        return self.system.curvature(x).ravel()

    def drawn_along(
        self, slid: Float[ndarray, "triples"], bending: Float[ndarray, "triples"], reach: float
    ) -> Float[ndarray, "triples"]:
        """Radial return in the space of curvatures: as a whole, along the straight line to the leading curvature."""
        away = (bending - slid).reshape(-1, 3)
        size = np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2 + 0.5 * away[:, 2] ** 2)
        over = np.maximum(0.0, 1.0 - reach / np.maximum(size, _TINY))
        return slid + (over[:, None] * away).ravel()

    def convexity(self, bending: Float[ndarray, "triples"]) -> Float[ndarray, "edges"]:
        """- (k1 + k2) / (|k1| + |k2|), k1 and k2 the principal curvatures: between the sides on a saddle."""
        k11, k22, twice = bending.reshape(-1, 3).T
        total, difference = k11 + k22, np.hypot(k11 - k22, twice)
        return -total / np.maximum(np.maximum(np.abs(total), difference), _TINY)

    def at_secant(self, bending: Float[ndarray, "triples"], p: Parameters) -> Parameters:
        """The plate whose rows are B at the size of the curvature."""
        tables, rest = secant_plates(bending.reshape(-1, 3), p.rest_angle.reshape(-1, 3), p.bending, float(p.poisson))
        return replace(p, bending=tables, rest_angle=rest.ravel())

    def shear(self, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "points"]:
        """Shear of every quadrature point."""
        return self.system.shear(x)

    def with_rest_shear(self, x: Float[ndarray, "vertices 3"], rest: Float[ndarray, "points"]) -> ShellSystem:
        """Every quadrature point's own rest shear."""
        return self.system.with_rest_shear(rest)
