"""Samples that cells read from the data, cached for the next cells, which mostly use the same cloth.

Decoding and checking the silhouettes of a cloth takes longer than scoring a trivial answer. The cache is limited in
bytes, so that memory grows neither with the grid nor with the width of the silhouettes: a cloth with 48 silhouettes of
512 pixels takes about 50 MB.
"""

from collections import OrderedDict
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TypedDict

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset, DrapeSample
from cusick_bench.datasets.errors import BadImage
from cusick_bench.datasets.index import OTHER_FACE

Silhouette = Float[ndarray, "size size"]

MOST_BYTES = 2**28
"""Most memory of the samples that are kept [bytes]: those of five cloths of the release."""


class SeenOfSamples(TypedDict):
    """What of a split's samples decides how they are fitted and scored, as `cell_numerics` takes it."""

    both_faces: bool
    repeats: bool
    series: bool
    pinhole: bool


@dataclass(frozen=True, eq=False)
class SampleCache:
    """The samples of a data set that were read last, at least one.

    Attributes:
        dataset: The data set.
        most_bytes: Most memory that they take together, unless one alone takes more [bytes].
    """

    dataset: DrapeDataset
    most_bytes: int = MOST_BYTES
    _kept: OrderedDict[int, DrapeSample] = field(init=False, repr=False, default_factory=OrderedDict)

    def read(self, row: int) -> DrapeSample:
        """A drape.

        Args:
            row: Row of the data set's index.

        Returns:
            The sample, the same object as long as it is kept.
        """
        if row not in self._kept:
            self._kept[row] = self.dataset.sample(row)
        self._kept.move_to_end(row)
        sizes = {kept: _bytes(sample) for kept, sample in self._kept.items()}
        while len(sizes) > 1 and sum(sizes.values()) > self.most_bytes:
            oldest, _ = self._kept.popitem(last=False)
            del sizes[oldest]
        return self._kept[row]


def _bytes(sample: DrapeSample) -> int:
    """Memory of a sample; its mesh is part of it once somebody has asked for that."""
    mesh = vars(sample).get("mesh")
    of_mesh = 0 if mesh is None else mesh.vertices.nbytes + mesh.faces.nbytes
    return sample.image.nbytes + sample.profile.radii.nbytes + of_mesh


@lru_cache(maxsize=1)
def _cache(dataset: DrapeDataset) -> SampleCache:
    return SampleCache(dataset)


def read_sample(dataset: DrapeDataset, row: int) -> DrapeSample:
    """A drape.

    Args:
        dataset: The data set.
        row: Row of its index.

    Returns:
        The sample, the same object for every cell of a process as long as it is kept.
    """
    return _cache(dataset).read(row)


def read_image(dataset: DrapeDataset, row: int) -> Silhouette:
    """A silhouette.

    Args:
        dataset: The data set.
        row: Row of its index.

    Returns:
        Coverage in [0, 1], an array of the caller's own.
    """
    return read_sample(dataset, row).image.numpy().astype(np.float64)


def readable_rows(dataset: DrapeDataset, rows: Iterable[int]) -> list[int]:
    """Rows whose silhouette can be read.

    Args:
        dataset: The data set.
        rows: Rows of its index.

    Returns:
        Those, in the same order.
    """
    readable = []
    for row in rows:
        with suppress(BadImage):
            read_sample(dataset, row)  # which keeps it for whoever reads these rows next
            readable.append(row)
    return readable


def training_rows(dataset: DrapeDataset, train: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """First captures of a cloth's training samples, by the face that is up: captures repeat each other.

    Args:
        dataset: The data set.
        train: Rows of its index that train; the first one is fitted.

    Returns:
        Rows that show the face of the first one, that one first, and rows known to show the other face; one a sample.
    """
    table = dataset.table.loc[list(train)]
    sides = table["side"].astype(str)
    fitted = sides.iloc[0]
    own, other = (table[sides == side].drop_duplicates("sample") for side in (fitted, OTHER_FACE.get(fitted)))
    return tuple(int(row) for row in own.index), tuple(int(row) for row in other.index)


def place_in_order(dataset: DrapeDataset, row: int) -> tuple[int, bool]:
    """Where a picture stands among those of one drape.

    Args:
        dataset: The data set.
        row: Row of its index; the picture of a named set has the number that it has in its fabric.

    Returns:
        Number of the capture, and whether an earlier picture lies before it: another capture, or one of a series over
        time.
    """
    table = dataset.index
    capture = int(table.at[_in_its_fabric(dataset, row), "capture"])
    earlier = any(int(table.at[other, "capture"]) < capture for other in dataset.repeats(row))
    return capture, earlier or _later_in_series(dataset, row)


def _in_its_fabric(dataset: DrapeDataset, row: int) -> int:
    """The row of its fabric that shows a picture of a named set; the row itself where there is none."""
    table = dataset.index
    return int([*table.index[table["image"] == table.at[row, "same_as"]], row][0])


def _later_in_series(dataset: DrapeDataset, row: int) -> bool:
    return int(dataset.index.at[_in_its_fabric(dataset, row), "observation"]) > 1


def seen_of_samples(dataset: DrapeDataset, train: Sequence[int], test: Sequence[int]) -> SeenOfSamples:
    """Faces, captures and camera of the samples of a split.

    Args:
        dataset: The data set.
        train: Rows of its index that train, of one cloth.
        test: Rows that are held out.

    Returns:
        Whether samples of both faces train, whether a held-out sample was captured several times, whether the picture
        that is fitted is a later one of a series over time, and whether the camera was so near that radii are corrected
        for perspective.
    """
    repeats = dataset.table.loc[list(test), "sample"].duplicated().any()
    return SeenOfSamples(
        both_faces=bool(training_rows(dataset, train)[1]),
        repeats=bool(repeats),
        series=_later_in_series(dataset, train[0]),
        pinhole=dataset.protocol.projection == "pinhole",
    )


@lru_cache(maxsize=1)
def read_repeats(dataset: DrapeDataset, cloth: str) -> list[tuple[Silhouette, Silhouette]]:
    """Pairs of captures of one drape that can be read: the floor below which no score of this cloth means anything.

    Args:
        dataset: The data set.
        cloth: Name of a set.

    Returns:
        Pairs of silhouettes; whoever reads them must not write to them.
    """
    pairs, images = dataset.repeat_pairs(cloth), dict[int, Silhouette]()
    for row in dict.fromkeys(row for pair in pairs for row in pair):
        with suppress(BadImage):
            images[row] = np.asarray(dataset.image(row), dtype=np.float64)
    return [(images[row], images[other]) for row, other in pairs if row in images and other in images]
