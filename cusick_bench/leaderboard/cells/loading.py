"""Finished cells of a results folder as one table; cells that failed or are damaged are listed and left out."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import pandas as pd

from cusick_bench.files import BadFile, read_json_object
from cusick_bench.files.shell_word import shell_word
from cusick_bench.leaderboard.cells.cell_number import SEEDS, with_numbers
from cusick_bench.leaderboard.cells.commands import cells_of_grid
from cusick_bench.leaderboard.cells.plausible import metric_of, name_of, whole_number_of
from cusick_bench.leaderboard.cells.record_types import check_result, check_run
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.metrics.found_stiffness import read_stiffness
from cusick_bench.runner import labelled
from cusick_bench.runner.environment import code_text
from cusick_bench.runner.labels import numerics_text, unspaced
from cusick_bench.runner.store import CELL_FILE, MARKED, RESULT_FILE, Store

_MAXIMUM_BYTES = 16 * 2**20  # a result.json has a few kilobytes
_REQUIRED = ("solver", "kind", "cloth", "seed")
_IDENTITY = ("space", "vertices", "dataset", "dataset_hash", "protocol")


@dataclass(frozen=True)
class Skipped:
    """A cell that is left out of the table.

    Attributes:
        folder: Where it lies.
        status: "failed", "unfinished" or "damaged".
        reason: What happened.
        solver: Its solver, "" where even that cannot be read.
        cloth: Its cloth.
        seed: Its seed, None where it cannot be read.
        columns: What identifies its problem, as in `Cells.table`; with `repeat`. Empty where it cannot be read.
    """

    folder: Path
    status: str
    reason: str
    solver: str = ""
    cloth: str = ""
    seed: int | None = None
    columns: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def note(self) -> str:
        """The cell, and why it is left out, in a line."""
        where = f"{self.solver or '?'} on {self.cloth or '?'}, seed {'?' if self.seed is None else self.seed}"
        return f"Left out, {self.status}: {where} ({self.folder.name}): {self.reason.splitlines()[0]}"


@dataclass(frozen=True, eq=False)
class Cells:
    """Finished cells of a results folder.

    Attributes:
        folder: The folder.
        run: Contents of `run.json`, empty where there is none.
        table: One row a finished cell: solver, kind, cloth, seed, what identifies the problem, `code_version` (versions
            of the numerics; of cells of before they had any, a fingerprint of the source), `commit`, `test` (index rows
            of the unseen samples), `spent_*`, all metrics, `stiffness` (a `FoundStiffness`, or None), `folder`, and
            `repeat`, the cell's number among those of its method and cloth.
        skipped: The other cells.
    """

    folder: Path
    run: dict[str, Any]
    table: pd.DataFrame
    skipped: tuple[Skipped, ...]

    def require_sound(self) -> None:
        """Refuses a folder that holds cells whose numbers cannot be believed.

        Raises:
            LeaderboardError: Some cell is damaged.
        """
        damaged = [cell for cell in self.skipped if cell.status == "damaged"]
        if damaged:
            more = f" ({len(damaged) - 1} more are damaged)" if len(damaged) > 1 else ""
            raise LeaderboardError(f"{damaged[0].folder / RESULT_FILE}: {damaged[0].reason}{more}")

    def require_finished(self) -> None:
        """Refuses a folder whose last command has not come to its end.

        Raises:
            LeaderboardError: Cells of its grid were cut off or not begun.
        """
        ended = {folder.name for folder in self.table["folder"]}
        ended |= {cell.folder.name for cell in self.skipped if cell.status != "unfinished"}
        left = [key for key in cells_of_grid(self.run) if key not in ended]
        if left:
            raise LeaderboardError(
                f"{self.folder} is not finished: {len(left)} cells were cut off or not begun, such as {left[0]}; "
                "repeat its `cusick-bench run` command to go on, or with fewer cells to do without the others"
            )


def load_cells(
    folder: Path | str,
    *,
    changed: bool = False,
    looked_at: Sequence[str] = MARKED,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Cells:
    """Reads every cell below a results folder.

    Args:
        folder: The folder that `cusick-bench run --out` wrote, or is writing.
        changed: Whether cells with files that were changed since they were finished stay in the table, for those who
            want to find them out; otherwise they count as damaged.
        looked_at: Files that must be unchanged; predictions are nearly all of a folder and take long to read.
        progress: Called with the cells that are read, and their number.

    Returns:
        Finished cells as a table, and the others by name.

    Raises:
        LeaderboardError: The folder is missing or holds no finished cell.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise LeaderboardError(f"no results folder at {folder}; give the folder of `cusick-bench run --out`")
    rows: list[dict[str, Any]] = []
    skipped: list[Skipped] = []
    folders = sorted(path for path in folder.glob("cells/*") if path.is_dir())
    for count, cell in enumerate(folders, 1):
        outcome = _read_cell(cell, () if changed else looked_at)
        progress(count, len(folders))
        if isinstance(outcome, Skipped):
            skipped.append(outcome)
        else:
            rows.append(outcome)
    if not rows and not skipped:
        command = f"cusick-bench run --out {shell_word(folder)}"
        raise LeaderboardError(f"{folder} holds no cells; fill it with `{command}`")
    if not rows:
        reasons = "\n".join(f"  {cell.solver or '?'} on {cell.cloth or '?'}: {cell.reason}" for cell in skipped[:5])
        raise LeaderboardError(
            f"none of the {len(skipped)} cells in {folder} has finished; "
            f"repeat the `cusick-bench run` command to go on\n{reasons}"
        )
    skipped = _in_one_spelling(rows, skipped)
    table = pd.DataFrame(rows)
    known = [place for place, cell in enumerate(skipped) if cell.columns]
    numbers = _repeats(pd.concat([table, pd.DataFrame([dict(skipped[place].columns) for place in known])]))
    for place, number in zip(known, numbers[len(table) :], strict=True):
        skipped[place] = replace(skipped[place], columns={**skipped[place].columns, "repeat": number})
    table = with_numbers(table, numbers[: len(table)]).sort_values(["solver", "cloth", "seed"], ignore_index=True)
    return Cells(folder, read_run(folder), table, tuple(skipped))


