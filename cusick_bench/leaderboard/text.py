"""A leaderboard as a table of short strings: the common source of its terminal, Markdown, LaTeX and HTML forms."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import floor, isfinite, log10
from typing import Any

from cusick_bench.leaderboard.board import Leaderboard
from cusick_bench.leaderboard.bootstrap import Estimate
from cusick_bench.leaderboard.cells.commands import machine, typed
from cusick_bench.leaderboard.order import direction
from cusick_bench.leaderboard.row import Row
from cusick_bench.runner.environment import code_text, hardware_text

_FOLDED = 25  # characters after which a long solver name is folded


@dataclass(frozen=True)
class Column:
    """A column of a leaderboard.

    Attributes:
        head: First line of the heading.
        unit: Second line.
        meaning: What it says, in full.
        entry: How a row's entry is written.
        left: Whether it is set flush left.
        rarity: Columns of the highest rarity go first where space is short; those of 0 stay.
        optional: Whether it is left out where no row has an entry.
    """

    head: str
    unit: str
    meaning: str
    entry: Callable[[Row], str]
    left: bool = False
    rarity: int = 0
    optional: bool = False


@dataclass(frozen=True)
class TextTable:
    """A table ready to be set.

    Attributes:
        title: One line above it.
        columns: Its columns.
        kinds: Kind of each row, to mark it by.
        entries: Strings, a row each.
        notes: Sentences below it.
    """

    title: str
    columns: tuple[Column, ...]
    kinds: tuple[str, ...]
    entries: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]

    def within(self, width: int) -> "TextTable":
        """The table without its rarest columns, as many as it takes to fit `width` characters.

        Args:
            width: Characters in a line.

        Returns:
            A table that fits, or that has no rare columns left.
        """
        sizes = [
            max(map(len, (column.head, column.unit, *(row[place] for row in self.entries)))) + 1
            for place, column in enumerate(self.columns)
        ]
        sizes = [min(size, _FOLDED) for size in sizes]
        rarity = max(column.rarity for column in self.columns)
        if rarity == 0 or sum(sizes) + 1 <= width:
            return self
        kept = [place for place, column in enumerate(self.columns) if column.rarity < rarity]
        columns = tuple(self.columns[place] for place in kept)
        entries = tuple(tuple(row[place] for place in kept) for row in self.entries)
        return replace(self, columns=columns, entries=entries).within(width)


def short(value: float, digits: int = 4) -> str:
    """A number below 1 as the paper writes it, `.0529`; nothing for NaN.

    Args:
        value: The number.
        digits: Digits after the point.

    Returns:
        Text.
    """
    if not isfinite(value):
        return ""
    text = f"{value:.{digits}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def significant(value: float, digits: int = 3) -> str:
    """A positive number with so many significant digits, without exponent: `0.000221`, `1.31`, `2690`.

    Args:
        value: The number.
        digits: Significant digits.

    Returns:
        Text, empty for NaN.
    """
    if not isfinite(value):
        return ""
    places = digits - 1 - floor(log10(value)) if value > 0 else 0
    return f"{value:.{max(places, 0)}f}"


def with_interval(estimate: Estimate | None) -> str:
    """A value with its interval: `.0529 [.0511, .0547]`.

    Args:
        estimate: What to write; None for nothing.

    Returns:
        Text, without an interval where there is none, empty where there is no value.
    """
    if estimate is None or not isfinite(estimate.value):
        return ""
    if not isfinite(estimate.low):
        return short(estimate.value)
    return f"{short(estimate.value)} [{short(estimate.low)}, {short(estimate.high)}]"


def best_of(row: Row) -> str:
    """Best-of-N error of a row, with N: `.0384 /1000`.

    Args:
        row: Row of a leaderboard.

    Returns:
        Text, empty where the row offers one draw, or there was no sample to compare its draws with.
    """
    best = short(row.value("test_mse_best"))
    return f"{best} /{row.draws:.0f}" if best and row.draws > 1 else ""


def _seconds(value: float) -> str:
    return "" if not isfinite(value) else f"{value:.1f}" if value < 100 else f"{value:,.0f}"


def _count(value: float) -> str:
    return f"{value:,.0f}" if isfinite(value) else ""


COLUMNS = (
    Column("#", "", "rank; rows of one rank cannot be told apart", lambda row: str(row.rank or "")),
    Column("solver", "", "solver and its options", lambda row: row.label, left=True),
    Column(
        "kind", "", "null: no physics; oracle: has seen the test samples", lambda row: row.kind, left=True, rarity=4
    ),
    Column(
        "cells",
        "",
        "finished cells (cloth x seed), + failed ones",
        lambda row: f"{row.cells}+{row.failed}✗" if row.failed else str(row.cells),
        rarity=3,
    ),
    Column("train", "MSE", "fit of the training silhouette, per pixel", lambda row: short(row.value("train_mse"))),
    Column(
        "test",
        "MSE [95 %]",
        "draws against unseen samples of the cloth, per pixel",
        lambda row: with_interval(row.estimates.get("test_mse")),
    ),
    Column("best", "MSE /N", "unseen samples against the best of N draws", best_of, rarity=2),
    Column(
        "random",
        "MSE /N",
        "the same, of N draws with random fold phases: what N alone is worth",
        lambda row: short(row.matched_null),
        rarity=2,
    ),
    Column(
        "H",
        "mm",
        "symmetric Hausdorff distance of the draws' surfaces from those of unseen samples",
        lambda row: short(1e3 * row.value("test_hausdorff_m"), 1),
    ),
    Column(
        "DC err",
        "points",
        "drape coefficient in per cent, mean of draws from mean of unseen samples",
        lambda row: short(1e2 * row.value("test_dc_error"), 1),
    ),
    Column(
        "folds",
        "err",
        "number of folds, mean of draws from mean of unseen samples",
        lambda row: short(row.value("test_folds_error"), 1),
        rarity=1,
    ),
    Column(
        "energy",
        "dist.",
        "energy distance of draws from unseen samples, over all statistics, standardised; 0 is alike",
        lambda row: short(row.value("test_energy_distance"), 2),
        rarity=2,
        optional=True,
    ),
    Column(
        "CRPS",
        "points",
        "continuous ranked probability score of the drape coefficient in per cent",
        lambda row: short(1e2 * row.value("test_dc_crps"), 1),
        rarity=2,
        optional=True,
    ),
    Column(
        "cover",
        "90 %",
        "per cent of unseen samples within the 90 % interval of the drape coefficients of many draws",
        lambda row: short(1e2 * row.value("test_dc_cover_90"), 0) if row.draws > 1 else "",
        rarity=2,
        optional=True,
    ),
    Column(
        "cost",
        "drapes",
        "forward-equivalents a cell: drapes, a gradient counting as two",
        lambda row: _count(row.value("spent_forward_equivalents")),
        rarity=1,
    ),
    Column("time", "s", "wall seconds a cell", lambda row: _seconds(row.value("spent_wall_seconds"))),
)


def text_table(board: Leaderboard) -> TextTable:
    """Sets a leaderboard in strings.

    Args:
        board: The leaderboard.

    Returns:
        Strings of every row, ready to be set.
    """
    statistic = {"mean": "mean", "iqm": "interquartile mean"}[board.statistic]
    way = f", {words}" if (words := direction(board.by).words) else ""
    data = f"{board.dataset}{board.apart.removeprefix(f', {board.dataset}')}"
    cloths = f"{len(board.cloths)} cloth{'s' * (len(board.cloths) != 1)}"
    columns = tuple(column for column in COLUMNS if not column.optional or any(map(column.entry, board.rows)))
    return TextTable(
        title=f"{data}, {cloths}, {statistic} over cells, ranked by {board.by}{way}",
        columns=columns,
        kinds=tuple(row.kind for row in board.rows),
        entries=tuple(tuple(column.entry(row) for column in columns) for row in board.rows),
        notes=(*board.notes, *provenance(board)),
    )


def provenance(board: Leaderboard) -> list[str]:
    """What is needed to make a leaderboard again, in sentences.

    Args:
        board: The leaderboard.

    Returns:
        Sentences on data, command, hardware and code.
    """
    run = board.run
    facts = [f"Data: {board.dataset} (sha256 {board.dataset_hash[:12]}), split: {board.protocol}"]
    if command := run.get("command"):
        facts.append(f"Command: {typed(command)}")
    if hardware := hardware_text(run):
        facts.append(f"Hardware: {hardware}")
    if code := code_text(run):
        facts.append(f"Code: {code}, {run.get('time', '')}".rstrip(", "))
    return [f"{fact}." for fact in facts]


def provenance_columns(board: Leaderboard, row: Row) -> dict[str, Any]:
    """What is needed to make a row again, by column.

    Args:
        board: The leaderboard.
        row: One of its rows.

    Returns:
        Data, split, command, code and hardware.
    """
    return {
        "dataset": board.dataset,
        "dataset_hash": board.dataset_hash,
        "protocol": board.protocol,
        "command": typed(board.run.get("command", "")),
        "code_version": row.code_version or code_text(board.run),
        "hardware": machine(board.run),
    }
