"""What may stand where a file is expected: devices, pipes, folders, loops of links, files of gigabytes."""

import os
from collections.abc import Callable
from pathlib import Path


def device(path: Path) -> None:
    """A file without an end."""
    path.symlink_to("/dev/zero")


def pipe(path: Path) -> None:
    """A file that waits for somebody to write."""
    os.mkfifo(path)


def folder(path: Path) -> None:
    """A folder."""
    path.mkdir()


def loop(path: Path) -> None:
    """A link to itself."""
    path.symlink_to(path)


def gone(path: Path) -> None:
    """A link to nothing."""
    path.symlink_to(path.with_name("gone"))


def sparse(path: Path) -> None:
    """4 GB of zeros that take no room."""
    with path.open("wb") as file:
        file.truncate(4 << 30)


def empty(path: Path) -> None:
    """A file of no bytes."""
    path.touch()


ODD: dict[str, tuple[Callable[[Path], None], str]] = {
    "device": (device, "must be a regular file, got a device"),
    "pipe": (pipe, "must be a regular file, got a pipe"),
    "folder": (folder, "must be a regular file, got a folder"),
    "loop of links": (loop, "[Ll]oop|[Tt]oo many levels"),
    "link to nothing": (gone, "No such file|no file|no .* file is there"),
    "4 GB of zeros": (sparse, "at most .* got 4 GiB"),
}
"""How to put it at a path, and what the readers say of it."""
