"""Differentiable distances between a simulated and a real silhouette.

`mse`, the default, is the paper's: the mean squared pixel difference, whatever the size of pixels and image
(`Protocol.mse_scale`). Where folds are out of phase it is nearly flat, and it then prefers no folds at all. `profile`
compares the radius-angle graph R(theta) instead: a fold pulled to the wrong side still pays by its distance. Both are
blind to what one silhouette cannot show.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.hanging_line import without_perspective
from cusick_bench.datasets.files.protocol import RELEASE, Protocol

RAYS = 360
SAMPLES_PER_RAY = 256
RAY_LENGTH = 0.17  # [m], for the standard's cloth; others have rays in proportion

Image = Float[Tensor, "*batch size size"]
Loss = Callable[[Tensor, Tensor, Protocol], Tensor]


@lru_cache(maxsize=4)
def _ray_grid(
    size: int, px_per_m: float, centre_px: tuple[float, float], image_y: str, reach: float
) -> Float[Tensor, "rays samples 2"]:
    """Sample points of the rays in grid_sample's coordinates: -1 and 1 are the outer edges of the image."""
    angle = torch.arange(RAYS, dtype=torch.float64) * (2 * math.pi / RAYS)
    radius = (torch.arange(SAMPLES_PER_RAY, dtype=torch.float64) + 0.5) * (reach / SAMPLES_PER_RAY)
    towards_rows = -1.0 if image_y == "up" else 1.0
    column = radius * px_per_m * angle.cos()[:, None] + (centre_px[0] - (size - 1) / 2)
    row = towards_rows * radius * px_per_m * angle.sin()[:, None] + (centre_px[1] - (size - 1) / 2)
    return torch.stack([column, row], -1) / (size / 2)


def radius_profile(image: Image, protocol: Protocol = RELEASE) -> Float[Tensor, "*batch rays"]:
    """Radius of the silhouette along rays from the centre: the length of cloth that each ray crosses.

    Args:
        image: Silhouettes, cloth = 1.
        protocol: How they were taken.

    Returns:
        Radii at equidistant angles, counter-clockwise from +x [m]; of a pinhole camera's image with its perspective
        taken out.
    """
    stack = image.reshape(-1, 1, *image.shape[-2:]).to(torch.float64)
    reach = RAY_LENGTH * protocol.cloth_scale
    grid = _ray_grid(image.shape[-1], protocol.px_per_m, protocol.centre_px, protocol.image_y, reach)
    values = torch.nn.functional.grid_sample(
        stack, grid.to(stack.device).expand(len(stack), -1, -1, -1), align_corners=False
    )
    radii = (values.sum(-1) * (reach / SAMPLES_PER_RAY)).reshape(*image.shape[:-2], RAYS)
    return radii if protocol.projection == "parallel" else without_perspective(radii, protocol)


def mse(image: Image, target: Image, protocol: Protocol = RELEASE) -> Float[Tensor, "*batch"]:
    """Squared difference, integrated over the plane, in units of the area that an image of the release shows.

    It is the mean over pixels of the public release, and the same number for the same drapes at any resolution and
    field of view, and for drapes of the same shape at any size (`Protocol.mse_scale`).

    Args:
        image: Simulated silhouettes in [0, 1].
        target: Real silhouettes in [0, 1].
        protocol: How they were taken.

    Returns:
        One loss an image.
    """
    by_row = (image - target).square().mean(-1)  # one mean over both axes would be cut by the number of threads
    return by_row.mean(-1) * protocol.mse_scale


def profile(image: Image, target: Image, protocol: Protocol = RELEASE) -> Float[Tensor, "*batch"]:
    """Mean squared difference of the radius profiles, in units of the overhanging width (0.06 m of the standard's).

    Args:
        image: Simulated silhouettes in [0, 1].
        target: Real silhouettes in [0, 1].
        protocol: How they were taken.

    Returns:
        One loss an image.
    """
    difference = radius_profile(image, protocol) - radius_profile(target, protocol)
    return (difference / protocol.overhang_m).square().mean(-1)


def mse_profile(image: Image, target: Image, protocol: Protocol = RELEASE) -> Float[Tensor, "*batch"]:
    """Sum of `mse` and `profile`.

    Args:
        image: Simulated silhouettes in [0, 1].
        target: Real silhouettes in [0, 1].
        protocol: How they were taken.

    Returns:
        One loss an image.
    """
    return mse(image, target, protocol) + profile(image, target, protocol)


LOSSES: dict[str, Loss] = {
    "mse": mse,
    "profile": profile,
    "mse+profile": mse_profile,
}
