"""Where results lie: one folder a cell, named by the hash of all that decides its numbers; files appear whole or not.

OUT/run.json                      command line, versions, hardware, dataset
OUT/cells/<hash>/cell.json        what was asked
OUT/cells/<hash>/trace.jsonl      one line an evaluation
OUT/cells/<hash>/state.bin|npz    what a resumed run is fed from
OUT/cells/<hash>/prediction.npz   the answer
OUT/cells/<hash>/result.json      cost and metrics
OUT/cells/<hash>/done             marker, written last
"""

import errno
import json
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cusick_bench.files import BadFile, read_json_object
from cusick_bench.runner.errors import RunnerError

try:
    import fcntl
except ImportError:  # Windows: two runs of one cell at the same time are not noticed there
    fcntl = None

# Faults of the disk, not of the solver: they end the grid instead of being recorded as a failed cell.
FATAL = {errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.EIO}


def _plain(value: Any) -> Any:
    """Numbers that JSON can hold: NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def disk_errors(out: Path) -> Iterator[None]:
    """Turns faults of the disk into one message with a remedy.

    Args:
        out: Results folder, named where the fault names no file.

    Returns:
        A context manager.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in FATAL:
            raise
        raise RunnerError(
            f"cannot write to {error.filename or out}: {os.strerror(error.errno or 0)}; free space or choose another "
            "--out, then repeat the command: finished cells are kept"
        ) from error


def write_atomically(path: Path, content: bytes) -> None:
    """Writes a file so that after a crash it is either there in full or as it was before.

    Args:
        path: File.
        content: All of it.
    """
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Writes a JSON document, whole or not at all.

    Args:
        path: File.
        document: What it shall hold; numbers that are not finite become null.
    """
    write_atomically(path, (json.dumps(_plain(document), indent=1, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> dict[str, Any]:
    """Reads a JSON document.

    Args:
        path: File.

    Returns:
        What it holds.

    Raises:
        RunnerError: It is damaged.
    """
    try:
        return read_json_object(path, remedy="delete its folder and run the cell again")
    except BadFile as error:
        raise RunnerError(f"{path} is damaged ({error.what}); {error.remedy}") from error


@dataclass(frozen=True)
class Store:
    """A results folder.

    Attributes:
        out: Its path.
    """

    out: Path

    def prepare(self) -> None:
        """Creates the folder and proves that it can be written to.

        Raises:
            RunnerError: It cannot.
        """
        with disk_errors(self.out):
            try:
                (self.out / "cells").mkdir(parents=True, exist_ok=True)
            except (FileExistsError, NotADirectoryError) as error:
                raise RunnerError(f"--out {self.out} is (or lies under) a file; choose a folder") from error
            with tempfile.TemporaryFile(dir=self.out / "cells") as probe:
                probe.write(b"writable")
                probe.flush()

    def folder(self, key: str) -> Path:
        """A cell's folder.

        Args:
            key: Name of the cell.

        Returns:
            Its path, whether it exists or not.
        """
        return self.out / "cells" / key

    def is_done(self, key: str) -> bool:
        """Whether a cell has been finished.

        Args:
            key: Name of the cell.

        Returns:
            Whether its marker is there.
        """
        return (self.folder(key) / "done").exists()

    def result(self, key: str) -> dict[str, Any]:
        """A finished or failed cell's result.

        Args:
            key: Name of the cell.

        Returns:
            Contents of its `result.json`.

        Raises:
            RunnerError: It is damaged.
        """
        return read_json(self.folder(key) / "result.json")

    def mark_done(self, key: str) -> None:
        """Says that a cell is finished and never to be written again.

        Args:
            key: Name of the cell.
        """
        write_atomically(self.folder(key) / "done", b"")

    @contextmanager
    def claimed(self, key: str) -> Iterator[Path]:
        """Holds a cell against other processes; the hold ends with the process, however it ends.

        Args:
            key: Name of the cell.

        Returns:
            A context manager that gives the cell's folder.

        Raises:
            RunnerError: Another process is running it.
        """
        folder = self.folder(key)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "lock").open("a") as lock:
            if fcntl is not None:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError as error:
                    raise RunnerError(f"another process is running {folder}; wait for it or stop it") from error
            yield folder
