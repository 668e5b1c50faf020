"""Folds of real cloths, measured as those of simulated ones are.

What is published of the paper's five cloths stands here; with the data at hand, every fabric is measured.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cusick_bench.benchmark.fold_selection.responses import FoldResponses, fold_responses
from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import BadImage
from cusick_bench.datasets.files.image import fit_plate
from cusick_bench.datasets.published import CLOTHS

PUBLISHED: Mapping[str, tuple[float, float, float]] = {
    "cotton_blue": (0.631, 0.029, 7.5),
    "cotton_pink": (0.572, 0.030, 8.1),
    "cotton_white": (0.434, 0.018, 8.9),
    "viscose_white": (0.133, 0.009, 12.1),
    "wool_red": (0.781, 0.021, 7.6),
}
"""Mean drape coefficient, its standard deviation between samples, and mean number of folds of the paper's cloths, as
`data stats` measures them on the public release."""

_FEWEST = 3  # samples from which a spread is told


@dataclass(frozen=True)
class ClothRow:
    """Folds of one face of a real cloth.

    Attributes:
        cloth: Its name.
        side: Which face lies up.
        responses: Of the first captures of its samples.
    """

    cloth: str
    side: str
    responses: FoldResponses


def cloth_rows(dataset: DrapeDataset) -> list[ClothRow]:
    """Measures every fabric and face of which there are three samples or more.

    Args:
        dataset: Real drapes; sets of the paper's own names, which repeat captures of the fabrics, and series over time
            are left out.

    Returns:
        A row a fabric and face.
    """
    table = dataset.table
    sets: dict[tuple[str, str], dict[int, int]] = {}
    for row, (cloth, side, sample, observation) in enumerate(
        zip(table["cloth"], table["side"].astype(str), table["sample"], table["observation"], strict=True)
    ):
        if str(cloth) not in CLOTHS and not observation:
            sets.setdefault((str(cloth), side), {}).setdefault(int(sample), row)
    rows = []
    for (cloth, side), first in sorted(sets.items()):
        images = [image for row in first.values() if (image := _usable(dataset, row)) is not None]
        if len(images) >= _FEWEST:
            rows.append(ClothRow(cloth, side, fold_responses(images, dataset.protocol)))
    return rows


def _usable(dataset: DrapeDataset, row: int) -> np.ndarray | None:
    """An image that can be read and has the right scale."""
    try:
        image = dataset.image(row).numpy()
    except BadImage:
        return None
    return None if fit_plate(image, dataset.protocol).fault == "shrunken-image" else np.asarray(image, np.float64)
