"""Texts for cells and versions; separate, so that reading results does not import the simulator."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

_OPTION = re.compile(r"\s*,\s*(\w+)\s*=\s*")


def unspaced(solver: str) -> str:
    """A solver's name and options without spaces between them, which mean nothing.

    Args:
        solver: Registered name, with options, such as `bdp-field, draws = 5`.

    Returns:
        Text such as `bdp-field,draws=5`.
    """
    return _OPTION.sub(r",\1=", solver).strip()


def labelled(solver: str, causes: Sequence[str]) -> str:
    """A solver's name with the causes that its simulator knows of.

    Args:
        solver: Registered name, with options.
        causes: Causes, as `plate-tilt:angle=2`.

    Returns:
        Text such as `homo + plate-tilt:angle=2`.
    """
    return " + ".join([solver, *causes])


def recorded_settings(record: Mapping[str, Any]) -> dict[str, Any]:
    """Settings in the record or the result of a cell.

    Args:
        record: Contents of `cell.json` or `result.json`.

    Returns:
        The settings, with an object `drape` and a list `causes`, either of them empty where none is recorded.

    Raises:
        ValueError: They are of other types.
    """
    settings = record.get("settings") or {}
    if not isinstance(settings, dict):
        raise ValueError(f"settings must be an object, got {settings!r:.60}")
    drape, causes = settings.get("drape", {}), settings.get("causes") or []
    if not isinstance(drape, dict):
        raise ValueError(f"settings.drape must be an object, got {drape!r:.60}")
    if not isinstance(causes, list) or not all(isinstance(cause, str) for cause in causes):
        raise ValueError(f"settings.causes must be a list of texts, got {causes!r:.60}")
    return {**settings, "drape": drape, "causes": causes}


def numerics_text(versions: Mapping[str, int]) -> str:
    """Versions in a line.

    Args:
        versions: Version of each part, by name.

    Returns:
        Text such as `engine 1, law paper 1, metrics 1`.
    """
    return ", ".join(f"{part} {version}" for part, version in versions.items())
