"""Scores as a page of Markdown, as rows of a CSV file, and as one JSON document."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any

import pandas as pd

from cusick_bench.withheld.format.label import SINGLE
from cusick_bench.withheld.scoring.calibration import reliability
from cusick_bench.withheld.scoring.failures import Failure, confusion_by_class, confusion_by_effect
from cusick_bench.withheld.scoring.figures import Figure
from cusick_bench.withheld.scoring.measures import (
    ALL,
    AUROC,
    CALIBRATION,
    CALIBRATION_BY_CHANCE,
    CLEAR,
    DISTINCT,
    HIDDEN,
    MEASURES,
)
from cusick_bench.withheld.scoring.score import ANSWERS, Scores
from cusick_bench.withheld.scoring.subsets import are_clear, unit_of_levels

_MEANINGS = {measure.name: measure.meaning for measure in MEASURES} | {
    AUROC: "how often an effect looks more like one than a null does",
    CALIBRATION: "largest probability against share right, bins of equal numbers of cases",
    CALIBRATION_BY_CHANCE: "what calibrated answers of these probabilities show in so few cases",
}
_SCORES = {measure.name for measure in MEASURES if not measure.is_share and measure.column != "top_two"}
_SCORES |= {CALIBRATION, CALIBRATION_BY_CHANCE, AUROC}  # written as numbers, all others in per cent


def written(name: str, value: float) -> str:
    """Writes a figure as it stands in the tables: shares in per cent.

    Args:
        name: Name of the figure.
        value: Its value.

    Returns:
        The text; "" for NaN.
    """
    if not isfinite(value):
        return ""
    return f"{value:.3f}" if name in _SCORES else f"{100 * value:.1f} %"


def with_interval(figure: Figure) -> str:
    """Writes a figure with its interval.

    Args:
        figure: The figure.

    Returns:
        The text.
    """
    if not isfinite(figure.low):
        return written(figure.name, figure.value)
    low, high = (written(figure.name, bound).removesuffix(" %") for bound in (figure.low, figure.high))
    return f"{written(figure.name, figure.value)} [{low}, {high}]"


def headline(scores: Scores) -> list[list[str]]:
    """Lines of the main table: one a figure with cases that has a goal, or that is given for all cases only.

    Args:
        scores: The scores.

    Returns:
        Heading and lines: figure, cases, n, answers with interval, goal, reached, then each other method.
    """
    rivals = list(dict.fromkeys(figure.method for figure in scores.figures if figure.method != ANSWERS))
    values = {(figure.method, figure.name, figure.subset): figure for figure in scores.figures}
    lines = [["figure", "cases", "n", "answers [95 %]", "goal", "reached", *rivals]]
    for figure in headline_figures(_of(scores, ANSWERS)):
        others = [values.get((rival, figure.name, figure.subset)) for rival in rivals]
        rest = ["" if other is None else written(other.name, other.value) for other in others]
        lines.append([*headline_cells(figure), *rest])
    return lines


def headline_figures(figures: Sequence[Figure]) -> list[Figure]:
    """Figures of the main table.

    Args:
        figures: All figures of one method.

    Returns:
        Those with cases that have a goal, are of clear effects, or of all cases where severity does not matter.
    """
    by_clear = {figure.name for figure in figures if figure.subset == CLEAR}
    return [
        figure
        for figure in figures
        if figure.cases
        and (figure.goal is not None or figure.subset in ((CLEAR, DISTINCT) if figure.name in by_clear else (ALL,)))
    ]


def headline_cells(figure: Figure) -> list[str]:
    """Cells of a figure in the main table.

    Args:
        figure: The figure.

    Returns:
        Figure, cases, n, value with interval, goal, reached.
    """
    goal = "" if figure.goal is None else str(figure.goal)
    return [figure.name, figure.subset, str(figure.cases), with_interval(figure), goal, figure.reached]


def _not_judged(scores: Scores) -> list[str]:
    """Figures that have no case."""
    figures = _of(scores, ANSWERS)
    judged = {figure.name for figure in figures if figure.cases}
    return [name for name in dict.fromkeys(figure.name for figure in figures) if name not in judged]


def by_severity(scores: Scores) -> list[list[str]]:
    """Lines of the power curve: one a figure that depends on severity, a column a level, cases in the last line.

    Args:
        scores: The scores.

    Returns:
        Heading and lines; nothing where no case has a severity.
    """
    figures = [f for f in _of(scores, ANSWERS) if f.cases and f.subset not in (ALL, CLEAR, DISTINCT)]
    if not figures:
        return []
    levels = sorted({figure.subset for figure in figures}, key=_order)
    values = {(figure.name, figure.subset): figure for figure in figures}
    names = list(dict.fromkeys(figure.name for figure in figures))
    lines = [["figure", *levels]]
    for name in names:
        entries = [values.get((name, level)) for level in levels]
        lines.append([name, *("" if entry is None else with_interval(entry) for entry in entries)])
    counted = next((name for name in ("power", "unknown recalled", "pairs: power") if name in names), "")
    counts = [values.get((counted, level)) for level in levels]
    return [*lines, ["cases", *("" if entry is None else str(entry.cases) for entry in counts)]]


def _order(subset: str) -> float:
    """Levels ascending, what has none last."""
    return float(subset[:-1]) if subset != HIDDEN else float("inf")


def _of(scores: Scores, method: str) -> list[Figure]:
    return [figure for figure in scores.figures if figure.method == method]


def markdown(scores: Scores, failed: Sequence[Failure], facts: Mapping[str, Any]) -> str:
    """Writes the whole table as a page, every failure at its end.

    Args:
        scores: The scores.
        failed: Cases in which something is wrong, from `failures`.
        facts: Provenance, such as the command.

    Returns:
        The page as Markdown.
    """
    origin = ", ".join(f"{name.replace('_', ' ')} `{value}`" for name, value in facts.items())
    parts = ["**Withheld cases**", "", *(f"- {note}" for note in scores.notes), f"- {origin}.", ""]
    lines = headline(scores)
    parts += [*_grid(lines), ""]
    shown = dict.fromkeys(line[0] for line in lines[1:])
    parts += [f"- {name}: {_MEANINGS[name]}." for name in shown]
    if absent := _not_judged(scores):
        parts += ["", f"Not judged, for want of cases: {', '.join(absent)}."]
    if levels := by_severity(scores):
        parts += ["", "**By severity** (nearest power of two)", "", *_grid(levels)]
    parts += ["", "**Reliability** of the largest probability", "", *_grid(_reliability(scores.cases))]
    parts += ["", "**Confusion by class** (rows: truth, columns: answer)", "", *_grid(_square(scores.cases))]
    parts += ["", "**Confusion by effect**", "", *_grid(_taken_for(scores.cases))]
    parts += ["", f"**Failures** ({len(failed)} of {len(scores.cases)} cases)", ""]
    lines = [[item.case, ", ".join(item.faults), item.label, item.answer] for item in failed]
    return "\n".join([*parts, *_grid([["case", "what is wrong", "label", "answer"], *lines])]) + "\n"


def _grid(lines: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table; the first is its heading."""
    escaped = [[entry.replace("|", r"\|") for entry in line] for line in lines]
    rows = [f"| {' | '.join(line)} |" for line in escaped]
    return [rows[0], "| " + " | ".join(["---"] * len(lines[0])) + " |", *rows[1:]]


