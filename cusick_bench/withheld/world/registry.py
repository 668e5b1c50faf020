"""Worlds by name: a new one is a file in `worlds` and a name here. None is imported before it is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cusick_bench.lazy import LazyTable
from cusick_bench.withheld.errors import WithheldError

if TYPE_CHECKING:
    from cusick_bench.withheld.world.world import World

_HERE = "cusick_bench.withheld.world.worlds"

DEFAULT = "paper"
"""The world of suites where none is asked for."""

WORLDS: LazyTable[World] = LazyTable({name: f"{_HERE}.{name}:WORLD" for name in ("paper", "published", "polar")})
"""All worlds."""


def world_of(name: str) -> World:
    """Finds a world.

    Args:
        name: Its name.

    Returns:
        The world.

    Raises:
        WithheldError: No such world.
    """
    if name not in WORLDS:
        raise WithheldError(f"world must be one of {', '.join(WORLDS)}, got {name!r}; see docs/diagnose.md")
    return WORLDS[name]
