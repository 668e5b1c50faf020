"""Table of the stiffness that solvers found: a row for each solver and cloth, over its seeds, with the truth if known.

Stiffnesses are averaged in the logarithm (geometric means). Where the truth is known a row has two scores: the error
factor exp(mean |log(found / true)|) over directions and seeds, 1 for a perfect answer, and the coverage, the share of
the 90 % intervals of posteriors that hold the truth. Solvers without physics have no stiffness: a row without numbers.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp, isfinite, log, nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.splits import left_out_sample
from cusick_bench.files.csv_text import csv_text
from cusick_bench.leaderboard.bootstrap import Estimate, geometric_mean, repeats
from cusick_bench.leaderboard.cells.cell_number import LEFT_OUT, SEEDS, split_of
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.cells.variants import method_label, of_boards, variants
from cusick_bench.leaderboard.text import Column, TextTable, short, significant
from cusick_bench.metrics.found_stiffness import FoundStiffness, Quantities, Quantity
from cusick_bench.metrics.stiffness import BENDING, GF_CM2_PER_CM, STRETCH

_MICRO = 1e6  # shown in uN m

CELL_COLUMNS = (
    "dataset", "cloth", "solver", "seed", "quantity", "direction", "unit", "value", "ci90_low", "ci90_high",
    "value_gf_cm2_cm", "ci90_low_gf_cm2_cm", "ci90_high_gf_cm2_cm", "spread_log", "true", "ratio", "ratio_ci90_low",
    "ratio_ci90_high", "path",
)  # fmt: skip
"""Columns of `stiffness.csv`; where samples are left out in turn, `left_out`, the sample's number, follows the seed."""


@dataclass(frozen=True)
class StiffnessRow:
    """Stiffness of one cloth found by one solver.

    Attributes:
        solver: Name with options, and what sets it apart from others of that name.
        dataset: Name of the data set.
        cloth: Cloth; "" for all cloths together.
        cells: Number of finished cells that have a stiffness.
        bending: Geometric mean over seeds of the bending stiffness of each direction, with its interval over seeds
            [N m]; empty for all cloths together.
        stretch: The same of membrane stiffness [N/m].
        true_bending: True bending stiffness [N m]; empty where it is not known.
        true_stretch: True membrane stiffness [N/m]; empty where it is not known.
        interval_factor: Half width of the posterior's 90 % interval of bending stiffness as a factor, geometric mean
            over directions and seeds; NaN without a posterior.
        error_factor: exp(mean |log ratio|) of bending stiffness; NaN where the truth is not known.
        stretch_error_factor: The same of membrane stiffness.
        coverage: Share of the 90 % intervals of bending stiffness that hold the truth; NaN where there are none.
    """

    solver: str
    dataset: str
    cloth: str
    cells: int
    bending: Mapping[str, Estimate]
    stretch: Mapping[str, Estimate]
    true_bending: Mapping[str, float]
    true_stretch: Mapping[str, float]
    interval_factor: float
    error_factor: float
    stretch_error_factor: float
    coverage: float


def stiffness_rows(cells: Cells, *, seed: int = 0) -> list[StiffnessRow]:
    """Sums up what the cells of a results folder found.

    Args:
        cells: From `load_cells`.
        seed: Seed of the bootstrap over seeds.

    Returns:
        A row for each solver and cloth, and one for all cloths of a solver where their truth is known, or where it has
        no stiffness at all; no rows where no cell has one.
    """
    generator = np.random.default_rng(seed)
    rows: list[StiffnessRow] = []
    for apart, board in of_boards(cells.table):
        dataset = board["dataset"].iloc[0]
        for (solver, variant), group in variants(board):
            label = method_label(solver, variant) + apart
            of_cloths = [
                (str(cloth), found) for cloth, part in group.groupby("cloth", sort=True) if (found := _found(part))
            ]
            rows += [_row(label, str(dataset), cloth, found, generator) for cloth, found in of_cloths]
            every = {key: one for _, found in of_cloths for key, one in found.items() if one.true_bending}
            if not of_cloths or (len(of_cloths) > 1 and every):
                count = len(every) or len(group)
                rows.append(
                    StiffnessRow(label, str(dataset), "", count, {}, {}, {}, {}, *stiffness_scores(every.values()))
                )
    return rows if any(row.bending for row in rows) else []


