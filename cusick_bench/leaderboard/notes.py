"""Notes for the readers of a leaderboard: which rows are over other cells than others, and what was left out."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite

import pandas as pd

from cusick_bench.files.first_names import first_names
from cusick_bench.leaderboard.bootstrap import MINIMUM_UNITS, cell_values, repeats
from cusick_bench.leaderboard.cells.cell_number import SEEDS, split_of
from cusick_bench.leaderboard.cells.loading import Skipped
from cusick_bench.leaderboard.cells.variants import Problem, problems_run
from cusick_bench.leaderboard.row import RANKED_KINDS, Row

_MOST_LEFT_OUT = 20  # cells that are left out and have a note each


def _seed_notes(
    rows: Sequence[Row], groups: Mapping[tuple[str, str], pd.DataFrame], skipped: Sequence[Skipped]
) -> Iterator[str]:
    """Rows that were not run on all problems of the others, of the cloths that they have."""
    run = {
        row.label: problems_run(groups[row.solver, row.variant], skipped) for row in rows if row.kind in RANKED_KINDS
    }
    known = frozenset[Problem]().union(*run.values())
    in_turn = any(split_of(number) for _, number in known)
    for row in rows:
        lacking = sorted(one for one in known - run.get(row.label, known) if one[0] in row.cloths)
        named = [
            f"seed {number % SEEDS} on {cloth}" + (f" split {split_of(number) + 1}" if in_turn else "")
            for cloth, number in lacking
        ]
        if lacking:
            yield (
                f"{row.label} lacks {len(lacking)} cell{'s' if len(lacking) > 1 else ''} that other rows have "
                f"({first_names(named)}); its mean is over other cells than theirs. Run all solvers with the same "
                "seeds (--seeds)."
            )


def _partly_measured(
    row: Row, unmeasured: Mapping[str, Mapping[tuple[str, str], Sequence[str]]], by: str
) -> dict[tuple[str, ...], list[str]]:
    """Metrics that a row has of some of its cloths only, by the cloths that lack them; not the one that ranks it."""
    found: dict[tuple[str, ...], list[str]] = {}
    for metric, lacking in unmeasured.items():
        own = tuple(cloth for cloth in lacking.get((row.solver, row.variant), ()) if cloth in row.cloths)
        if own and metric != by and isfinite(row.value(metric)):
            found.setdefault(own, []).append(metric)
    return found


def interval_note(table: pd.DataFrame) -> str:
    """How the intervals of a board were found, as `bootstrap` finds them.

    Args:
        table: Cells of the board.

    Returns:
        The note.
    """
    in_turn = any(split_of(number) for number in repeats(table))
    within = (
        "of the samples that are left out within each cloth"
        if in_turn
        else "of seeds within each cloth, or of cloths where seeds change nothing"
    )
    return (
        f"Intervals of 95 % are found by bootstrap, {within}, and widened for small numbers of them as Student's t is. "
        "Rows of one rank cannot be told apart: the interval of their paired difference includes 0."
    )


def row_notes(
    rows: Sequence[Row],
    groups: Mapping[tuple[str, str], pd.DataFrame],
    skipped: Sequence[Skipped],
    cloths: tuple[str, ...],
    by: str,
    unmeasured: Mapping[str, Mapping[tuple[str, str], Sequence[str]]],
) -> Iterator[str]:
    """What readers have to know to compare the rows of a board.

    Args:
        rows: The rows.
        groups: Cells by solver and variant.
        skipped: Cells that are left out.
        cloths: Cloths that any row covers.
        by: Metric that orders the rows.
        unmeasured: By metric, then by solver and variant, the cloths of which these lack it.

    Yields:
        One note, of one or two sentences, at a time.
    """
    yield from _seed_notes(rows, groups, skipped)
    if len(cloths) < MINIMUM_UNITS and all(row.cells < MINIMUM_UNITS for row in rows):
        yield (
            f"Fewer than {MINIMUM_UNITS} cells a row: no intervals, and all ranks are tied. "
            "Run more cloths (--cloth) or seeds (--seeds)."
        )
    elif not any(isfinite(row.estimates[by].low) for row in rows if by in row.estimates):
        yield (
            f"No row has an interval, and rows whose difference has none share a rank: of fewer than {MINIMUM_UNITS} "
            "cloths it takes several seeds of each that differ, or more samples that are left out. Run more cloths "
            "(--cloth)."
        )
    if not any(row.kind == "floor" for row in rows):
        yield "No floor: these data hold no drape that was captured twice."
    for row in rows:
        if row.kind in RANKED_KINDS and row.cloths != cloths:
            yield f"{row.label} has no rank: it lacks {', '.join(sorted(set(cloths) - set(row.cloths)))}."
        elif (
            row.kind in RANKED_KINDS
            and isfinite(row.value(by))
            and (lacking := unmeasured[by][row.solver, row.variant])
        ):
            yield f"{row.label} has no rank: its cells on {', '.join(lacking)} have no {by}."
        if row.failed and row.rank is not None:
            yield (
                f"{row.label} has failed in {row.failed} cell{'s' * (row.failed != 1)}, so that its mean is over other "
                "cells than those of the rows beside it."
            )
        for lacking, metrics in _partly_measured(row, unmeasured, by).items():
            yield (
                f"{row.label}: its cells on {', '.join(lacking)} have no {', '.join(metrics)}; means of these are over "
                "other cloths than those of the rows beside it."
            )
        offered = set(cell_values(groups[row.solver, row.variant], "draws").values()) if row.kind == "solver" else set()
        if len(offered) > 1:
            yield (
                f"{row.label} offers {min(offered):.0f} to {max(offered):.0f} draws a cell; a best of N is shown only "
                "where N is the same in all cells."
            )
    if any(row.draws > 1 and row.kind == "solver" and not isfinite(row.matched_null) for row in rows):
        yield (
            "A best-of-N score rewards N: run null:random-phase on the same cloths with as many draws "
            "to have something to read it against."
        )
    yield from (cell.note for cell in skipped[:_MOST_LEFT_OUT])
    if more := Counter(cell.status for cell in skipped[_MOST_LEFT_OUT:]):
        counts = ", ".join(f"{count} {status}" for status, count in more.most_common())
        yield f"Left out as well: {more.total()} more cells ({counts}); `leaderboard --json` lists them all."
