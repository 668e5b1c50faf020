"""Reading of answers and labels: JSON objects whose every value is checked, with the place of what is wrong."""

import json
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from math import isfinite, nan
from pathlib import Path
from typing import Any

from cusick_bench.withheld.errors import WithheldError

_MAXIMUM_BYTES = 1 << 28


def read_object(path: Path) -> dict[str, Any]:
    """Reads a JSON file that holds one object.

    Raises:
        WithheldError: There is no such file, it is too large, not JSON, no object, or holds a key twice.
    """
    if not path.is_file():
        raise WithheldError(f"no file at {path}; give answers.json and labels.json as they were written")
    if path.stat().st_size > _MAXIMUM_BYTES:
        raise WithheldError(
            f"{path} must be below {_MAXIMUM_BYTES >> 20} MiB, got {path.stat().st_size >> 20}; split it"
        )
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise WithheldError(f"{path} must be JSON, got a file that cannot be read ({error}); write it anew") from error
    return mapping(document, str(path))


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the key {next(name for name in names if names.count(name) > 1)!r} stands twice")
    return found


def entries(document: Mapping[str, Any], keys: Collection[str]) -> dict[str, Any]:
    """The cases of a document: under one of the keys, beside facts about the file, or all of it."""
    for key in keys:
        inner = document.get(key)
        if isinstance(inner, dict) and all(isinstance(value, dict) for value in inner.values()):
            return inner
    return {name: value for name, value in document.items() if isinstance(value, dict)}


def mapping(found: Any, where: str) -> dict[str, Any]:
    """A JSON object.

    Raises:
        WithheldError: Something else.
    """
    if not isinstance(found, dict):
        raise WithheldError(f"{where} must be an object, got {_shown(found)}; see the format of answers and labels")
    return found


def listed(found: Any, length: int | None, where: str) -> list[Any]:
    """A list, of a length if one is given.

    Raises:
        WithheldError: No list, or one of another length.
    """
    if not isinstance(found, list) or (length is not None and len(found) != length):
        rule = "a list" if length is None else f"a list of {length}"
        raise WithheldError(f"{where} must be {rule}, got {_shown(found)}; correct it")
    return found


def strings(found: Any, where: str) -> list[str]:
    """A list of strings.

    Raises:
        WithheldError: Something else.
    """
    for item in listed(found, None, where):
        if not isinstance(item, str):
            raise WithheldError(f"{where} must be a list of names, got {_shown(found)}; correct it")
    return found


def number(found: Any, where: str) -> float:
    """A number; NaN for null.

    Raises:
        WithheldError: Something else, or an infinite number.
    """
    if found is None:
        return nan
    if isinstance(found, bool) or not isinstance(found, int | float) or not (isfinite(found) or found != found):
        raise WithheldError(f"{where} must be a finite number or null, got {_shown(found)}; correct it")
    return float(found)


def one_of(found: Any, choices: Collection[str], where: str) -> str:
    """A string out of some.

    Raises:
        WithheldError: Another value.
    """
    if not isinstance(found, str) or found not in choices:
        near = get_close_matches(str(found), list(choices), n=1)
        remedy = f"did you mean {near[0]!r}?" if near else f"use {', '.join(choices)}"
        raise WithheldError(f"{where} must be a known name, got {_shown(found)}; {remedy}")
    return found


def _shown(found: Any) -> str:
    text = json.dumps(found, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