def stiffness_table(rows: Sequence[StiffnessRow]) -> TextTable:
    """Sets the rows in strings.

    Args:
        rows: From `stiffness_rows`.

    Returns:
        A table with a line a row, cloth by cloth.
    """
    ordered = sorted(rows, key=lambda row: (row.dataset, row.cloth == "", row.cloth))
    written = [(column, [entry(row) for row in ordered]) for column, entry in _COLUMNS]
    kept = [(column, texts) for column, texts in written if any(texts) or not column.optional]
    return TextTable(
        title="stiffness found",
        columns=tuple(column for column, _ in kept),
        kinds=tuple("floor" if row.cloth == "" else "" for row in ordered),
        entries=tuple(zip(*(texts for _, texts in kept), strict=True)),
        notes=tuple(_notes(rows)),
    )


def stiffness_records(rows: Iterable[StiffnessRow]) -> list[dict[str, Any]]:
    """Every row in full, flat.

    Args:
        rows: From `stiffness_rows`.

    Returns:
        Values by column: `bending_warp_N_m` with `_low`, `_high` (95 % over seeds) and `_true`, ...
    """
    return [_record(row) for row in rows]


def stiffness_rows_csv(rows: Iterable[StiffnessRow]) -> str:
    """`stiffness_records` as a table.

    Args:
        rows: From `stiffness_rows`.

    Returns:
        Text of the file.
    """
    return csv_text(pd.DataFrame(stiffness_records(rows)))


def cell_records(cells: Cells, dataset: DrapeDataset | None = None) -> list[dict[str, Any]]:
    """Stiffness found by every cell, a record for each quantity and direction: the lines of `stiffness.csv`.

    Args:
        cells: From `load_cells`.
        dataset: Data of the cells, which tell the numbers of samples that are left out in turn.

    Returns:
        Values by column; empty where something is not known.
    """
    records: list[dict[str, Any]] = []
    for cell in cells.table.to_dict("records"):
        found = cell.get("stiffness")
        if not isinstance(found, FoundStiffness):
            continue
        identity = {name: cell[name] for name in ("dataset", "cloth", "solver", "seed")} | _left_out(cell, dataset)
        path = {"path": f"cells/{Path(str(cell['folder'])).name}"}
        for direction, one in found.bending.items():
            record = identity | {"quantity": "bending", "direction": direction, "unit": "N m"} | _interval("", one)
            record |= _interval("_gf_cm2_cm", one.times(1 / GF_CM2_PER_CM))
            record |= {"spread_log": found.spread.get(direction, "")}
            records.append(record | _against(found.true_bending, found.bending_ratio, direction) | path)
        for direction, one in found.stretch.items():
            record = identity | {"quantity": "stretch", "direction": direction, "unit": "N/m"} | _interval("", one)
            records.append(record | _against(found.true_stretch, found.stretch_ratio, direction) | path)
    return records


def _left_out(cell: Mapping[Any, Any], dataset: DrapeDataset | None) -> dict[str, int]:
    """Number of the sample that a cell leaves out; nothing where none is, or where the data given are not its own."""
    if dataset is None or cell["dataset_hash"] != dataset.content_hash:
        return {}
    sample = left_out_sample(dataset.table, cell["protocol"], cell["test"])
    return {} if sample is None else {LEFT_OUT: sample}


def cell_table(cells: Cells, dataset: DrapeDataset | None = None) -> pd.DataFrame:
    """Every number of every finished cell, a row a cell.

    Args:
        cells: From `load_cells`.
        dataset: Data of the cells, which tell the numbers of samples that are left out in turn.

    Returns:
        What identifies the cell (with `left_out`, where samples are left out in turn and the data are given; empty of
        cells of other data), `settings` as JSON, `test_samples`, what was spent, all metrics, the stiffness found
        as `bending_<direction>_n_m` and `stretch_<direction>_n_per_m` with `_low` and `_high` (NaN where there is
        none), and `path` below the results folder.
    """
    rows: list[dict[str, Any]] = []
    stride = max(cells.table["seed"]) + 1  # so that numbers of many splits fit into a file's 64 bits
    for cell in cells.table.to_dict("records"):
        number = int(cell["repeat"])
        cell["repeat"] = split_of(number) * stride + number % SEEDS
        row = {str(name): value for name, value in cell.items() if name not in ("stiffness", "test", "folder")}
        row |= {"test_samples": len(cell["test"])} | _left_out(cell, dataset)
        found = cell.get("stiffness")
        if isinstance(found, FoundStiffness):
            kinds = (("bending", "n_m", found.bending), ("stretch", "n_per_m", found.stretch))
            for kind, unit, quantities in kinds:
                for direction, one in quantities.items():
                    name, (low, high) = f"{kind}_{direction}_{unit}", one.ci90 or (nan, nan)
                    row |= {name: one.value, f"{name}_low": low, f"{name}_high": high}
        rows.append(row | {"path": f"cells/{Path(str(cell['folder'])).name}"})
    table = pd.DataFrame(rows)
    return table.astype({LEFT_OUT: "Int64"}) if LEFT_OUT in table else table


