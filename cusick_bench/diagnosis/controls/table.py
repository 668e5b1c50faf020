"""Judgements and figures as rows of a CSV file, as a page of Markdown, and as one JSON document."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from math import isfinite
from pathlib import Path
from typing import Any

import pandas as pd

from cusick_bench.diagnosis.controls.figures import ControlFigure
from cusick_bench.diagnosis.controls.judgement import Judgement
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.files.formula import unguarded_cell

_TITLE = "Controls of the diagnosis"
_MEANING = (
    "What is planted in the pictures of real cloth, or known of them, and what the diagnosis makes of it. Rules and "
    "controls: `cusick_bench.diagnosis.controls`. Intervals are Wilson's, of as many cases as the scatter between "
    "fabrics leaves (Rao and Scott 1992)."
)


def rows(judgements: Sequence[Judgement], shares: Sequence[ControlFigure], facts: Mapping[str, Any]) -> pd.DataFrame:
    """Rows of a CSV file.

    Args:
        judgements: Verdict on every control of every fabric.
        shares: From `figures`.
        facts: Provenance that every row carries, such as the command.

    Returns:
        A row for each judgement, then one for each share.
    """
    lines = [{"row": "control", **asdict(one)} for one in judgements]
    lines += [{"row": "share", **figure.record()} for figure in shares]
    return pd.DataFrame([{**line, **facts} for line in lines])


def read_judgements(path: Path, facts: Mapping[str, Any]) -> list[Judgement]:
    """Judgements of a table that was begun.

    Args:
        path: CSV file of `rows`; it may be missing.
        facts: Provenance that its rows must carry.

    Returns:
        Its judgements; none of a table with another provenance.

    Raises:
        DiagnosisError: Not such a table.
    """
    if not path.exists():
        return []
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
        controls = table[table["row"] == "control"]
        if any(name not in table or (table[name] != str(value)).any() for name, value in facts.items()):
            return []
        return [_judgement(dict(zip(controls, row, strict=True))) for row in controls.to_numpy()]
    except (ValueError, KeyError) as error:
        raise DiagnosisError(
            f"{path} is no table of controls ({error!r}); move it away or give another --out"
        ) from error


def _judgement(row: Mapping[str, str]) -> Judgement:
    """A judgement from its row of text; an empty number is NaN."""
    truth = {"True": True, "False": False}
    read = {float: lambda text: float(text or "nan"), bool: truth.__getitem__, str: unguarded_cell}
    return Judgement(**{field.name: read[field.type](row[field.name]) for field in fields(Judgement)})


def document(
    judgements: Sequence[Judgement], shares: Sequence[ControlFigure], facts: Mapping[str, Any]
) -> dict[str, Any]:
    """One JSON document.

    Args:
        judgements: Verdict on every control of every fabric.
        shares: From `figures`.
        facts: Provenance, such as the command.

    Returns:
        Shares, goals that were missed, judgements, provenance.
    """
    return {
        "shares": [figure.record() for figure in shares],
        "missed": [f"{figure.name} ({figure.goal})" for figure in shares if figure.reached == "no"],
        "controls": [asdict(one) for one in judgements],
        **facts,
    }


def share_lines(shares: Sequence[ControlFigure]) -> list[list[str]]:
    """Lines of the table of shares.

    Args:
        shares: From `figures`.

    Returns:
        Heading and lines.
    """
    lines = [["what", "strength", "count", "share [95 %]", "goal", "reached"]]
    for figure in shares:
        value = f"{100 * figure.value:.0f} % [{100 * figure.low:.0f}, {100 * figure.high:.0f}]" if figure.cases else ""
        counts = f"{figure.count} of {figure.cases}"
        lines.append([figure.name, figure.level, counts, value, figure.goal, figure.reached])
    return lines


def control_lines(judgements: Sequence[Judgement]) -> list[list[str]]:
    """Lines of the table of controls.

    Args:
        judgements: Verdict on every control of every fabric.

    Returns:
        Heading and lines.
    """
    heads = ["fabric", "control", "level", "right or (wrong) answer", "hit", "false alarm", "verdict", "named",
             "probability", "planted", "estimated", "shown"]  # fmt: skip
    return [heads, *(_control_line(one) for one in judgements)]


def _control_line(one: Judgement) -> list[str]:
    answer = f"({one.effects})" if one.kind in ("absent", "null") else one.effects
    return [
        one.fabric, one.control, one.level, answer, one.hit, "yes" if one.false_alarm else "",
        _change(one.verdict_before, one.verdict), one.named or one.note,
        _change(_number(one.probability_before, ".2f"), _number(one.probability, ".2f")),
        _number(one.planted, ".3g"), _number(one.estimated, ".3g"), _number(one.largest_shift, ".1f"),
    ]  # fmt: skip


def markdown(judgements: Sequence[Judgement], shares: Sequence[ControlFigure], facts: Mapping[str, Any]) -> str:
    """A page of Markdown.

    Args:
        judgements: Verdict on every control of every fabric.
        shares: From `figures`.
        facts: Provenance, such as the command.

    Returns:
        The page.
    """
    head = [f"# {_TITLE}", "", _MEANING, "", *(f"* {name}: `{value}`" for name, value in facts.items()), ""]
    notes = [
        "`shown`: largest change of a statistic's mean, in standard errors between samples. `planted`, `estimated`: "
        "the severity in the unit of the effect's parameter, and the change of its estimate. An arrow goes from the "
        "diagnosis without what was planted to that with it.",
        "",
    ]
    tables = [*_table(share_lines(shares)), "", "## Every control", "", *notes, *_table(control_lines(judgements)), ""]
    return "\n".join([*head, *tables])


def _table(lines: Sequence[Sequence[str]]) -> list[str]:
    head, *body = ("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
    return [head, "|" + " :--- |" * len(lines[0]), *body]


def _change(before: str, after: str) -> str:
    return after if not before or before == after else f"{before} → {after}"


def _number(value: float, form: str) -> str:
    return format(value, form) if isfinite(value) else ""
