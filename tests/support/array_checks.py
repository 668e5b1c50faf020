"""Checks arrays against the shapes and types that annotations state, in calls that tests make.

To import it is enough, before the package. Once a module has been run, functions and methods whose annotations name
arrays (`Float[np.ndarray, "points 2"]`, jaxtyping), those that make dataclasses included, are replaced by functions
that check these arguments and results. Nothing else is touched, so that it is as fast as for users. Functions within
functions, modules that compile something with numba, and annotations that are strings are left alone, as are arrays
within lists and dictionaries, of which beartype would look at one at random.

Of every function its first calls in each test are checked: in loops of thousands of calls, checks would take longer
than what they check. Worker processes do not check, nor do tests marked `unchecked_arrays` (of what users are told of
wrong arrays), slow or nightly.
"""

import functools
import re
import sys
import types
import typing
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path

import jaxtyping
from beartype import beartype
from docstrings import FOLDERS

ROOT = Path(__file__).resolve().parents[2]
COMPILED = re.compile(r"^@kernel|\bnumba\b", re.MULTILINE)  # in modules with functions that numba compiles
PACKAGE = "cusick_bench"
CALLS = 20
"""Calls of every function that are checked in a test."""
calls_left: dict[Callable, int] = {}
"""Of the functions called in this test; `pytest_runtest_setup` empties it."""


class CheckingFinder:
    """Finds the modules whose arrays are checked, before Python's own finders.

    Attributes:
        modules: Their names.
    """

    def __init__(self, modules: frozenset[str]) -> None:
        self.modules = modules

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: types.ModuleType | None = None
    ) -> ModuleSpec | None:
        """Where a module lies, with a loader that has its arrays checked.

        Args:
            name: Of the module.
            path: Folders of the package in which it lies.
            target: Module that is loaded again.

        Returns:
            Nothing for other modules.
        """
        spec = PathFinder.find_spec(name, path, target) if name in self.modules else None
        if spec is None or spec.origin is None:
            return None
        spec.loader = CheckingLoader(name, spec.origin)
        return spec


class CheckingLoader(SourceFileLoader):
    """Runs a module, and has its arrays checked from then on."""

    def exec_module(self, module: types.ModuleType) -> None:
        """Runs a module.

        Args:
            module: The module, empty.
        """
        super().exec_module(module)
        for name, value in list(vars(module).items()):
            if getattr(value, "__module__", None) != module.__name__:
                continue
            if isinstance(value, type):
                check_class(value)
            elif isinstance(value, types.FunctionType):
                setattr(module, name, checked(value))


def check_class(checked_class: type) -> None:
    """Has the arrays of a class' methods checked and, of a dataclass, those of its fields.

    Args:
        checked_class: The class.
    """
    for name, value in list(vars(checked_class).items()):
        if isinstance(value, staticmethod | classmethod):
            setattr(checked_class, name, type(value)(checked(value.__func__)))
        elif isinstance(value, property) and value.fget is not None:
            setattr(checked_class, name, property(checked(value.fget), value.fset, value.fdel))
        elif isinstance(value, functools.cached_property):
            value.func = checked(value.func)
        elif isinstance(value, types.FunctionType):
            setattr(checked_class, name, checked(value))


def checked(function: Callable) -> Callable:
    """A function whose array arguments and results are checked.

    Args:
        function: Function, with annotations.

    Returns:
        The function itself where it takes and gives no arrays.
    """
    if not any(map(is_array, getattr(function, "__annotations__", {}).values())):
        return function
    checking = jaxtyping.jaxtyped(function, typechecker=_arrays_checked)

    @functools.wraps(function)
    def checked_at_first(*arguments: object, **options: object) -> object:
        left = calls_left.get(function, CALLS)
        if not left:
            return function(*arguments, **options)
        calls_left[function] = left - 1
        return checking(*arguments, **options)

    return checked_at_first


def _arrays_checked(function: Callable) -> Callable:
    """The check that jaxtyping makes within its shapes: of arrays alone."""
    function.__annotations__ = {name: kind for name, kind in function.__annotations__.items() if is_array(kind)}
    return beartype(function) if function.__annotations__ else function


def is_array(annotation: object) -> bool:
    """Whether an annotation is one of an array, of a union with arrays or of a tuple with arrays in given places.

    Args:
        annotation: The annotation.

    Returns:
        Whether jaxtyping has something to check in it.
    """
    if isinstance(annotation, type) and issubclass(annotation, jaxtyping.AbstractArray):
        return True
    inner = typing.get_args(annotation)
    whole = typing.get_origin(annotation) in (typing.Union, types.UnionType, tuple) and Ellipsis not in inner
    return whole and any(map(is_array, inner))


def checkable_modules() -> frozenset[str]:
    """Modules in which nothing is compiled.

    Returns:
        Their names.
    """
    found = set()
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.stem != "__init__" and not COMPILED.search(path.read_text(encoding="utf-8")):
                parts = path.relative_to(ROOT).with_suffix("").parts
                found.add(".".join(parts if folder == PACKAGE else (PACKAGE, *parts)))
    return frozenset(found)


sys.meta_path.insert(0, CheckingFinder(checkable_modules()))
