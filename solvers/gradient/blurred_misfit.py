"""Distance of two silhouettes that gradients can follow: the mean squared difference of their blurred images.

The squared difference of sharp images grows with the area between two outlines, as |u| with their distance u: its
gradient is as long near the optimum as far from it, and turns round there. Blurred with a Gaussian of width s, images
differ as u^2 while u is below s: a least-squares problem,

    E = |r|^2,    r = G_s * (image - target) / sqrt(pixels).

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024 (images 256 x 256).
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

EVERY = 2  # pixels between those that are kept of a residual: a blurred image has no more detail


class BlurredMisfit:
    """E as a measure for `DrapeProblem.evaluate_and_gradient_batch`, which remembers the residual of the last image.

    Attributes:
        residual: r, thinned out to every second pixel each way and scaled so that its square is still E.
    """

    def __init__(self, target: Float[np.ndarray, "256 256"], width: float) -> None:
        """Takes the silhouette to compare with, and the width s [px]."""
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
        blurred = torch.fft.irfft2(spectrum, s=image.shape) / len(target)
        self.residual = EVERY * blurred.detach()[::EVERY, ::EVERY].cpu().numpy().ravel()
        return blurred.square().sum()
