"""A folder that appears with all its files or not at all, whatever cuts the writing off."""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from cusick_bench.files.folder_lock import locked

_PART = ".part"


def free(out: Path, names: Collection[str], allowed: Collection[str] = ()) -> bool:
    """Whether `whole_folder` may write here.

    Args:
        out: The folder; it need not exist.
        names: What is going to be written: what a crash has left of it is in nobody's way.
        allowed: Other files that may be there; they stay.

    Returns:
        False where a file that is not hidden is in the way, or the folder is a file itself.
    """
    if not out.exists():
        return True
    known = {*allowed, *(names if (out / _PART).exists() else ())}
    return out.is_dir() and all(path.name in known or path.name.startswith(".") for path in out.iterdir())


@contextmanager
def whole_folder(out: Path, names: Collection[str]) -> Iterator[Path]:
    """Gives a temporary folder to write to, which becomes `out` when the block ends; after an error nothing is left.

    It lies beside `out`, and is renamed. Where `out` exists, it lies in there, since `out` may be a volume of its own,
    and its files are moved; the other files of `out` are not touched.

    Args:
        out: The folder to write, free by `free`.
        names: Names of what is going to be written.

    Yields:
        The temporary folder, empty.

    Raises:
        FolderInUse: Another process is writing it.
    """
    exists, whole = out.exists(), out.absolute()
    beside, inside = whole.with_name(f".{whole.name}{_PART}"), whole / _PART
    part, half_moved = inside if exists else beside, inside.exists()
    if exists and beside.exists():
        with locked(beside, wait=False):
            _remove(beside)  # what a crash has left
    part.mkdir(parents=True, exist_ok=True)
    with locked(part, wait=False):
        _remove(*([whole / name for name in names] if half_moved else []), *part.iterdir())  # what a crash has left
        moved: list[Path] = []
        try:
            yield part
            if not exists:
                os.replace(part, whole)
                return
            for path in sorted(part.iterdir()):
                moved.append(whole / path.name)
                os.replace(path, moved[-1])
            part.rmdir()
        except BaseException:
            _remove(*moved, part)
            raise


def _remove(*paths: Path) -> None:
    for path in paths:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
