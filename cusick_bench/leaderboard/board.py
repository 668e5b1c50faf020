"""From cells to ranked rows: one row a solver, beside the floor, the rows without physics and the oracles.

Rows are ordered by a metric, best first (`order`). A row shares the rank of the row above it unless it is worse
than the first row of that rank: unless the bootstrap interval of their paired difference is above 0. The floor and
the oracles have no rank, since they have seen the held-out images that the others predict; nor has a row that
lacks a cloth, or the metric of a cloth, since its mean is over an easier or harder set.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Any

import numpy as np
import pandas as pd

from cusick_bench.leaderboard.bootstrap import (
    STATISTICS,
    Statistic,
    Values,
    beside,
    cell_values,
    difference,
    estimate,
    repeats,
)
from cusick_bench.leaderboard.cells.commands import command_record
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.cells.plausible import largest
from cusick_bench.leaderboard.cells.variants import BOARD, failures, of_boards, variants
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.metric_name import metric_called
from cusick_bench.leaderboard.notes import interval_note, row_notes
from cusick_bench.leaderboard.order import Direction, direction
from cusick_bench.leaderboard.row import RANKED_KINDS, Row

RANDOM_PHASE = "null:random-phase"
_FLOOR = "repeat of the same drape"
_MEASURED = ("train_", "test_", "floor_", "spent_")


@dataclass(frozen=True)
class Leaderboard:
    """Rows on one data set, best first.

    Attributes:
        dataset: Name of the data set.
        dataset_hash: Its content hash.
        protocol: How samples were split.
        by: Metric that orders the rows.
        statistic: "mean" or "iqm".
        cloths: Cloths that any row covers.
        rows: The rows.
        notes: Remarks for readers, one sentence each.
        run: `run.json` of the results folder.
        apart: What sets it apart from the folder's other leaderboards, such as ", split first-8"; "" if nothing does.
    """

    dataset: str
    dataset_hash: str
    protocol: str
    by: str
    statistic: str
    cloths: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    run: dict[str, Any]
    apart: str = ""


def metric_names(table: pd.DataFrame) -> list[str]:
    """Metrics and costs in a table of cells, in its order.

    Args:
        table: Table of cells, from `load_cells`.

    Returns:
        Names of columns.
    """
    return [name for name in table.columns if name.startswith(_MEASURED)]


def leaderboards(cells: Cells, *, by: str = "test_mse", statistic: str = "mean", seed: int = 0) -> list[Leaderboard]:
    """Ranks the solvers of a results folder, on one board for each data set and split in it.

    Args:
        cells: From `load_cells`.
        by: Metric to rank by, in full or short (see `metric_called`), best first: a coverage by its distance from
            what it promises.
        statistic: "mean" or "iqm" (interquartile mean), over cells.
        seed: Seed of the bootstrap.

    Returns:
        A board for each data set and split, its rows best first.

    Raises:
        LeaderboardError: Unknown metric or statistic, or a metric that is neither better nor worse.
    """
    by = metric_called(by, metric_names(cells.table))
    if statistic not in STATISTICS:
        raise LeaderboardError(f"unknown statistic {statistic!r}; use one of: {', '.join(STATISTICS)}")
    ranking = _Ranking(by, direction(by), STATISTICS[statistic], np.random.default_rng(seed))
    boards, tables = [], list(of_boards(cells.table))
    places = {_place(table.iloc[0]) for _, table in tables}
    for apart, table in tables:
        cloths = tuple(sorted(table["cloth"].unique()))
        groups = dict(variants(table))
        unmeasured = {metric: _unmeasured(groups, metric) for metric in metric_names(table)}
        rows = ranking.rows(cells, table, cloths, unmeasured[by])
        place = _place(table.iloc[0])
        skipped = [cell for cell in cells.skipped if _place(cell.columns) not in places - {place}]
        notes = (interval_note(table), *row_notes(rows, groups, skipped, cloths, by, unmeasured))
        run = command_record(cells.run, (folder.name for folder in table["folder"]))
        identity = dict(zip(BOARD, place, strict=True))
        boards.append(
            Leaderboard(
                **identity, by=by, statistic=statistic, cloths=cloths, rows=rows, notes=notes, run=run, apart=apart
            )
        )
    return boards


def _place(cell: Mapping[str, Any] | pd.Series) -> tuple[str, ...]:
    """The leaderboard that a cell is of."""
    return tuple(str(cell.get(name)) for name in BOARD)


@dataclass(frozen=True)
class _Ranking:
    """Makes, orders and ranks rows."""

    by: str
    direction: Direction
    statistic: Statistic
    generator: np.random.Generator

    def cost(self, row: Row) -> float:
        """Value by which rows are ordered, smaller is better; NaN where the row has none."""
        return float(self.direction.cost(row.value(self.by)))

    def rows(
        self,
        cells: Cells,
        table: pd.DataFrame,
        cloths: tuple[str, ...],
        unmeasured: Mapping[tuple[str, str], Sequence[str]],
    ) -> tuple[Row, ...]:
        groups = dict(variants(table))
        rows = []
        for (solver, variant), group in groups.items():
            rows.append(self._row(solver, variant, group, len(failures(group, cells.skipped)), table))
        if (floor := self._floor(table)) is not None:
            rows.append(floor)
        rows.sort(key=lambda row: (not isfinite(cost := self.cost(row)), cost, row.label))
        values = {key: cell_values(group, self.by) for key, group in groups.items()}
        return tuple(self._ranked(rows, values, cloths, unmeasured))

    def _row(self, solver: str, variant: str, group: pd.DataFrame, failed: int, table: pd.DataFrame) -> Row:
        columns = {name: cell_values(group, name) for name in metric_names(group)}
        columns = {name: values for name, values in columns.items() if values}
        arrays = {name: np.array(list(values.values())) for name, values in columns.items()}
        draws, cloths = set(cell_values(group, "draws").values()), tuple(sorted(set(group["cloth"])))
        return Row(
            solver=solver,
            variant=variant,
            kind=str(group["kind"].iloc[0]),
            rank=None,
            cells=len(set(zip(group["cloth"], repeats(group), strict=True))),  # one may be there under two spellings
            failed=failed,
            cloths=cloths,
            draws=draws.pop() if len(draws) == 1 else nan,
            estimates={
                name: estimate(values, self.statistic, self.generator, largest(name))
                for name, values in columns.items()
            },
            means={name: float(STATISTICS["mean"](array)) for name, array in arrays.items()},
            iqms={name: float(STATISTICS["iqm"](array)) for name, array in arrays.items()},
            matched_null=self._matched_null(group, table),
            code_version=_code_of(group),
        )

    def _matched_null(self, group: pd.DataFrame, table: pd.DataFrame) -> float:
        """Best-of-N of as many random-phase draws, in the same cells; where these have none, of their cloth."""
        counts = set(cell_values(group, "draws").values())
        if len(counts) != 1 or (draws := counts.pop()) <= 1:
            return nan
        null = table.loc[table["solver"].str.startswith(RANDOM_PHASE)]
        equal = null.loc[null["draws"] == draws]
        best = cell_values(null, f"test_mse_best_of_{draws:.0f}") | cell_values(equal, "test_mse_best")
        own, by_cloth = cell_values(group, "test_mse_best"), dict[str, list[float]]()
        for (cloth, _), value in best.items():
            by_cloth.setdefault(cloth, []).append(value)
        means = {cloth: float(np.mean(values)) for cloth, values in by_cloth.items()}
        matched = {cell: best.get(cell, means.get(cell[0], nan)) for cell in own}
        return beside(own, matched, self.statistic) if own else nan

    def _floor(self, table: pd.DataFrame) -> Row | None:
        """Score of a second capture of the same drape, mean over the cloths that have one."""
        values = {(cloth, 0): value for (cloth, _), value in cell_values(table, "floor_mse").items()}
        if not values:
            return None
        array = np.array(list(values.values()))
        return Row(
            solver=_FLOOR,
            variant="",
            kind="floor",
            rank=None,
            cells=len(values),
            failed=0,
            cloths=tuple(sorted(cloth for cloth, _ in values)),
            draws=nan,
            estimates={"test_mse": estimate(values, self.statistic, self.generator, largest("test_mse"))},
            means={"test_mse": float(STATISTICS["mean"](array))},
            iqms={"test_mse": float(STATISTICS["iqm"](array))},
        )

    def _ranked(
        self,
        rows: list[Row],
        values: Mapping[tuple[str, str], Values],
        cloths: tuple[str, ...],
        unmeasured: Mapping[tuple[str, str], Sequence[str]],
    ) -> Iterator[Row]:
        leader, rank, place = None, 0, 0
        for row in rows:
            whole = row.kind in RANKED_KINDS and row.cloths == cloths and isfinite(row.value(self.by))
            if not whole or unmeasured[row.solver, row.variant]:
                yield row
                continue
            place += 1
            own = values[row.solver, row.variant]
            statistic = self.direction.of(self.statistic)
            # Below 0 it is better on the cells that both have, and stands here for cells that one of them lacks.
            if leader is None or difference(own, leader, statistic, self.generator).low > 0:
                leader, rank = own, place
            yield replace(row, rank=rank)


def _code_of(group: pd.DataFrame) -> str:
    """Versions of the numerics and commits of a row's cells: `engine 1, metrics 1; commit 1a2b3c4d5e6f`."""
    names = [name for name in ("code_version", "commit") if name in group]
    return "; ".join(text for name in names for text in dict.fromkeys(map(str, group[name])) if text)


def of_board(table: pd.DataFrame, board: Leaderboard) -> pd.DataFrame:
    """The cells that a leaderboard is made of.

    Args:
        table: Table of cells, from `load_cells`.
        board: One of its leaderboards.

    Returns:
        Those of the board's data and split.
    """
    return table.loc[np.logical_and.reduce([table[name] == getattr(board, name) for name in BOARD])]


def _unmeasured(groups: Mapping[tuple[str, str], pd.DataFrame], metric: str) -> dict[tuple[str, str], list[str]]:
    """Cloths of which a (solver, variant) lacks a metric that another one, whose kind is ranked, has."""
    measured = {key: {cloth for cloth, _ in cell_values(group, metric)} for key, group in groups.items()}
    ranked = [key for key, group in groups.items() if str(group["kind"].iloc[0]) in RANKED_KINDS]
    known = {cloth for key in ranked for cloth in measured[key]}
    return {key: sorted(known - own) for key, own in measured.items()}