def numbered_alike(tables: Sequence[pd.DataFrame]) -> list[pd.DataFrame]:
    """Tables of several runs, numbered together: the same problem has the same `repeat` in all of them.

    Args:
        tables: `Cells.table` of each run.

    Returns:
        The tables, in this order.
    """
    numbers = iter(_repeats(pd.concat(tables)))
    return [with_numbers(table, list(islice(numbers, len(table)))) for table in tables]


def _repeats(table: pd.DataFrame) -> list[int]:
    """Number of each cell among those of its method and cloth: its seed, and where samples are left out in turn, those.

    The same problem has the same number for all methods.
    """
    numbers = [int(seed) for seed in table["seed"]]
    for _, rows in table.groupby(["dataset_hash", "protocol", "cloth"]).indices.items():
        seeds, left_out = table["seed"].iloc[rows].tolist(), table["test"].iloc[rows].tolist()
        if len(set(zip(seeds, left_out, strict=True))) > len(set(seeds)):
            rank = {test: place for place, test in enumerate(sorted(set(left_out)))}
            for row, test in zip(rows, left_out, strict=True):
                numbers[row] += SEEDS * rank[test]
    return numbers


def _in_one_spelling(rows: Sequence[dict[str, Any]], skipped: Sequence[Skipped]) -> list[Skipped]:
    """Gives cells of one solver with equal options one text, the shortest of theirs; else they would make two rows.

    Options stand in any order in a text, and it may name those that have their defaults. In rows the text is replaced;
    the skipped cells are returned.
    """
    known = [*rows, *(dict(cell.columns) for cell in skipped)]
    methods = [columns.pop("method", None) for columns in known]
    shortest: dict[Any, str] = {}
    for columns, method in zip(known, methods, strict=True):
        if method is not None:
            text = str(columns["solver"])
            shortest[method] = min(shortest.get(method, text), text, key=lambda one: (len(one), one))
    for columns, method in zip(known, methods, strict=True):
        if method is not None:
            columns["solver"] = shortest[method]
    others = zip(skipped, known[len(rows) :], strict=True)
    return [replace(cell, solver=columns.get("solver", cell.solver), columns=columns) for cell, columns in others]


