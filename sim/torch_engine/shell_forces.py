"""Forces, Gauss-Newton stiffness and adjoint products of many cloths under law `plate`, on any device.

At a quadrature point everything depends on the material derivatives of the position, y = (x_,1, x_,2) and at edges also
(x_,11, x_,22, 2 x_,12), which are fixed sums over control points: y = W u + base. There are strain measures e_t(y)
with conjugate forces m_t and stiffness C_tq: at edges the curvatures kappa with moments and A D, with
n = x_,1 x x_,2 / J and c_k = (s_k - (n . s_k) n) / J, s = (x_,11, x_,22, 2 x_,12),

    d kappa_k / d s_k = n,   d kappa_k / d x_,1 = x_,2 x c_k,   d kappa_k / d x_,2 = c_k x x_,1,

and at edges and vertices the membrane's, with d e_0 = x_,1 . dx_,1, d e_1 = x_,2 . dx_,2, d e_2 = x_,1 . dx_,2 +
x_,2 . dx_,1 and A [[k0, k1, 0], [k1, k2, 0], [0, 0, k3 / 2]]. With b_ti = sum_r W_ri d e_t / d y_r the force on node i
is - sum_t m_t b_ti and the stiffness between nodes i and j sum_tq C_tq b_ti b_qj^T, to which stretched directions add
the membrane's geometric stiffness. The adjoint differentiates S = force_factor lambda . F - stiffness_factor lambda .
K v at the points, where lambda and v have derivatives of their own.

References:
    Cirak, Ortiz, Schroeder. Subdivision surfaces: a new paradigm for thin-shell finite-element analysis. Int. J.
    Numerical Methods in Engineering 47, 2000: energy of the shell, Section 2.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.engine.plate.system import EDGE_SHARE, ShellSystem
from cusick_bench.sim.laws.tables import CURVATURE_STEP
from cusick_bench.sim.torch_engine.forces import BatchParameters
from cusick_bench.sim.torch_engine.gather import GatherProducts, GatherSum
from cusick_bench.sim.torch_engine.laws import stretch, tension
from cusick_bench.sim.torch_engine.plate import bending_matrix, plate_stiffness
from cusick_bench.sim.torch_engine.small_products import small_product, small_times_vector

_MEMBRANE = "paper"  # law `plate` has the membrane of law `paper`
_FORWARD_NUMBERS, _ADJOINT_NUMBERS = 110, 110  # alive at once per node of a point (measured: at most 97)


@dataclass(frozen=True, eq=False)
class _Points:
    """Stencils of the quadrature points of one kind, on a device."""

    nodes: Int[Tensor, "points width"]
    weights: Float[Tensor, "points rows width"]
    area: Float[Tensor, "points"]
    blocks: GatherProducts

    def derivatives(self, field: Float[Tensor, "members nodes 3"]) -> Float[Tensor, "members points rows 3"]:
        """sum_i W_ri field_i."""
        return small_product(self.weights, field[:, self.nodes])

    def spread(self, by_y: Float[Tensor, "members points rows 3"]) -> Float[Tensor, "members nodes 3"]:
        """Derivatives by the nodes of all points from those by y."""
        return small_product(self.weights.mT, by_y).flatten(1, 2)

    def node_vectors(self, slopes: Float[Tensor, "members points terms rows 3"]) -> Tensor:
        """b_ti (members, points, width, terms, 3)."""
        by_row = slopes.transpose(2, 3).flatten(3)
        vectors = small_product(self.weights[:, : slopes.shape[3]].mT, by_row)
        return vectors.unflatten(3, (slopes.shape[2], 3))


@dataclass(frozen=True, eq=False)
class _Strains:
    """Strain measures at points: their gradients by y, conjugate forces and stiffness, both times the area."""

    slopes: Float[Tensor, "members points terms rows 3"]
    force: Float[Tensor, "members points terms"]
    stiffness: Float[Tensor, "members points terms terms"]

    def change(self, z: Float[Tensor, "members points rows 3"]) -> Float[Tensor, "members points terms"]:
        """Changes of the strains where y changes by z."""
        return (self.slopes * z[:, :, None, : self.slopes.shape[3]]).sum((3, 4))


class TorchShell:
    """A shell for batches on one device; see the module for the equations. It offers what `TorchForces` does.

    Attributes:
        system: Mesh, support and stencils.
        device: Where tensors live.
        slots: Slots of the layout that `evaluate` fills, in its order.
        diagonal: Place of every free control point's diagonal block among them.
        free, fixed: Vertices whose control points move, and those on the plate.
        flat: Control points of the undeformed cloth [m].
    """

    def __init__(self, system: ShellSystem, device: str, slots: Int[ndarray, "slots"] | None = None) -> None:
        """Copies stencils and lays out the gathers.

        Args:
            system: Mesh, support and stencils.
            device: Where tensors live.
            slots: Slots of the layout that are needed, diagonal ones among them; all by default.
        """
        s, layout = system.stencils, system.layout
        self.system, self.device = system, device
        self.slots = np.arange(len(layout.indices)) if slots is None else slots
        place = np.full(len(layout.indices), -1)
        place[self.slots] = np.arange(len(self.slots))
        self.diagonal, self.free = self._put(place[layout.diagonal]), self._put(system.free)
        self.fixed = self._put(np.flatnonzero(system.fixed))
        self._edges = self._points(s.edge_nodes, s.edge_counts, s.edge_weights, s.edge_area, place)
        self._vertices = self._points(s.vertex_nodes, s.vertex_counts, s.vertex_weights, s.vertex_area, place)
        self._nodes = self._node_sums()
        at, control = system.sheet.material[system.fixed], s.control_material
        self._plate_frame = self._put(np.linalg.pinv(np.column_stack([at, np.ones(len(at))])))
        self._plate_row = self._put(np.column_stack([control, np.ones(len(control))]))
        flat = system.sheet.flat.copy()
        flat[system.free, :2] = control
        self.flat = self._put(flat)
        self._turn = self._put(np.array([1.0, 1.0, 0.5]) / CURVATURE_STEP**2)  # half of dS / dk, over k

    def _put(self, array: ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(array), device=self.device)

    def _points(self, nodes: ndarray, counts: ndarray, weights: ndarray, area: ndarray, place: ndarray) -> _Points:
        """Stencils on the device, and which slot every pair of nodes adds to."""
        layout, width = self.system.layout, nodes.shape[1]
        used = np.arange(width) < counts[:, None]
        point, i, j = np.nonzero(used[:, :, None] & used[:, None, :])
        rows = len(self.system.free)
        keys = np.repeat(np.arange(rows), np.diff(layout.indptr)) * rows + layout.indices
        target = place[np.searchsorted(keys, nodes[point, i] * rows + nodes[point, j])]
        kept = target >= 0
        left, right = (point * width + i)[kept], (point * width + j)[kept]
        blocks = GatherProducts(target[kept], left, right, len(self.slots), self.device)
        return _Points(self._put(nodes), self._put(weights), self._put(area), blocks)

    def _node_sums(self) -> GatherSum:
        """From vectors of all nodes of edges, then vertices, to the free control points."""
        s, rows, sources, behind = self.system.stencils, [], [], 0
        for nodes, counts in ((s.edge_nodes, s.edge_counts), (s.vertex_nodes, s.vertex_counts)):
            used = np.arange(nodes.shape[1]) < counts[:, None]
            rows.append(nodes[used])
            sources.append(behind + np.flatnonzero(used))
            behind += nodes.size
        return GatherSum(np.concatenate(rows), np.concatenate(sources), len(self.system.free), self.device)

    @property
    def shapes(self) -> dict[str, tuple[tuple[int, ...] | int, ...]]:
        """Shapes of a member's parameters; a table for each point or one for all."""
        edges, points, vertices = self.system.edges, self.system.points, self.system.mesh.vertices
        return {
            "stretch": ((points, 1), 6, 4), "bending": ((edges, 1), 3, 5), "mass": (vertices,),
            "rest_angle": (3 * edges,), "poisson": (),
        }  # fmt: skip

    def numbers(self, *, differentiate: bool) -> int:
        """Numbers of one member that are alive at once while its points are evaluated.

        Args:
            differentiate: Whether there will be gradients.

        Returns:
            Their count.
        """
        nodes = self._edges.nodes.numel() + self._vertices.nodes.numel()
        return (_ADJOINT_NUMBERS if differentiate else _FORWARD_NUMBERS) * nodes

    def _derivatives(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """y at edges (members, edges, 5, 3) and at vertices (members, points, 2, 3)."""
        frame = self._plate_frame @ x[:, self.fixed]
        u = x[:, self.free] - self._plate_row @ frame
        at_edges, at_vertices = self._edges.derivatives(u), self._vertices.derivatives(u)
        at_edges[:, :, :2] += frame[:, None, :2]
        at_vertices += frame[:, None, :2]
        return at_edges, at_vertices

    def _bending(self, y: Tensor, p: BatchParameters) -> _Strains:
        x_u, x_v, second = y[:, :, 0], y[:, :, 1], y[:, :, 2:]
        across = torch.linalg.cross(x_u, x_v)
        length = torch.linalg.vector_norm(across, dim=2, keepdim=True)
        n = (across / length).unsqueeze(2)
        value = (n * second).sum(3)
        c = (second - value.unsqueeze(3) * n) / length.unsqueeze(3)
        by_u, by_v = torch.linalg.cross(x_v.unsqueeze(2), c), torch.linalg.cross(c, x_u.unsqueeze(2))
        unit = torch.eye(3, dtype=y.dtype, device=y.device)
        slopes = torch.cat([torch.stack([by_u, by_v], dim=3), unit[:, :, None] * n.unsqueeze(3)], dim=3)
        k = value - p.rest_angle.unflatten(1, (-1, 3))
        turn = k * self._turn
        d, d1 = (bending_matrix(e) for e in plate_stiffness((k * turn).sum(2), p.bending, p.poisson))
        along = small_times_vector(d, k)
        change = (k * small_times_vector(d1, k)).sum(2, keepdim=True)
        area = self._edges.area[:, None]
        return _Strains(slopes, area * (along + change * turn), area.unsqueeze(2) * d)

    @staticmethod
    def _membrane(y: Tensor, table: Tensor, area: Tensor) -> tuple[_Strains, Tensor]:
        """Strains, and geometric stiffness (members, points, 2) of x_,1 and x_,2 times the area."""
        x_u, x_v = y[:, :, 0], y[:, :, 1]
        none, area = torch.zeros_like(x_u), area[:, None]
        rows = ((x_u, none), (none, x_v), (x_v, x_u))
        slopes = torch.stack([torch.stack(row, dim=2) for row in rows], dim=2)
        strain = (((x_u * x_u).sum(2) - 1) / 2, ((x_v * x_v).sum(2) - 1) / 2, (x_u * x_v).sum(2) / 2)
        k, (s0, s1, s2) = stretch(_MEMBRANE, strain, table)
        k0, k1, k2, k3 = k.unbind(2)
        stiffness = bending_matrix((k0, k2, k1, k3 / 2))
        hold = torch.stack(tension(_MEMBRANE, k, strain), dim=2)
        force = torch.stack([s0, s1, s2 / 2], dim=2)
        return _Strains(slopes, area * force, area.unsqueeze(2) * stiffness), area * hold

    def _strains(
        self, at_edges: Tensor, at_vertices: Tensor, p: BatchParameters
    ) -> list[tuple[_Points, list[_Strains], Tensor]]:
        """Strains of the edges and of the vertices, and their geometric stiffness."""
        edges, vertices, table = self._edges, self._vertices, p.stretch
        first, last = (
            (table, table) if table.shape[1] == 1 else (table[:, : len(edges.area)], table[:, len(edges.area) :])
        )
        at_edge, hold = self._membrane(at_edges[:, :, :2], first, EDGE_SHARE * edges.area)
        at_vertex, held = self._membrane(at_vertices, last, (1 - EDGE_SHARE) * vertices.area)
        return [(edges, [self._bending(at_edges, p), at_edge], hold), (vertices, [at_vertex], held)]

    def evaluate(
        self, x: Float[Tensor, "members vertices 3"], anchor: Float[Tensor, "#members vertices 3"],
        p: BatchParameters,
    ) -> tuple[Float[Tensor, "members vertices 3"], Float[Tensor, "members slots 3 3"]]:  # fmt: skip
        """Forces on the free control points [N] and stiffness blocks in the wanted slots [N/m].

        Args:
            x: Control points and fixed vertices [m].
            anchor: Not used; there are no springs.
            p: The cloths, by quadrature points.
        """
        with torch.no_grad():
            blocks = x.new_zeros((len(x), len(self.slots), 3, 3))
            on_nodes, hold_of_slots = [], x.new_zeros((len(x), len(self.slots)))
            for points, strains, hold in self._strains(*self._derivatives(x), p):
                left = [points.node_vectors(one.slopes) for one in strains]
                pushes = [(one.force[:, :, None, :, None] * b).sum(3) for one, b in zip(strains, left, strict=True)]
                on_nodes.append(-sum(pushes[1:], pushes[0]).flatten(1, 2))
                right = [small_product(one.stiffness.unsqueeze(2), b) for one, b in zip(strains, left, strict=True)]
                pair = (torch.cat(terms, dim=3).flatten(1, 2) for terms in (left, right))
                blocks += points.blocks.outer(*pair)
                slope = points.weights[:, :2].mT  # (points, width, 2)
                hold_of_slots += points.blocks.inner(slope.flatten(0, 1), (hold.unsqueeze(2) * slope).flatten(1, 2))
            blocks.diagonal(dim1=2, dim2=3).add_(hold_of_slots.unsqueeze(2))
            force = torch.zeros_like(x).index_copy(1, self.free, self._nodes(torch.cat(on_nodes, dim=1)))
            force[:, self.free, 2] -= self.system.gravity * p.mass[:, self.free]
        return force, blocks

    def add_diagonal(
        self, blocks: Float[Tensor, "members slots 3 3"], amount: Float[Tensor, "#members vertices"]
    ) -> None:
        """Adds amount[i] times the identity to the diagonal block of every free control point, in place.

        Args:
            blocks: Blocks in the layout's slots [N/m]; changed.
            amount: A number for every vertex [N/m].
        """
        blocks.diagonal(dim1=2, dim2=3)[:, self.diagonal] += amount[:, self.free, None]

    def adjoint(
        self,
        x: Float[Tensor, "members vertices 3"],
        multiplier: Float[Tensor, "members vertices 3"],
        velocity: Float[Tensor, "members vertices 3"],
        p: BatchParameters,
        *,
        force_factor: float,
        stiffness_factor: float,
    ) -> tuple[Float[Tensor, "members vertices 3"], Float[Tensor, "members vertices 3"], BatchParameters]:
        """Derivatives of S = force_factor lambda . F - stiffness_factor lambda . K v at fixed lambda and v.

        Args:
            x: Control points and fixed vertices [m].
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: The cloths, by quadrature points.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the Gauss-Newton stiffness.

        Returns:
            dS/dx per member, zeros for the anchors, and dS/d(parameters) in the shapes of `p`, summed where shared.
        """
        at = self._derivatives(x)
        leaves = (*at, p.stretch, p.bending, p.rest_angle, p.poisson)
        leaves = tuple(leaf.detach().requires_grad_() for leaf in leaves)
        along, across = multiplier[:, self.free], velocity[:, self.free]
        with torch.enable_grad():
            held = BatchParameters(leaves[2], leaves[3], p.mass, leaves[4], leaves[5])
            s = self._product(leaves[0], leaves[1], held, along, across, force_factor, stiffness_factor)
        by_edges, by_vertices, *by = torch.autograd.grad(s, leaves)
        by_mass = torch.zeros_like(x[:, :, 0])
        by_mass[:, self.free] = -force_factor * self.system.gravity * along[:, :, 2]
        by_mass = by_mass if len(p.mass) > 1 else by_mass.sum(0, keepdim=True)
        by_x = self._by_configuration(x, by_edges, by_vertices)
        return by_x, torch.zeros_like(x), BatchParameters(by[0], by[1], by_mass, by[2], by[3])

    def _product(
        self, at_edges: Tensor, at_vertices: Tensor, p: BatchParameters, along: Tensor, across: Tensor, h: float,
        hh: float,
    ) -> Tensor:  # fmt: skip
        """S without gravity, summed over the batch."""
        total = at_edges.new_zeros(())
        for points, strains, hold in self._strains(at_edges, at_vertices, p):
            l, v = points.derivatives(along), points.derivatives(across)
            for one in strains:
                by_l, by_v = one.change(l), one.change(v)
                reaction = h * one.force + hh * small_times_vector(one.stiffness, by_v)
                total = total - (by_l * reaction).sum()
            total = total - hh * (hold * (l * v)[:, :, :2].sum(3)).sum()
        return total

    def _by_configuration(self, x: Tensor, by_edges: Tensor, by_vertices: Tensor) -> Tensor:
        """Derivatives by control points and fixed vertices from those by y."""
        by_u = self._nodes(torch.cat([self._edges.spread(by_edges), self._vertices.spread(by_vertices)], dim=1))
        by_frame = -(self._plate_row.mT @ by_u)
        by_frame[:, :2] += by_edges[:, :, :2].sum(1) + by_vertices.sum(1)
        by_x = torch.zeros_like(x).index_copy(1, self.free, by_u)
        return by_x.index_copy(1, self.fixed, self._plate_frame.mT @ by_frame)
