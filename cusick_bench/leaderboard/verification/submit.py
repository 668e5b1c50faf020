"""Rows of a run for a committed table: one file for each track, one line for each solver, with all data to repeat it.

A line is identified by its track and the hash of its cells, and so by code, data, settings and budget. If it is
submitted again, it replaces the line before and its state, which becomes *verified* once all of its cells are
(`verify`). Ranks are left out, since they are among the rows of one run, and a table collects many runs. A table that
`leaderboard --out` wrote for the same grid becomes a track's file when that grid is submitted; a table of another grid
is left as it is.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from io import StringIO
from math import isclose, isnan, nan
from pathlib import Path
from typing import Any

import pandas as pd

from cusick_bench.files import BadFile, read_csv
from cusick_bench.files.csv_text import csv_text
from cusick_bench.files.folder_lock import locked
from cusick_bench.leaderboard.board import Leaderboard, leaderboards, metric_names, of_board
from cusick_bench.leaderboard.cells.commands import command_record, machine, typed
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.cells.variants import variants
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.formats import record
from cusick_bench.leaderboard.row import Row
from cusick_bench.leaderboard.verification.tracks import require_fit
from cusick_bench.leaderboard.verification.verify import verified_keys
from cusick_bench.runner.labels import unspaced
from cusick_bench.runner.store import write_atomically

_TRACK = re.compile(r"[a-z0-9][a-z0-9-]*")
_LEFT_OUT = ("_mean", "_iqm")
_FIRST = ("track", "solver", "variant", "kind", "state", "cells", "failed", "cloths", "draws")
_LAST = (
    "dataset", "dataset_hash", "protocol", "settings", "budget", "command", "code_version", "hardware", "time", "row",
)  # fmt: skip
_STATED = ("solver", "kind", "cloths", "dataset", "dataset_hash", "protocol", "settings", "budget")
"""Columns of text that say what a line's numbers are of."""
_GRID = ("solver", "variant", "kind", "cells", "cloths", "dataset", "dataset_hash", "protocol")
"""Columns by which a line of a leaderboard and a line of a track are matched, whatever code they were run with."""


def rows_of(cells: Cells, track: str) -> list[dict[str, Any]]:
    """Lines for a track.

    Args:
        cells: Cells of a results folder.
        track: Such as `paper-table-1`: lower-case letters, digits and hyphens.

    Returns:
        A line a solver, its values by column.

    Raises:
        LeaderboardError: The track's name is none.
    """
    if not _TRACK.fullmatch(track):
        raise LeaderboardError(f"a track's name has lower-case letters, digits and hyphens, got {track!r}")
    verified, lines = verified_keys(cells.folder), []
    for board in leaderboards(cells):
        groups = dict(variants(of_board(cells.table, board)))
        ranked = [row for row in board.rows if row.kind != "floor"]
        lines += [_line(board, row, groups[row.solver, row.variant], cells, track, verified) for row in ranked]
    return lines


def append(path: Path, rows: list[dict[str, Any]]) -> dict[str, int]:
    """Adds lines to a track's file, whole or not at all; a line that is there already is replaced.

    Args:
        path: The track's file.
        rows: From `rows_of`.

    Returns:
        How many were added, replaced, and left as they were.

    Raises:
        LeaderboardError: The file is no such table, or a leaderboard with solvers or data that the lines lack; or the
            lines have data or mesh sizes that their track is not for.
    """
    if path.suffix != ".csv":
        raise LeaderboardError(f"cannot write {path}: a track's file must end in .csv")
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked(path.parent):
        old = _lines_in(path, rows) if path.exists() else pd.DataFrame({"row": []}, dtype=str)
        new = pd.read_csv(StringIO(pd.DataFrame(rows).to_csv(index=False)), dtype=str, keep_default_na=False)
        known = {_key(line): line for line in old.to_dict("records")}
        require_fit(rows, known.values())
        counts = {"added": 0, "replaced": 0, "unchanged": 0}
        for line in new.to_dict("records"):
            before = known.get(_key(line))
            same = before is not None and all(str(before.get(name, "")) == value for name, value in line.items())
            counts["unchanged" if same else "added" if before is None else "replaced"] += 1
            known[_key(line)] = line
        table = pd.DataFrame(list(known.values())).fillna("")
        write_atomically(path, csv_text(table.reindex(columns=_ordered(list(table)))).encode())
    return counts


def _key(line: Mapping[Any, Any]) -> tuple[str, str]:
    """Key of a line in a file; one run may be in several tracks."""
    return str(line.get("track", "")), str(line["row"])


