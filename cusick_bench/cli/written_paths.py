"""Where commands may write: anywhere but into the installed package, which other users may share.

A folder is made before long work, which so ends at once where it cannot be written, and leaves nothing behind that is
empty.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer

import cusick_bench

PACKAGE = Path(cusick_bench.__file__).resolve().parent


@contextmanager
def folder_made(folder: Path) -> Iterator[None]:
    """Makes a folder; where the work then fails or is interrupted before anything is written, it is removed again.

    Args:
        folder: The folder; one that exists stays in any case.

    Returns:
        A context manager.
    """
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for one in new:
            with suppress(OSError):  # something is in it
                one.rmdir()
        raise


def outside_package(value: Any) -> Any:
    """Checks what an option that says where to write was given; the callback of such options.

    Args:
        value: A path, several, or anything else, which is let pass.

    Returns:
        The same.

    Raises:
        typer.BadParameter: A path lies in the installed package.
    """
    for path in value if isinstance(value, Iterable) and not isinstance(value, str) else [value]:
        if isinstance(path, Path) and path.expanduser().resolve().is_relative_to(PACKAGE):
            raise typer.BadParameter(
                f"{path} lies in the installed package, which no command writes to; give a path outside of {PACKAGE}"
            )
    return value
