"""Tables of cells to compare: read from a results folder, CSV or JSON, and written as a baseline to commit.

A baseline has a line for each cell: its solver, cloth and seed (and the sample that is left out, where samples are left
out in turn), whether it finished, hashes of its settings and data, its split, and the metrics that `check` can compare.
Other projects need only the columns solver, cloth, seed and their metrics, as CSV or as JSON,
`{"cells": [{"solver": ..., "cloth": ..., "seed": ..., "train_mse": ...}]}`.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from cusick_bench.datasets.splits import LEAVE_ONE_OUT, left_out_sample
from cusick_bench.files import read_csv, read_json
from cusick_bench.files.csv_text import csv_text
from cusick_bench.leaderboard.board import metric_names
from cusick_bench.leaderboard.cells.cell_number import LEFT_OUT, SEEDS, with_numbers
from cusick_bench.leaderboard.cells.commands import cells_of_grid
from cusick_bench.leaderboard.cells.loading import Cells, load_cells
from cusick_bench.leaderboard.cells.plausible import metric_of, name_of, whole_number_of
from cusick_bench.leaderboard.cells.source import load_data_of
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.metric_name import is_metric
from cusick_bench.leaderboard.order import smaller_is_better
from cusick_bench.runner.labels import comparable_versions, unspaced
from cusick_bench.runner.store import write_atomically

IDENTITY = ("solver", "cloth", "seed")
STATUSES = ("done", "failed")

_PROBLEM = ("status", "settings", "dataset_hash", "protocol", "code_version")
_MOST_BYTES = 64 << 20
_DIGITS = 8  # significant, of a baseline's numbers


def read_cells(path: Path, *, progress: Callable[[int, int], None] = lambda done, total: None) -> pd.DataFrame:
    """Reads cells to compare.

    Args:
        path: A results folder of `run --out`, or a CSV or JSON file of cells.
        progress: Called with the cells of a folder that are read, and their number.

    Returns:
        A row a cell: solver, cloth, seed, status ("done" or "failed"), what is known of its problem, metrics; `repeat`,
        its number among those of its solver and cloth, the same in all tables; `left_out` where samples are.

    Raises:
        LeaderboardError: There is no such file, it holds no cells, some of them twice, or one that is damaged: without
            a name, or with a metric that is none. Or the run is not finished.
    """
    if path.is_dir():
        cells = load_cells(path, progress=progress)
        cells.require_sound()
        table = _of_run(cells)
    elif path.is_file():
        table = _of_file(path)
    else:
        raise LeaderboardError(f"no cells at {path}; give a folder of `cusick-bench run --out`, a CSV or a JSON file")
    table = _numbered(table)
    double = table.duplicated(["solver", "cloth", "repeat"], keep=False)
    if double.any():
        first, remedy = table.loc[double].iloc[0], "keep one of them, or give repeats seeds of their own"
        if path.is_dir():
            remedy = "compare runs of one command, each in its own folder"
        elif first.get("protocol") == LEAVE_ONE_OUT and LEFT_OUT not in table:
            remedy = f"give the numbers of the samples that are left out in turn, in a column {LEFT_OUT}"
        raise LeaderboardError(
            f"{path} holds {first['solver']} on {first['cloth']}, seed {first['seed']}, more than once; {remedy}"
        )
    return table


def write_baseline(table: pd.DataFrame, path: Path, facts: Iterable[str]) -> None:
    """Writes cells as a baseline, whole or not at all.

    Args:
        table: From `read_cells`.
        path: A .csv file.
        facts: Lines for its head, such as the command that made it.

    Raises:
        LeaderboardError: The name does not end in .csv.
    """
    if path.suffix != ".csv":
        raise LeaderboardError(f"cannot write {path}: a baseline's name must end in .csv")
    metrics = [name for name in table if is_metric(name) and smaller_is_better(name)]
    columns = [*(name for name in (*IDENTITY, LEFT_OUT, *_PROBLEM) if name in table), *metrics]
    text = csv_text(table.reindex(columns=columns), float_format=f"%.{_DIGITS}g")
    head = "".join(f"# {' '.join(fact.split())}\n" for fact in facts)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, (head + text).encode())


def settings_digest(settings: str) -> str:
    """Fingerprint of a cell's settings, as they stand in the table of `load_cells`.

    Args:
        settings: JSON text.

    Returns:
        12 hexadecimal digits.
    """
    return hashlib.sha256(settings.encode()).hexdigest()[:12]


def _text_of(name: str, value: Any) -> str:
    """What a file says of a cell's problem, as a baseline has it: settings in full, of a `result.json` or of a table of
    `leaderboard --cells`, as their fingerprint.
    """
    text = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
    return settings_digest(text) if name == "settings" and text.startswith("{") else text


def _numbered(table: pd.DataFrame) -> pd.DataFrame:
    """With `repeat`: the seed, and where samples are left out in turn, the sample before it."""
    left_out = table[LEFT_OUT].tolist() if LEFT_OUT in table else []
    if not any(pd.notna(sample) for sample in left_out):
        return table.drop(columns=LEFT_OUT, errors="ignore").assign(repeat=table["seed"])
    shift = [(1 + int(sample)) * SEEDS if pd.notna(sample) else 0 for sample in left_out]
    repeat = [seed + more for seed, more in zip(table["seed"].tolist(), shift, strict=True)]
    return with_numbers(table.astype({LEFT_OUT: "Int64"}), repeat)


def _with_index(cells: Cells) -> tuple[Cells, pd.DataFrame]:
    """Cells, and the index of the run's data, which tells the numbers of samples that are left out in turn.

    Where there are none, the index is empty; else cells of other data are left aside, whose rows are other samples.

    Raises:
        LeaderboardError: Cells of the last command are of other data, or all are.
    """
    table, skipped = cells.table, cells.skipped
    without = [cell for cell in skipped if cell.columns.get("protocol") == LEAVE_ONE_OUT]
    if LEAVE_ONE_OUT not in set(table["protocol"]) and not without:
        return cells, pd.DataFrame()
    dataset, last = load_data_of(cells), set(cells.run.get("cells", []))
    states = zip(table["protocol"], table["dataset_hash"], strict=True)
    own = [split != LEAVE_ONE_OUT or state == dataset.content_hash for split, state in states]
    without = [cell for cell in without if cell.columns["dataset_hash"] != dataset.content_hash]
    others = {folder.name for folder, kept in zip(table["folder"], own, strict=True) if not kept}
    others |= {cell.folder.name for cell in without}
    if last & others or (others and not any(own)):
        raise LeaderboardError(
            f"{dataset.name} must be the data of {cells.folder}, since they tell which samples were left out, and is "
            "not what the run used; repeat its `cusick-bench run` command, or bring back the data"
        )
    kept = tuple(cell for cell in skipped if cell not in without)
    return replace(cells, table=table.loc[own].reset_index(drop=True), skipped=kept), dataset.table


def _of_run(cells: Cells) -> pd.DataFrame:
    """Cells of a results folder; where it holds some twice (other code, other settings), those asked for last.

    Cells of a solver by other code than those of the last command stay out, though this asked for fewer seeds.
    """
    cells, index = _with_index(cells)
    done = cells.table.drop(columns="repeat")
    done[LEFT_OUT] = [left_out_sample(index, *split) for split in zip(done["protocol"], done["test"], strict=True)]
    done["key"] = [folder.name for folder in done["folder"]]
    done["settings"] = done["settings"].map(settings_digest)
    others = [
        {"solver": cell.solver, "cloth": cell.cloth, "seed": cell.seed, "status": cell.status, "key": cell.folder.name}
        | (_problem_of(cell.columns, index) if cell.columns else {})
        for cell in cells.skipped
        if cell.seed is not None
    ]
    table = done.assign(status="done")
    table = pd.concat([table, pd.DataFrame(others)], ignore_index=True) if others else table
    commands = [*cells.run.get("history", []), cells.run]
    places = {key: place for place, command in enumerate(commands) for key in command.get("cells", [])}
    asked = pd.Series([places.get(key, -1) for key in table["key"]], table.index)
    last = asked.groupby([table[name] for name in (*IDENTITY, LEFT_OUT)], dropna=False).transform("max")
    table = table.loc[asked == last].assign(asked=last)
    latest = table.loc[table["asked"] == table.groupby("solver")["asked"].transform("max")]
    versions = comparable_versions(table["code_version"].dropna().unique())
    codes = latest.dropna(subset=["code_version"]).groupby("solver")["code_version"]
    known = {solver: {versions[code] for code in group} for solver, group in codes}
    same = [
        pd.isna(code) or solver not in known or versions[code] in known[solver]
        for solver, code in zip(table["solver"], table["code_version"], strict=True)
    ]
    table = table.loc[same]
    _require_finished(cells, table)
    kept = table.sort_values(list(IDENTITY), ignore_index=True)
    return kept[[*IDENTITY, LEFT_OUT, *_PROBLEM, *metric_names(kept)]].astype({"seed": int})


def _problem_of(columns: Mapping[str, Any], index: pd.DataFrame) -> dict[str, Any]:
    """What a cell that has no metrics shares with those that have."""
    sample = left_out_sample(index, columns["protocol"], columns["test"])
    return {LEFT_OUT: sample, "code_version": columns["code_version"]}


def _require_finished(cells: Cells, table: pd.DataFrame) -> None:
    """Refuses a run that has not come to its end: what an older command has left would stand for what it lacks."""
    last, known = set(cells.run.get("cells", [])), set(table["key"])
    present = {folder.name for folder in cells.table["folder"]} | {cell.folder.name for cell in cells.skipped}
    left = table.loc[table["status"] == "unfinished", "key"].tolist()
    left += [key for key in cells_of_grid(cells.run) if key not in (known if key in last else present)]
    if left:
        raise LeaderboardError(
            f"{cells.folder} is not finished: {len(left)} cells were cut off or not begun, such as {left[0]}; repeat "
            "its `cusick-bench run` command to go on"
        )


def _of_file(path: Path) -> pd.DataFrame:
    try:
        entries = _of_json(path) if path.suffix == ".json" else _of_csv(path)
    except ValueError as error:
        raise LeaderboardError(f"{path} is no table of cells ({error}); make it anew with `check --write`") from error
    if not entries:
        raise LeaderboardError(f"{path} holds no cells; make it with `check RUN --against FILE --write`")
    names = {name for _, entry in entries for name in entry}
    missing = [name for name in IDENTITY if name not in names]
    if missing:
        hint = "a leaderboard has a line a solver, not a cell; " if {"rank", "cloths"} <= names else ""
        raise LeaderboardError(
            f"{path} lacks the column {missing[0]!r}: {hint}make it with `check RUN --against FILE --write`"
        )
    table = pd.DataFrame([_cell(where, entry) for where, entry in entries])
    return table.astype({"seed": int}).sort_values(list(IDENTITY), ignore_index=True)


def _of_csv(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Lines of a CSV file with where they stand, empty cells as None."""
    table = read_csv(path, remedy="", comment="#", most_bytes=_MOST_BYTES)
    if not table.rows:
        return [(str(path), dict.fromkeys(table.header))] if not set(IDENTITY) <= set(table.header) else []
    return [(f"{path}, line {line}", {name: text or None for name, text in row.items()}) for line, row in table.rows]


