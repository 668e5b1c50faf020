"""What is measured on a set of drapes of one cloth, simulated or real: means, and the spread from drape to drape.

All numbers come from silhouettes, so that real and simulated drapes are measured alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.silhouette_statistics.selections import Selection
from cusick_bench.metrics.distances.image import mse_pairs

_MEASURED = Selection(("area_dc", "folds", "fold_depth", "fold_skewness", "crest_number"), ())
_MM = 1e3
_CREST_SCALE = 10  # `crest_number` is in tens


@dataclass(frozen=True)
class FoldResponses:
    """Folds of a set of drapes.

    Attributes:
        drapes: Number of drapes.
        drape_coefficient, folds, fold_depth_mm, fold_skewness, crest_number: Means: drape coefficient of the profile,
            number of folds, root mean square depth [mm], skewness of the folds (> 0 where crests are narrower than
            valleys), and root mean square order of the folds' slopes (larger than the number of folds where they are
            sharp or uneven).
        drape_coefficient_sd, folds_sd, fold_depth_mm_sd, fold_skewness_sd, crest_number_sd: Standard deviations between
            the drapes.
        pair_mse: Mean squared error of the images of two of the drapes, mean over the pairs.
    """

    drapes: int
    drape_coefficient: float
    folds: float
    fold_depth_mm: float
    fold_skewness: float
    crest_number: float
    drape_coefficient_sd: float
    folds_sd: float
    fold_depth_mm_sd: float
    fold_skewness_sd: float
    crest_number_sd: float
    pair_mse: float

    def error(self, name: str) -> float:
        """Standard error of a mean.

        Args:
            name: Name of the mean, such as `folds`.

        Returns:
            Its standard error; NaN of fewer than two drapes.
        """
        return float(getattr(self, f"{name}_sd")) / float(np.sqrt(max(self.drapes, 1)))


MEANS = ("drape_coefficient", "folds", "fold_depth_mm", "fold_skewness", "crest_number")
"""Names of the means, in order."""


def fold_responses(images: Sequence[Float[ndarray, "height width"]], protocol: Protocol = RELEASE) -> FoldResponses:
    """Measures a set of silhouettes.

    Args:
        images: Silhouettes of drapes of one cloth, cloth = 1.
        protocol: How they were taken.

    Returns:
        Means and spreads; NaN where there are too few drapes for them.
    """
    count = len(images)
    if count == 0:
        return FoldResponses(0, *([float("nan")] * (2 * len(MEANS) + 1)))
    radii = np.stack([profile_of(image, protocol).radii for image in images])
    values = _MEASURED.measure(radii, cloth_radius=protocol.cloth_radius_m, plate_radius=protocol.plate_radius_m)
    values *= [1.0, 1.0, _MM, 1.0, _CREST_SCALE]
    spread = values.std(0, ddof=1) if count > 1 else np.full(len(MEANS), np.nan)
    pairs = float("nan")
    if count > 1:
        table = mse_pairs(np.stack(images), np.stack(images), protocol)
        pairs = float(table.sum() - np.trace(table)) / (count * (count - 1))
    means = dict(zip(MEANS, values.mean(0).tolist(), strict=True))
    spreads = {f"{name}_sd": float(sd) for name, sd in zip(MEANS, spread, strict=True)}
    return FoldResponses(drapes=count, pair_mse=pairs, **means, **spreads)
