"""Between a cloth (vertices, faces, hinges) and its shell (control and quadrature points) on a device: `ShellUnknowns`
in torch. Parameters and final positions stay on the device; the shapes in which the cloths are laid down are turned
into control points on the host, where that sparse system is factorised."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_array, vstack
from torch import Tensor

from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns
from cusick_bench.sim.first_derivatives import first_derivatives
from cusick_bench.sim.torch_engine.forces import BatchParameters
from cusick_bench.sim.torch_engine.gather import SparseMatrix


def _host(tensor: Tensor) -> ndarray:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float64)


class _ControlPoints(torch.autograd.Function):
    """Control points of surfaces through given positions, by a sparse solve on the host."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, laid: Tensor, unknowns: ShellUnknowns
    ) -> Tensor:
        ctx.unknowns = unknowns
        return torch.from_numpy(unknowns.configuration(_host(laid))).to(laid.device)

    @staticmethod
    @first_derivatives("the shape in which a cloth is laid down")
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, None]:
        g = grad_outputs[0]
        return torch.from_numpy(ctx.unknowns.by_laid(_host(g))).to(g.device), None


@dataclass(frozen=True, eq=False)
class ShellMaps:
    """The maps of one shell on one device; all are differentiable.

    Attributes:
        unknowns: The shell, and its maps on the host.
        device: Torch device.
    """

    unknowns: ShellUnknowns
    device: str

    def _put(self, array: ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(array), device=self.device)

    @cached_property
    def _free(self) -> Tensor:
        return self._put(self.unknowns.system.free)

    @cached_property
    def _matrices(self) -> dict[str, SparseMatrix]:
        """From elements and vertices to points and control points, and from those to free vertices."""
        s, free = self.unknowns.system.stencils, self.unknowns.system.free
        matrices = {
            "stretch": csr_array(vstack([s.stretch_of_edge, s.stretch_of_vertex])), "bending": s.bending_of_edge,
            "mass": s.load, "rest": s.rest_curvature, "surface": csr_array(csr_array(s.surface)[free]),
        }  # fmt: skip
        return {name: SparseMatrix(matrix, self.device) for name, matrix in matrices.items()}

    @cached_property
    def _planes(self) -> tuple[Tensor, Tensor, Tensor]:
        """Least squares for the plate's plane by all vertices, and rows (x, y, 1) of control points and vertices."""
        system = self.unknowns.system
        mesh, free = system.sheet, system.free
        at = np.column_stack([mesh.material, np.ones(mesh.vertices)])
        frame = np.zeros((3, mesh.vertices))
        frame[:, system.fixed] = np.linalg.pinv(at[system.fixed])
        control = np.column_stack([system.stencils.control_material, np.ones(len(free))])
        return self._put(frame), self._put(control), self._put(at[free])

    def parameters(self, p: BatchParameters) -> BatchParameters:
        """Tables, curvatures at rest and masses of the points.

        Args:
            p: Cloths by faces, hinges and vertices, on any device.

        Returns:
            Cloths as `TorchShell` takes them, on the device.
        """
        stretch, bending, mass, rest, poisson = (
            tensor.to(self.device, torch.float64) for tensor in (p.stretch, p.bending, p.mass, p.rest_angle, p.poisson)
        )
        by_control = torch.zeros_like(mass).index_copy(1, self._free, self._matrices["mass"](mass))
        return BatchParameters(
            stretch if stretch.shape[1] == 1 else self._matrices["stretch"](stretch),
            bending if bending.shape[1] == 1 else self._matrices["bending"](bending),
            by_control, self._matrices["rest"](rest), poisson,
        )  # fmt: skip

    def configuration(self, laid: Float[Tensor, "#members vertices 3"]) -> Float[Tensor, "#members vertices 3"]:
        """Control points of the surface through given positions; fixed vertices stay.

        Args:
            laid: Positions of the vertices [m].

        Returns:
            Control points, at the indices of their vertices [m].

        Raises:
            SimulationError: The fixed vertices do not lie in a plane, undeformed.
        """
        found = _ControlPoints.apply(laid, self.unknowns)
        assert isinstance(found, Tensor)
        return found

    def positions(self, x: Float[Tensor, "members vertices 3"]) -> Float[Tensor, "members vertices 3"]:
        """Points of the surface at the vertices.

        Args:
            x: Control points and fixed vertices [m].

        Returns:
            Positions [m].
        """
        plane, control, at = self._planes
        frame = plane @ x
        moved = at @ frame + self._matrices["surface"](x[:, self._free] - control @ frame)
        return x.index_copy(1, self._free, moved)
