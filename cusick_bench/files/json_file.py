"""JSON that others wrote: no key twice, no number that is none, nothing nested without end."""

import json
import math
from pathlib import Path
from typing import Any

from cusick_bench.files.errors import BadFile
from cusick_bench.files.regular_file import read_text

MOST_JSON_BYTES = 16 << 20
"""Size that a JSON file may have at most, unless its reader says otherwise."""
_MOST_DIGITS = 40  # of a whole number: seeds have up to 128 bits
_DEEPEST = 64  # objects and lists within each other
_LONGEST_SHOWN = 60  # characters of a value in a message


def read_json_object(path: Path, *, remedy: str, most_bytes: int = MOST_JSON_BYTES) -> dict[str, Any]:
    """Reads a JSON file that must hold one object.

    Args:
        path: The file.
        remedy: What the user can do where it cannot be read.
        most_bytes: Size that it may have at most [bytes].

    Returns:
        The object.

    Raises:
        BadFile: See `read_json`; or it holds something else than an object.
    """
    document = read_json(path, remedy=remedy, most_bytes=most_bytes)
    if not isinstance(document, dict):
        raise BadFile(path, f"must hold one JSON object, {{...}}, got {shown(document)}", remedy)
    return document


def read_json(path: Path, *, remedy: str, most_bytes: int = MOST_JSON_BYTES) -> Any:
    """Reads a JSON file.

    Args:
        path: The file.
        remedy: What the user can do where it cannot be read.
        most_bytes: Size that it may have at most [bytes].

    Returns:
        What it holds.

    Raises:
        BadFile: See `read_text`; or it is no JSON, see `parse_json`.
    """
    return parse_json(read_text(path, most_bytes=most_bytes, remedy=remedy), path, remedy=remedy)


def parse_json(text: str, where: object, *, remedy: str) -> Any:
    """Reads JSON text.

    Args:
        text: The text.
        where: The file and the line that it is from, for messages.
        remedy: What the user can do where it cannot be read.

    Returns:
        What it holds.

    Raises:
        BadFile: It is no JSON, holds a key twice, a number that is infinite, NaN or of too many digits, or is nested
            too deep.
    """
    try:
        document = json.loads(
            text, object_pairs_hook=_unique_keys, parse_constant=_constant, parse_float=_finite, parse_int=_whole
        )
        if _too_deep(document):
            raise RecursionError
    except RecursionError as error:
        raise BadFile(where, f"is nested deeper than {_DEEPEST} levels", remedy) from error
    except ValueError as error:
        raise BadFile(where, f"cannot be read as JSON ({error})", remedy) from error
    return document


def shown(value: Any) -> str:
    """A value for a message, cut where it is long.

    Args:
        value: A value that JSON can hold.

    Returns:
        It as JSON, on one line.
    """
    text = json.dumps(value, default=str)
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {shown(twice)} stands twice")
    return content


def _constant(word: str) -> float:
    raise ValueError(f"{word} is no JSON number; write null where a value is unknown")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]} is too large")
    return value


def _whole(text: str) -> int:
    if len(text.lstrip("-")) > _MOST_DIGITS:
        raise ValueError(f"the number {text[:20]}... is too large: it has {len(text.lstrip('-'))} digits")
    return int(text)


def _too_deep(document: Any) -> bool:
    """Whether lists and objects stand too deep in each other, found level by level."""
    level = [document]
    for _ in range(_DEEPEST + 1):
        level = [
            item
            for holder in level
            for item in (holder.values() if isinstance(holder, dict) else holder if isinstance(holder, list) else ())
            if isinstance(item, dict | list)
        ]
        if not level:
            return False
    return True
