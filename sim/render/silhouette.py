"""Silhouettes: differentiable images of a cloth, 1 where it covers the pixel and 0 where it does not.

The Cusick plate lies under the cloth, so the cloth alone makes the silhouette.
"""

from collections.abc import Callable
from numbers import Integral
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.constants import IMAGE_SIZE
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.first_derivatives import first_derivatives
from cusick_bench.sim.render.camera import Camera
from cusick_bench.sim.render.coverage import area_gradient, pixel_areas
from cusick_bench.sim.render.outline import outline
from cusick_bench.sim.render.soft_mask import soft_mask

Method = Literal["coverage", "soft"]

_FARTHEST = 1e9  # [px]; farther away, areas lose their accuracy


class _Coverage(torch.autograd.Function):
    """Exact pixel coverage. The sweep is sequential, so it runs on the CPU whatever the device of the points is;
    the renderer that stays on the device is `soft`."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, faces: ndarray, size: int) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        # Pixel p covers [p - 1/2, p + 1/2] here and [p, p + 1] in `coverage`.
        ctx.points = np.ascontiguousarray(points.detach().cpu().numpy().astype(np.float64) + 0.5)
        ctx.faces = faces
        ctx.save_for_backward(points)
        ctx.outline = outline(ctx.points, faces, size)
        return torch.from_numpy(pixel_areas(ctx.points, ctx.outline, size, size)).to(points.device)

    @staticmethod
    @first_derivatives("the coverage of pixels")
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        gradient = area_gradient(ctx.points, ctx.faces, ctx.outline, upstream.detach().cpu().numpy())
        return torch.from_numpy(gradient).to(upstream.device), None, None


def _coverage_image(points: Float[Tensor, "vertices 2"], faces: ndarray, size: int) -> Float[Tensor, "size size"]:
    return _Coverage.apply(points, faces, size)  # pyright: ignore[reportReturnType]


_METHODS: dict[str, Callable[[Tensor, ndarray, int], Tensor]] = {"coverage": _coverage_image, "soft": soft_mask}


def _checked_faces(faces: ndarray | Tensor, vertices: int) -> Int[ndarray, "faces 3"]:
    triangles = np.ascontiguousarray(faces.detach().cpu().numpy() if isinstance(faces, Tensor) else faces)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise SimulationError(
            f"faces must be integer triangles of shape (faces, 3), got {triangles.dtype} {triangles.shape}"
        )
    triangles = triangles.astype(np.int64, copy=False)
    if triangles.size and not (triangles.min() >= 0 and triangles.max() < vertices):
        raise SimulationError(
            f"face indices must lie in [0, {vertices - 1}], got {triangles.min()} to {triangles.max()};"
            " do the faces belong to these vertices?"
        )
    return triangles


def render(
    vertices: Float[Tensor, "*batch vertices 3"] | Float[ndarray, "*batch vertices 3"],
    faces: Int[ndarray, "faces 3"] | Int[Tensor, "faces 3"],
    camera: Camera,
    *,
    method: Method = "coverage",
    size: int = IMAGE_SIZE,
) -> Float[Tensor, "*batch size size"]:
    """Draws the silhouette of a cloth, differentiably to its vertices.

    Args:
        vertices: Positions [m]; an array, such as a mesh from a file has, is drawn without gradients.
        faces: Vertex indices of the triangles, shared by the whole batch.
        camera: Where the cloth is seen from; its pixel coordinates start at the image's upper left pixel.
        method: `coverage`, the exact covered area of every pixel with its exact gradient (see `coverage`), or `soft`,
            the mask of the paper's renderer (see `soft_mask`).
        size: Height and width of the image [px].

    Returns:
        Images in [0, 1], float64, on the device of the vertices.

    Raises:
        SimulationError: Unknown method, malformed or non-finite input, or a point behind the camera.
    """
    if method not in _METHODS:
        raise SimulationError(f"method must be one of {', '.join(_METHODS)}, got {method!r}")
    if not isinstance(size, Integral) or size < 1:
        raise SimulationError(f"an image needs a whole number of pixels a side, at least one, got size {size}")
    if not isinstance(vertices, Tensor):
        vertices = torch.from_numpy(np.array(vertices, dtype=np.float64))
    if vertices.ndim < 2 or vertices.shape[-1] != 3:
        raise SimulationError(f"vertices must have shape (..., vertices, 3), got {tuple(vertices.shape)}")
    triangles = _checked_faces(faces, vertices.shape[-2])
    points = camera.project(vertices.double())
    if not bool((points.abs() < _FARTHEST).all()):  # also false for NaN
        raise SimulationError(
            f"vertices must be finite and within {_FARTHEST:g} pixels of the image to be drawn; did the drape diverge?"
        )
    draw = _METHODS[method]
    images = [draw(item, triangles, size) for item in points.reshape(-1, *points.shape[-2:])]
    flat = torch.stack(images) if images else points.new_zeros(0, size, size)
    return flat.reshape(*points.shape[:-2], size, size)
