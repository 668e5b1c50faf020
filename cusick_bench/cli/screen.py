"""How text and tables are printed: as written, harmless on any terminal, and without cutting numbers.

Text may come from a file name or from somebody else's data, so no console here reads markup in it, and terminal control
characters are written as escapes. If standard output is not a terminal, a table has its natural width. In a narrower
terminal (or COLUMNS) its words are folded first, then its headings, and then each row is stacked.
"""

import errno
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from typing import IO, Any

from rich.cells import cell_len
from rich.console import Console, ConsoleDimensions, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

NATURAL_WIDTH = 100_000  # [characters] of a line that is never broken
WORDS_WIDTH = 12  # [characters] below which a column of words is not folded
HEADING_WIDTH = 8  # [characters] that a stacked heading gets however long the numbers are

_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff\ud800-\udfff]")
_EXPONENT = re.compile(r"(?<=\d)e[-+]?\d+")
_LETTER = re.compile(r"[^\W\d_]")
_UNIT_LETTERS = 3  # that a number may have beside it: 12.5 mm, nan
_ASCII = str.maketrans(
    {"±": "+/-", "…": "...", "×": "x", "✗": "x", "→": "->", "−": "-", "–": "-", "—": "-", "°": " deg", "µ": "u"}
    | {"²": "2", "³": "3", "≤": "<=", "≥": ">=", "‘": "'", "’": "'", "“": '"', "”": '"', "·": "*", "│": "|", "─": "-"}
)


def harmless(text: str) -> str:
    """Text without characters that control a terminal.

    Args:
        text: Any text, such as a cloth's name or an error message.

    Returns:
        The text with control characters, marks of writing direction, invisible characters and bytes that are no text
        written out as in Python (`\\x1b`); line breaks and tabs stay.
    """
    return _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def in_encoding(text: str, encoding: str) -> str:
    """Text that an encoding has characters for.

    Args:
        text: Any text.
        encoding: Name of the encoding, such as `ascii`.

    Returns:
        The text; what the encoding lacks is written in ASCII (`+/-` for `±`), or else as its code.
    """
    if encoding.startswith("utf"):
        return text
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return text.translate(_ASCII).encode(encoding, "backslashreplace").decode(encoding)
    return text


