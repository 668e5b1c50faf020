"""A JSON object beside the data; a fault is told as the data layer tells it."""

from pathlib import Path
from typing import Any

from cusick_bench.datasets.errors import BadTable
from cusick_bench.files import BadFile, read_json_object

_MOST_BYTES = 1 << 20


def read_object(path: Path, kind: str, *, most_bytes: int = _MOST_BYTES) -> dict[str, Any]:
    """Reads a JSON file that must hold one object.

    Args:
        path: The file.
        kind: Kind of the error, as an audit lists it.
        most_bytes: Size that it may have at most [bytes].

    Returns:
        The object.

    Raises:
        BadTable: Not a file, too large, not JSON, a key given twice, or no object.
    """
    try:
        return read_json_object(path, remedy="correct it", most_bytes=most_bytes)
    except BadFile as error:
        raise BadTable(error.what, where=path, remedy=error.remedy, kind=kind) from error
