"""The data of a run, found again from its record: whoever reads a results folder need not say where they are."""

import os
from itertools import pairwise
from pathlib import Path

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.errors import DataNotFound
from cusick_bench.datasets.registry import folder_of
from cusick_bench.leaderboard.cells import Cells
from cusick_bench.leaderboard.errors import LeaderboardError


def data_of(cells: Cells) -> tuple[str, str | None]:
    """The `--data` and `--fabrics-csv` of the run's command line; the data set's name where it had none.

    Args:
        cells: What the run's folder holds.

    Returns:
        The name or folder of the data, and the table of areal densities, if one was named.
    """
    words = [str(word) for word in cells.run.get("command", []) or []]
    given: dict[str, str] = {}
    for word, following in pairwise([*words, ""]):
        name, equals, value = word.partition("=")
        if name in ("--data", "--fabrics-csv"):
            given[name] = value if equals else following
    return given.get("--data", str(cells.table["dataset"].iloc[0])), given.get("--fabrics-csv")


def load_data_of(cells: Cells, data: str | None = None, fabrics_csv: str | Path | None = None) -> DrapeDataset:
    """Loads the data of a run; whether they are those that it used is for the caller to check.

    Args:
        cells: What the run's folder holds.
        data: Name or folder; by default what the run was given, or where that is not here, the release in CUSICK_DATA.
        fabrics_csv: Table of areal densities; by default what the run was given.

    Returns:
        The data set.

    Raises:
        LeaderboardError: The run's own data are not here, and no others were named.
        DataError: They cannot be loaded.
    """
    recorded, table = data_of(cells)
    return load(data or _present(recorded, cells.folder), fabrics_csv=fabrics_csv or table)


def _present(recorded: str, run: Path) -> str:
    """The recorded data where they are here, else the public release."""
    try:
        folder_of(recorded)
    except DataNotFound as error:
        if recorded == "cusick" or not os.environ.get("CUSICK_DATA"):
            raise LeaderboardError(
                f"the data of {run} must be here, and {error.where} is not; give their folder with --data, or, for the "
                "public release, set CUSICK_DATA to it"
            ) from error
        return "cusick"
    return recorded
