"""How the cloth is laid down, guessed from the silhouette: it decides which of its many rests the cloth falls into.

Where folds form depends on undulations of a millimetre in the shape in which the cloth was laid on the plate. Nobody
measured them, and stiffness cannot stand in for them: without a guess, the best fit of a pixel loss is whatever has
the fewest folds in the wrong place. So a fit lays the cloth half draped along the folds that the training silhouette
shows: straight generators from the plate's edge to the rim, which fall by half of what the silhouette implies,

    drop(theta) = sqrt(L^2 - (R(theta) - r)^2) / 2,    L = overhang, r = plate radius, R = silhouette.

Only the initial shape is set. From there the cloth moves by its own mechanics, and its folds may merge or split.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.profile import profile_from_image
from cusick_bench.sim.mesh import CLOTH_RADIUS, PLATE_RADIUS, Mesh

# Of 0.1 to 1, 0.5 left the five named cloths' folds in place most often.
SHARE = 0.5
MODES = 20  # harmonics of the profile that are kept: folds, not pixels


def laid_like(image: Float[np.ndarray, "256 256"], mesh: Mesh, *, share: float = SHARE) -> Float[Tensor, "vertices 3"]:
    """Lays the cloth down with the folds of a silhouette.

    Args:
        image: Silhouette, cloth = 1.
        mesh: The cloth.
        share: How much of the silhouette's depth it is given, 0 (flat) to 1.

    Returns:
        Initial positions [m]: flat on the plate, ruled outside, generators as long as in the flat cloth.
    """
    overhang = CLOTH_RADIUS - PLATE_RADIUS
    harmonics = np.fft.rfft(profile_from_image(image).radii)
    harmonics[MODES + 1 :] = 0
    radii = np.fft.irfft(harmonics, 720)
    depth = share * np.sqrt(np.maximum(overhang**2 - np.clip(radii - PLATE_RADIUS, 0, overhang) ** 2, 0))
    x, y = mesh.material.T
    radius, angle = np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)
    fall = np.interp(angle, np.arange(721) * (2 * np.pi / 720), np.append(depth, depth[0])) / overhang
    along = np.maximum(radius - PLATE_RADIUS, 0)  # of the generator [m]
    shrunk = np.minimum(radius, PLATE_RADIUS) + along * np.sqrt(1 - fall**2)
    return torch.as_tensor(np.column_stack([shrunk * np.cos(angle), shrunk * np.sin(angle), -along * fall]))