class Screen(Console):
    """A console that prints text as it is, without markup, and fits tables into the available width."""

    def __init__(self, *, stderr: bool = False, **options: Any) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False, **options)
        self._width = options.get("width")  # COLUMNS is read where a table is printed, not when this is made
        self._terminal: bool | None = options.get("force_terminal")

    @contextmanager
    def writing_to(self, file: IO[str]) -> Iterator[None]:
        """Writes to one file for a while, whatever becomes of `sys.stdout` and `sys.stderr` meanwhile.

        Args:
            file: Where to write.

        Returns:
            A context manager.
        """
        before, self._file = self._file, file
        try:
            yield
        finally:
            self._file = before

    @property
    def on_terminal(self) -> bool:
        """Whether it writes to a terminal; `is_terminal` is true of a log that FORCE_COLOR has coloured, too."""
        if self._terminal is not None:  # asked for where this was made
            return self._terminal
        try:
            return self.file.isatty()
        except ValueError:  # it is closed
            return False

    @property
    def size(self) -> ConsoleDimensions:
        """Size of the terminal; without one, lines are as long as it takes, unless COLUMNS says otherwise."""
        found = super().size
        narrowed = self.on_terminal or self._width is not None or os.environ.get("COLUMNS", "").isdigit()
        if narrowed and found.width > 0:  # COLUMNS=0 says nothing
            return found
        return ConsoleDimensions(NATURAL_WIDTH, found.height)

    @size.setter
    def size(self, new_size: tuple[int, int]) -> None:
        self._width, self._height = new_size

    def print(self, *objects: Any, **options: Any) -> None:
        """Prints text and tables.

        Args:
            objects: What to print; tables are made to fit.
            options: As of `rich.console.Console.print`.
        """
        super().print(*(self.fitted(one) if isinstance(one, Table) else one for one in objects), **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text as this console shows it.

        Args:
            text: What to show.
            options: As of `rich.console.Console.render_str`.

        Returns:
            The text, harmless and in the encoding of the file.
        """
        return super().render_str(in_encoding(harmless(text), self.encoding), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Pieces of text of whatever is printed; what did not come as plain text is made harmless here.

        Args:
            renderable: What to print.
            options: Width, encoding and other options of the console.

        Yields:
            Pieces of text with their styles.
        """
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                text = in_encoding(harmless(segment.text), self.encoding)
                yield segment if text == segment.text else Segment(text, segment.style)

    def on_broken_pipe(self) -> None:
        """The reader of the output has left; the command ends as it does where it prints without this console.

        The console of rich would exit by itself, and silence `sys.stdout`, which is standard error in a command.

        Raises:
            BrokenPipeError: Always.
        """
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    def fitted(self, table: Table) -> Table:
        """The table as it fits into a line; no number is ever cut.

        Args:
            table: A table of text.

        Returns:
            The same table where it fits, one with words and headings folded where that is enough, or else one that
            says row by row what each heading is.
        """
        unlimited = self.options.update(max_width=NATURAL_WIDTH)
        width = Measurement.get(self, unlimited, table).maximum
        if width <= self.width:
            return table
        columns = [_Contents.of(self, column) for column in table.columns]
        frame = width - sum(column.widest for column in columns)
        widths = _shared(columns, self.width - frame)
        return self._stacked(table) if widths is None else _folded(table, widths)

    def _stacked(self, table: Table) -> Table:
        """A line for each entry: its heading and what it says; an empty line between rows."""
        heads = [_plain(self, column.header).replace("\n", " ") for column in table.columns]
        numbers = max(_Contents.of(self, column).least for column in table.columns)
        width = min(max(map(cell_len, heads)), max(HEADING_WIDTH, self.width - numbers - 2))
        stack = Table.grid(
            Column(width=width, overflow="fold", style="dim"), Column(overflow="fold"), padding=(0, 2, 0, 0)
        )
        stack.title, stack.caption, stack.title_justify = table.title, table.caption, "left"
        for number, row in enumerate(zip(*(column.cells for column in table.columns), strict=True)):
            style = table.get_row_style(self, number)
            if number:
                stack.add_row()
            for head, entry in zip(heads, row, strict=True):
                if _plain(self, entry):
                    stack.add_row(head, entry, style=style)
        return stack


@dataclass(frozen=True)
class _Contents:
    """Widths that a column's heading and entries ask for [characters].

    Attributes:
        least: With fewer a number would be cut.
        good: With fewer a word of the heading is broken.
        widest: With these nothing is folded.
    """

    least: int
    good: int
    widest: int

    @classmethod
    def of(cls, screen: Screen, column: Column) -> "_Contents":
        """Widths of a column."""
        entries = [line for cell in column.cells for line in _plain(screen, cell).splitlines()]
        head = _plain(screen, column.header)
        words = [entry for entry in entries if not _is_number(entry)]
        least = max(_widest(filter(_is_number, entries)), min(_widest(words), WORDS_WIDTH), 1)
        return cls(least, max(least, _widest(head.split())), _widest([*head.splitlines(), *entries, " "]))


def _widest(texts: Iterable[str]) -> int:
    return max(map(cell_len, texts), default=0)


def _is_number(entry: str) -> bool:
    """Whether an entry is a number, with or without interval and unit, rather than words."""
    letters = _LETTER.findall(_EXPONENT.sub("", entry))
    return any(character.isdigit() for character in entry) and len(letters) <= _UNIT_LETTERS


def _plain(screen: Screen, cell: RenderableType) -> str:
    return cell.plain if isinstance(cell, Text) else screen.render_str(str(cell)).plain


def _shared(columns: list[_Contents], space: int) -> list[int] | None:
    """Widths that take up the space, at the cost of words first and of headings then; None where it is too little."""
    widths = [column.widest for column in columns]
    for floors in ([column.good for column in columns], [column.least for column in columns]):
        while sum(widths) > space:
            slack = [width - floor for width, floor in zip(widths, floors, strict=True)]
            if max(slack) <= 0:
                break
            widths[slack.index(max(slack))] -= 1
    return widths if sum(widths) <= space else None


def _folded(table: Table, widths: list[int]) -> Table:
    """The table with columns of these widths."""
    folded = copy(table)
    folded.columns = [
        replace(column, width=width, min_width=None, max_width=None, no_wrap=False, overflow="fold")
        for column, width in zip(table.columns, widths, strict=True)
    ]
    return folded
