"""Differentiable distances between a simulated and a real silhouette.

`mse`, the default, is the paper's: the mean squared pixel difference. Where folds are out of phase it is
nearly flat, and it then prefers no folds at all. `profile` compares the radius-angle graph R(theta) instead:
a fold pulled to the wrong side still pays by its distance. Both are blind to what one silhouette cannot show.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.silhouette_statistics.definitions import OVERHANG_WIDTH

CENTRE_PX = 127.5
PX_PER_M = 723.0
RAYS = 360
SAMPLES_PER_RAY = 256
RADIUS_MAX = 0.17  # [m]

Image = Float[Tensor, "*batch 256 256"]


@lru_cache(maxsize=1)
def _ray_grid() -> Float[Tensor, "rays samples 2"]:
    """Sample points of the rays in grid_sample's coordinates: -1 and 1 are the outer edges of the image."""
    angle = torch.arange(RAYS, dtype=torch.float64) * (2 * math.pi / RAYS)
    radius = (torch.arange(SAMPLES_PER_RAY, dtype=torch.float64) + 0.5) * (RADIUS_MAX / SAMPLES_PER_RAY)
    x = radius * PX_PER_M * angle.cos()[:, None]
    y = -radius * PX_PER_M * angle.sin()[:, None]
    return torch.stack([x, y], -1) / (CENTRE_PX + 0.5)


def radius_profile(image: Image) -> Float[Tensor, "*batch rays"]:
    """Radius of the silhouette along rays from the centre: the length of cloth that each ray crosses.

    Args:
        image: Silhouettes, cloth = 1.

    Returns:
        Radii at equidistant angles, counter-clockwise from +x [m].
    """
    stack = image.reshape(-1, 1, *image.shape[-2:]).to(torch.float64)
    grid = _ray_grid().to(stack.device).expand(len(stack), -1, -1, -1)
    values = torch.nn.functional.grid_sample(stack, grid, align_corners=False)
    return (values.sum(-1) * (RADIUS_MAX / SAMPLES_PER_RAY)).reshape(*image.shape[:-2], RAYS)


def mse(image: Image, target: Image) -> Float[Tensor, "*batch"]:
    """Mean squared pixel difference.

    Args:
        image: Simulated silhouettes in [0, 1].
        target: Real silhouettes in [0, 1].

    Returns:
        One loss an image.
    """
    return (image - target).square().mean((-2, -1))


def profile(image: Image, target: Image) -> Float[Tensor, "*batch"]:
    """Mean squared difference of the radius profiles, in units of the overhanging width (0.06 m).

    Args:
        image: Simulated silhouettes in [0, 1].
        target: Real silhouettes in [0, 1].

    Returns:
        One loss an image.
    """
    return ((radius_profile(image) - radius_profile(target)) / OVERHANG_WIDTH).square().mean(-1)


def mse_profile(image: Image, target: Image) -> Float[Tensor, "*batch"]:
    """Sum of `mse` and `profile`.

    Args:
        image: Simulated silhouettes in [0, 1].
        target: Real silhouettes in [0, 1].

    Returns:
        One loss an image.
    """
    return mse(image, target) + profile(image, target)


LOSSES: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "mse": mse,
    "profile": profile,
    "mse+profile": mse_profile,
}