def read_rows(path: Path) -> pd.DataFrame:
    """Lines of a track's file, as text.

    Args:
        path: The track's file.

    Returns:
        A table of strings.

    Raises:
        LeaderboardError: It is no such table.
    """
    table = _read_table(path)
    if "row" not in table:
        raise LeaderboardError(f"{path} has no column 'row', so `submit` did not make it; choose another --out")
    return table


def altered(line: dict[str, Any], made: dict[str, Any]) -> list[str]:
    """What a committed line says and its run does not, but for what depends on the rows beside: intervals, variant.

    A metric or cost that the run has not is among it.

    Args:
        line: The committed line.
        made: The line that its run gives now, from `rows_of`.

    Returns:
        A sentence for each number that differs, and for each of `_STATED`.
    """
    wrong = []
    for name, value in made.items():
        if not isinstance(value, int | float) or name.endswith(("_low", "_high")) or name == "matched_null":
            continue
        text = str(line.get(name, ""))
        try:
            claimed = float(text) if text else nan
        except ValueError:
            claimed = nan
        if not (isnan(claimed) and isnan(value)) and not isclose(claimed, value, rel_tol=1e-9, abs_tol=1e-12):
            wrong.append(f"{name} {text or 'missing'}, the run has {value:.6g}")
    measured = [name for name in metric_names(pd.DataFrame([line])) if not name.endswith((*_LEFT_OUT, "_low", "_high"))]
    wrong += [f"{name} {line[name]}, the run has none" for name in measured if line[name] and name not in made]
    for name in _STATED:
        claimed, text = (str(one[name]) if name in one else "" for one in (line, made))
        if name == "solver":  # equal options may be written in several ways
            claimed, text = (unspaced(one).partition(",")[0] for one in (claimed, text))
        if name in line and claimed != text:
            wrong.append(f"{name} {claimed or 'missing'}, the run has {text}")
    return wrong


def _read_table(path: Path) -> pd.DataFrame:
    try:
        found = read_csv(path, remedy="restore it, or choose another --out")
    except BadFile as error:
        raise LeaderboardError(f"{error.where} is no table ({error.what}); {error.remedy}") from error
    return pd.DataFrame([cells for _, cells in found.rows], columns=list(found.header), dtype=str)


def _lines_in(path: Path, rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Lines that a file has before a submission; none of a leaderboard, where the submission says all that it says."""
    table = _read_table(path)
    if "row" in table or not set(_GRID) <= set(table):
        return read_rows(path)
    offered = {tuple(str(row[name]) for name in _GRID) for row in rows}
    lost = [
        f"{line['solver']} on {line['cloths']} of {line['dataset']}"
        for line in table.to_dict("records")
        if line["kind"] != "floor" and tuple(line[name] for name in _GRID) not in offered
    ]
    if lost:
        raise LeaderboardError(
            f"{path} was written by `leaderboard --out` and has {len(lost)} lines of another grid, which this run does "
            f"not replace ({'; '.join(lost[:3])}); move it away, submit its run as well, or choose another --out"
        )
    return table.iloc[:0].assign(row="")


def _line(
    board: Leaderboard, row: Row, group: pd.DataFrame, cells: Cells, track: str, verified: set[str]
) -> dict[str, Any]:
    keys = sorted(folder.name for folder in group["folder"])
    full = record(board, row)
    settings = json.loads(str(group["settings"].iloc[0]))
    made = command_record(cells.run, keys)
    numbers = {name: value for name, value in full.items() if not name.endswith(_LEFT_OUT) and name != "rank"}
    line = numbers | {
        "track": track,
        "state": "verified" if verified.issuperset(keys) else "reported",
        "settings": json.dumps(settings, sort_keys=True),
        "budget": _budget(settings.get("budget") or {}),
        "command": typed(made.get("command", [])),
        "hardware": machine(made),
        "time": made.get("time", ""),
        "row": hashlib.sha256(" ".join(keys).encode()).hexdigest()[:16],
    }
    return {name: line[name] for name in _ordered(list(line))}


def _budget(budget: dict[str, Any]) -> str:
    units = {"forward_equivalents": "drapes", "seconds": "s"}
    return ", ".join(f"{budget[name]:g} {unit}" for name, unit in units.items() if budget.get(name)) or "none"


def _ordered(names: list[str]) -> list[str]:
    middle = [name for name in names if name not in (*_FIRST, *_LAST)]
    return [name for name in (*_FIRST, *middle, *_LAST) if name in names]
