"""Texts for cells and versions; separate, so that reading results does not import the simulator."""

import re
from collections.abc import Mapping, Sequence

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


def numerics_text(versions: Mapping[str, int]) -> str:
    """Versions in a line.

    Args:
        versions: Version of each part, by name.

    Returns:
        Text such as `engine 1, law paper 1, metrics 1`.
    """
    return ", ".join(f"{part} {version}" for part, version in versions.items())