def stiffness_csv(cells: Cells, dataset: DrapeDataset | None = None) -> str:
    """`cell_records` as a table.

    Args:
        cells: From `load_cells`.
        dataset: Data of the cells, which tell the numbers of samples that are left out in turn.

    Returns:
        Text of the file, only a heading where no cell has a stiffness.
    """
    records, after = cell_records(cells, dataset), CELL_COLUMNS.index("seed") + 1
    if not any(LEFT_OUT in record for record in records):
        return csv_text(pd.DataFrame(records, columns=list(CELL_COLUMNS)))
    columns = [*CELL_COLUMNS[:after], LEFT_OUT, *CELL_COLUMNS[after:]]
    return csv_text(pd.DataFrame(records, columns=columns).astype({LEFT_OUT: "Int64"}))


Found = dict[tuple[str, int], FoundStiffness]


def _found(part: pd.DataFrame) -> Found:
    """By cloth and number (`repeats`); cells without a stiffness are left out."""
    if "stiffness" not in part:
        return {}
    cells = zip(part["cloth"], repeats(part), part["stiffness"], strict=True)
    return {(str(cloth), number): one for cloth, number, one in cells if isinstance(one, FoundStiffness)}


def _row(label: str, dataset: str, cloth: str, found: Found, generator: np.random.Generator) -> StiffnessRow:
    first = next(iter(found.values()))
    bending = {name: _over_seeds({key: one.bending[name] for key, one in found.items()}, generator) for name in BENDING}
    stretch = {name: _over_seeds({key: one.stretch[name] for key, one in found.items()}, generator) for name in STRETCH}
    true = dict(first.true_bending or {}), dict(first.true_stretch or {})
    return StiffnessRow(label, dataset, cloth, len(found), bending, stretch, *true, *stiffness_scores(found.values()))


def _over_seeds(values: Mapping[tuple[str, int], Quantity], generator: np.random.Generator) -> Estimate:
    return geometric_mean({key: log(max(one.value, 1e-300)) for key, one in values.items()}, generator)


def stiffness_scores(found: Iterable[FoundStiffness]) -> tuple[float, float, float, float]:
    """Scores of fits: width of intervals, error and coverage.

    Args:
        found: What each fit found.

    Returns:
        Half width of the 90 % interval of bending stiffness as a factor, error factors of bending and of membrane
        stiffness, and coverage, as in `StiffnessRow`.
    """
    cells = list(found)
    widths = [
        log(one.ci90[1] / one.ci90[0]) / 2
        for cell in cells
        for one in cell.bending.values()
        if one.ci90 and one.ci90[0]
    ]
    held = [
        one.holds(cell.true_bending[name]) for cell in cells if cell.true_bending for name, one in cell.bending.items()
    ]
    known = [one for one in held if one is not None]
    return (
        exp(np.mean(widths)) if widths else nan,
        _error_factor(cell.bending_ratio for cell in cells),
        _error_factor(cell.stretch_ratio for cell in cells),
        float(np.mean(known)) if known else nan,
    )


def _error_factor(ratios: Iterable[Quantities]) -> float:
    logs = [abs(log(max(one.value, 1e-300))) for ratio in ratios for one in ratio.values()]
    return exp(np.mean(logs)) if logs else nan


def _bending(direction: str, factor: float) -> Callable[[StiffnessRow], str]:
    return lambda row: _with_interval(row.bending.get(direction), factor)


def _stretch(direction: str) -> Callable[[StiffnessRow], str]:
    return lambda row: _with_interval(row.stretch.get(direction), 1.0)


