"""The outline read from the light across it by a small network, fitted to photographs whose outline is known.

An outline placed where the light is halfway between both sides would be pulled inwards by .2 to .5 mm by a stripe or a
blotch near the rim. Instead a network learns what edges look like that lens and JPEG have blurred over a millimetre,
with cloth of any colours inside: two layers of rectified units read `profiles` and give the offset of the outline from
the curve, and its expected error.
`python -m cusick_bench.photographs.edge_fitting` fits it and writes `edge_model.npz`.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.files import read_npz
from cusick_bench.photographs.segmentation.curve import Curve, normals, resampled, smoothed
from cusick_bench.photographs.segmentation.plane import PlanePicture
from cusick_bench.photographs.segmentation.profiles import profiles

WEIGHTS = Path(__file__).with_name("edge_model.npz")
LEAST_SPREAD = 0.02  # [mm]
_SMOOTH = 0.5e-3  # [m] along the outline: standard deviation of the filter of the offsets
_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class EdgeModel:
    """A fitted network.

    Attributes:
        layers: Weights and offsets of its layers, the last of which has two outputs.
    """

    layers: tuple[tuple[Float[ndarray, "inputs outputs"], Float[ndarray, " outputs"]], ...]

    def read(
        self, features: Float[ndarray, "points features"]
    ) -> tuple[Float[ndarray, " points"], Float[ndarray, " points"]]:
        """Reads the outline's place.

        Args:
            features: Profiles across the curve.

        Returns:
            How far outside the curve the outline lies [m]; and the mean error that is expected of that [m].
        """
        values = features
        for weights, offsets in self.layers[:-1]:
            values = np.maximum(values @ weights + offsets, 0)
        weights, offsets = self.layers[-1]
        place, spread = (values @ weights + offsets).T
        return 1e-3 * place, 1e-3 * (np.logaddexp(0, spread) + LEAST_SPREAD)


@lru_cache(maxsize=1)
def fitted_model() -> EdgeModel:
    """The network that is shipped."""
    kept = read_npz(WEIGHTS, remedy="install cusick-bench again")
    layers = range(len(kept) // 2)
    return EdgeModel(tuple((kept[f"weights{n}"].astype(float), kept[f"offsets{n}"].astype(float)) for n in layers))


def read_outline(
    picture: PlanePicture, curve: Curve, model: EdgeModel
) -> tuple[Float[ndarray, "moved 2"], Float[ndarray, " measured"]]:
    """Moves a curve to where the network reads the outline.

    Args:
        picture: Evenly lit.
        curve: Points in order, counter-clockwise [m].
        model: The network.

    Returns:
        The moved curve [m]; and the mean error that is expected at each point that was moved [m].
    """
    spread = np.zeros(0)
    for _ in range(_ROUNDS):
        curve = resampled(curve)
        place, spread = model.read(profiles(picture, curve))
        weight = 1 / spread**2
        total = smoothed(np.column_stack([place * weight, weight]), _SMOOTH)
        curve = curve + normals(curve) * (total[:, 0] / total[:, 1])[:, None]
    return curve, spread
