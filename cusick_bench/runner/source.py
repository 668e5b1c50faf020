"""Where a run's data come from, and the data themselves, loaded once a process."""

from dataclasses import dataclass
from functools import lru_cache

from cusick_bench.datasets import DrapeDataset, load


@dataclass(frozen=True)
class Source:
    """Where a data set comes from: what workers are sent instead of the data.

    Attributes:
        data: Name or folder.
        fabrics_csv: Table of areal densities, None for the one beside the data.
    """

    data: str
    fabrics_csv: str | None = None


@lru_cache(maxsize=1)  # a data set is frozen, and its files are taken not to change while a grid runs
def load_once(source: Source) -> DrapeDataset:
    """The data set of a source.

    Args:
        source: Where it comes from.

    Returns:
        The data set, the same object for every cell of a process.

    Raises:
        DataError: It cannot be loaded.
    """
    return load(source.data, fabrics_csv=source.fabrics_csv)
