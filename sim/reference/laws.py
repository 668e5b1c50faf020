"""Laws `paper` and `published` in plain torch: readable, any device, differentiated by autograd, slow.

It is written from the formulas, independently of the compiled kernels, which are tested against it; `drop_reference`
drops a cloth with it, and the benchmark compares speed with that. Per face with deformation gradient F = Ds D,
D = Dm^-1, and Green strain G = (F^T F - I) / 2:

    psi(G) = k0 G00^2 / 2 + k1 G00 G11 + k2 G11^2 / 2 + k3 G01^2,    (k0, k1, k2, k3) = k(G) read from C (6 x 4)

Per hinge with dihedral angle theta, edge length l and adjacent face areas A1 + A2, where kappa = theta l / (A1 + A2):

    M(theta) = B(kappa) theta l^2 / (A1 + A2),    B read from B (3 x 5)

With the system's `half_hinges`, A1 + A2 of a hinge on the edge of fixed cloth is the area of its free face alone.

Law `paper` has the energy E = sum_faces A psi + sum_hinges int M dtheta and forces -grad E. Law `published` takes the
secant forces (k and B held fixed in the derivative) and a quarter of the hinge moment.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3-5, Section 3.3.1.
    Baraff, Witkin. Large steps in cloth simulation. SIGGRAPH 1998, Eq. 6.
"""

import math
from dataclasses import dataclass, field

import torch
from jaxtyping import Float, Int
from torch import Tensor

from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.reference.tables import (
    CURVATURE_STEP,
    hat,
    stretch_published,
    weights_bending_paper,
    weights_stretch_paper,
)

_GAUSS = 1 / math.sqrt(3)  # nodes of the two-point rule, exact for the cubic pieces of B(kappa) kappa


@dataclass(frozen=True)
class TorchParameters:
    """One cloth as tensors; any of them may require gradients.

    Attributes:
        stretch: C, one shared table (1, 6, 4) or one per face [N/m].
        bending: B, one shared table (1, 3, 5) or one per hinge [N m].
        mass: Vertex masses [kg].
        rest_angle: Stress-free dihedral angles [rad].
    """

    stretch: Float[Tensor, "stretch_tables 6 4"]
    bending: Float[Tensor, "bending_tables 3 5"]
    mass: Float[Tensor, "vertices"]
    rest_angle: Float[Tensor, "hinges"]


