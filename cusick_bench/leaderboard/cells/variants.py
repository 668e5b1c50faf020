"""Which finished cells make one row: those of one method, with the same settings, by the same code."""

import json
from collections.abc import Iterable, Iterator
from typing import Any

import pandas as pd

from cusick_bench.leaderboard.cells.loading import Skipped
from cusick_bench.runner.labels import comparable_versions

VARIANT = ["solver", "kind", "space", "vertices", "settings", "code_version"]
"""Columns that are the same in all cells of a row."""
BOARD = ["dataset", "dataset_hash", "protocol"]
"""Columns that are the same in all cells of a leaderboard."""
_HASHES = ("dataset_hash", "settings")
_HASH_DIGITS = 12  # of a hash that is shown

Problem = tuple[str, int]  # cloth, seed or number of the split and seed


def variants(table: pd.DataFrame) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """Groups of comparable cells; cells of one solver under other settings or other code make another row.

    Args:
        table: Table of cells, from `load_cells`.

    Returns:
        (Solver, what sets it apart from others of the same name) and its cells; all of them have the versions of all
        parts of the code that any of them needs.
    """
    for solver, cells in table.groupby("solver", sort=True):
        versions = comparable_versions(cells["code_version"].unique())
        group = cells.assign(code_version=[versions[text] for text in cells["code_version"]])
        settings = [flattened(json.loads(text)) for text in group["settings"].unique()]
        for _, part in group.groupby(VARIANT, sort=True):
            first = part.iloc[0]
            own = {name: first[name] for name in VARIANT if name != "settings" and len(set(group[name])) > 1}
            if "code_version" in own:
                own["code_version"] = _own_versions(str(own["code_version"]), group["code_version"].unique())
            own |= {
                name: value
                for name, value in flattened(json.loads(str(first["settings"]))).items()
                if name not in VARIANT and any(other.get(name) != value for other in settings)
            }
            yield (str(solver), ", ".join(f"{name}={value}" for name, value in own.items())), part


def of_boards(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Cells of each leaderboard: of one data set in one state, split in one way.

    Args:
        table: Table of cells, from `load_cells`.

    Returns:
        What sets them apart from those on other boards, such as ", cusick", ", split first-8" or
        ", data 0123456789ab", "" where nothing does; and the cells.
    """
    splits = len(set(table["protocol"]))
    states = {str(dataset): len(set(cells["dataset_hash"])) for dataset, cells in table.groupby("dataset")}
    for _, cells in table.groupby(BOARD, sort=True):
        dataset, state, split = (str(cells[name].iloc[0]) for name in BOARD)
        apart = f", {dataset}" if len(states) > 1 else ""
        apart += f", split {split}" if splits > 1 else ""
        yield apart + (f", data {state[:_HASH_DIGITS]}" if states[dataset] > 1 else ""), cells


def method_label(solver: str, variant: str) -> str:
    """Name of a method as it is shown.

    Args:
        solver: Name with options.
        variant: What sets its row apart from others of the same name.

    Returns:
        Such as "homo (budget=40)".
    """
    return f"{solver} ({variant})" if variant else solver


def failures(group: pd.DataFrame, skipped: Iterable[Skipped]) -> list[Skipped]:
    """Failed cells that are of the same board as finished ones, and of the same method, settings and code.

    Args:
        group: Finished cells, from `variants` of one board's table.
        skipped: Cells that are left out.

    Returns:
        Those of them that failed.
    """
    columns = [name for name in (*VARIANT, *BOARD) if name != "code_version"]
    own, codes = set(group[columns].itertuples(index=False, name=None)), [*group["code_version"].unique()]

    def of_one_code(text: str) -> bool:
        versions = comparable_versions([text, *codes])
        return versions[text] in {versions[code] for code in codes}

    return [
        cell
        for cell in skipped
        if cell.status == "failed"
        and tuple(map(cell.columns.get, columns)) in own
        and of_one_code(str(cell.columns.get("code_version")))
    ]


def problems_run(group: pd.DataFrame, skipped: Iterable[Skipped]) -> frozenset[Problem]:
    """Problems of finished cells, and of those failed ones whose settings and code are theirs.

    Args:
        group: Finished cells, from `variants` of one board's table.
        skipped: Cells that are left out.

    Returns:
        The problems on which the method was run.
    """
    problems = {(str(cloth), int(number)) for cloth, number in zip(group["cloth"], group["repeat"], strict=True)}
    for cell in failures(group, skipped):
        if cell.seed is not None:
            problems.add((cell.cloth, int(cell.columns.get("repeat", cell.seed))))
    return frozenset(problems)


def law_of(cell: pd.Series) -> str:
    """Material law of a cell.

    Args:
        cell: Its row of the table of cells.

    Returns:
        Name of the law; that of the paper where the record of the cell names none.
    """
    return str(flattened(json.loads(str(cell["settings"]))).get("drape.law", "paper"))


def flattened(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings as `drape.steps: 100`.

    Args:
        settings: What a cell's problem is made of, settings of the simulator among them, as documents in each other.
        prefix: Names of the documents that they stand in, each with a full stop.

    Returns:
        Values by name.
    """
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= flattened(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat


def _own_versions(text: str, texts: Iterable[str]) -> str:
    """Versions of a row's code that differ from those of other rows."""
    others = [other.split(", ") for other in texts]
    return ", ".join(part for part in text.split(", ") if any(part not in other for other in others)) or text


def values_in_words(column: str, values: Iterable[object]) -> str:
    """Values of a column that tells what cells are of, for a message.

    Args:
        column: Name of the column.
        values: Its values.

    Returns:
        The values in order; hashes shortened, names in full.
    """
    digits = _HASH_DIGITS if column in _HASHES else None
    return ", ".join(sorted(str(value)[:digits] for value in values))