def _of_json(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Cells of a JSON file with where they stand, their metrics beside the rest."""
    document: Any = read_json(path, remedy="")
    cells = document.get("cells") if isinstance(document, dict) else document
    if not isinstance(cells, list) or not all(isinstance(cell, dict) for cell in cells):
        raise ValueError('it must hold {"cells": [{"solver": ..., "cloth": ..., "seed": ..., metrics}]}')
    if not all(isinstance(cell.get("metrics") or {}, dict) for cell in cells):
        raise ValueError('metrics of a cell must be an object, {"train_mse": ..., ...}')
    return [(f"{path}, cell {place}", {**cell, **(cell.get("metrics") or {})}) for place, cell in enumerate(cells, 1)]


def _cell(where: str, entry: dict[str, Any]) -> dict[str, Any]:
    """A cell of a file, its numbers as numbers; raises LeaderboardError where it says what no cell can say."""
    try:
        cell = entry | {name: name_of(name, entry.get(name)) for name in ("solver", "cloth")}
        cell["solver"] = unspaced(cell["solver"])
        cell["seed"] = whole_number_of("seed", entry.get("seed"))
        if entry.get(LEFT_OUT) is not None:
            cell[LEFT_OUT] = whole_number_of(LEFT_OUT, entry[LEFT_OUT])
        cell |= {name: _text_of(name, entry[name]) for name in _PROBLEM if entry.get(name) is not None}
        cell["status"] = entry.get("status") or "done"
        if cell["status"] not in STATUSES:
            raise ValueError(f"status must be {' or '.join(STATUSES)}, got {cell['status']!r}")
        return cell | {name: metric_of(name, entry[name]) for name in entry if is_metric(name)}
    except ValueError as error:
        raise LeaderboardError(f"{where}: {error}; correct the file, or make it anew with `check --write`") from error
