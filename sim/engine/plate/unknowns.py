"""Linear maps between vertices, faces and hinges of a drape and control and quadrature points of a shell.

Each has its transpose for gradients."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import splu

from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.errors import SimulationError

_FLAT = 1e-6  # [m] by which vertices may lie off the plate's plane


@dataclass(frozen=True, eq=False)
class VertexUnknowns:
    """Maps for laws whose unknowns are the vertices: all are identities."""

    def parameters(self, p: Parameters) -> Parameters:
        """Parameters as the system takes them."""
        return p

    def configuration(self, positions: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Unknowns of given positions [m]."""
        return positions

    def positions(self, x: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Positions of the vertices [m]."""
        return x

    def by_configuration(self, g: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Turns derivatives by positions into derivatives by unknowns."""
        return g

    def gradient(
        self, found: ParameterGradient, g_start: Float[ndarray, "members vertices 3"]
    ) -> tuple[ParameterGradient, Float[ndarray, "members vertices 3"]]:
        """Turns derivatives by the system's parameters and initial unknowns into those by the cloth's and positions."""
        return found, g_start


@dataclass(frozen=True, eq=False)
class ShellUnknowns:
    """Maps for law `plate`.

    Attributes:
        system: The shell.
    """

    system: ShellSystem

    def __getstate__(self) -> dict[str, Any]:
        """The system alone, for copies and other processes, where matrices are factorised again."""
        return {"system": self.system}

    @cached_property
    def _stretch(self) -> csr_array:
        s = self.system.stencils
        return csr_array(vstack([s.stretch_of_edge, s.stretch_of_vertex]))

    @cached_property
    def _surface(self) -> csr_array:
        """Displacements of the free vertices from those of their control points."""
        return csr_array(self.system.stencils.surface)[self.system.free]

    def parameters(self, p: Parameters) -> Parameters:
        """Tables, rest curvatures and masses of the quadrature and control points.

        Args:
            p: A batch, by faces, hinges and vertices.

        Returns:
            The batch as `ShellSystem` takes it; `rest_angle` holds curvatures (members, 3 edges) [1/m].
        """
        s = self.system.stencils
        mass = np.zeros_like(p.mass)
        mass[:, self.system.free] = _each(s.load, p.mass)
        return Parameters(
            p.stretch if p.stretch.shape[1] == 1 else _mean(self._stretch, p.stretch),
            p.bending if p.bending.shape[1] == 1 else _mean(s.bending_of_edge, p.bending),
            mass, _each(s.rest_curvature, p.rest_angle), p.poisson,
        )  # fmt: skip

    def configuration(self, positions: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Control points of the surface through given positions; fixed vertices stay.

        Args:
            positions: Positions of the vertices [m].

        Returns:
            Control points, at the indices of their vertices [m].

        Raises:
            SimulationError: The fixed vertices do not lie in a plane, undeformed.
        """
        system = self.system
        frame = system.frame(positions)
        flat = np.column_stack([system.sheet.material, np.ones(system.mesh.vertices)]) @ frame
        off = float(np.abs((positions - flat)[:, system.fixed]).max(initial=0.0))
        if off > _FLAT:
            raise SimulationError(
                f"law 'plate' holds the cloth flat and undeformed on the plate, but a vertex there is laid down "
                f"{1e3 * off:.3g} mm off; lay the cloth down flat within the plate's edge, or use law 'paper'"
            )
        found = positions.copy()
        found[:, system.free] = self._solve((positions - flat)[:, system.free], "N") + system.placement.to_rows @ frame
        return found

    def positions(self, x: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Points of the surface at the vertices.

        Args:
            x: Control points and fixed vertices [m].

        Returns:
            Positions [m].
        """
        system = self.system
        found = x.copy()
        at = np.column_stack([system.sheet.material[system.free], np.ones(len(system.free))])
        found[:, system.free] = at @ system.frame(x) + _each(self._surface, system.displacement(x))
        return found

    def by_configuration(self, g: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Turns derivatives by positions into derivatives by control points and fixed vertices.

        Args:
            g: Derivatives by the vertices' positions.

        Returns:
            Derivatives by the unknowns.
        """
        system, free = self.system, self.system.free
        found = g.copy()
        at = np.column_stack([system.sheet.material[free], np.ones(len(free))])
        found[:, free] = _each(csr_array(self._surface.T), g[:, free])
        by_frame = at.T @ g[:, free] - system.placement.to_rows.T @ found[:, free]
        found[:, system.fixed] += system.placement.from_fixed.T @ by_frame
        return found

    def gradient(
        self, found: ParameterGradient, g_start: Float[ndarray, "members vertices 3"]
    ) -> tuple[ParameterGradient, Float[ndarray, "members vertices 3"]]:
        """Turns derivatives by the system's parameters and initial unknowns into those by the cloth's and positions.

        Args:
            found: By quadrature and control points.
            g_start: By the unknowns at the start.

        Returns:
            Derivatives by faces, hinges and vertices, and by the positions at the start.
        """
        s, free = self.system.stencils, self.system.free
        gradient = ParameterGradient(
            _each(csr_array(self._stretch.T), found.stretch), _each(csr_array(s.bending_of_edge.T), found.bending),
            _each(csr_array(s.load.T), found.mass[:, free]), _each(csr_array(s.rest_curvature.T), found.rest_angle),
            found.poisson,
        )  # fmt: skip
        return gradient, self.by_laid(g_start)

    def by_laid(self, g_start: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members vertices 3"]:
        """Turns derivatives by the initial unknowns into those by the positions in which the cloth is laid down.

        Args:
            g_start: By the unknowns at the start.

        Returns:
            Derivatives by positions.
        """
        system, free = self.system, self.system.free
        found = g_start.copy()
        found[:, free] = self._solve(g_start[:, free], "T")
        at = np.column_stack([system.sheet.material[free], np.ones(len(free))])
        by_frame = system.placement.to_rows.T @ g_start[:, free] - at.T @ found[:, free]
        found[:, system.fixed] += system.placement.from_fixed.T @ by_frame
        return found

    @cached_property
    def _factor(self):
        return splu(self._surface.tocsc())

    def _solve(self, right: Float[ndarray, "members rows 3"], trans: str) -> Float[ndarray, "members rows 3"]:
        # Member by member: SuperLU's roundings depend on how many right-hand sides it solves for together.
        return np.stack([self._factor.solve(np.ascontiguousarray(one), trans) for one in right])


def _mean(matrix: csr_array, values: Float[ndarray, "members columns *rest"]) -> Float[ndarray, "members rows *rest"]:
    """Means whose weights add up to one; exact where all values are equal, as a shared table's are."""
    first = values[:, :1]
    return first + _each(matrix, values - first)


def _each(matrix: csr_array, values: Float[ndarray, "members columns *rest"]) -> Float[ndarray, "members rows *rest"]:
    """A matrix times every member's array, along its first axis."""
    members, columns = values.shape[:2]
    flat = np.moveaxis(values.reshape(members, columns, -1), 1, 0).reshape(columns, -1)
    found = np.asarray(matrix @ flat).reshape(-1, members, flat.shape[1] // members)
    return np.ascontiguousarray(np.moveaxis(found, 0, 1)).reshape(members, -1, *values.shape[2:])
