"""Results on disk: one folder for each cell, named by the hash of all that decides its numbers; files appear whole.

OUT/run.json                      command line, versions, hardware, dataset
OUT/cells/<hash>/cell.json        the cell: solver, cloth, seed and settings
OUT/cells/<hash>/trace.jsonl      one line for each evaluation
OUT/cells/<hash>/state.bin|npz    arrays of the evaluations, and a solver's state, from which a run resumes
OUT/cells/<hash>/prediction.npz   the answer
OUT/cells/<hash>/result.json      cost and metrics
OUT/cells/<hash>/done             marker, written last, with a hash of each of the cell's files

If files are missing, or do not fit the hashes of the marker, the marker is ignored and the cell is run again.
"""

import errno
import hashlib
import logging
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cusick_bench.files import BadFile, read_json_object
from cusick_bench.files.folder_lock import lock, locked
from cusick_bench.files.json_file import MOST_JSON_BYTES
from cusick_bench.files.json_text import json_text
from cusick_bench.files.plain_names import part_of, parts_left
from cusick_bench.runner.errors import CellIsRunning, RunnerError

_log = logging.getLogger(__name__)

CELL_FILE = "cell.json"
"""What was asked of a cell."""
RESULT_FILE = "result.json"
"""What a cell cost, and its metrics."""
PREDICTION_FILE = "prediction.npz"
"""A cell's answer."""
MOST_PREDICTION_BYTES = 16 << 30
"""Most that an answer's arrays have: 100,000 draws of 256 px with drapes of 2699 vertices, or a thousand of 4096 px."""
MARKED = (CELL_FILE, "trace.jsonl", PREDICTION_FILE, RESULT_FILE)
"""Files of a finished cell that its marker stands for."""

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}
_FATAL = {*_FULL, errno.EACCES, errno.EPERM, errno.EIO}


def ends_grid(error: OSError, out: Path) -> bool:
    """Whether an error is a fault of the disk, which ends the grid instead of being recorded as a failed cell.

    Args:
        error: Raised while a cell was run.
        out: Results folder, or the cell's.

    Returns:
        True for a full disk, and for a file that cannot be read or written if it lies in the folder or is not known;
        a file elsewhere is the solver's own.
    """
    known = [Path(name).absolute() for name in (error.filename, error.filename2) if isinstance(name, str | Path)]
    inside = not known or any(path.is_relative_to(out.absolute()) for path in known)
    return error.errno in _FULL or (error.errno in _FATAL and inside)


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
        if error.errno not in _FATAL:
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
    part = part_of(path)  # two runners may write into one folder
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException as error:  # such as a full disk, or Ctrl-C
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):
            error.filename = str(path)
        raise
    _log.debug("wrote %s", path)


def append_line(path: Path, line: str) -> None:
    """Adds a line to a file that others may add lines to, too; once this returns, a crash does not lose it.

    A last line that a crash or a full disk has cut off makes way for it.

    Args:
        path: File; it and its folder are made where they are missing.
        line: The line, without its end.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked(path.parent), path.open("a+b") as file:
        file.seek(0)
        lines = file.read()
        file.truncate(lines.rfind(b"\n") + 1)
        file.write(f"{line}\n".encode())
        file.flush()
        os.fsync(file.fileno())


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Writes a JSON document, whole or not at all.

    Args:
        path: File.
        document: What it shall hold; numbers that are not finite become null.
    """
    write_atomically(path, json_text(document).encode())


def read_json(path: Path, *, most_bytes: int = MOST_JSON_BYTES) -> dict[str, Any]:
    """Reads a JSON document.

    Args:
        path: File.
        most_bytes: Size that it may have at most [bytes].

    Returns:
        What it holds.

    Raises:
        RunnerError: It is damaged.
    """
    try:
        return read_json_object(path, remedy="repeat the run command, which makes it anew", most_bytes=most_bytes)
    except BadFile as error:
        raise RunnerError(f"{path} is damaged ({error.what}); {error.remedy}") from error


def file_digests(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """SHA-256 of files of a folder.

    Args:
        folder: The folder.
        names: Names of files; those that are not there are left out.

    Returns:
        Hexadecimal digits by name.
    """
    found: dict[str, str] = {}
    for name in names:
        if (folder / name).is_file():
            with (folder / name).open("rb") as file:
                found[name] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


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
        """Whether a cell is finished and its files are unchanged since.

        Args:
            key: Name of the cell.

        Returns:
            Whether nothing is left to do.
        """
        return (self.folder(key) / "done").exists() and not self.fault(key)

    def fault(self, key: str) -> str:
        """Fault of a cell that is marked as finished.

        Args:
            key: Name of the cell.

        Returns:
            A sentence with the path; "" where nothing is wrong, or the cell is not marked.
        """
        folder = self.folder(key)
        if not (folder / "done").exists():
            return ""
        if not set(MARKED) <= set(self._marked(key)):
            return f"{folder / 'done'} is damaged"
        changed = self.changed(key)
        return str(folder / changed) if changed else ""

    def changed(self, key: str, names: Sequence[str] = MARKED) -> str:
        """What of a finished cell is no longer as its marker says.

        Args:
            key: Name of the cell.
            names: Files that are looked at.

        Returns:
            A sentence that begins with the file's name; "" where nothing has changed, or where the marker names no
            files, as in cells of before markers held hashes.
        """
        marked, present = self._marked(key), file_digests(self.folder(key), names)
        for name in names:
            if name in marked and name not in present:
                return f"{name} is missing"
            if name in marked and present[name] != marked[name]:
                return f"{name} is not what the cell was finished with"
        return ""

    def _marked(self, key: str) -> dict[str, str]:
        """Hashes of the files of a cell, as its marker has them; none where the marker is damaged or missing."""
        try:
            marked = read_json(self.folder(key) / "done").get("files")
        except (OSError, RunnerError):
            return {}
        return marked if isinstance(marked, dict) else {}

    def result(self, key: str) -> dict[str, Any]:
        """A finished or failed cell's result.

        Args:
            key: Name of the cell.

        Returns:
            Contents of its `result.json`.

        Raises:
            RunnerError: It is damaged.
        """
        return read_json(self.folder(key) / RESULT_FILE)

    def mark_done(self, key: str) -> None:
        """Says that a cell is finished and never to be written again.

        Args:
            key: Name of the cell.
        """
        folder = self.folder(key)
        write_json(folder / "done", {"files": file_digests(folder, MARKED)})

    @contextmanager
    def claimed(self, key: str) -> Iterator[Path]:
        """Holds a cell against other processes; the hold ends with the process, however it ends.

        Args:
            key: Name of the cell.

        Returns:
            A context manager that gives the cell's folder.

        What an earlier process has left half written is removed, and a marker that is wrong, which is logged.

        Raises:
            CellIsRunning: Another process is running it.
        """
        folder = self.folder(key)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "lock").open("a") as file:
            try:
                alone = lock(file.fileno(), wait=False)
            except BlockingIOError as error:
                raise CellIsRunning(f"another process is running {folder}; wait for it or stop it") from error
            for part in parts_left(folder) if alone else ():
                part.unlink()
            if fault := self.fault(key):
                _log.warning("%s; the cell is run again", fault)
                (folder / "done").unlink()
            yield folder
