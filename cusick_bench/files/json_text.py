"""JSON that we write: arrays as lists, and numbers that are not finite, which JSON has not, as null."""

import json
import math
from pathlib import Path
from typing import Any


def json_text(document: Any, *, indent: int = 1) -> str:
    """A document as JSON.

    Args:
        document: Numbers and arrays of numpy, paths, and what JSON holds itself.
        indent: Spaces of a level.

    Returns:
        Content of the file, with a line's end.
    """
    return json.dumps(_plain(document), indent=indent, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # an array or a scalar of numpy
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
