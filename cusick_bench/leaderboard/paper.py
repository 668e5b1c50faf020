"""The paper's two tables: their methods, the layout of their rows, and the published figures for comparison.

Table 1 asks how well silhouettes of unseen samples are predicted; the paper's figures are means over the held-out
samples of one drape (HOMO, HETER) or of the best of 1000 draws (BDP). A best-of-N score improves with N alone, so the
score of N draws with random fold phases is shown beside it. Table 2 asks how well the training silhouette is fitted at
equal cost.

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024, Tables 1 and 2.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from cusick_bench.datasets.published import CLOTHS
from cusick_bench.leaderboard.board import RANDOM_PHASE, Leaderboard
from cusick_bench.leaderboard.bootstrap import Estimate, Values, cell_values, difference, mean
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.cells.variants import method_label, variants
from cusick_bench.leaderboard.gate.paired import holm
from cusick_bench.leaderboard.row import Row
from cusick_bench.leaderboard.text import (
    Column,
    TextTable,
    best_of,
    provenance,
    provenance_columns,
    short,
    with_interval,
)
from cusick_bench.runner.labels import unspaced
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.black_box.nlopt_family import BENCHMARKED
from cusick_bench.solvers.registry import solver_class

_REFERENCES = (
    "null:disc", "null:copy", "null:rotation", RANDOM_PHASE, "oracle:mean", "oracle:best-other",
)  # fmt: skip
SOLVERS = {
    "table-1": ("homo", "heter", "bdp", "bdp-field", *_REFERENCES),
    "table-2": (
        "bdp", "rembo", "hesbo", "rembo@heter", "hesbo@heter", *(f"nlopt:{name}" for name in BENCHMARKED),
        "turbo", "baxus", "cmaes", "vanilla-bo", "sobol", "homo", "heter", "null:disc", "null:copy",
    ),
}  # fmt: skip
"""Methods of each table; `@heter` asks for a parameter space other than the run's."""

PUBLISHED: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "table-1": {"homo": (0.0572, 0.0340), "heter": (0.0551, 0.0328), "bdp": (0.0384, 0.0217)},
    "table-2": {"bdp": (0.0452, 0.0201), "rembo": (0.0603, 0.0425), "hesbo": (0.0590, 0.0435)},
}
"""MSE and Hausdorff distance [m] as the paper prints them, for five cloths on a mesh of 2699 vertices."""
FOLD_LEVEL = 0.05
"""Probability that fold numbers are rejected in any cell of a method that has those of the samples in all."""


@dataclass(frozen=True)
class Method:
    """A solver in a parameter space.

    Attributes:
        solver: Name with options.
        space: Parameter space, None for the run's.
    """

    solver: str
    space: str | None = None


@dataclass(frozen=True)
class Line:
    """One line of a table.

    Attributes:
        row: The leaderboard's row.
        published: MSE and Hausdorff distance [m] of the paper; NaN where it has none.
        against_random: Best-of-N MSE minus that of as many draws with random phases, paired by cell.
        at_equal_time: Best training loss once the fastest method had ended; NaN where not asked.
        fold_tests: Adjusted p-values (Holm, over the cells) of the same fold numbers as the unseen samples have.
    """

    row: Row
    published: tuple[float, float] = (nan, nan)
    against_random: Estimate = field(default=Estimate(nan, nan, nan))
    at_equal_time: float = nan
    fold_tests: tuple[float, ...] = ()

    @property
    def folds_rejected(self) -> int:
        """Number of cells in which fold numbers differ from those of the unseen samples, at `FOLD_LEVEL` over all."""
        return sum(p < FOLD_LEVEL for p in self.fold_tests)

    def value(self, metric: str) -> float:
        """A metric of the row.

        Args:
            metric: Name of the metric.

        Returns:
            Its value; NaN where the row has none.
        """
        return self.row.value(metric)


@dataclass(frozen=True)
class PaperTable:
    """A table of the paper, with ours.

    Attributes:
        name: "table-1" or "table-2".
        title: One line above it.
        board: The leaderboard behind it.
        lines: Its lines, in the leaderboard's order.
        notes: Sentences below it.
    """

    name: str
    title: str
    board: Leaderboard
    lines: tuple[Line, ...]
    notes: tuple[str, ...]


def methods(names: Iterable[str], draws: int) -> tuple[list[Method], list[str]]:
    """Methods of names such as `rembo@heter`, those that offer draws set to a number of them.

    Args:
        names: Registered names, `@space` behind those that ask for a parameter space.
        draws: Draws of each method that offers any.

    Returns:
        The methods, and the names that nothing is registered for.
    """
    found, missing = [], []
    for name in names:
        text, _, space = (part.strip() for part in unspaced(name).partition("@"))
        try:
            cls = solver_class(text.partition(",")[0])
        except SolverError:
            missing.append(name)
            continue
        offers = "draws" in {option.name for option in fields(cls)} and text != "null:rotation"
        chosen = f"{text},draws={draws}" if offers and "draws=" not in text else text
        found.append(Method(chosen, space or None))
    return found, missing


