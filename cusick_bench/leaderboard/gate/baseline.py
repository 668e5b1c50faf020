"""Tables of cells to compare: read from a results folder, CSV or JSON, and written as a baseline to commit.

A baseline holds a line a cell: who (solver), where (cloth, seed), whether it finished, under which settings and on
which data, and the metrics. Other projects need only the columns solver, cloth, seed and their metrics, as CSV or as
JSON, `{"cells": [{"solver": ..., "cloth": ..., "seed": ..., "train_mse": ...}]}`.
"""

import hashlib
from collections.abc import Iterable
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd

from cusick_bench.files import read_csv, read_json, read_text
from cusick_bench.leaderboard.board import metric_names
from cusick_bench.leaderboard.cells import Cells, load_cells
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.runner.store import write_atomically

IDENTITY = ("solver", "cloth", "seed")
KEPT = ("train_mse", "test_mse", "test_mse_best", "test_hausdorff_m", "test_profile_rms_m", "test_dc_error")
"""Metrics that a baseline keeps; `check` compares some of them."""

_PROBLEM = ("status", "settings", "dataset_hash", "code_version")
_MOST_BYTES = 64 << 20
_DIGITS = 8  # significant, of a baseline's numbers


def read_cells(path: Path) -> pd.DataFrame:
    """Reads cells to compare.

    Args:
        path: A results folder of `run --out`, or a CSV or JSON file of cells.

    Returns:
        A row a cell: solver, cloth, seed, status ("done" or "failed"), what is known of its problem, metrics.

    Raises:
        LeaderboardError: There is no such file, it holds no cells, or some of them twice.
    """
    if path.is_dir():
        table = _of_run(load_cells(path))
    elif path.is_file():
        table = _of_file(path)
    else:
        raise LeaderboardError(f"no cells at {path}; give a folder of `cusick-bench run --out`, a CSV or a JSON file")
    double = table.duplicated(list(IDENTITY), keep=False)
    if double.any():
        first = table.loc[double].iloc[0]
        raise LeaderboardError(
            f"{path} holds {first['solver']} on {first['cloth']}, seed {first['seed']}, more than once; "
            "compare runs of one command, each in its own folder"
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
    columns = [name for name in (*IDENTITY, *_PROBLEM, *KEPT) if name in table]
    text = table[columns].to_csv(index=False, lineterminator="\n", float_format=f"%.{_DIGITS}g")
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


def _of_run(cells: Cells) -> pd.DataFrame:
    """Cells of a results folder; where it holds some twice (other code, other settings), those of its last command."""
    done = cells.table.copy()
    done["key"] = [folder.name for folder in done["folder"]]
    done["settings"] = done["settings"].map(settings_digest)
    failed = [
        {"solver": cell.solver, "cloth": cell.cloth, "seed": cell.seed, "status": "failed", "key": cell.folder.name}
        for cell in cells.skipped
        if cell.seed is not None
    ]
    table = done.assign(status="done")
    table = pd.concat([table, pd.DataFrame(failed)], ignore_index=True) if failed else table
    last = table["key"].isin(cells.run.get("cells", []))
    stale = table.duplicated(list(IDENTITY), keep=False) & ~last
    kept = table.loc[~stale].sort_values(list(IDENTITY), ignore_index=True)
    return kept[[*IDENTITY, *_PROBLEM, *metric_names(kept)]].astype({"seed": int})


def _of_file(path: Path) -> pd.DataFrame:
    try:
        if path.suffix == ".json":
            table = _of_json(read_json(path, remedy=""))
        else:
            read_csv(path, remedy="", comment="#")  # no column twice, no line too long
            text = read_text(path, remedy="", most_bytes=_MOST_BYTES)
            table = pd.read_csv(StringIO(text), comment="#")
    except (ValueError, pd.errors.ParserError) as error:
        raise LeaderboardError(f"{path} is no table of cells ({error}); make it anew with `check --write`") from error
    missing = [name for name in IDENTITY if name not in table]
    if missing:
        hint = "a leaderboard has a line a solver, not a cell; " if {"rank", "cloths"} <= set(table) else ""
        raise LeaderboardError(
            f"{path} lacks the column {missing[0]!r}: {hint}make it with `check RUN --against FILE --write`"
        )
    if table.empty:
        raise LeaderboardError(f"{path} holds no cells")
    status = table["status"].fillna("done") if "status" in table else "done"
    names = {"solver": str, "cloth": str, "seed": int}
    return table.assign(status=status).astype(names).sort_values(list(IDENTITY), ignore_index=True)


def _of_json(document: Any) -> pd.DataFrame:
    cells = document.get("cells") if isinstance(document, dict) else document
    if not isinstance(cells, list) or not all(isinstance(cell, dict) for cell in cells):
        raise ValueError('it must hold {"cells": [{"solver": ..., "cloth": ..., "seed": ..., metrics}]}')
    return pd.DataFrame([{**cell, **(cell.get("metrics") or {})} for cell in cells])
