"""Locks of files and folders, which end with the process that holds them, however it ends."""

import errno
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cusick_bench.files.errors import FolderInUse

try:
    import fcntl
except ImportError:  # Windows: two processes that write into one folder do not notice each other there
    fcntl = None

_NO_LOCKS = {errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP}  # of file systems without `flock`, as Lustre may be mounted

_log = logging.getLogger(__name__)


def lock(file: int, *, wait: bool) -> bool:
    """Locks an open file or folder against other processes.

    Args:
        file: Its descriptor.
        wait: Whether a process that holds it is waited for.

    Returns:
        False where its file system has no locks, so that it may not be held alone.

    Raises:
        BlockingIOError: Another process holds it, and is not waited for.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        _log.debug("no locks here (%s): processes that write into one folder do not notice each other", error.strerror)
        return False
    return True


@contextmanager
def locked(folder: Path, *, wait: bool = True) -> Iterator[None]:
    """Whoever writes into a folder that others write into, too, waits here for them, or is refused.

    Args:
        folder: The folder; nothing is written into it for that.
        wait: Whether a process that holds it is waited for.

    Yields:
        Nothing; the folder is held within the `with` block, or until the process ends.

    Raises:
        FolderInUse: Another process holds it, and is not waited for.
    """
    if fcntl is None:
        yield
        return
    opened = os.open(folder, 0)
    try:
        try:
            lock(opened, wait=wait)
        except BlockingIOError as error:
            raise FolderInUse(f"another process is writing into {folder}; wait for it, or stop it") from error
        yield
    finally:
        os.close(opened)
