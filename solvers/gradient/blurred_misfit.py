"""Distance of two silhouettes that gradients can follow: the mean squared difference of their blurred images.

The squared difference of sharp images grows with the area between two outlines, as |u| with their distance u: its
gradient is as long near the optimum as far from it, and turns round there. Blurred with a Gaussian of width s, images
differ as u^2 while u is below s: a least-squares problem,

    E = |r|^2,    r = G_s * (image - target) / sqrt(pixels),

with widths and pixels of the public release: others are scaled (`Protocol.mse_scale`).

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024.
"""

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.protocol import RELEASE, Protocol

EVERY = 2.0  # pixels of the release between those that are kept of a residual: a blurred image has no more detail


class BlurredMisfit:
    """E as a measure for `DrapeProblem.evaluate_and_gradient_batch`, which remembers the residual of the last image.

    Attributes:
        residual: r, thinned out to every second pixel of the release each way and scaled so that its square is still E.
    """

    def __init__(self, target: Float[np.ndarray, "size size"], width: float, protocol: Protocol = RELEASE) -> None:
        """Takes the silhouette to compare with, the width s [px of the release], and how the silhouette was taken."""
        finer = protocol.px_per_m / RELEASE.px_per_m * protocol.cloth_scale  # pixels to one of the release, per side
        self._every = max(int(EVERY * finer), 1)
        self._scale = math.sqrt(protocol.mse_scale)
        width = width * finer
        self._target = torch.as_tensor(target)
        frequency = torch.fft.fftfreq(len(target), dtype=torch.float64)
        gain = torch.exp(-2 * (torch.pi * width * frequency) ** 2)
        self._gain = gain[:, None] * gain[None, : len(target) // 2 + 1]
        self.residual: Float[np.ndarray, " kept"] = np.zeros(0)

    def __call__(self, images: dict[int, Tensor]) -> Tensor:
        """E of the only image."""
        (image,) = images.values()
        gain, target = self._gain.to(image.device), self._target.to(image)
        spectrum = torch.fft.rfft2(image - target) * gain
        blurred = torch.fft.irfft2(spectrum, s=image.shape) / len(target) * self._scale
        self.residual = self._every * blurred.detach()[:: self._every, :: self._every].cpu().numpy().ravel()
        return blurred.square().sum()