def make_table(
    name: str,
    cells: Cells,
    board: Leaderboard,
    *,
    at_equal_time: Mapping[tuple[str, str], float] | None = None,
    notes: Sequence[str] = (),
) -> PaperTable:
    """Sets a leaderboard as one of the paper's tables.

    Args:
        name: "table-1" or "table-2".
        cells: What the leaderboard was made of.
        board: Ranked by `test_mse` (table 1) or `train_mse` (table 2).
        at_equal_time: Best training loss of a (solver, variant) when the fastest method had ended.
        notes: Remarks for readers.

    Returns:
        The table.
    """
    best = _best_of_n(cells.table)
    folds = {key: holm([*cell_values(group, "test_fold_p").values()]) for key, group in variants(cells.table)}
    generator = np.random.default_rng(0)
    lines = []
    for row in board.rows:
        published = PUBLISHED[name].get(_base(row.solver), (nan, nan)) if row.kind == "solver" else (nan, nan)
        random = best.get(RANDOM_PHASE, {}).get(row.draws, {})
        own = best.get(row.label, {}).get(row.draws, {})
        margin = difference(own, random, mean, generator) if row.kind == "solver" and own else Estimate(nan, nan, nan)
        equal = (at_equal_time or {}).get((row.solver, row.variant), nan)
        tests = tuple(folds.get((row.solver, row.variant), ()))
        lines.append(Line(row, published, margin, equal, tests))
    question = {"table-1": "unseen samples predicted", "table-2": "training silhouette fitted"}[name]
    count = f"{len(board.cloths)} cloths" if len(board.cloths) > 1 else "".join(board.cloths)
    title = f"{name}: {question}; {board.dataset}, {count}, mean over cells"
    said = (*_EXPLAINED[name], *_others(board), *notes, *board.notes, *provenance(board))
    return PaperTable(name, title, board, tuple(lines), said)


def set_table(table: PaperTable) -> TextTable:
    """The table in strings, without columns that nobody fills.

    Args:
        table: From `make_table`.

    Returns:
        Strings of every line, ready to be set.
    """
    entries = [[column.entry(line) for line in table.lines] for column in _COLUMNS[table.name]]
    kept = [place for place, texts in enumerate(entries) if any(texts)]
    columns = tuple(_COLUMNS[table.name][place] for place in kept)
    return TextTable(
        title=table.title,
        columns=tuple(Column(c.head, c.unit, c.meaning, lambda row: "", left=c.left) for c in columns),
        kinds=tuple(line.row.kind for line in table.lines),
        entries=tuple(tuple(entries[place][at] for place in kept) for at in range(len(table.lines))),
        notes=(*table.notes, *(f"{c.head} {c.unit}: {c.meaning}.".replace(" :", ":") for c in columns if c.meaning)),
    )


def records(table: PaperTable) -> list[dict[str, Any]]:
    """Every line in full, flat: all metrics with intervals, the published figures, the margins and what made it.

    Args:
        table: From `make_table`.

    Returns:
        Values by column, a dictionary a line.
    """
    lines = []
    for line in table.lines:
        row, margin = line.row, line.against_random
        numbers: dict[str, Any] = {}
        for metric, estimate in row.estimates.items():
            numbers |= estimate.columns(metric)
        lines.append(
            {"solver": row.solver, "variant": row.variant, "kind": row.kind, "rank": row.rank, "cells": row.cells}
            | {"failed": row.failed, "cloths": " ".join(row.cloths), "draws": row.draws}
            | {"published_mse": line.published[0], "published_hausdorff_m": line.published[1]}
            | {"random_phase_mse_best": row.matched_null}
            | margin.columns("margin")
            | {"loss_at_equal_time": line.at_equal_time}
            | {"folds_rejected": line.folds_rejected, "folds_tested": len(line.fold_tests)}
            | numbers
            | provenance_columns(table.board, row)
        )
    return lines


def _others(board: Leaderboard) -> list[str]:
    """A warning where the published figures are for other cloths than these."""
    if set(board.cloths) == set(CLOTHS):
        return []
    return [f"The published figures are for {', '.join(CLOTHS)}; these rows are for {', '.join(board.cloths)}."]


def _base(solver: str) -> str:
    return solver.partition(",")[0]


def _best_of_n(table: pd.DataFrame) -> dict[str, dict[float, Values]]:
    """Best-of-N MSE by row, N and cell; the random-phase row serves every N that it was scored for."""
    found: dict[str, dict[float, dict[tuple[str, int], float]]] = {}
    for (solver, variant), group in variants(table):
        random = solver.startswith(RANDOM_PHASE)
        label = RANDOM_PHASE if random else method_label(solver, variant)
        counts = {1.0: "test_mse"} if random else {}
        counts |= {float(name.rsplit("_", 1)[1]): name for name in table if name.startswith("test_mse_best_of_")}
        for draws in set(group["draws"].dropna()):
            counts[float(draws)] = "test_mse_best"
        for count, column in counts.items():
            if column in group:
                found.setdefault(label, {}).setdefault(count, {}).update(cell_values(group, column))
    return {label: dict(by_count) for label, by_count in found.items()}


