"""Names of a package that are imported when they are first used, so that nobody waits for what is not used.

A package's `__init__` writes `__getattr__ = lazy_names(__name__, {"Budget": "budget", ...})`, and imports the same
names under `TYPE_CHECKING` for type checkers. No name may be that of a module of the package: once that module is
imported, it would hide the name.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any, TypeVar

T = TypeVar("T")


def lazy_names(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose names are imported when they are first used.

    Args:
        package: Name of the package.
        modules: Module, below the package, of every name.

    Returns:
        A function from a name to its value, which raises AttributeError for all others.
    """

    def found(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{modules[name]}"), name)
        setattr(sys.modules[package], name, value)  # found without this function from now on
        return value

    return found


class LazyTable(Mapping[str, T]):
    """A table whose names are there at once, and whose values are imported when they are asked for."""

    def __init__(self, places: Mapping[str, str]) -> None:
        """Keeps the places.

        Args:
            places: Place of every value, as `module:name`.
        """
        self._places = dict(places)

    def __getitem__(self, name: str) -> T:
        module, _, value = self._places[name].partition(":")
        return getattr(import_module(module), value)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)
