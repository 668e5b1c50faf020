"""Source of a run's data, and the data themselves, loaded once in each process."""

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from cusick_bench.datasets import REGISTRY, DrapeDataset, load
from cusick_bench.datasets.errors import DataError


@dataclass(frozen=True)
class Source:
    """Source of a data set, which is sent to workers instead of the data.

    Attributes:
        data: Name or folder.
        fabrics_csv: Table of areal densities, None for the one beside the data.
    """

    data: str
    fabrics_csv: str | None = None

    def places(self, run: Path) -> dict[str, dict[str, str]]:
        """Places of the data, by which they are found from any working folder.

        Args:
            run: Results folder.

        Returns:
            Of `data`, and of `fabrics_csv` where there is one: `given`, as it was named, and of a folder or file its
            absolute `path` and its place as seen `from_run`, which holds where both are moved together.
        """
        named = {"data": self.data, "fabrics_csv": self.fabrics_csv}
        return {name: _place(given, run) for name, given in named.items() if given is not None}


def _place(given: str, run: Path) -> dict[str, str]:
    place = {"given": given}
    if given not in REGISTRY:
        path = Path(given).expanduser().resolve()
        place["path"] = str(path)
        with suppress(ValueError):  # Windows: on another drive
            place["from_run"] = Path(os.path.relpath(path, run.resolve())).as_posix()
    return place


def load_once(source: Source) -> DrapeDataset:
    """The data set of a source.

    Args:
        source: Where it comes from.

    Returns:
        The data set, the same object for every cell of a process: as it was when it was first loaded, so that in a
        process that outlives changes of the data, such as a notebook, cells are planned with `datasets.load`.

    Raises:
        DataError: It cannot be loaded.
    """
    anywhere = source.data in REGISTRY and source.fabrics_csv is None
    return _loaded(source, "" if anywhere else os.getcwd())


def load_afresh(source: Source) -> DrapeDataset:
    """The data set of a source as it is now, whatever this process has loaded before.

    Args:
        source: Where it comes from.

    Returns:
        The data set, which `load_once` gives from now on.

    Raises:
        DataError: It cannot be loaded.
    """
    _loaded.cache_clear()
    return load_once(source)


def load_planned(source: Source, dataset_hash: str) -> DrapeDataset:
    """The data set that cells were planned for; loaded again where this process has kept an earlier state of it.

    Args:
        source: Where it comes from.
        dataset_hash: Its content hash, from the cells.

    Returns:
        The data set, the same object for every cell of a process.

    Raises:
        DataError: It cannot be loaded, or is another one by now.
    """
    dataset = load_once(source)
    if dataset.content_hash != dataset_hash:
        dataset = load_afresh(source)
    if dataset.content_hash != dataset_hash:
        raise DataError(
            f"the data {source.data} are not those that the cells were planned for: files, weights or protocol have "
            "changed since",
            remedy="repeat the command, which plans anew",
        )
    return dataset


def require_unchanged(source: Source, planned: Iterable[str]) -> None:
    """Makes sure that the data are still those that cells were planned for, whatever this process has loaded before.

    Args:
        source: Where they come from.
        planned: Content hashes, from the cells.

    Raises:
        DataError: They cannot be loaded, or are others by now.
    """
    load_afresh(source)
    for dataset_hash in sorted(set(planned)):
        load_planned(source, dataset_hash)


@lru_cache(maxsize=1)  # a data set is frozen, and its files are taken not to change while a grid runs
def _loaded(source: Source, folder: str) -> DrapeDataset:
    """Loads a data set; a relative path means another one in another working folder."""
    return load(source.data, fabrics_csv=source.fabrics_csv)
