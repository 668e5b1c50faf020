"""Forces, Gauss-Newton stiffness and adjoint products of many cloths on one mesh, in closed form, on any device.

Faces, with x_u, x_v the columns of the deformation gradient and stress (S0, S1, S2) = d psi / d (G00, G11, G01):
force on corner a is -A [s_u[a] (S0 x_u + S2 x_v / 2) + s_v[a] (S1 x_v + S2 x_u / 2)]; the stiffness block of corners
a, b is A sum_pq s_p[a] s_q[b] K_pq over p, q in {u, v}, where

    K_uu = k0 x_u x_u^T + k3 / 2 x_v x_v^T + g_uu I,    K_vv = k2 x_v x_v^T + k3 / 2 x_u x_u^T + g_vv I,
    K_uv = K_vu^T = k1 x_u x_v^T + k3 / 2 x_v x_u^T

Hinges, with dihedral angle theta, t = theta - rest angle and M = weight B t: force -M grad theta, stiffness
(M / t) grad theta grad theta^T. The adjoint differentiates S = force_factor lambda . F - stiffness_factor lambda . K v,
element by element and without blocks; sums over elements are gathers, in an order that never changes.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3-5.
    Tamstorf, Grinspun. Discrete bending forces and their Jacobians. Graphical Models 75(6), 2013: grad theta.
"""

from dataclasses import dataclass, field, fields

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.torch_engine.gather import GatherOuter, GatherSum
from cusick_bench.sim.torch_engine.laws import Strain, bending, stretch, tension
from cusick_bench.sim.torch_engine.small_products import small_product

_FORWARD_NUMBERS, _ADJOINT_NUMBERS = 140, 220  # alive at once per face and per hinge (measured: at most 122 and 201)


@dataclass(frozen=True, eq=False)
class BatchParameters:
    """Parameters of several cloths; a leading axis of 1 is shared by all members, as is an element axis of 1.

    Attributes:
        stretch: C [N/m].
        bending: B [N m].
        mass: Vertex masses [kg].
        rest_angle: Stress-free dihedral angles [rad]; of a shell's points the curvatures at rest [1/m].
        poisson: Poisson's ratio of bending, which law `plate` has.
    """

    stretch: Float[Tensor, "#members #faces 6 4"]
    bending: Float[Tensor, "#members #hinges 3 5"]
    mass: Float[Tensor, "#members vertices"]
    rest_angle: Float[Tensor, "#members rest_angles"]
    poisson: Float[Tensor, "#members"] = field(default_factory=lambda: torch.zeros(1, dtype=torch.float64))

    def member(self, first: int, end: int) -> "BatchParameters":
        """Members first to end - 1.

        Args:
            first: First member.
            end: One beyond the last member.

        Returns:
            Their parameters, in the same memory.
        """
        tensors = (getattr(self, one.name) for one in fields(self))
        return BatchParameters(*(value if len(value) == 1 else value[first:end] for value in tensors))

    def take(self, members: Int[Tensor, "some"]) -> "BatchParameters":
        """Some cloths of this batch.

        Args:
            members: Places of the cloths in the batch.

        Returns:
            Their parameters, with gradients.
        """
        tensors = (getattr(self, one.name) for one in fields(self))
        return BatchParameters(*(value if len(value) == 1 else value[members.to(value.device)] for value in tensors))


def _dot(first: Tensor, second: Tensor) -> Tensor:
    return (first * second).sum(-1)


def _outer(first: Tensor, second: Tensor) -> Tensor:
    return first.unsqueeze(-1) * second.unsqueeze(-2)