@dataclass(frozen=True, eq=False)
class Reference:
    """Element constants of a system as tensors; see the module for the equations.

    Attributes:
        system: Mesh, law and support.
        device: Where tensors live.
        faces: Vertex indices.
        inverse: D = Dm^-1 [1/m].
        area: Material areas of the faces [m2].
        hinges: Vertex indices (edge start, edge end, the two outer corners).
        length: Material edge lengths of the hinges [m].
        hinge_area: A1 + A2, or of a hinge on a clamp that of its free face [m2].
        direction: Weights of the hinge directions 0, 45, 90 degrees from the warp.
        spring: Stiffness of each vertex's spring to its anchor [N/m].
        free: Vertices that move.
    """

    system: DrapeSystem
    device: str = "cpu"
    faces: Int[Tensor, "faces 3"] = field(init=False, repr=False)
    inverse: Float[Tensor, "faces 2 2"] = field(init=False, repr=False)
    area: Float[Tensor, "faces"] = field(init=False, repr=False)
    hinges: Int[Tensor, "hinges 4"] = field(init=False, repr=False)
    length: Float[Tensor, "hinges"] = field(init=False, repr=False)
    hinge_area: Float[Tensor, "hinges"] = field(init=False, repr=False)
    direction: Float[Tensor, "hinges 3"] = field(init=False, repr=False)
    spring: Float[Tensor, "vertices"] = field(init=False, repr=False)
    free: Int[Tensor, "free"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        mesh = self.system.mesh
        material = torch.as_tensor(mesh.material, device=self.device)
        faces, hinges = (torch.as_tensor(index, device=self.device) for index in (mesh.faces, mesh.hinges))
        corner = material[faces]
        edges = torch.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], dim=2)
        start, end, left, right = material[hinges].unbind(1)
        along = end - start
        areas = [torch.linalg.det(torch.stack([along, outer - start], dim=2)).abs() / 2 for outer in (left, right)]
        hinge_area = areas[0] + areas[1]
        if self.system.half_hinges:
            at_start, at_end, at_left, at_right = torch.as_tensor(self.system.fixed, device=self.device)[hinges].T
            for held, free, area in ((at_left, ~at_right, areas[1]), (at_right, ~at_left, areas[0])):
                hinge_area = torch.where(at_start & at_end & held & free, area, hinge_area)
        to_warp = torch.atan2(along[:, 1].abs(), along[:, 0].abs())
        for name, value in {
            "faces": faces,
            "inverse": torch.linalg.inv(edges),
            "area": torch.linalg.det(edges) / 2,
            "hinges": hinges,
            "length": along.norm(dim=1),
            "hinge_area": hinge_area,
            "direction": hat(to_warp / (math.pi / 4), 3),
            "spring": torch.as_tensor(self.system.spring, device=self.device),
            "free": torch.as_tensor(self.system.free, device=self.device),
        }.items():
            object.__setattr__(self, name, value)

    def strain(self, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "faces 2 2"]:
        """Green strain G of the faces.

        Args:
            x: Positions [m].

        Returns:
            Symmetric strains, without unit.
        """
        gradient = self._gradient(x)
        return (gradient.mT @ gradient - torch.eye(2, dtype=x.dtype, device=x.device)) / 2

    def _gradient(self, x: Tensor) -> Tensor:
        """Deformation gradient F = [x_u | x_v] (faces, 3, 2)."""
        corner = x[self.faces]
        return torch.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], dim=2) @ self.inverse

    def stretch_stiffness(
        self, strain: Float[Tensor, "faces 2 2"], table: Float[Tensor, "tables 6 4"]
    ) -> Float[Tensor, "faces 4"]:
        """k0..k3 of every face [N/m].

        Args:
            strain: Green strain G.
            table: C, shared or one for each face [N/m].

        Returns:
            Stiffness.
        """
        if self.system.law == "paper":
            return (weights_stretch_paper(strain)[:, :, None] * table).sum(1)
        return stretch_published(strain, table)

    def angles(self, corners: Float[Tensor, "hinges 4 3"]) -> Float[Tensor, "hinges"]:
        """Dihedral angles from the hinges' corners, positive where both outer corners lie below the edge [rad].

        Args:
            corners: Positions of v0, v1 and both opposite vertices [m].

        Returns:
            Angles.
        """
        start, end, left, right = corners.unbind(1)
        edge = end - start
        normal0, normal1 = torch.linalg.cross(edge, left - start), torch.linalg.cross(right - start, edge)
        sine = (torch.linalg.cross(normal0, normal1) * edge).sum(1) / edge.norm(dim=1)
        return torch.atan2(sine, (normal0 * normal1).sum(1))

    def bending_stiffness(
        self, angle: Float[Tensor, "hinges *nodes"], table: Float[Tensor, "tables 3 5"]
    ) -> Float[Tensor, "hinges *nodes"]:
        """B of every hinge at given angles [N m].

        Args:
            angle: Dihedral angles less the stress-free ones [rad].
            table: B, shared or one for each hinge [N m].

        Returns:
            Stiffness.
        """
        trailing = (1,) * (angle.ndim - 1)
        curvature = angle * (self.length / self.hinge_area).reshape(-1, *trailing)
        row = torch.einsum("hd,hds->hs", self.direction, table.expand(len(angle), 3, 5)).reshape(-1, *trailing, 5)
        if self.system.law == "paper":
            return (weights_bending_paper(curvature) * row).sum(-1)
        # The program measures the angle with the opposite sign, and reads sample 0 for all of its negative angles.
        position = (-curvature / CURVATURE_STEP).clamp(0, 4)
        return (hat(position, 5) * row).sum(-1).relu()

    def energy(
        self, x: Float[Tensor, "vertices 3"], anchor: Float[Tensor, "vertices 3"], p: TorchParameters
    ) -> Float[Tensor, ""]:
        """Potential energy of law `paper` [J]: stretch, bending, gravity and plate springs.

        Args:
            x: Positions [m].
            anchor: Where the springs hold [m].
            p: The cloth.

        Returns:
            The energy, differentiable.

        Raises:
            SimulationError: Law `published` has no energy.
        """
        if self.system.law != "paper":
            raise SimulationError("law 'published' has no energy; use law 'paper', or `forces`")
        strain = self.strain(x)
        k = self.stretch_stiffness(strain, p.stretch)
        g00, g11, g01 = strain[:, 0, 0], strain[:, 1, 1], strain[:, 0, 1]
        psi = k[:, 0] * g00**2 / 2 + k[:, 1] * g00 * g11 + k[:, 2] * g11**2 / 2 + k[:, 3] * g01**2
        gravity = self.system.gravity * (p.mass * x[:, 2]).sum()
        springs = 0.5 * (self.spring[:, None] * (x - anchor) ** 2).sum()
        return (self.area * psi).sum() + self._energy_bending(x, p) + gravity + springs

    def _energy_bending(self, x: Tensor, p: TorchParameters) -> Tensor:
        """sum_h l^2 / (A1 + A2) int_0^theta B(kappa(t)) t dt, by Gauss-Legendre between knots of the spline (exact)."""
        angle = self.angles(x[self.hinges]) - p.rest_angle
        per_knot = CURVATURE_STEP * self.hinge_area / self.length  # angle between two samples
        stops = [angle.clamp(-(n + 0.5) * per_knot, (n + 0.5) * per_knot) for n in range(5)] + [angle]
        total, start = torch.zeros_like(angle), torch.zeros_like(angle)
        for stop in stops:
            middle, half = (start + stop) / 2, (stop - start) / 2
            nodes = middle[:, None] + half[:, None] * torch.tensor([-_GAUSS, _GAUSS], dtype=x.dtype, device=x.device)
            total = total + half * (self.bending_stiffness(nodes, p.bending) * nodes).sum(1)
            start = stop
        return (self.length**2 / self.hinge_area * total).sum()

    def forces(
        self, x: Float[Tensor, "vertices 3"], anchor: Float[Tensor, "vertices 3"], p: TorchParameters
    ) -> Float[Tensor, "vertices 3"]:
        """Net force on every vertex [N]; differentiable."""
        with torch.enable_grad():
            x = x if x.requires_grad else x.detach().requires_grad_()
            if self.system.law == "paper":
                return -torch.autograd.grad(self.energy(x, anchor, p), x, create_graph=True)[0]
            force = self._published_stretch(x, p) + self._published_bending(x, p)
        down = torch.tensor([0.0, 0.0, -self.system.gravity], dtype=x.dtype, device=x.device)
        return force + p.mass[:, None] * down - self.spring[:, None] * (x - anchor)

    def _columns(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """f_uu = s_u (x) x_u, f_vv, f_uv (faces, 3 corners, 3 axes), and s_u, s_v (faces, 3)."""
        inverse = self.inverse
        weights = torch.cat([-inverse.sum(1, keepdim=True), inverse], dim=1)
        s_u, s_v = weights[:, :, 0], weights[:, :, 1]
        x_u, x_v = self._gradient(x).unbind(2)
        f_uu, f_vv = s_u[:, :, None] * x_u[:, None], s_v[:, :, None] * x_v[:, None]
        f_uv = s_u[:, :, None] * x_v[:, None] + s_v[:, :, None] * x_u[:, None]
        return f_uu, f_vv, f_uv, s_u, s_v

    def _published_stretch(self, x: Tensor, p: TorchParameters) -> Tensor:
        """f = -A [k0 G00 f_uu + k2 G11 f_vv + k1 (G00 f_vv + G11 f_uu) + k3 G01 f_uv], summed at the vertices."""
        strain = self.strain(x)
        k0, k1, k2, k3 = (k[:, None, None] for k in self.stretch_stiffness(strain, p.stretch).unbind(1))
        g00, g11, g01 = (strain[:, a, b, None, None] for a, b in ((0, 0), (1, 1), (0, 1)))
        f_uu, f_vv, f_uv, _, _ = self._columns(x)
        force = k0 * g00 * f_uu + k2 * g11 * f_vv + k1 * (g00 * f_vv + g11 * f_uu) + k3 * g01 * f_uv
        force = -self.area[:, None, None] * force
        return torch.zeros_like(x).index_add(0, self.faces.reshape(-1), force.reshape(-1, 3))

    def _published_bending(self, x: Tensor, p: TorchParameters) -> Tensor:
        """f = -ke theta grad theta, summed at the vertices."""
        angle, gradient, stiffness = self._hinge_state(x, p)
        force = -(stiffness * angle)[:, None, None] * gradient
        return torch.zeros_like(x).index_add(0, self.hinges.reshape(-1), force.reshape(-1, 3))

    def _hinge_state(self, x: Tensor, p: TorchParameters) -> tuple[Tensor, Tensor, Tensor]:
        """theta - rest, grad theta (hinges, 4, 3) and secant stiffness M / (theta - rest)."""
        corners = x[self.hinges]
        bent = self.angles(corners)
        gradient = torch.autograd.grad(bent.sum(), corners, create_graph=True)[0]
        angle = bent - p.rest_angle
        factor = 1.0 if self.system.law == "paper" else 0.25
        stiffness = factor * self.length**2 / self.hinge_area * self.bending_stiffness(angle, p.bending)
        return angle, gradient, stiffness

    def gauss_newton_blocks(
        self, x: Float[Tensor, "vertices 3"], p: TorchParameters
    ) -> tuple[Float[Tensor, "faces 9 9"], Float[Tensor, "hinges 12 12"]]:
        """Stiffness of every element in the implicit step, over its corners' coordinates; differentiable [N/m].

        Faces: A [k0 (f_uu f_uu^T + G00+ D_uu) + k2 (f_vv f_vv^T + G11+ D_vv) + k1 (f_uu f_vv^T + f_vv f_uu^T
        + G00+ D_vv + G11+ D_uu) + k3 / 2 f_uv f_uv^T], G+ = max(G, 0), D_uu = s_u s_u^T (x) I; law `paper` takes
        max(factor, 0) of D_uu and of D_vv, which c12 < 0 could make negative.
        Hinges: M / theta grad grad^T.

        Args:
            x: Positions [m].
            p: The cloth.

        Returns:
            Matrices of the faces and of the hinges.
        """
        with torch.enable_grad():
            x = x if x.requires_grad else x.detach().requires_grad_()
            strain = self.strain(x)
            k0, k1, k2, k3 = (k[:, None, None] for k in self.stretch_stiffness(strain, p.stretch).unbind(1))
            plus0, plus1 = (strain[:, a, a, None, None].clamp(min=0) for a in (0, 1))
            *columns, s_u, s_v = self._columns(x)
            f_uu, f_vv, f_uv = (f.flatten(1) for f in columns)

            def outer(first: Tensor, second: Tensor) -> Tensor:
                return first[:, :, None] * second[:, None, :]

            axes = torch.eye(3, dtype=x.dtype, device=x.device)
            d_uu, d_vv = (torch.kron(outer(s, s).contiguous(), axes) for s in (s_u, s_v))
            g_uu, g_vv = k0 * plus0 + k1 * plus1, k2 * plus1 + k1 * plus0
            if self.system.law == "paper":
                g_uu, g_vv = g_uu.clamp(min=0), g_vv.clamp(min=0)
            blocks = k0 * outer(f_uu, f_uu) + k2 * outer(f_vv, f_vv) + g_uu * d_uu + g_vv * d_vv
            blocks = blocks + k1 * (outer(f_uu, f_vv) + outer(f_vv, f_uu)) + k3 / 2 * outer(f_uv, f_uv)
            _, gradient, stiffness = self._hinge_state(x, p)
            g = gradient.flatten(1)
            return self.area[:, None, None] * blocks, stiffness[:, None, None] * outer(g, g)

    def gauss_newton(
        self, x: Float[Tensor, "vertices 3"], p: TorchParameters
    ) -> Float[Tensor, "coordinates coordinates"]:
        """Stiffness K of the implicit step over all 3 V coordinates (vertex-major), dense [N/m].

        Args:
            x: Positions [m].
            p: The cloth.

        Returns:
            The matrix.
        """
        faces, hinges = self.gauss_newton_blocks(x, p)
        return self._scatter(faces, self.faces, 3 * len(x)) + self._scatter(hinges, self.hinges, 3 * len(x))

    @staticmethod
    def _scatter(blocks: Tensor, corners: Tensor, size: int) -> Tensor:
        """Adds element matrices to a dense matrix."""
        axes = torch.arange(3, device=corners.device)
        coordinate = (3 * corners[:, :, None] + axes).flatten(1)
        slot = coordinate[:, :, None] * size + coordinate[:, None, :]
        flat = torch.zeros(size * size, dtype=blocks.dtype, device=blocks.device)
        return flat.index_add(0, slot.reshape(-1), blocks.reshape(-1)).reshape(size, size)
