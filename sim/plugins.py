"""Classes that other packages register under an entry point; one that cannot be used is named and left out."""

import sys
import warnings
from collections.abc import Callable, Collection
from functools import lru_cache
from importlib.metadata import entry_points
from inspect import isabstract
from typing import Any, TypeVar

from cusick_bench.sim.errors import raise_stop

T = TypeVar("T")
_left_out: dict[tuple[str, str], str] = {}  # why, by group and name


def registered_classes(group: str, base: type[T], taken: Collection[str]) -> dict[str, type[T]]:
    """Loads what other packages register.

    Whatever goes wrong in such a package is no reason to stop a command that may not even use it: it is told as a
    warning.

    Args:
        group: Group of the entry points.
        base: Class of which each must be a subclass.
        taken: Names that are built in, which nobody else may have.

    Returns:
        Classes by name.
    """
    found: dict[str, type[T]] = {}
    for entry in _entries(entry_points, group, tuple(sys.path)):
        if entry.name in taken or entry.name in found:
            leave_out(group, entry.name, entry.value, "has a name that is taken; give it another one")
            continue
        try:
            loaded = entry.load()
        except (Exception, SystemExit) as error:  # a module may raise anything while it is imported
            raise_stop(error)
            leave_out(group, entry.name, entry.value, f"cannot be imported ({type(error).__name__}: {error}); mend it")
            continue
        if why := _fault(loaded, base, entry.name):
            leave_out(group, entry.name, entry.value, why)
        else:
            found[entry.name] = loaded
    return found


def _fault(loaded: Any, base: type, name: str) -> str:
    """Why what an entry point leads to cannot be used; empty where it can."""
    if not (isinstance(loaded, type) and issubclass(loaded, base)):
        return f"must be a subclass of {base.__name__}, got {loaded!r:.60}"
    if isabstract(loaded):
        return f"lacks {', '.join(sorted(loaded.__abstractmethods__))}; write it"
    if (own := getattr(loaded, "name", None)) != name:  # records have the class's name, and are read by it
        return f"must have the name that it is registered under, got name = {own!r}; make them equal"
    if "," in name:  # parts options and parameters, so that nobody could ask for it
        return "must have a name without commas; give it another one"
    version: Any = getattr(loaded, "version", 1)
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:  # tables refuse records with another
        return f"must have a version that is a whole number >= 1, got version = {version!r:.60}; correct it"
    return ""


@lru_cache(maxsize=8)  # going through all that is installed takes 10 ms, and a grid asks several times a cell
def _entries(find: Callable[..., Any], group: str, path: tuple[str, ...]) -> tuple[Any, ...]:
    """Entry points of a group; `path`, where packages are looked for, tells one answer from another."""
    return tuple(find(group=group))


def leave_out(group: str, name: str, value: object, why: str) -> None:
    """Warns of a registered class that cannot be used.

    Args:
        group: Group of the entry points.
        name: Name under which it is registered.
        value: What is registered.
        why: What is wrong with it, and what mends it.
    """
    _left_out[group, name] = f"{name!r} ({value}) of {group} {why}"
    warnings.warn(f"{_left_out[group, name]}; it is left out", RuntimeWarning, stacklevel=3)


def why_left_out(group: str, name: str) -> str:
    """Why a name that another package registers cannot be used, for who asks for it where warnings are not shown.

    Args:
        group: Group of the entry points.
        name: Name that was asked for.

    Returns:
        What is wrong, and what mends it; empty where nothing of this name was left out.
    """
    return _left_out.get((group, name), "")
