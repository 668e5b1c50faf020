"""Tables whose lines are coloured by whether they reached their goal."""

from rich import box
from rich.table import Table
from rich.text import Text

_STYLES = {"no": "red", "yes": "green", "": ""}


def marked_table(lines: list[list[str]], mark: str | None = None) -> Table:
    """A table of strings.

    Args:
        lines: Heading and lines.
        mark: Heading of the column that holds yes, no or nothing, and colours its line; None for no colours.

    Returns:
        The table.
    """
    heading, *rows = lines
    place = None if mark is None else heading.index(mark)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for head in heading:
        table.add_column(Text(head), overflow="fold")
    for line in rows:
        table.add_row(*map(Text, line), style="" if place is None else _STYLES[line[place]])
    return table
