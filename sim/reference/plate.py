"""Law `plate` in plain torch: a Kirchhoff-Love shell whose energy is a sum over points, differentiated by autograd.

It is written from the equations, independently of the compiled kernels and of the law that they use; only the stencils
are shared: derivatives of the displacement at every point as sums over control points. With the material derivatives
x_,1 and x_,2, F = [x_,1 | x_,2], G = (F^T F - I) / 2, n = x_,1 x x_,2 / |x_,1 x x_,2| and curvatures
kappa = (n . x_,11, n . x_,22, 2 n . x_,12) less those at rest,

    E = sum_edges A [1/2 kappa^T D kappa + s psi(G)] + sum_vertices A (1 - s) psi(G) + sum_i m_i g z_i,

psi the membrane energy of law `paper` and s the share of it that the edges carry. D at the size q of the curvatures,
q^2 = k11^2 + k22^2 + 2 k12^2, is made of means of the table's rows (warp, bias, weft),

    Bm(q) = 2 / q^2 int_0^q B(t) t dt = 2 int_0^1 B(q r) r dr:
    D11 = Bm_weft,  D22 = Bm_warp,  D12 = nu sqrt(D11 D22),  D33 = Bm_bias - (D11 + D22) / 4 - D12 / 2,

where D33 below a tenth of sqrt(D11 D22) is replaced by m phi(D33 / m), m = sqrt(D11 D22) / 20, with phi(t) = t for
t >= 2 and 2 - 4 y / (4 + y^2), y = 2 - t, below.

References:
    Cirak, Ortiz, Schroeder. Subdivision surfaces: a new paradigm for thin-shell finite-element analysis. Int. J.
    Numerical Methods in Engineering 47, 2000, Section 2.
    Timoshenko, Woinowsky-Krieger. Theory of Plates and Shells, 2nd edition, 1959, Sections 85 and 86 (orthotropy).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.engine.plate.system import EDGE_SHARE, ShellSystem
from cusick_bench.sim.reference.laws import TorchParameters
from cusick_bench.sim.reference.tables import CURVATURE_STEP, weights_bending_paper, weights_stretch_paper

_GAUSS = 1 / math.sqrt(3)  # nodes of the two-point rule, exact for the cubic pieces of B(t) t
_LEAST = 0.05  # least D33 over sqrt(D11 D22)
_TINY = 1e-20  # [1/m2] least squared curvature, since a square root has no derivative at 0


@dataclass(frozen=True)
class PlateParameters(TorchParameters):
    """One cloth as tensors, by its faces, hinges and vertices; any of them may require gradients.

    Attributes:
        poisson: Poisson's ratio nu of bending.
    """

    poisson: Float[Tensor, ""]


@dataclass(frozen=True, eq=False)
class PlateReference:
    """The shell of a system as tensors on the CPU; positions are those of control points and fixed vertices.

    Attributes:
        system: Mesh, support and stencils.
    """

    system: ShellSystem

    @cached_property
    def _edge_rows(self) -> Float[Tensor, "edges 5 rows"]:
        s = self.system.stencils
        return _dense(s.edge_nodes, s.edge_weights, len(s.free))

    @cached_property
    def _vertex_rows(self) -> Float[Tensor, "points 2 rows"]:
        s = self.system.stencils
        return _dense(s.vertex_nodes, s.vertex_weights, len(s.free))

    @cached_property
    def _matrices(self) -> dict[str, Tensor]:
        """Dense matrices from faces, hinges and vertices to points and control points, and from those to vertices."""
        names = ("stretch_of_edge", "stretch_of_vertex", "bending_of_edge", "rest_curvature", "load", "surface")
        return {name: torch.from_numpy(getattr(self.system.stencils, name).toarray()) for name in names}

    @cached_property
    def free(self) -> Int[Tensor, "rows"]:
        """Vertices whose control points move."""
        return torch.from_numpy(self.system.stencils.free)

    def frame(self, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "3 3"]:
        """The plate's plane, by least squares through the fixed vertices.

        Args:
            x: Positions [m].

        Returns:
            Rows x_,1, x_,2 of the undeformed cloth and its material origin [m].
        """
        fixed = torch.from_numpy(self.system.fixed)
        at = _with_ones(self.system.sheet.material)[fixed]
        return torch.linalg.pinv(at) @ x[fixed]

    def displacement(self, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "rows 3"]:
        """Displacements of the free control points from the undeformed cloth.

        Args:
            x: Positions [m].

        Returns:
            Displacements [m].
        """
        return x[self.free] - _with_ones(self.system.stencils.control_material) @ self.frame(x)

    def positions(self, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "vertices 3"]:
        """Points of the surface at the free vertices; fixed ones stay.

        Args:
            x: Positions of control points and fixed vertices [m].

        Returns:
            Positions of the cloth [m].
        """
        undeformed = (_with_ones(self.system.sheet.material) @ self.frame(x))[self.free]
        moved = undeformed + self._matrices["surface"][self.free] @ self.displacement(x)
        return x.index_copy(0, self.free, moved)

    def derivatives(self, x: Float[Tensor, "vertices 3"]) -> tuple[Tensor, Tensor]:
        """Material derivatives of the position.

        Args:
            x: Positions [m].

        Returns:
            x_,1, x_,2, x_,11, x_,22 and 2 x_,12 at the edges (edges, 5, 3); x_,1, x_,2 at the vertices (points, 2, 3).
        """
        u, frame = self.displacement(x), self.frame(x)
        at_edges, at_vertices = self._edge_rows @ u, self._vertex_rows @ u
        first = at_edges[:, :2] + frame[:2]
        return torch.cat([first, at_edges[:, 2:]], dim=1), at_vertices + frame[:2]

    def curvature(self, derivatives: Float[Tensor, "edges 5 3"]) -> Float[Tensor, "edges 3"]:
        """Curvatures k11, k22, 2 k12.

        Args:
            derivatives: From `derivatives`.

        Returns:
            Curvatures [1/m].
        """
        normal = torch.linalg.cross(derivatives[:, 0], derivatives[:, 1])
        return (derivatives[:, 2:] * torch.nn.functional.normalize(normal, dim=1)[:, None]).sum(2)

    def bent(self, x: Float[Tensor, "vertices 3"], p: PlateParameters) -> Float[Tensor, "edges 3"]:
        """Curvatures at the edges less those at rest.

        Args:
            x: Positions [m].
            p: The cloth.

        Returns:
            Curvatures [1/m].
        """
        return self.curvature(self.derivatives(x)[0]) - self._rest(p)

    def _rest(self, p: PlateParameters) -> Tensor:
        return (self._matrices["rest_curvature"] @ p.rest_angle).reshape(-1, 3)

    def mass(self, p: PlateParameters) -> Float[Tensor, "rows"]:
        """Masses of the free control points [kg].

        Args:
            p: The cloth.

        Returns:
            Masses.
        """
        return self._matrices["load"] @ p.mass

    def _tables(self, name: str, table: Tensor) -> Tensor:
        """Tables of the points; one table is shared by all."""
        return table if len(table) == 1 else torch.tensordot(self._matrices[name], table, dims=1)

    def bending_matrix(self, curvature: Float[Tensor, "edges 3"], p: PlateParameters) -> Float[Tensor, "edges 3 3"]:
        """D of every edge.

        Args:
            curvature: Curvatures less those at rest [1/m].
            p: The cloth.

        Returns:
            Symmetric matrices [N m].
        """
        square = curvature[:, 0] ** 2 + curvature[:, 1] ** 2 + curvature[:, 2] ** 2 / 2
        table = self._tables("bending_of_edge", p.bending)
        warp, bias, weft = (mean_weights(square)[:, None] * table).sum(2).unbind(1)
        mean = (warp * weft).sqrt()
        both = p.poisson * mean
        twist = _not_below(bias - (warp + weft) / 4 - both / 2, _LEAST * mean)
        none = torch.zeros_like(twist)
        rows = [torch.stack(row, dim=1) for row in ((weft, both, none), (both, warp, none), (none, none, twist))]
        return torch.stack(rows, dim=1)

    def bending_energy(self, curvature: Float[Tensor, "edges 3"], p: PlateParameters) -> Float[Tensor, "edges"]:
        """1/2 kappa^T D kappa of every edge.

        Args:
            curvature: Curvatures less those at rest [1/m].
            p: The cloth.

        Returns:
            Energies per area [J/m2].
        """
        return torch.einsum("pk,pkl,pl->p", curvature, self.bending_matrix(curvature, p), curvature) / 2

    def moments(self, x: Float[Tensor, "vertices 3"], p: PlateParameters) -> Float[Tensor, "edges 3"]:
        """Derivatives of the bending energy per area by the curvatures.

        Args:
            x: Positions [m].
            p: The cloth.

        Returns:
            Moments [N].
        """
        with torch.enable_grad():
            curvature = self.bent(x, p)
            curvature = curvature if curvature.requires_grad else curvature.requires_grad_()
            energy = self.bending_energy(curvature, p).sum()
            return torch.autograd.grad(energy, curvature, create_graph=True)[0]

    def _membranes(self, x: Tensor, p: PlateParameters) -> list[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """Rows, x_,1 and x_,2, k0..k3 and weighted areas of the edges' and the vertices' membrane."""
        s, (at_edges, at_vertices) = self.system.stencils, self.derivatives(x)
        parts = (
            ("stretch_of_edge", self._edge_rows[:, :2], at_edges[:, :2], EDGE_SHARE * s.edge_area),
            ("stretch_of_vertex", self._vertex_rows, at_vertices, (1 - EDGE_SHARE) * s.vertex_area),
        )
        found = []
        for name, rows, gradient, area in parts:
            weights = weights_stretch_paper(_strain(gradient))
            k = (weights[:, :, None] * self._tables(name, p.stretch)).sum(1)
            found.append((rows, gradient, k, torch.from_numpy(area)))
        return found

    def energy(self, x: Float[Tensor, "vertices 3"], p: PlateParameters) -> Float[Tensor, ""]:
        """Potential energy: bending, membrane and gravity.

        Args:
            x: Positions of control points and fixed vertices [m].
            p: The cloth.

        Returns:
            The energy [J], differentiable.
        """
        area = torch.from_numpy(self.system.stencils.edge_area)
        total = (area * self.bending_energy(self.bent(x, p), p)).sum()
        for _, gradient, k, weight in self._membranes(x, p):
            strain = _strain(gradient)
            g00, g11, g01 = strain[:, 0, 0], strain[:, 1, 1], strain[:, 0, 1]
            psi = k[:, 0] * g00**2 / 2 + k[:, 1] * g00 * g11 + k[:, 2] * g11**2 / 2 + k[:, 3] * g01**2
            total = total + (weight * psi).sum()
        return total + self.system.gravity * (self.mass(p) * x[self.free, 2]).sum()

    def forces(self, x: Float[Tensor, "vertices 3"], p: PlateParameters) -> Float[Tensor, "rows 3"]:
        """Net forces on the free control points, by autograd.

        Args:
            x: Positions [m].
            p: The cloth.

        Returns:
            Forces [N], differentiable.
        """
        with torch.enable_grad():
            x = x if x.requires_grad else x.detach().requires_grad_()
            return -torch.autograd.grad(self.energy(x, p), x, create_graph=True)[0][self.free]

    def gauss_newton(self, x: Float[Tensor, "vertices 3"], p: PlateParameters) -> Float[Tensor, "numbers numbers"]:
        """Stiffness of the implicit step over the 3 coordinates of every free control point (point-major), dense.

        Bending: B^T D B with B = d kappa / dx. Membrane: that of law `paper`,
        k0 f_uu f_uu^T + k2 f_vv f_vv^T + k1 (f_uu f_vv^T + f_vv f_uu^T) + k3 / 2 f_uv f_uv^T + g_uu D_uu + g_vv D_vv
        with g_uu = max(k0 G00+ + k1 G11+, 0), g_vv = max(k2 G11+ + k1 G00+, 0), G+ = max(G, 0).

        Args:
            x: Positions [m].
            p: The cloth.

        Returns:
            The matrix [N/m], differentiable.
        """
        with torch.enable_grad():
            x = x if x.requires_grad else x.detach().requires_grad_()
            return self._bending_stiffness(x, p) + sum(
                self._membrane_stiffness(*part) for part in self._membranes(x, p)
            )

    def _bending_stiffness(self, x: Tensor, p: PlateParameters) -> Tensor:
        y = self.derivatives(x)[0]
        curvature = self.curvature(y)
        slopes = [torch.autograd.grad(column.sum(), y, create_graph=True)[0] for column in curvature.unbind(1)]
        by_nodes = torch.einsum("pkrc,prn->pknc", torch.stack(slopes, dim=1), self._edge_rows).flatten(2)
        area = torch.from_numpy(self.system.stencils.edge_area)
        matrix = area[:, None, None] * self.bending_matrix(curvature - self._rest(p), p)
        return by_nodes.flatten(0, 1).mT @ (matrix @ by_nodes).flatten(0, 1)

    @staticmethod
    def _membrane_stiffness(rows: Tensor, gradient: Tensor, k: Tensor, area: Tensor) -> Tensor:
        (s_u, s_v), (x_u, x_v) = rows.unbind(1), gradient.unbind(1)
        f_uu, f_vv = _columns(s_u, x_u), _columns(s_v, x_v)
        f_uv = _columns(s_u, x_v) + _columns(s_v, x_u)
        k0, k1, k2, k3 = (area[:, None] * k).unbind(1)
        strain = _strain(gradient)
        plus0, plus1 = strain[:, 0, 0].clamp(min=0), strain[:, 1, 1].clamp(min=0)
        g_uu, g_vv = (k0 * plus0 + k1 * plus1).clamp(min=0), (k2 * plus1 + k1 * plus0).clamp(min=0)
        tension = s_u.mT @ (g_uu[:, None] * s_u) + s_v.mT @ (g_vv[:, None] * s_v)
        stiffness = torch.kron(tension, torch.eye(3, dtype=tension.dtype))
        pairs = ((k0, f_uu, f_uu), (k2, f_vv, f_vv), (k1, f_uu, f_vv), (k1, f_vv, f_uu), (k3 / 2, f_uv, f_uv))
        for factor, left, right in pairs:
            stiffness = stiffness + left.mT @ (factor[:, None] * right)
        return stiffness

    def drop(
        self, p: PlateParameters, start: Float[Tensor, "vertices 3"], *, steps: int, step_seconds: float
    ) -> Float[Tensor, "vertices 3"]:
        """Drops the cloth from rest by (M + h^2 K) v' = M v + h F, x' = x + h v', differentiated by autograd.

        Args:
            p: The cloth.
            start: Control points and fixed vertices at the start [m].
            steps: Number of steps.
            step_seconds: Step h [s].

        Returns:
            Last control points [m], with gradients to every parameter and to `start`.
        """
        h, mass, x = step_seconds, self.mass(p)[:, None], start
        v = torch.zeros((len(self.free), 3), dtype=start.dtype)
        for _ in range(steps):
            matrix = torch.diag(mass.expand(-1, 3).flatten()) + h * h * self.gauss_newton(x, p)
            right = (mass * v + h * self.forces(x, p)).flatten()
            v = torch.linalg.solve(matrix, right).reshape(-1, 3)
            x = x.index_add(0, self.free, h * v)
        return x


def mean_weights(square: Float[Tensor, "edges"]) -> Float[Tensor, "edges 5"]:
    """Weights of the samples of B in 2 int_0^1 B(q r) r dr, by Gauss-Legendre between knots of the spline (exact).

    Args:
        square: q^2 [1/m2].

    Returns:
        Weights of the five samples; they sum to 1.
    """
    size = square.clamp(min=_TINY).sqrt()
    stops = [((n + 0.5) * CURVATURE_STEP / size).clamp(max=1) for n in range(5)] + [torch.ones_like(size)]
    total, start = torch.zeros((len(size), 5), dtype=size.dtype), torch.zeros_like(size)
    for stop in stops:
        middle, half = (start + stop) / 2, (stop - start) / 2
        for r in (middle - _GAUSS * half, middle + _GAUSS * half):
            total = total + (2 * half * r)[:, None] * weights_bending_paper(size * r)
        start = stop
    return total


def _not_below(value: Tensor, least: Tensor) -> Tensor:
    """least * phi(value / least), see the module."""
    t = value / least
    y = 2 - t
    return least * torch.where(t >= 2, t, 2 - 4 * y / (4 + y**2))


def _strain(gradient: Float[Tensor, "points 2 3"]) -> Float[Tensor, "points 2 2"]:
    return (gradient @ gradient.mT - torch.eye(2, dtype=gradient.dtype)) / 2


def _columns(row: Float[Tensor, "points rows"], x: Float[Tensor, "points 3"]) -> Float[Tensor, "points numbers"]:
    return (row[:, :, None] * x[:, None]).flatten(1)


def _with_ones(material: Float[ndarray, "points 2"]) -> Float[Tensor, "points 3"]:
    return torch.from_numpy(np.column_stack([material, np.ones(len(material))]))


def _dense(nodes: ndarray, weights: ndarray, columns: int) -> Tensor:
    """Rows of padded stencils as full rows (padding has weight 0)."""
    full = np.zeros((*weights.shape[:2], columns))
    point, row = np.ogrid[: len(weights), : weights.shape[1]]
    np.add.at(full, (point[:, :, None], row[:, :, None], nodes[:, None, :]), weights)
    return torch.from_numpy(full)
