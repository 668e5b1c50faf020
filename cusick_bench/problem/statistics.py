"""What two samples of one cloth have in common, as differentiable statistics of a silhouette.

Where the folds of a drape lie is chance; that the next sample has as much area, as many folds and as deep ones is not.
With R(theta) = sum_m c_m exp(i m theta) the radius profile and 0.06 m the width of the overhang:

    area        log odds of the drape coefficient, the mean of R^2 between plate and cloth: stiffness moves them evenly,
                the coefficient itself less and less at both ends
    depth       log of the root mean square of the folds, m >= 3
    number      expected number of crests of a random profile with the folds' power, sqrt(sum m^4 P / sum m^2 P), by
                Rice's formula; it follows the number counted where the mean m of the power falls behind
    asymmetry   skewness of the folds: narrow crests and wide valleys, or the other way round
    grain       real and imaginary part of c_2, and the real part of c_4: warp against weft, in the cloth's frame

References:
    Rice. Mathematical analysis of random noise. Bell System Technical Journal 23-24, 1944-45, Sec. 3.6.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.losses import RADIUS_SCALE, Image, radius_profile
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

STATISTICS = ("area", "depth", "number", "asymmetry", "grain_2_real", "grain_2_imaginary", "grain_4_real")
FIRST_FOLD, LAST_FOLD = 3, 16
_LEAST_ODDS = 0.01  # drape coefficient from which on down (or up to 1) the log odds stand still
_SHALLOW = 1e-4  # [m] a fold below a tenth of a pixel has no depth that an image could show


def drape_statistics(image: Image) -> Float[Tensor, "*batch 7"]:
    """Statistics of silhouettes (cloth = 1), in the order of `STATISTICS`, each of the size of 1."""
    radius = radius_profile(image)
    harmonics = torch.fft.rfft(radius) / radius.shape[-1]
    power = 2 * harmonics.abs().square()[..., FIRST_FOLD : LAST_FOLD + 1]
    total = power.sum(-1) + _SHALLOW**2
    low = torch.fft.irfft(_only_low(harmonics), n=radius.shape[-1]) * radius.shape[-1]
    folds = radius - low
    variance = folds.square().mean(-1) + _SHALLOW**2
    coefficient = (radius.square().mean(-1) - PLATE_RADIUS**2) / (CLOTH_RADIUS**2 - PLATE_RADIUS**2)
    columns = [
        torch.logit(coefficient, eps=_LEAST_ODDS),
        0.5 * torch.log(total / RADIUS_SCALE**2),
        (_moment(power, 4) / _moment(power, 2)).sqrt() / 10,
        folds.pow(3).mean(-1) / variance**1.5,
        harmonics[..., 2].real / RADIUS_SCALE * 20,
        harmonics[..., 2].imag / RADIUS_SCALE * 20,
        harmonics[..., 4].real / RADIUS_SCALE * 20,
    ]
    return torch.stack(columns, -1)


def _moment(power: Float[Tensor, "*batch orders"], exponent: int) -> Float[Tensor, "*batch"]:
    """sum m^exponent P; a flat profile counts as one of the first order."""
    orders = torch.arange(FIRST_FOLD, LAST_FOLD + 1, dtype=power.dtype)
    return (power * orders**exponent).sum(-1) + _SHALLOW**2 * FIRST_FOLD**exponent


def _only_low(harmonics: Tensor) -> Tensor:
    """The harmonics below those of folds."""
    kept = torch.zeros_like(harmonics)
    kept[..., :FIRST_FOLD] = harmonics[..., :FIRST_FOLD]
    return kept
