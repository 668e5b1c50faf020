"""CSV tables that others wrote: every line has the columns of the first, and no column stands twice."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from cusick_bench.files.errors import BadFile
from cusick_bench.files.formula import unguarded_cell
from cusick_bench.files.regular_file import read_text

_MOST_BYTES = 64 << 20
_OTHER_MARKS = {";": "semicolons", "\t": "tabs"}  # that spreadsheets write between cells


@dataclass(frozen=True)
class CsvTable:
    """A table as it is in its file, cells as text.

    Attributes:
        header: Names of the columns.
        rows: Number of the line, and its cells by column; cells that a short line lacks are empty.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[int, dict[str, str]], ...]


def read_csv(
    path: Path,
    *,
    remedy: str,
    required: tuple[str, ...] = (),
    comment: str | None = None,
    most_bytes: int = _MOST_BYTES,
) -> CsvTable:
    """Reads a table; blank lines are left out, blanks around cells and guards of `csv_text` too.

    Args:
        path: The file.
        remedy: What the user can do where it cannot be read.
        required: Columns that it must have.
        comment: Mark of lines, at their beginning, that are left out.
        most_bytes: Size that it may have at most [bytes].

    Returns:
        The table.

    Raises:
        BadFile: See `read_text`; or it is no CSV, has other marks than commas between cells, lacks a column or has one
            twice, or a line has too many cells.
    """
    text = read_text(path, most_bytes=most_bytes, remedy=remedy)
    lines = _Lines(text, comment)
    reader, rows = csv.reader(lines, strict=True), []
    try:
        while (cells := _row(lines, reader)) is not None:
            if any(cell.strip() for cell in cells):
                rows.append((reader.line_num, [unguarded_cell(cell.lstrip()).rstrip() for cell in cells]))
    except csv.Error as error:
        raise BadFile(f"{path}, line {reader.line_num}", f"cannot be read as CSV ({error})", remedy) from error
    header = tuple(rows[0][1]) if rows else ()
    if len(header) == 1 and (other := next((mark for mark in _OTHER_MARKS if mark in header[0]), "")):
        raise BadFile(path, f"must have commas between cells, got {_OTHER_MARKS[other]}", "write it with commas")
    if not set(required) <= set(header):
        what = f"needs the columns {' and '.join(required)}, got {_shown(header)}"
        raise BadFile(path, what, "name them in the first line")
    if twice := sorted({name for name in header if name and header.count(name) > 1}):
        raise BadFile(path, f"has the column {twice[0][:60]!r} twice", "keep one of them")
    for number, cells in rows[1:]:
        if len(cells) > len(header):
            what = f"has {len(cells)} fields for {len(header)} columns"
            raise BadFile(f"{path}, line {number}", what, "correct it")
    padded = ((number, cells + [""] * (len(header) - len(cells))) for number, cells in rows[1:])
    return CsvTable(header, tuple((number, dict(zip(header, cells, strict=True))) for number, cells in padded))


class _Lines:
    """Lines of a table, blank in place of comments; those within a cell of several lines are no comments."""

    def __init__(self, text: str, comment: str | None) -> None:
        self._lines = StringIO(text, newline="")  # `splitlines` would end lines at characters that cells may hold
        self._comment, self._within = comment, False

    def begin_row(self) -> None:
        """The next line begins a row."""
        self._within = False

    def __iter__(self) -> "_Lines":
        return self

    def __next__(self) -> str:
        line, within = next(self._lines), self._within
        self._within = True
        return "\n" if self._comment is not None and not within and line.startswith(self._comment) else line


def _row(lines: _Lines, reader: Iterator[list[str]]) -> list[str] | None:
    """Cells of the next row; None after the last."""
    lines.begin_row()
    return next(reader, None)


def _shown(header: tuple[str, ...]) -> str:
    text = ", ".join(header) or "none"
    return text if len(text) <= 80 else text[:77] + "..."