def _read_cell(folder: Path, looked_at: Sequence[str]) -> dict[str, Any] | Skipped:
    try:
        return _read_result(folder, looked_at)
    except FileNotFoundError:
        asked = _asked(folder / CELL_FILE)
        return Skipped(folder, "unfinished", "still running, or killed; repeat the run command to go on", **asked)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        asked = _asked(folder / CELL_FILE)
        return Skipped(folder, "damaged", f"{error}; repeat the run command, which runs the cell again", **asked)


def _read_result(folder: Path, looked_at: Sequence[str]) -> dict[str, Any] | Skipped:
    result = _read_json(folder / RESULT_FILE)
    for name in _REQUIRED:
        if name not in result:
            raise ValueError(f"result.json lacks {name!r}")
    check_result(result)
    identity, test = _named(result), tuple(int(row) for row in result.get("test", ()))
    if result.get("status") == "failed":
        reason, columns = str(result.get("failure") or "no reason recorded"), {**identity, **_problem(result)}
        return Skipped(folder, "failed", reason, **identity, columns=columns | {"test": test})
    if not (folder / "done").exists():
        raise FileNotFoundError("no done marker")
    metrics = {name: metric_of(name, value) for name, value in result["metrics"].items()}
    for name in ("train_mse", "test_mse") if test else ("train_mse",):
        if not math.isfinite(metrics.get(name, math.nan)):
            raise ValueError(f"result.json has no finite {name}")
    if looked_at and (what := Store(folder.parent.parent).changed(folder.name, looked_at)):
        raise ValueError(what)
    spent = {f"spent_{name}": metric_of(f"spent_{name}", value) for name, value in result.get("spent", {}).items()}
    known = {**identity, **_problem(result), "test": test}
    return {**known, **spent, **metrics, "stiffness": read_stiffness(result), "folder": folder}


def _problem(result: Mapping[str, Any]) -> dict[str, Any]:
    """The problem of a cell: cloth, settings and data, with the code that solved it."""
    known = {name: result.get(name, "") for name in _IDENTITY} | _code(result)
    settings = json.dumps(result.get("settings") or {"budget": result.get("budget")}, sort_keys=True)
    return {"kind": str(result["kind"]), **known, "settings": settings, "method": _method(result)}


def _method(result: Mapping[str, Any]) -> tuple[Any, ...] | None:
    """The solver by its name, all of its options and the causes; None of a cell that does not record its options."""
    options = result.get("solver_options")
    if not isinstance(options, dict):
        return None
    name = unspaced(str(result["solver"])).partition(",")[0]
    values = (value if isinstance(value, int | float | str) else json.dumps(value) for value in options.values())
    return (name, frozenset(zip(options, values, strict=True)), *map(str, _causes(result)))


def _causes(record: Mapping[str, Any]) -> Sequence[Any]:
    return (record.get("settings") or {}).get("causes", ())


def _code(result: Mapping[str, Any]) -> dict[str, str]:
    """The code of a cell; cells with the same `code_version` may be compared, whatever their `commit`."""
    if numerics := result.get("numerics"):
        return {"code_version": numerics_text(numerics), "commit": code_text(result)}
    return {"code_version": str(result.get("code_version", "")), "commit": ""}


def _read_json(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise FileNotFoundError(path)
    try:
        return read_json_object(path, remedy="", most_bytes=_MAXIMUM_BYTES)
    except BadFile as error:
        raise ValueError(f"{path.name} {error.what}") from error


def _asked(path: Path) -> dict[str, Any]:
    """Who a cell without a result is, and its problem, as far as `cell.json` says."""
    try:
        record = _read_json(path)
        identity = _named(record)
        check_result(record)
        return identity | {"columns": identity | _problem(record) | {"test": tuple(record.get("test", ()))}}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def _named(record: dict[str, Any]) -> dict[str, Any]:
    """Solver, with the causes that its simulator knew of, cloth and seed."""
    solver = labelled(unspaced(name_of("solver", record["solver"])), [str(cause) for cause in _causes(record)])
    return {
        "solver": solver,
        "cloth": name_of("cloth", record["cloth"]),
        "seed": whole_number_of("seed", record["seed"]),
    }


def read_run(folder: Path) -> dict[str, Any]:
    """Reads what is recorded of the commands that filled a results folder.

    Args:
        folder: The folder.

    Returns:
        Contents of `run.json`, empty where there is none that can be read.
    """
    try:
        document = _read_json(folder / "run.json")
        check_run(document)
        return document
    except (OSError, ValueError):
        return {}
