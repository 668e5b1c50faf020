"""Checks arrays against the shapes and types that annotations state, in every call that tests make.

To import it is enough, before the package. It looks at arguments and results, those of dataclasses included, whose
annotations name arrays (`Float[np.ndarray, "points 2"]`, jaxtyping), within functions of all modules that compile
nothing with numba and whose annotations are not strings. Other annotations are not checked, since tests hand over
simple stand-ins; nor are arrays within lists and dictionaries, of which beartype would look at one at random.

Worker processes do not check, nor do tests marked `unchecked_arrays` (of what users are told of wrong arrays), slow or
nightly.
"""

import re
import types
import typing
from collections.abc import Callable
from pathlib import Path

import jaxtyping
from beartype import beartype
from docstrings import FOLDERS

ROOT = Path(__file__).resolve().parents[2]
COMPILED = re.compile(r"^@kernel|\bnumba\b", re.MULTILINE)  # in modules with functions that numba compiles
PACKAGE = "cusick_bench"


def checked(function: Callable) -> Callable:
    """A function whose array arguments and results are checked.

    Args:
        function: Function, with annotations.

    Returns:
        The function itself where it takes and gives no arrays.
    """
    arrays = {name: kind for name, kind in function.__annotations__.items() if is_array(kind)}
    function.__annotations__ = arrays
    return beartype(function) if arrays else function


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


def checkable_modules() -> list[str]:
    """Modules in which nothing is compiled.

    Returns:
        Their names.
    """
    found = []
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.stem != "__init__" and not COMPILED.search(path.read_text(encoding="utf-8")):
                parts = path.relative_to(ROOT).with_suffix("").parts
                found.append(".".join(parts if folder == PACKAGE else (PACKAGE, *parts)))
    return found


jaxtyping.install_import_hook(checkable_modules(), "array_checks.checked")
