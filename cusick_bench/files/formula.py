"""Cells of text that begin as a formula of a spreadsheet does.

A spreadsheet runs what begins with `=`, `+`, `-`, `@`, a tab or a carriage return. Such a text gets an apostrophe in
front where we write it, and loses it where we read it. Numbers stay as they are, negative ones too.

References:
    OWASP. CSV Injection. https://owasp.org/www-community/attacks/CSV_Injection
"""

import re
from typing import Any

_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_GUARDED = re.compile(r"'+[=+\-@\t\r]")


def guarded_cell(value: Any) -> Any:
    """A cell that no spreadsheet takes for a formula.

    Args:
        value: Content of a cell.

    Returns:
        It, with an apostrophe in front where it is a text that begins as a formula does.
    """
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) and not _is_number(value) else value


def unguarded_cell(text: str) -> str:
    """The content of a cell that `guarded_cell` made.

    Args:
        text: Text of the cell.

    Returns:
        The text without its guard.
    """
    return text[1:] if _GUARDED.match(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
