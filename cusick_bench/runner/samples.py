"""What cells read of the data: kept for the cells that follow, which are mostly about the same cloth.

Decoding and checking the silhouettes of a cloth takes longer than scoring a trivial answer. What is kept is bounded, so
that memory does not grow with the grid: a cloth of 48 silhouettes takes about 50 MB.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset, DrapeSample

Silhouette = Float[ndarray, "size size"]

SAMPLES_KEPT = 64  # more than a cloth has in the release


@lru_cache(maxsize=SAMPLES_KEPT)
def read_sample(dataset: DrapeDataset, row: int) -> DrapeSample:
    """A drape.

    Args:
        dataset: Data.
        row: Row of its index.

    Returns:
        The sample, the same object for every cell of a process as long as it is kept.
    """
    return dataset.sample(row)


def read_image(dataset: DrapeDataset, row: int) -> Silhouette:
    """A silhouette.

    Args:
        dataset: Data.
        row: Row of its index.

    Returns:
        Coverage in [0, 1], an array of the caller's own.
    """
    return read_sample(dataset, row).image.numpy().astype(np.float64)


@lru_cache(maxsize=1)
def read_repeats(dataset: DrapeDataset, cloth: str) -> list[tuple[Silhouette, Silhouette]]:
    """Pairs of captures of one drape: the floor below which no score of this cloth means anything.

    Args:
        dataset: Data.
        cloth: Name of a set.

    Returns:
        Pairs of silhouettes; whoever reads them must not write to them.
    """
    pairs = dataset.repeat_pairs(cloth)
    images = {row: np.asarray(dataset.image(row), dtype=np.float64) for pair in pairs for row in pair}
    return [(images[row], images[other]) for row, other in pairs]
