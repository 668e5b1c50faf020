"""Laid-down shape guessed from the silhouette: it decides into which of its many equilibria the cloth falls.

Where folds form depends on undulations of a millimetre in the shape in which the cloth was laid on the plate. They were
not measured, and stiffness cannot replace them: without a guess, the best fit of a pixel loss is the cloth with the
fewest folds in wrong places. So a fit starts from a cloth that is half draped along the folds of the training
silhouette, with straight generators from plate to rim, which fall by half of what the silhouette implies,

    drop(theta) = sqrt(L^2 - (R(theta) - r)^2) / 2,    L = overhang, r = plate radius, R = silhouette.

Only the initial shape is set. From there the cloth moves by its own mechanics, and its folds may merge or split.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.sim.cloth.mesh import Mesh

# Of values from 0.1 to 1, with 0.5 the folds of the five named cloths stayed in place most often.
SHARE = 0.5
MODES = 20  # harmonics of the profile that are kept: folds, not pixels


def laid_like(
    radii: Float[np.ndarray, " angles"],
    mesh: Mesh,
    *,
    plate_radius: float = RELEASE.plate_radius_m,
    share: float = SHARE,
) -> Float[Tensor, "vertices 3"]:
    """Lays the cloth down with the folds of a silhouette.

    Args:
        radii: Profile of the silhouette at equidistant angles, counter-clockwise from +x [m].
        mesh: The cloth.
        plate_radius: Radius of the plate [m].
        share: How much of the silhouette's depth it is given, 0 (flat) to 1.

    Returns:
        Initial positions [m]: flat on the plate, ruled outside, generators as long as in the flat cloth.
    """
    x, y = mesh.material.T
    radius, angle = np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)
    overhang = radius.max() - plate_radius
    harmonics = np.fft.rfft(radii)
    harmonics[MODES + 1 :] = 0
    reach = np.clip(np.fft.irfft(harmonics, len(radii)) - plate_radius, 0, overhang)
    depth = share * np.sqrt(overhang**2 - reach**2)
    angles = np.arange(len(radii) + 1) * (2 * np.pi / len(radii))
    fall = np.interp(angle, angles, np.append(depth, depth[0])) / overhang
    along = np.maximum(radius - plate_radius, 0)  # of the generator [m]
    shrunk = np.minimum(radius, plate_radius) + along * np.sqrt(1 - fall**2)
    return torch.as_tensor(np.column_stack([shrunk * np.cos(angle), shrunk * np.sin(angle), -along * fall]))
