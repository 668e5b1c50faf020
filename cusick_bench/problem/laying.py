"""How the cloth is laid down, guessed from the silhouette: it decides which of its many rests the cloth falls into.

Where folds form depends on undulations of a millimetre in the shape in which the cloth was laid on the plate. Nobody
measured them, and stiffness cannot stand in for them. So a fit lays the cloth with the undulation that the training
silhouette betrays: high where the rim will stand out, low where it will fall in. Only the initial shape is set; the
cloth then comes to rest by its own mechanics, and its folds may still merge or split.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.profile import profile_from_image
from cusick_bench.sim.mesh import CLOTH_RADIUS, PLATE_RADIUS, Mesh

AMPLITUDE = 2e-3  # [m] standard deviation of the rim's height
MODES = 20  # harmonics of the profile that are kept: folds, not pixels


def laid_like(
    image: Float[np.ndarray, "256 256"], mesh: Mesh, *, amplitude: float = AMPLITUDE
) -> Float[Tensor, "vertices 3"]:
    """Lays the cloth down with the folds of a silhouette.

    Args:
        image: Silhouette, cloth = 1.
        mesh: The cloth.
        amplitude: Standard deviation of the rim's height [m].

    Returns:
        Initial positions [m]: flat on the plate, and outside of it rising linearly to the rim's height.
    """
    radii = profile_from_image(image).radii
    harmonics = np.fft.rfft(radii)
    harmonics[0] = 0
    harmonics[MODES + 1 :] = 0
    height = np.fft.irfft(harmonics, len(radii))
    height *= amplitude / max(height.std(), 1e-12)
    x, y = mesh.material.T
    angle = np.arctan2(y, x) % (2 * np.pi)
    at_angle = np.interp(angle, np.arange(len(radii) + 1) * (2 * np.pi / len(radii)), np.append(height, height[0]))
    share = np.clip((np.hypot(x, y) - PLATE_RADIUS) / (CLOTH_RADIUS - PLATE_RADIUS), 0, 1)
    return torch.as_tensor(np.column_stack([x, y, share * at_angle]))
