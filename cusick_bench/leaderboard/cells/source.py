"""The data of a run, found from its record, so that commands on a results folder need no `--data`."""

import os
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.errors import DataNotFound
from cusick_bench.datasets.loading import read_dataset
from cusick_bench.datasets.registry import folder_of
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.errors import LeaderboardError


def data_of(cells: Cells) -> tuple[str, str | None]:
    """The data of the run and its table of areal densities, wherever this is asked from.

    Args:
        cells: Cells of the run's folder.

    Returns:
        The name or folder of the data, and the table of areal densities, if one was named. Folder and table are those
        that the run was given or, where the results folder was moved with them, their like beside it. A run that does
        not record them so is asked for its command line. Of several commands the last one counts that finished cells
        are of.
    """
    command = _command_of(cells)
    places = command.get("source")
    if not isinstance(places, dict):
        places = {}
    given = _options_of(command)
    data = _found(places.get("data"), cells.folder) or given.get("--data", str(cells.table["dataset"].iloc[0]))
    return data, _found(places.get("fabrics_csv"), cells.folder) or given.get("--fabrics-csv")


def _command_of(cells: Cells) -> Mapping[str, Any]:
    """The record of the last command whose data the cells are of; where no record tells its data, of the last one."""
    hashes, earlier = set(cells.table["dataset_hash"]), reversed(cells.run.get("history", []))
    return next((one for one in (cells.run, *earlier) if one.get("dataset_hash") in hashes), cells.run)


def _options_of(command: Mapping[str, Any]) -> dict[str, str]:
    """Data and table as they stand in a command line."""
    line = command.get("command")
    words = [str(word) for word in line] if isinstance(line, list) else []
    given: dict[str, str] = {}
    for word, following in pairwise([*words, ""]):
        name, equals, value = word.partition("=")
        if name in ("--data", "--fabrics-csv"):
            given[name] = value if equals else following
    return given


def _found(place: Any, run: Path) -> str:
    """A recorded place that is there: as it was, or as seen from the results folder; else as it was given."""
    if not isinstance(place, dict):
        return ""
    path, near = place.get("path"), place.get("from_run")
    for candidate in ([Path(path)] if path else []) + ([run.resolve() / near] if near else []):
        if candidate.exists():
            return os.path.normpath(candidate)
    return str(path or place.get("given", ""))


def load_data_of(cells: Cells, data: str | None = None, fabrics_csv: str | Path | None = None) -> DrapeDataset:
    """Loads the data of a run; whether they are those that it used is for the caller to check.

    Args:
        cells: Cells of the run's folder.
        data: Name or folder; by default what the run was given, or where that is not here, the release in CUSICK_DATA.
        fabrics_csv: Table of areal densities; by default what the run was given.

    Returns:
        The data set.

    Raises:
        LeaderboardError: The run's own data are not here, and no others were named.
        DataError: They cannot be loaded.
    """
    recorded, table = data_of(cells)
    return read_dataset(data or _present(recorded, cells.folder), fabrics_csv=fabrics_csv or table)


def data_set_of(cells: Cells, data: str | None = None) -> str:
    """The data set that a command is about whose pictures and sizes are those of one.

    Args:
        cells: Cells of the run's folder.
        data: Name or folder that the user gave.

    Returns:
        Its name: of several in the folder that of `data`, or else that of the last command that has finished cells.

    Raises:
        LeaderboardError: The folder has several, and none of them is `data`.
        DataError: `data` cannot be loaded.
    """
    names = sorted(set(cells.table["dataset"]))
    if len(names) == 1 or data is None:
        last = _command_of(cells).get("dataset")
        return str(last) if last in names else names[0]
    if (name := load_data_of(cells, data).name) not in names:
        raise LeaderboardError(
            f"{cells.folder} has no cell on {name}; give the data of {' or '.join(names)} with --data"
        )
    return name


def only_of(cells: Cells, name: str) -> Cells:
    """The cells of one data set.

    Args:
        cells: Cells of a folder.
        name: Name of the data set.

    Returns:
        Its cells, and those that are left out of it or of no data set that can be read.
    """
    table = cells.table.loc[cells.table["dataset"] == name].reset_index(drop=True)
    skipped = tuple(cell for cell in cells.skipped if cell.columns.get("dataset", name) == name)
    return replace(cells, table=table, skipped=skipped)


def _present(recorded: str, run: Path) -> str:
    """The recorded data where they are here, else the public release."""
    try:
        folder_of(recorded)
    except DataNotFound as error:
        if recorded == "cusick" or not os.environ.get("CUSICK_DATA"):
            raise LeaderboardError(
                f"the data of {run} must be here, and {error.where} is not; give their folder with --data, or, for the "
                "public release, set CUSICK_DATA to it; `check`, which has no --data, finds them where they were"
            ) from error
        return "cusick"
    return recorded
