"""Where commands may write: anywhere but into the installed package, which other users may share.

A folder is made before long work, which so ends at once where it cannot be written, and leaves nothing behind that is
empty.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import typer

import cusick_bench
from cusick_bench.sim.errors import CusickError

PACKAGE = Path(cusick_bench.__file__).resolve().parent


@contextmanager
def folder_made(folder: Path | None) -> Iterator[None]:
    """Makes a folder, and tries whether it can be written to, before any work.

    Where the work then fails or is interrupted before anything is written, a new folder is removed again.

    Args:
        folder: The folder; one that exists stays in any case. None: nothing is to be written.

    Returns:
        A context manager.
    """
    if folder is None:
        yield
        return
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with TemporaryFile(dir=folder):
            pass
        yield
    except BaseException:
        for one in new:
            with suppress(OSError):  # something is in it
                one.rmdir()
        raise


def room_for_picture(picture: Path | None) -> AbstractContextManager[None]:
    """Makes the folder of a picture before minutes are spent on what it shows, as `folder_made` does.

    Args:
        picture: What `--picture` names; None for no picture.

    Returns:
        A context manager.

    Raises:
        typer.BadParameter: It names a folder.
    """
    if picture is not None and picture.is_dir():
        raise typer.BadParameter(f"{picture} is a folder; name a PNG file in it", param_hint="--picture")
    return folder_made(None if picture is None else picture.parent)


def room_for_file(file: Path) -> AbstractContextManager[None]:
    """Makes the folder of a file before hours are spent on what it is to hold, as `folder_made` does.

    Args:
        file: What `--out` names.

    Returns:
        A context manager.

    Raises:
        CusickError: It names a folder.
    """
    if file.is_dir():
        raise CusickError(f"--out must name a file, got the folder {file}; give for instance {file / 'out.json'}")
    return folder_made(file.parent)


def require_csv(table: Path | None, example: str) -> None:
    """Makes sure, before any work, that a table is to be a CSV file.

    Args:
        table: What `--out` names; None for no table.
        example: A name that would do, for the message.

    Raises:
        CusickError: The name ends otherwise.
    """
    if table is not None and table.suffix != ".csv":
        raise CusickError(f"the name of the table must end in .csv, got {table}; give for instance {example}")


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
        # `Path.resolve` raises where links go round in circles
        if isinstance(path, Path) and Path(os.path.realpath(path)).is_relative_to(PACKAGE):
            raise typer.BadParameter(
                f"{path} lies in the installed package, which no command writes to; give a path outside of {PACKAGE}"
            )
    return value
