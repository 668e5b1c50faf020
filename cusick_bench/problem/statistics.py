"""What two samples of one cloth have in common, as differentiable statistics of a silhouette.

Where the folds of a drape lie is chance; that the next sample has as much area, as many folds and as deep ones is not.
The statistics are the selection `INFERRED` of `cusick_bench.datasets.silhouette_statistics`, where each is defined;
here they are computed with torch, on the profile that `radius_profile` measures, so that an image has gradients.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.silhouette_statistics.definitions import (
    CREST_SCALE,
    FIRST_FOLD,
    GRAIN_SCALE,
    LAST_FOLD,
    LEAST_ODDS,
    SHALLOW,
)
from cusick_bench.datasets.silhouette_statistics.selections import INFERRED
from cusick_bench.problem.losses import Image, radius_profile

STATISTICS = INFERRED.names


def drape_statistics(image: Image, protocol: Protocol = RELEASE) -> Float[Tensor, "*batch 7"]:
    """Statistics of silhouettes, each of the size of 1.

    Args:
        image: Silhouettes, cloth = 1.
        protocol: How they were taken.

    Returns:
        In the order of `STATISTICS`; float64.
    """
    return profile_statistics(radius_profile(image, protocol), protocol)


def profile_statistics(
    radius: Float[Tensor, "*batch angles"], protocol: Protocol = RELEASE
) -> Float[Tensor, "*batch 7"]:
    """Statistics of radius profiles, each of the size of 1.

    Args:
        radius: Radii at equidistant angles over the full turn [m].
        protocol: Gives the radii of cloth and plate.

    Returns:
        In the order of `STATISTICS`.
    """
    if not radius.numel():
        return radius.new_zeros((*radius.shape[:-1], len(STATISTICS)))
    shallow, overhang = SHALLOW * protocol.cloth_scale, protocol.overhang_m
    inner, outer = protocol.plate_radius_m**2, protocol.cloth_radius_m**2
    harmonics = torch.fft.rfft(radius) / radius.shape[-1]
    power = 2 * harmonics.abs().square()[..., FIRST_FOLD : LAST_FOLD + 1]
    total = power.sum(-1) + shallow**2
    low = torch.fft.irfft(_only_low(harmonics), n=radius.shape[-1]) * radius.shape[-1]
    folds = radius - low
    variance = folds.square().mean(-1) + shallow**2
    coefficient = (radius.square().mean(-1) - inner) / (outer - inner)
    columns = [
        torch.logit(coefficient, eps=LEAST_ODDS),
        0.5 * torch.log(total / overhang**2),
        (_moment(power, 4, shallow) / _moment(power, 2, shallow)).sqrt() / CREST_SCALE,
        folds.pow(3).mean(-1) / variance**1.5,
        harmonics[..., 2].real / overhang * GRAIN_SCALE,
        harmonics[..., 2].imag / overhang * GRAIN_SCALE,
        harmonics[..., 4].real / overhang * GRAIN_SCALE,
    ]
    return torch.stack(columns, -1)


def _moment(power: Float[Tensor, "*batch orders"], exponent: int, shallow: float) -> Float[Tensor, "*batch"]:
    """sum m^exponent P; a flat profile counts as one of the first order."""
    orders = torch.arange(FIRST_FOLD, LAST_FOLD + 1, dtype=power.dtype, device=power.device)
    return (power * orders**exponent).sum(-1) + shallow**2 * FIRST_FOLD**exponent


def _only_low(harmonics: Tensor) -> Tensor:
    """The harmonics below those of folds."""
    kept = torch.zeros_like(harmonics)
    kept[..., :FIRST_FOLD] = harmonics[..., :FIRST_FOLD]
    return kept
