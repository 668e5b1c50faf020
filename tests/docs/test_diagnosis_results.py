"""The page on how often a diagnosis is right says what the committed tables of scores say."""

import csv
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "diagnosis-results.md").read_text(encoding="utf-8")
SUITES = ("paper-16-fresh", "published-16-fresh", "polar-16-fresh", "paper-16", "published-16")
"""Suites that version 16 answered, in the order of the columns of its table."""


def _rows(heading: str) -> dict[str, list[str]]:
    """Cells of the table whose first line begins with a heading, by the first cell of each line, without the goal."""
    (table,) = re.findall(rf"^\| {re.escape(heading)} \|.*\n(?:\|.*\n)+", PAGE, re.M)
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    return {name: cells for name, _, *cells in lines}


def _figure(suite: str, name: str, subset: str) -> tuple[float, int] | None:
    """Value of a figure and number of its cases; None where the table has none."""
    with (ROOT / "leaderboards" / f"withheld-{suite}.csv").open(encoding="utf-8") as file:
        found = [
            row for row in csv.DictReader(file)
            if (row["row"], row["method"], row["name"], row["subset"]) == ("figure", "answers", name, subset)
        ]  # fmt: skip
    return next(((float(row["value"]), int(row["cases"])) for row in found if row["value"]), None)


@pytest.mark.parametrize("column", range(len(SUITES)), ids=SUITES)
def test_version_16_on_visible_effects(column: int):
    rows, shown = _rows("Visible single effects"), f"{SUITES[column]}-shown"
    for line, name in (("found", "power"), ("named exactly", "exact effect"), ("class right", "class")):
        figure = _figure(shown, name, ">= 2x")
        assert figure is not None
        assert int(rows["number"][column]) == figure[1]
        assert int(rows[line][column].split(" %")[0]) == round(100 * figure[0])


@pytest.mark.parametrize("column", range(len(SUITES)), ids=SUITES)
def test_detection_and_calibration_of_visible_effects_and_of_all_as_drawn(column: int):
    heads = ("detection AUROC", "expected calibration error")
    lines = [line for line in PAGE.split("### Versions 6 and 7")[0].splitlines() if line.startswith("|")]
    for head in heads:
        (place,) = [n for n, line in enumerate(lines) if line.startswith(f"| {head}, with visible effects")]
        for line, suite in ((lines[place], f"{SUITES[column]}-shown"), (lines[place + 1], SUITES[column])):
            cell = line.strip("|").split("|")[2 + column].split(";")[0].strip()
            figure = _figure(suite, head, ">= 2x")
            assert (cell == "") == (figure is None)
            assert figure is None or float(cell) == pytest.approx(figure[0], abs=0.0051)
