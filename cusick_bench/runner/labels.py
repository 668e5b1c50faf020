"""Texts for cells and versions; separate, so that reading results does not import the simulator."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
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


PARTS_OF_SAMPLES = ("both faces", "repeats", "series")
"""Parts of the numerics that cells have only where their samples need them: cells of one code may differ in them."""


def comparable_versions(texts: Iterable[str]) -> dict[str, str]:
    """Versions of several cells such that those of one code are the same.

    Cells that differ in `PARTS_OF_SAMPLES` alone are of one code, as long as none of these parts has two versions.

    Args:
        texts: Versions of each cell, from `numerics_text`.

    Returns:
        By each text, the same with those of these parts that other cells of its code have.
    """
    alike: dict[frozenset[str], dict[str, set[str]]] = defaultdict(dict)
    for text in texts:
        parts = set(text.split(", "))
        of_samples = {part for part in parts if _part_name(part) in PARTS_OF_SAMPLES}
        alike[frozenset(parts - of_samples)][text] = of_samples
    found: dict[str, str] = {}
    for cells in alike.values():
        known = set[str]().union(*cells.values())
        once = len(set(map(_part_name, known))) == len(known)
        for text, own in cells.items():
            missing = known - own if once else ()
            found[text] = ", ".join(sorted([*text.split(", "), *missing], key=_part_name)) if missing else text
    return found


def _part_name(part: str) -> str:
    return part.rpartition(" ")[0]
