"""The soft silhouette of DIB-R, in Kaolin's convention: the paper's renderer.

A pixel whose centre is covered by a triangle is 1; any other pixel is

    S = 1 - prod_f (1 - exp(-d_f^2 / delta)),

over all faces f whose bounding box, widened by a margin, holds the pixel's centre; d_f is the distance from the centre
to the face in normalised image coordinates ([-1, 1] across the image). Kaolin stops after 30 faces per pixel in index
order; here all are taken, so the image does not depend on the numbering.

References:
    W. Chen, J. Gao, H. Ling, E. J. Smith, J. Lehtinen, A. Jacobson, S. Fidler. Learning to Predict 3D Objects with an
    Interpolation-based Differentiable Renderer. NeurIPS 2019, Eq. 5-6.
"""

import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor

SHARPNESS = 7000.0  # 1/delta in normalised coordinates; Kaolin's default sigmainv
MARGIN = 0.02  # in normalised coordinates; Kaolin's default boxlen
_SMALLEST = 1e-300  # keeps 0/0 of collapsed sides, and log 0 of centres that round onto a side, finite


def _boxes(
    corners: Float[Tensor, "faces 3 2"], margin: float, size: int
) -> tuple[Int[Tensor, "faces 2"], Int[Tensor, "faces 2"]]:
    """First pixel (column, row) and extent of the faces' bounding boxes, widened by a margin [px]."""
    low = (corners.amin(1) - margin).ceil().clamp(0, size).long()
    high = (corners.amax(1) + margin).floor().clamp(-1, size - 1).long()
    return low, (high - low + 1).clamp(min=0)


def _pixels(
    low: Int[Tensor, "faces 2"], extent: Int[Tensor, "faces 2"]
) -> tuple[Int[Tensor, "pairs"], Int[Tensor, "pairs 2"]]:
    """All pairs of a face and a pixel (column, row) in its box."""
    count = extent.prod(1)
    face = torch.repeat_interleave(torch.arange(len(low), device=low.device), count)
    rank = torch.arange(len(face), device=low.device) - torch.repeat_interleave(count.cumsum(0) - count, count)
    width = extent[face, 0]
    return face, low[face] + torch.stack([rank % width, rank // width], dim=1)


def _cross(u: Tensor, v: Tensor) -> Tensor:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def _covered(corners: Float[Tensor, "faces 3 2"], size: int) -> Tensor:
    """Which pixel centres lie in a triangle, edges included; flat (size * size,)."""
    face, pixel = _pixels(*_boxes(corners, 0.0, size))
    start = corners[face]
    side = start.roll(-1, dims=1) - start
    turn = _cross(side, pixel[:, None, :] - start)
    inside = (turn >= 0).all(1) | (turn <= 0).all(1)
    covered = torch.zeros(size * size, dtype=torch.bool, device=corners.device)
    covered[pixel[inside, 1] * size + pixel[inside, 0]] = True
    return covered


def _any_open(
    open_pixels: Bool[Tensor, "size size"], low: Int[Tensor, "faces 2"], extent: Int[Tensor, "faces 2"]
) -> Bool[Tensor, "faces"]:
    """Whether a box holds an uncovered pixel, from a summed-area table; most faces are spared further work."""
    table = torch.nn.functional.pad(open_pixels.long().cumsum(0).cumsum(1), (1, 0, 1, 0))
    (left, upper), (right, lower) = low.T, (low + extent).T
    return table[lower, right] - table[upper, right] - table[lower, left] + table[upper, left] > 0


def _squared_distance(corners: Float[Tensor, "pairs 3 2"], point: Float[Tensor, "pairs 2"]) -> Float[Tensor, "pairs"]:
    """Squared distance from a point outside a triangle to it: to the nearest of its sides."""
    side = corners.roll(-1, dims=1) - corners
    away = point[:, None, :] - corners
    along = (away * side).sum(-1) / (side * side).sum(-1).clamp(min=_SMALLEST)
    foot = corners + along.clamp(0, 1)[..., None] * side
    return (point[:, None, :] - foot).square().sum(-1).amin(1)


def soft_mask(
    points: Float[Tensor, "vertices 2"],
    faces: Int[ndarray, "faces 3"],
    size: int,
    *,
    sharpness: float = SHARPNESS,
    margin: float = MARGIN,
) -> Float[Tensor, "size size"]:
    """Draws the soft mask; differentiable to the points, on their device.

    Args:
        points: Vertices (column, row) in pixel coordinates, pixel centres at integers.
        faces: Vertex indices.
        size: Height and width of the image [px].
        sharpness: 1/delta.
        margin: How far a face's bounding box is widened, in normalised coordinates.

    Returns:
        The mask, in [0, 1].
    """
    pixels_per_unit = size / 2
    corners = points[torch.as_tensor(faces, device=points.device)]
    with torch.no_grad():
        covered = _covered(corners, size)
        low, extent = _boxes(corners, margin * pixels_per_unit, size)
        near_open = torch.where(_any_open(~covered.reshape(size, size), low, extent)[:, None], extent, 0)
        face, pixel = _pixels(low, near_open)
        index = pixel[:, 1] * size + pixel[:, 0]
        open_pairs = ~covered[index]
        face, pixel, index = face[open_pairs], pixel[open_pairs], index[open_pairs]
    exponent = sharpness * _squared_distance(corners[face], pixel.to(points.dtype)) / pixels_per_unit**2
    log_transparency = torch.log(-torch.expm1(-exponent.clamp(min=_SMALLEST)))
    total = points.new_zeros(size * size).index_add(0, index, log_transparency)
    return torch.where(covered, 1.0, 1 - torch.exp(total)).reshape(size, size)