def _of_corners(corners: Float[Tensor, "members hinges 4 3"]) -> tuple[Tensor, Tensor]:
    """Dihedral angles (members, hinges) and their gradients (members, hinges, 4, 3)."""
    start, end, left, right = corners.unbind(2)
    e, p, r = end - start, left - start, right - start
    n0, n1 = torch.linalg.cross(e, p), torch.linalg.cross(r, e)
    square = _dot(e, e)
    length = square.sqrt()
    angle = torch.atan2(-length * _dot(p, n1), _dot(n0, n1))
    by_left, by_right = (-(length / _dot(n, n)).unsqueeze(2) * n for n in (n0, n1))
    t0, t1 = (_dot(leg, e).div(square).unsqueeze(2) for leg in (p, r))
    by_end = -(t0 * by_left + t1 * by_right)
    return angle, torch.stack([-(by_end + by_left + by_right), by_end, by_left, by_right], dim=2)


class TorchForces:
    """A drape system for batches on one device; see the module for the equations.

    Attributes:
        system: Mesh, law and support.
        device: Where tensors live.
        slots: Slots of the layout that `evaluate` fills, in its order.
        diagonal: Place of every free vertex's diagonal block among them.
        free: Vertices that move.
        spring: Stiffness of each vertex's spring to its anchor [N/m].
        flat: The undeformed cloth [m].
    """

    def __init__(self, system: DrapeSystem, device: str, slots: Int[ndarray, "slots"] | None = None) -> None:
        """Copies element constants and lays out the gathers.

        Args:
            system: Mesh, law and support.
            device: Where tensors live.
            slots: Slots of the layout that are needed, diagonal ones among them; all by default.
        """
        el, layout = system.elements, system.layout
        self.system, self.device = system, device
        self.slots = np.arange(len(layout.indices)) if slots is None else slots

        def put(array: ndarray) -> Tensor:
            return torch.as_tensor(np.ascontiguousarray(array), device=device)

        self.faces, self.hinges, self.area = put(el.faces), put(el.hinges), put(el.face_area)
        self.columns = put(np.stack([el.face_u, el.face_v], axis=1))
        self.curvature, self.weight = put(el.hinge_scale), put(el.hinge_weight)
        # the published hinge stiffness is a quarter of the one that gives a plate the tabulated bending stiffness
        self.weight = self.weight * (1.0 if system.law == "paper" else 0.25)
        low, fraction = el.direction_low[:, None], el.direction_fraction[:, None]
        index = np.arange(3)
        self.direction = put((index == low) * (1 - fraction) + (index == low + 1) * fraction)
        self.free, self.spring, self.flat = put(system.free), put(system.spring), put(system.mesh.flat)
        self._lay_out()

    def _lay_out(self) -> None:
        el, layout, vertices = self.system.elements, self.system.layout, self.system.mesh.vertices
        place = np.full(len(layout.indices), -1)
        place[self.slots] = np.arange(len(self.slots))
        self.diagonal = torch.as_tensor(place[layout.diagonal], device=self.device)
        self._face_corners, self._hinge_corners = (
            GatherSum(corners.ravel(), np.arange(corners.size), vertices, self.device)
            for corners in (el.faces, el.hinges)
        )
        target = place[np.repeat(np.arange(len(layout.indices)), np.diff(layout.contribution_ptr))]
        source, behind = layout.contributions, 9 * len(el.faces)
        face, hinge = (target >= 0) & (source < behind), (target >= 0) & (source >= behind)
        self._face_blocks = GatherSum(target[face], source[face], len(self.slots), self.device)
        self._hinge_blocks = GatherOuter(target[hinge], source[hinge] - behind, len(self.slots), 4, self.device)

    @property
    def shapes(self) -> dict[str, tuple[tuple[int, ...] | int, ...]]:
        """Shapes of a member's parameters; a table for each element or one for all."""
        faces, hinges, vertices = (len(self.faces), 1), (len(self.hinges), 1), self.system.mesh.vertices
        return {
            "stretch": (faces, 6, 4), "bending": (hinges, 3, 5), "mass": (vertices,), "rest_angle": (hinges[0],),
            "poisson": (),
        }  # fmt: skip

    def numbers(self, *, differentiate: bool) -> int:
        """Numbers of one member that are alive at once while its elements are evaluated.

        Args:
            differentiate: Whether there will be gradients.

        Returns:
            Their count.
        """
        each = _ADJOINT_NUMBERS if differentiate else _FORWARD_NUMBERS
        return each * (len(self.faces) + len(self.hinges))

    def _gather(self, on_faces: Tensor, on_hinges: Tensor) -> Float[Tensor, "members vertices 3"]:
        return self._face_corners(on_faces.flatten(1, 2)) + self._hinge_corners(on_hinges.flatten(1, 2))

    def _columns_of(self, corners: Float[Tensor, "members faces 3 3"]) -> tuple[Tensor, Tensor]:
        """sum_a s_u[a] y_a and sum_a s_v[a] y_a of a vertex field (members, faces, 3)."""
        u, v = small_product(self.columns, corners).unbind(2)
        return u, v

    def _face_state(self, corners: Tensor, table: Tensor) -> tuple[Tensor, Tensor, Strain, Tensor, Strain]:
        x_u, x_v = self._columns_of(corners)
        strain = ((_dot(x_u, x_u) - 1) / 2, (_dot(x_v, x_v) - 1) / 2, _dot(x_u, x_v) / 2)
        k, stress = stretch(self.system.law, strain, table)
        return x_u, x_v, strain, k, stress

    def _hinge_state(self, corners: Tensor, p: BatchParameters) -> tuple[Tensor, Tensor, Tensor]:
        """t, grad theta and M / t of every hinge."""
        bent, gradient = _of_corners(corners)
        t = bent - p.rest_angle
        rows = torch.einsum("hd,mhds->mhs", self.direction, p.bending)
        return t, gradient, self.weight * bending(self.system.law, self.curvature * t, rows)

    def evaluate(
        self, x: Float[Tensor, "members vertices 3"], anchor: Float[Tensor, "#members vertices 3"],
        p: BatchParameters,
    ) -> tuple[Float[Tensor, "members vertices 3"], Float[Tensor, "members slots 3 3"]]:  # fmt: skip
        """Forces on all vertices [N] and stiffness blocks of the free ones in the wanted slots [N/m].

        Args:
            x: Positions [m].
            anchor: Where the springs hold [m].
            p: The cloths.
        """
        with torch.no_grad():
            on_faces, face_blocks = self._faces(x[:, self.faces], p.stretch)
            t, gradient, stiffness = self._hinge_state(x[:, self.hinges], p)
            pull = stiffness[:, :, None, None] * gradient
            force = self._gather(on_faces, -t[:, :, None, None] * pull)
            force[:, :, 2] -= self.system.gravity * p.mass
            force -= self.spring[:, None] * (x - anchor)
            blocks = self._face_blocks(face_blocks)
            blocks += self._hinge_blocks.outer(pull.flatten(1, 2), gradient.flatten(1, 2))
            self.add_diagonal(blocks, self.spring[None])
        return force, blocks

    def _faces(self, corners: Tensor, table: Tensor) -> tuple[Tensor, Tensor]:
        """Forces (members, faces, 3, 3) and blocks (members, 9 faces, 3, 3)."""
        x_u, x_v, strain, k, (s0, s1, s2) = self._face_state(corners, table)
        s0, s1, s2 = (s[:, :, None] for s in (s0, s1, s2))
        both = torch.stack([s0 * x_u + s2 / 2 * x_v, s1 * x_v + s2 / 2 * x_u], dim=2)
        weights = self.area[:, None, None] * self.columns  # A s_p[a]
        force = -small_product(weights.mT, both)
        k0, k1, k2, k3 = (one[:, :, None, None] for one in k.unbind(2))
        g_uu, g_vv = (g[:, :, None, None] for g in tension(self.system.law, k, strain))
        uu, vv, uv = _outer(x_u, x_u), _outer(x_v, x_v), _outer(x_u, x_v)
        unit = torch.eye(3, dtype=x_u.dtype, device=x_u.device)
        across = k1 * uv + k3 / 2 * uv.mT
        four = [k0 * uu + k3 / 2 * vv + g_uu * unit, across, across.mT, k2 * vv + k3 / 2 * uu + g_vv * unit]
        pairs = torch.einsum("fpa,fqb->pqfab", weights, self.columns).reshape(4, -1, 9, 1, 1)  # A s_p[a] s_q[b]
        blocks = pairs[0] * four[0].unsqueeze(2)
        for pair, one in zip(pairs[1:], four[1:], strict=True):
            blocks.addcmul_(pair, one.unsqueeze(2))
        return force, blocks.flatten(1, 2)

    def add_diagonal(
        self, blocks: Float[Tensor, "members slots 3 3"], amount: Float[Tensor, "#members vertices"]
    ) -> None:
        """Adds amount[i] times the identity to the diagonal block of every free vertex, in place.

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
            x: Positions [m].
            multiplier: lambda; zero at fixed vertices.
            velocity: v [m/s].
            p: The cloths.
            force_factor: Factor of the forces.
            stiffness_factor: Factor of the Gauss-Newton stiffness.

        Returns:
            dS/dx and dS/d(anchor) per member, and dS/d(parameters) in the shapes of `p`, summed where shared.
        """
        on_faces, on_hinges = x[:, self.faces].detach(), x[:, self.hinges].detach()
        leaves = (on_faces, on_hinges, p.stretch.detach(), p.bending.detach(), p.rest_angle.detach())
        leaves = tuple(leaf.requires_grad_() for leaf in leaves)
        factors = (force_factor, stiffness_factor)
        with torch.enable_grad():
            s = self._product_faces(leaves[0], multiplier, velocity, leaves[2], *factors)
            held = BatchParameters(leaves[2], leaves[3], p.mass, leaves[4])
            s = s + self._product_hinges(leaves[1], multiplier, velocity, held, *factors)
        by_faces, by_hinges, by_stretch, by_bending, by_rest = torch.autograd.grad(s, leaves)
        by_mass = -force_factor * self.system.gravity * multiplier[:, :, 2]
        by_mass = by_mass if len(p.mass) > 1 else by_mass.sum(0, keepdim=True)
        pull = force_factor * self.spring[:, None] * multiplier
        by_x = self._gather(by_faces, by_hinges) - pull
        by = BatchParameters(by_stretch, by_bending, by_mass, by_rest, torch.zeros_like(p.poisson))
        return by_x, pull, by

    def _product_faces(
        self, corners: Tensor, multiplier: Tensor, velocity: Tensor, table: Tensor, h: float, hh: float
    ) -> Tensor:
        """The faces' share of S, summed over the batch."""
        x_u, x_v, strain, k, (s0, s1, s2) = self._face_state(corners, table)
        l_u, l_v = self._columns_of(multiplier[:, self.faces])
        v_u, v_v = self._columns_of(velocity[:, self.faces])
        a, b, c = _dot(x_u, l_u), _dot(x_v, l_v), _dot(x_v, l_u) + _dot(x_u, l_v)  # f_uu . lambda, f_vv . , f_uv .
        d, e, f = _dot(x_u, v_u), _dot(x_v, v_v), _dot(x_v, v_u) + _dot(x_u, v_v)
        k0, k1, k2, k3 = k.unbind(2)
        g_uu, g_vv = tension(self.system.law, k, strain)
        stiff = k0 * a * d + k2 * b * e + k1 * (a * e + b * d) + k3 / 2 * c * f
        stiff = stiff + g_uu * _dot(l_u, v_u) + g_vv * _dot(l_v, v_v)
        return -(self.area * (h * (s0 * a + s1 * b + s2 / 2 * c) + hh * stiff)).sum()

    def _product_hinges(
        self, corners: Tensor, multiplier: Tensor, velocity: Tensor, p: BatchParameters, h: float, hh: float
    ) -> Tensor:
        """The hinges' share of S, summed over the batch."""
        t, gradient, stiffness = self._hinge_state(corners, p)
        along = (gradient * multiplier[:, self.hinges]).sum((2, 3))
        across = (gradient * velocity[:, self.hinges]).sum((2, 3))
        return -(stiffness * along * (h * t + hh * across)).sum()
