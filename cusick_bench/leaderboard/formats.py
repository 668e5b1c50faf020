"""The forms of a leaderboard: terminal, Markdown, LaTeX, HTML fragment, and CSV with every number in full."""

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd
from rich import box
from rich.table import Table
from rich.text import Text

from cusick_bench.files.csv_text import csv_text
from cusick_bench.leaderboard.board import Leaderboard
from cusick_bench.leaderboard.row import Row
from cusick_bench.leaderboard.text import TextTable, provenance_columns, text_table

_STYLES = {"null": "yellow", "oracle": "magenta", "floor": "cyan", "solver": "bold"}
_LATEX = str.maketrans(
    {"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "$": r"\$", "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}"}
    | {"^": r"\textasciicircum{}", "\\": r"\textbackslash{}", "✗": r"$\times$", "±": r"$\pm$"}
    | {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}  # other characters in TeX's own fonts
)
_EMPHASIS = re.compile(r"[\\*~]|(?<![^\W_])_(?=.*_(?![^\W_]))|(?<=\])(?=\()", re.DOTALL)
"""What Markdown takes for emphasis or a link: not the underscores within `test_mse`."""


def terminal(board: Leaderboard | TextTable, width: int = 120) -> Table:
    """A table for a terminal of that many characters; the rarer columns are left out where it is narrow.

    Args:
        board: A leaderboard, or any table of strings.
        width: Characters in a line.

    Returns:
        The table, for `rich`.
    """
    text = _text(board).within(width)
    table = Table(title=text.title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, title_justify="left")
    for column in text.columns:
        table.add_column(
            Text(f"{column.head}\n{column.unit}".rstrip()),
            justify="left" if column.left else "right",
            no_wrap=not column.left,
            overflow="fold",
        )
    for kind, entries in zip(text.kinds, text.entries, strict=True):
        table.add_row(*map(Text, entries), style=_STYLES.get(kind, ""))
    return table


def markdown(board: Leaderboard | TextTable) -> str:
    """A Markdown table with its notes.

    Args:
        board: A leaderboard, or any table of strings.

    Returns:
        Text.
    """
    text = _text(board)
    heads = [f"{column.head} {column.unit}".strip() for column in text.columns]
    lines = [f"**{_escaped(text.title)}**", "", _line(heads)]
    lines.append(_line([":---" if column.left else "---:" for column in text.columns]))
    lines += [_line(list(map(_escaped, entries))) for entries in text.entries]
    return "\n".join([*lines, "", *(f"- {_escaped(note)}" for note in text.notes)]) + "\n"


def latex(board: Leaderboard | TextTable) -> str:
    """A LaTeX `tabular` (booktabs) with its notes as comments.

    Args:
        board: A leaderboard, or any table of strings.

    Returns:
        Text.
    """
    text = _text(board)
    heads = [f"{column.head} {column.unit}".strip().translate(_LATEX) for column in text.columns]
    lines = [f"% {' '.join(note.split())}" for note in (text.title, *text.notes)]  # a line break would end a comment
    lines.append(r"\begin{tabular}{" + "".join("l" if column.left else "r" for column in text.columns) + "}")
    lines += [r"\toprule", " & ".join(heads) + r" \\", r"\midrule"]
    lines += [_latex_row(entries) for entries in text.entries]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def html_table(board: Leaderboard | TextTable, links: Mapping[tuple[str, str], str] | None = None) -> str:
    """An HTML `table` element; rows carry their kind as a class.

    Args:
        board: A leaderboard, or any table of strings.
        links: Where the name of a solver leads to, by cloth and solver; cloth "" is for rows of no cloth of their own.

    Returns:
        Text of the element.
    """
    text = _text(board)
    return "\n".join(
        [
            '<table class="leaderboard">',
            f"<caption>{html.escape(text.title)}</caption>",
            f"<thead><tr>{_heads(text)}</tr></thead>",
            "<tbody>",
            *(_html_row(text, place, links or {}) for place in range(len(text.entries))),
            "</tbody></table>",
        ]
    )


def csv(boards: list[Leaderboard]) -> str:
    """All rows of all boards, every metric with statistic, 95 % interval, mean and interquartile mean, provenance.

    Args:
        boards: The leaderboards.

    Returns:
        Text of the file.
    """
    return csv_text(board_table(boards))


def board_table(boards: list[Leaderboard]) -> pd.DataFrame:
    """The table that `csv` writes.

    Args:
        boards: The leaderboards.

    Returns:
        A row for each row of a board; see `record`.
    """
    return pd.DataFrame([record(board, row) for board in boards for row in board.rows])


def record(board: Leaderboard, row: Row) -> dict[str, Any]:
    """A row in full, flat, with what is needed to repeat it.

    Args:
        board: The leaderboard.
        row: One of its rows.

    Returns:
        Values by column.
    """
    numbers: dict[str, Any] = {}
    for name, estimate in row.estimates.items():
        numbers |= estimate.columns(name)
        numbers |= {f"{name}_mean": row.means[name], f"{name}_iqm": row.iqms[name]}
    apart = ("estimates", "means", "iqms", "cloths", "code_version")
    identity = {key: value for key, value in asdict(row).items() if key not in apart}
    return {
        **identity,
        "rank": "" if row.rank is None else row.rank,
        "cloths": " ".join(row.cloths),
        "statistic": board.statistic,
        **numbers,
        **provenance_columns(board, row),
    }


def _text(board: Leaderboard | TextTable) -> TextTable:
    return board if isinstance(board, TextTable) else text_table(board)


def _line(entries: list[str]) -> str:
    return f"| {' | '.join(entries)} |"


def _escaped(text: str) -> str:
    plain = _EMPHASIS.sub(r"\\\g<0>", html.escape(text, quote=False))
    return plain.replace("|", r"\|").replace("\n", " ")


def _latex_row(entries: Sequence[str]) -> str:
    row = " & ".join(entry.translate(_LATEX) for entry in entries) + r" \\"
    return "{}" + row if row.startswith(("[", "*")) else row  # or it would be an option of the row above


def _heads(text: TextTable) -> str:
    return "".join(
        f'<th scope="col"{_side(column.left)} title="{html.escape(column.meaning)}">{html.escape(column.head)}'
        f"<small>{html.escape(column.unit)}</small></th>"
        for column in text.columns
    )


def _html_row(text: TextTable, place: int, links: Mapping[tuple[str, str], str]) -> str:
    pairs = list(zip(text.columns, text.entries[place], strict=True))
    cloth = next((entry for column, entry in pairs if column.head == "cloth"), "")
    cells = []
    for column, entry in pairs:
        link = (links.get((cloth, entry)) or links.get(("", entry))) if column.head == "solver" else None
        words = html.escape(entry)
        words = f'<a href="{html.escape(link)}">{words}</a>' if link else words
        cells.append(f"<td{_side(column.left)}>{words}</td>")
    return f'<tr class="{html.escape(text.kinds[place])}">{"".join(cells)}</tr>'


def _side(left: bool) -> str:
    return ' class="left"' if left else ""