@dataclass(frozen=True)
class _PaperColumn:
    head: str
    unit: str
    meaning: str
    entry: Callable[[Line], str]
    left: bool = False


def _metric(name: str, factor: float = 1.0, digits: int = 4) -> Callable[[Line], str]:
    return lambda line: short(factor * line.value(name), digits)


_SOLVER = _PaperColumn("method", "", "", lambda line: line.row.label, left=True)
_COST = (
    _PaperColumn(
        "cost", "drapes", "forward-equivalents a cell, a gradient counting as two",
        lambda line: short(line.value("spent_forward_equivalents"), 0),
    ),
    _PaperColumn("time", "s", "wall seconds a cell", lambda line: short(line.value("spent_wall_seconds"), 1)),
)  # fmt: skip
_COLUMNS: dict[str, tuple[_PaperColumn, ...]] = {
    "table-1": (
        _SOLVER,
        _PaperColumn("published", "MSE", "the paper's own figure", lambda line: short(line.published[0])),
        _PaperColumn("published", "H mm", "the paper's own figure", lambda line: short(1e3 * line.published[1], 1)),
        _PaperColumn(
            "test", "MSE [95 %]", "all draws against unseen samples",
            lambda line: with_interval(line.row.estimates.get("test_mse")),
        ),
        _PaperColumn("best", "MSE /N", "unseen samples against the best of N draws", lambda line: best_of(line.row)),
        _PaperColumn(
            "random", "MSE /N", "the same of N draws with random fold phases: what N alone is worth",
            lambda line: short(line.row.matched_null) if line.row.draws > 1 else "",
        ),
        _PaperColumn(
            "best - random", "MSE [95 %]", "paired by cell; below 0 is better than chance",
            lambda line: with_interval(line.against_random),
        ),
        _PaperColumn("H", "mm", "Hausdorff distance of the draws", _metric("test_hausdorff_m", 1e3, 1)),
        _PaperColumn(
            "H best", "mm", "of the best of N draws",
            lambda line: short(1e3 * line.value("test_hausdorff_best_m"), 1) if line.row.draws > 1 else "",
        ),
        _PaperColumn("energy", "dist.", "energy distance, standardised", _metric("test_energy_distance", 1, 3)),
        _PaperColumn("variogram", "score", "of the profile", _metric("test_variogram_score", 1, 4)),
        _PaperColumn("CRPS", "DC points", "of the drape coefficient", _metric("test_dc_crps", 1e2, 2)),
        _PaperColumn("cover", "50 %", "held-out DC within the central interval", _metric("test_dc_cover_50", 1e2, 0)),
        _PaperColumn("cover", "90 %", "held-out DC within the central interval", _metric("test_dc_cover_90", 1e2, 0)),
        _PaperColumn("folds", "p", "of the same fold numbers; mean over cells", _metric("test_fold_p", 1, 2)),
        _PaperColumn(
            "folds", "rejected", f"cells in which fold numbers are not the same, at {FOLD_LEVEL:.0%} over all (Holm)",
            lambda line: f"{line.folds_rejected} of {len(line.fold_tests)}" if line.fold_tests else "",
        ),
        _PaperColumn("train", "MSE", "fit of the training silhouette", _metric("train_mse")),
        *_COST,
    ),
    "table-2": (
        _SOLVER,
        _PaperColumn("published", "MSE", "the paper's figure, at 500 trials", lambda line: short(line.published[0])),
        _PaperColumn("published", "H mm", "the paper's own figure", lambda line: short(1e3 * line.published[1], 1)),
        _PaperColumn(
            "train", "MSE [95 %]", "fit of the training silhouette",
            lambda line: with_interval(line.row.estimates.get("train_mse")),
        ),
        _PaperColumn("H", "mm", "Hausdorff distance to the training drape", _metric("train_hausdorff_m", 1e3, 1)),
        _PaperColumn(
            "equal time", "MSE", "best training loss when the fastest method had ended",
            lambda line: short(line.at_equal_time),
        ),
        _PaperColumn("test", "MSE", "the same drape against unseen samples", _metric("test_mse")),
        *_COST,
    ),
}  # fmt: skip
_EXPLAINED = {
    "table-1": (
        "The paper's figures are one drape against the 11 unseen samples (HOMO, HETER) and the best of 1000 draws "
        "(BDP); read BDP's against 'best', and 'best' against 'random' of equal N.",
    ),
    "table-2": (
        "Budgets are equal in drapes, a gradient counting as two; 'equal time' reads the anytime curves at equal wall "
        "time instead.",
    ),
}