def _reliability(cases: pd.DataFrame) -> list[list[str]]:
    known = cases.loc[cases["confidence"].notna()]
    points = reliability(known["confidence"].to_numpy(float), known["right"].to_numpy(float)) if len(known) else []
    lines = [[f"{confidence:.3f}", f"{right:.3f}", str(number)] for confidence, right, number in points]
    return [["mean probability", "share right", "cases"], *lines]


def _square(cases: pd.DataFrame) -> list[list[str]]:
    table = confusion_by_class(cases)
    lines = [
        [str(name), *(str(count or "") for count in row)]
        for name, row in zip(table.index, table.to_numpy(), strict=True)
    ]
    return [["", *map(str, table.columns)], *lines]


def _taken_for(cases: pd.DataFrame) -> list[list[str]]:
    """One line a truth: how often it was found, also where it was clear, and what else was said, most often first."""
    clear = are_clear(cases) | ((cases["kind"] != SINGLE) & cases["multiple"].isna())
    strong = _nested(confusion_by_effect(cases.loc[clear]))
    lines = []
    for truth, counts in _nested(confusion_by_effect(cases)).items():
        others = sorted(((n, said) for said, n in counts.items() if said != truth), key=lambda item: -item[0])
        taken = ", ".join(f"{said} {n}" for n, said in others)
        lines.append([truth, _recognised(truth, counts), _recognised(truth, strong.get(truth, {})), taken])
    return [["truth", "found", f"found {CLEAR}", "taken for"], *lines]


def _recognised(truth: str, counts: Mapping[str, int]) -> str:
    return f"{counts.get(truth, 0)} of {sum(counts.values())}" if counts else ""


def rows(scores: Scores, failed: Sequence[Failure], facts: Mapping[str, Any]) -> pd.DataFrame:
    """Writes rows of a CSV file: every figure of every method, both confusions, every failure.

    Args:
        scores: The scores.
        failed: Cases in which something is wrong, from `failures`.
        facts: Provenance that every row carries, such as the command.

    Returns:
        The rows.
    """
    lines = [{"row": "figure", **figure.record()} for figure in scores.figures]
    lines += _counts("confusion by class", confusion_by_class(scores.cases))
    lines += _counts("confusion by effect", confusion_by_effect(scores.cases))
    lines += [
        {"row": "failure", "case": f.case, "faults": ", ".join(f.faults), "label": f.label, "answer": f.answer}
        for f in failed
    ]
    unit = unit_of_levels(scores.cases)
    return pd.DataFrame([{**row, "severities": unit, **facts} for row in lines])


def _counts(kind: str, table: pd.DataFrame) -> Iterable[dict[str, Any]]:
    return [
        {"row": kind, "method": ANSWERS, "label": truth, "answer": said, "value": count}
        for truth, row in table.iterrows()
        for said, count in row.items()
        if count
    ]


def document(scores: Scores, failed: Sequence[Failure], facts: Mapping[str, Any]) -> dict[str, Any]:
    """Writes one JSON document.

    Args:
        scores: The scores.
        failed: Cases in which something is wrong, from `failures`.
        facts: Provenance, such as the command.

    Returns:
        Figures, goals that were missed, confusions, failures, provenance.
    """
    return {
        "figures": [figure.record() for figure in scores.figures],
        "missed": [f"{f.name} ({f.subset})" for f in _of(scores, ANSWERS) if f.reached == "no"],
        "detection": scores.detection,
        "confusion": {
            "class": _nested(confusion_by_class(scores.cases)),
            "effect": _nested(confusion_by_effect(scores.cases)),
        },
        "reliability": _reliability(scores.cases)[1:],
        "cases": scores.cases.to_dict("records"),
        "failures": [vars(failure) for failure in failed],
        "notes": list(scores.notes),
        **facts,
    }


def _nested(table: pd.DataFrame) -> dict[str, dict[str, int]]:
    return {str(truth): {str(said): int(n) for said, n in row.items() if n} for truth, row in table.iterrows()}
