"""Figures of several suites together, from the tables of `withheld score`: one interval over all of their cases.

Shares have Wilson's interval of all cases; of means over cases only the mean is known. Areas under the receiver
operating characteristic and errors of calibration need the single cases, so they are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isfinite, nan
from pathlib import Path

import pandas as pd

from cusick_bench.files import BadFile, read_csv
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.scoring.calibration import wilson_interval
from cusick_bench.withheld.scoring.figures import Figure
from cusick_bench.withheld.scoring.measures import ALL, MEASURES, Measure
from cusick_bench.withheld.scoring.score import ANSWERS
from cusick_bench.withheld.scoring.table import headline_cells, headline_figures, written

_COLUMNS = ("row", "method", "name", "subset", "value", "cases", "command", "labels_sha256")
_REMEDY = "make it again with `withheld score ANSWERS LABELS --out FILE.csv`"
_NAMES = {measure.name for measure in MEASURES}
_TWINS = "--twins"  # option of the command that scores by measured severities


@dataclass(frozen=True)
class ScoreTable:
    """Figures of the answers to one suite.

    Attributes:
        path: Its file.
        values: Value and number of cases, by name of the figure and of the subset of cases.
        labels: Digest of the suite's labels; suites of one seed have the same in all worlds.
        cases: Digest of the cases' files; "" where the answers or the table are too old to say.
        measured: Whether severities are those that silhouettes show; None where no case has an effect.
        unit: What levels of severity are multiples of; "" where no case has one, or the file is too old to say.
    """

    path: Path
    values: Mapping[tuple[str, str], tuple[float, int]]
    labels: str
    measured: bool | None
    unit: str
    cases: str = ""


@dataclass(frozen=True)
class PooledFigure:
    """A figure over the cases of several suites.

    Attributes:
        figure: The figure.
        parts: Its value in each suite; NaN in those without cases.
    """

    figure: Figure
    parts: tuple[float, ...]


def read_score_table(path: Path) -> ScoreTable:
    """Reads a table of scores.

    Args:
        path: CSV file of `withheld score --out`.

    Returns:
        The figures of the answers.

    Raises:
        BadFile: The file cannot be read, or is no table of scores.
    """
    found = read_csv(path, remedy=_REMEDY, required=_COLUMNS)
    rows = [(number, cells) for number, cells in found.rows if _is_pooled(cells)]
    if not rows:
        raise BadFile(path, "has no shares or means of answers", _REMEDY)
    values = {(cells["name"], cells["subset"]): _value(path, number, cells) for number, cells in rows}
    first = rows[0][1]
    has_effects = any(cases for (_, subset), (_, cases) in values.items() if subset != ALL)
    measured = _TWINS in first["command"] if has_effects else None
    unit = first.get("severities", "") if has_effects else ""
    return ScoreTable(path, values, first["labels_sha256"], measured, unit, first.get("cases_sha256", ""))


def _is_pooled(cells: Mapping[str, str]) -> bool:
    return (cells["row"], cells["method"]) == ("figure", ANSWERS) and cells["name"] in _NAMES


def _value(path: Path, number: int, cells: Mapping[str, str]) -> tuple[float, int]:
    try:
        value, cases = float(cells["value"] or nan), int(cells["cases"])
    except ValueError as error:
        raise BadFile(f"{path}, line {number}", str(error), _REMEDY) from error
    if cases < 0 or (cases and not isfinite(value)):
        raise BadFile(f"{path}, line {number}", f"has the value {cells['value']!r} of {cases} cases", _REMEDY)
    return value, cases


def pooled(tables: Sequence[ScoreTable]) -> list[PooledFigure]:
    """Figures over the cases of all suites.

    Args:
        tables: One table of each suite.

    Returns:
        Shares and means over cases that any suite has, in the order of `MEASURES`.

    Raises:
        WithheldError: Two tables are of the same cases, or their severities are not of one kind.
    """
    for one, other in combinations(tables, 2):
        apart = one.cases and other.cases and one.cases != other.cases  # suites of one seed in two worlds
        if one.labels == other.labels and not apart:
            raise WithheldError(f"{one.path} and {other.path} are of the same cases; give one of them")
        if {one.measured, other.measured} == {True, False}:
            plain = other if one.measured else one
            raise WithheldError(f"severities are not measured in {plain.path}, but in others; score it with {_TWINS}")
        if one.unit and other.unit and one.unit != other.unit:
            raise WithheldError(
                f"severities are multiples of the {one.unit} in {one.path}, of the {other.unit} in {other.path}; score "
                f"both with {_TWINS}, or pool suites of one kind"
            )
    found = []
    for measure in MEASURES:
        named = [subset for table in tables for name, subset in table.values if name == measure.name]
        for subset in dict.fromkeys(named):
            parts = [table.values.get((measure.name, subset), (nan, 0)) for table in tables]
            if any(cases for _, cases in parts):
                found.append(PooledFigure(_together(measure, subset, parts), tuple(value for value, _ in parts)))
    return found


def _together(measure: Measure, subset: str, parts: Sequence[tuple[float, int]]) -> Figure:
    cases = sum(number for _, number in parts)
    total = sum(value * number for value, number in parts if number)
    low, high = wilson_interval(round(total), cases) if measure.is_share else (nan, nan)
    return Figure(ANSWERS, measure.name, subset, total / cases, low, high, cases, measure.goals.get(subset))


def suite_names(tables: Sequence[ScoreTable]) -> list[str]:
    """Names of suites: the file's, and where another table has the same, the folders that tell them apart.

    Args:
        tables: Tables of suites.

    Returns:
        The name of each.
    """
    parts = [table.path.resolve().parts for table in tables]
    names = []
    for own in parts:
        length = 1
        while length < len(own) and sum(other[-length:] == own[-length:] for other in parts) > 1:
            length += 1
        names.append("/".join(own[-length:]))
    return names


def pooled_rows(figures: Sequence[PooledFigure], tables: Sequence[ScoreTable], command: str) -> pd.DataFrame:
    """Rows of a CSV file: every figure, with a column for each suite.

    Args:
        figures: From `pooled`.
        tables: The tables that they are from.
        command: The command that made it.

    Returns:
        The rows.
    """
    heads = suite_names(tables)
    return pd.DataFrame(
        [{**one.figure.record(), **dict(zip(heads, one.parts, strict=True)), "command": command} for one in figures]
    )


def pooled_lines(figures: Sequence[PooledFigure], tables: Sequence[ScoreTable]) -> list[list[str]]:
    """Lines of the table for readers: figures with a goal, and the others of clear effects or of all cases.

    Args:
        figures: From `pooled`.
        tables: The tables that they are from.

    Returns:
        Heading and lines: figure, cases, n, all suites with interval, goal, reached, then each suite.
    """
    suites = [name.removesuffix(".csv") for name in suite_names(tables)]
    lines = [["figure", "cases", "n", "all [95 %]", "goal", "reached", *suites]]
    parts = {(one.figure.name, one.figure.subset): one.parts for one in figures}
    for figure in headline_figures([one.figure for one in figures]):
        own = [written(figure.name, value) for value in parts[figure.name, figure.subset]]
        lines.append([*headline_cells(figure), *own])
    return lines