def _with_interval(one: Estimate | None, factor: float) -> str:
    if one is None:
        return "-"
    text = significant(factor * one.value)
    if isfinite(one.low):
        text += f" [{significant(factor * one.low)}, {significant(factor * one.high)}]"
    return text


def _column(head: str, unit: str, meaning: str, **options: Any) -> Column:
    return Column(head, unit, meaning, lambda row: "", **options)


_COLUMNS: tuple[tuple[Column, Callable[[StiffnessRow], str]], ...] = (
    (_column("cloth", "", "cloth", left=True), lambda row: row.cloth or "all cloths"),
    (_column("solver", "", "solver and its options", left=True), lambda row: row.solver),
    (_column("cells", "", "finished cells, one a seed", rarity=3), lambda row: str(row.cells)),
    *((_column(name, "µN m", f"bending stiffness of the {name}"), _bending(name, _MICRO)) for name in BENDING),
    *(
        (_column(name, "gf cm²/cm", f"bending stiffness of the {name}", rarity=2), _bending(name, 1 / GF_CM2_PER_CM))
        for name in BENDING
    ),
    (
        _column("posterior", "×/÷", "half width of the posterior's 90 % interval, as a factor", optional=True),
        lambda row: significant(row.interval_factor),
    ),
    (
        _column("error", "×/÷", "exp(mean |log found / true|) of bending stiffness; 1 is perfect", optional=True),
        lambda row: significant(row.error_factor),
    ),
    (
        _column("cover", "90 %", "per cent of the 90 % intervals of bending that hold the truth", optional=True),
        lambda row: short(1e2 * row.coverage, 0),
    ),
    *((_column(name, "N/m", f"membrane stiffness, {name}", rarity=1), _stretch(name)) for name in STRETCH),
    (
        _column("stretch err", "×/÷", "exp(mean |log found / true|) of stretch", rarity=1, optional=True),
        lambda row: significant(row.stretch_error_factor),
    ),
)
"""Columns of `stiffness_table`, with how a row's entry is written."""


def _notes(rows: Sequence[StiffnessRow]) -> Iterator[str]:
    yield (
        "Bending stiffness of the direction that bends [µN m; 1 gf cm²/cm = 98.0665 µN m], stretch in N/m: geometric "
        "means over seeds, or over samples that are left out in turn, with 95 % bootstrap intervals over three of them "
        "or more."
    )
    if any(isfinite(row.interval_factor) for row in rows):
        yield "posterior ×/÷: half width of the 90 % interval over cloths drawn from the posterior, as a factor."
    if any(isfinite(row.error_factor) for row in rows):
        yield (
            "error ×/÷: exp(mean |log(found / true)|), 1 for a perfect answer; cover: per cent of the 90 % intervals "
            "that hold the truth."
        )


def _record(row: StiffnessRow) -> dict[str, Any]:
    record: dict[str, Any] = {"solver": row.solver, "dataset": row.dataset, "cloth": row.cloth, "cells": row.cells}
    for quantity, unit, names, found, true in (
        ("bending", "N_m", BENDING, row.bending, row.true_bending),
        ("stretch", "N_per_m", STRETCH, row.stretch, row.true_stretch),
    ):
        for name in names:
            column = f"{quantity}_{name}_{unit}"
            record |= found.get(name, Estimate(nan, nan, nan)).columns(column) | {f"{column}_true": true.get(name, nan)}
    for name in BENDING:
        record[f"bending_{name}_gf_cm2_cm"] = row.bending[name].value / GF_CM2_PER_CM if row.bending else nan
    scores = ("interval_factor", "error_factor", "stretch_error_factor", "coverage")
    return record | {name: getattr(row, name) for name in scores}


def _interval(suffix: str, one: Quantity) -> dict[str, Any]:
    low, high = one.ci90 or ("", "")
    return {f"value{suffix}": one.value, f"ci90_low{suffix}": low, f"ci90_high{suffix}": high}


def _against(true: Mapping[str, float] | None, ratios: Quantities, direction: str) -> dict[str, Any]:
    if true is None:
        return {}
    ratio = ratios[direction]
    low, high = ratio.ci90 or ("", "")
    return {"true": true[direction], "ratio": ratio.value, "ratio_ci90_low": low, "ratio_ci90_high": high}
