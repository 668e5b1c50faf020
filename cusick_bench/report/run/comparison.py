"""Comparison of a run with another one: a table of changes, a graph, and other differences."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from markupsafe import Markup

from cusick_bench.leaderboard import Cells, short
from cusick_bench.leaderboard.two_runs import Change, MethodChange, TwoRuns, compare_runs
from cusick_bench.report.drawing.change_graph import change_graph
from cusick_bench.report.drawing.inline_svg import inline_svg

_HEADS = {
    "test_mse": "test MSE",
    "train_mse": "train MSE",
    "test_hausdorff_m": "Hausdorff",
    "spent_forward_equivalents": "drapes",
    "spent_wall_seconds": "seconds",
}
_FEWEST_PLACES, _MOST_PLACES = 2, 6  # decimals of a ratio


@dataclass(frozen=True)
class ChangeCell:
    """An entry of the table.

    Attributes:
        text: The ratio with its interval; "" where there is none.
        verdict: "better", "worse" or "same".
    """

    text: str
    verdict: str


@dataclass(frozen=True)
class ChangeRow:
    """A method of the table.

    Attributes:
        label: Its name.
        kind: "solver", "null" or "oracle".
        cells: Number of its cells.
        before: Test MSE in the other run.
        after: Test MSE in this run.
        changes: An entry a heading.
    """

    label: str
    kind: str
    cells: int
    before: str
    after: str
    changes: list[ChangeCell]


@dataclass(frozen=True)
class ComparisonSection:
    """Comparison of this run with another.

    Attributes:
        other: Folder of the other run.
        heads: Headings of the changes.
        rows: The methods that both runs have.
        graph: Test MSE in both runs; None where neither has one.
        notes: Remarks for readers.
        differences: What else differs: name, value there, value here.
    """

    other: str
    heads: list[str]
    rows: list[ChangeRow]
    graph: Markup | None
    notes: list[str]
    differences: Sequence[tuple[str, str, str]]


def comparison_section(here: Cells, there: Cells, *, seed: int = 0) -> ComparisonSection:
    """Compares two runs for the page of one of them.

    Args:
        here: The run that the page is of.
        there: The other one.
        seed: Seed of the resamples.

    Returns:
        The content of the section.

    Raises:
        LeaderboardError: The runs are of other data or splits, or share no method on a cloth.
    """
    both = compare_runs(here, there, seed=seed)
    heads = [name for name in _HEADS if any(name in one.changes for one in both.methods)]
    drawn = [one for one in both.methods if "test_mse" in one.changes]
    graph = inline_svg(change_graph(drawn, "test_mse"), _in_words(drawn), "wide") if drawn else None
    return ComparisonSection(
        other=str(Path(there.folder)),
        heads=[_HEADS[name] for name in heads],
        rows=[_row(one, heads) for one in both.methods],
        graph=graph,
        notes=_notes(both),
        differences=both.differences,
    )


def _row(one: MethodChange, heads: Sequence[str]) -> ChangeRow:
    error = one.changes.get("test_mse")
    return ChangeRow(
        one.label,
        one.kind,
        one.cells,
        short(error.before) if error else "",
        short(error.after) if error else "",
        [_entry(one.changes.get(name)) for name in heads],
    )


def _entry(change: Change | None) -> ChangeCell:
    if change is None or not isfinite(change.ratio.value):
        return ChangeCell("", "same")
    ratio = change.ratio
    places = next((places for places in range(_FEWEST_PLACES, _MOST_PLACES) if _tell(change, places)), _MOST_PLACES)
    span = f" [{ratio.low:.{places}f}, {ratio.high:.{places}f}]" if isfinite(ratio.low) else ""
    return ChangeCell(f"× {ratio.value:.{places}f}{span}", change.verdict)


def _tell(change: Change, places: int) -> bool:
    """Whether so many decimals tell the ratio from 0, and from 1 the interval that leaves it out."""
    ratio = change.ratio
    if ratio.value > 0 and round(ratio.value, places) == 0:
        return False
    if change.verdict == "same":
        return True
    return round(ratio.high, places) < 1 if change.verdict == "better" else round(ratio.low, places) > 1


def _in_words(methods: Sequence[MethodChange]) -> str:
    changes = [(one.label, one.changes["test_mse"]) for one in methods]
    said = "; ".join(f"{label} from {one.before:.4f} to {one.after:.4f}" for label, one in changes)
    return f"Test MSE in the other run and in this one: {said}"


def _notes(both: TwoRuns) -> list[str]:
    notes = [
        "Ratio of this run to the other one over the cells that both have, paired by cloth and seed: geometric mean "
        "over cloths with its 95 % bootstrap interval. Below 1 is better. Marked where the interval leaves out 1; "
        "with many numbers in a table some do by chance, and cusick-bench check corrects for that."
    ]
    for words, labels in (("Only in this run", both.only_here), ("Only in the other run", both.only_there)):
        if labels:
            notes.append(f"{words}: {', '.join(labels)}.")
    return notes
