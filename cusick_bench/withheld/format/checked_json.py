"""Reading of JSON files into models, with the file, the case and the key of what is wrong.

Every document of a suite is a frozen pydantic model; this module reads the JSON text, and turns what pydantic finds
wrong into a sentence: what the rule is, what was found, and where.
"""

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from cusick_bench.files import BadFile, read_json_object
from cusick_bench.files.json_file import shown
from cusick_bench.withheld.errors import WithheldError

T = TypeVar("T")

_MAXIMUM_BYTES = 1 << 28
_RULES = {
    "missing": "must be there",
    "bool_type": "must be true or false",
    "string_type": "must be a string",
    "int_type": "must be a whole number",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be an object",
    "model_type": "must be an object",
    "model_attributes_type": "must be an object",
    "dataclass_type": "must be an object",
}
"""Rules in plain words, by pydantic's name of the error."""


def read_object(path: Path, lacking: str = "check its path") -> dict[str, Any]:
    """Reads a JSON file that holds one object.

    Args:
        path: The file.
        lacking: What to do where there is no such file.

    Returns:
        The object.

    Raises:
        WithheldError: There is no such file, it is too large, not JSON, no object, or holds a key twice.
    """
    if not path.exists():
        raise WithheldError(f"no file at {path}; {lacking}")
    try:
        return read_json_object(path, remedy="write it anew", most_bytes=_MAXIMUM_BYTES)
    except BadFile as error:
        raise WithheldError(str(error)) from error


def entries(document: Mapping[str, Any], keys: Collection[str]) -> dict[str, Any]:
    """Finds the cases of a document: under one of the keys, beside facts about the file, or all of it.

    Args:
        document: Content of the file.
        keys: Keys under which the cases may stand.

    Returns:
        The entry of each case.
    """
    for key in keys:
        inner = document.get(key)
        if isinstance(inner, dict) and all(isinstance(value, dict) for value in inner.values()):
            return inner
    return {name: value for name, value in document.items() if isinstance(value, dict)}


def validated(kind: TypeAdapter[T], content: Any, where: str) -> T:
    """Checks a part of a document.

    Args:
        kind: What it must be.
        content: Its value, as `json` reads it.
        where: File and case, for messages.

    Returns:
        The model.

    Raises:
        WithheldError: What breaks the format first.
    """
    try:
        return kind.validate_python(content)
    except ValidationError as error:
        raise WithheldError(f"{where}: {_sentence(error)}") from error


def _sentence(error: ValidationError) -> str:
    """The first thing that is wrong: key, rule, value, remedy."""
    first = error.errors(include_url=False)[0]
    key = _key(first["loc"])
    if first["type"] == "broken_rule":  # says itself what was found
        return f"{key}: {first['msg']}" if key else first["msg"]
    context = first.get("ctx", {})
    length = context.get("min_length", context.get("max_length"))
    rule = f"must be a list of {length}" if first["type"] in ("too_short", "too_long") else None
    rule = rule or _RULES.get(first["type"], first["msg"])
    if first["type"] == "missing":
        return f"{key} {rule}; write the file anew"
    return f"{key or 'it'} {rule}, got {shown(first['input'])}; {context.get('remedy', 'correct it')}"


def _key(places: Iterable[str | int]) -> str:
    """A place in a document as `causes[0].effect`; marks of alternatives, as `<one>`, are left out."""
    key = ""
    for place in places:
        if isinstance(place, int):
            key += f"[{place}]"
        elif not place.startswith("<"):
            key += f".{place}" if key else place
    return key
