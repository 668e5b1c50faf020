"""The bytes or the text of a file, once it is known to be one and no larger than it may be."""

import logging
import stat
from pathlib import Path

from cusick_bench.files.errors import BadFile

_log = logging.getLogger(__name__)


def require_regular(path: Path, *, most_bytes: int, remedy: str) -> None:
    """Makes sure that a file is one, and no larger than it may be; it is not opened.

    A pipe or a device would never end, or wait for ever.

    Args:
        path: The file.
        most_bytes: Size that it may have at most [bytes].
        remedy: What the user can do where it cannot be read.

    Raises:
        BadFile: It is missing, no regular file, or too large.
    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:  # a path with a zero byte is a ValueError
        what = getattr(error, "strerror", None) or str(error)
        raise BadFile(path, f"cannot be read ({what})", remedy) from error
    if not stat.S_ISREG(found.st_mode):
        raise BadFile(path, f"must be a regular file, got a {_kind(found.st_mode)}", remedy)
    if found.st_size > most_bytes:
        raise BadFile(path, f"must have at most {size(most_bytes)}, got {size(found.st_size)}", remedy)


def read_bytes(path: Path, *, most_bytes: int, remedy: str) -> bytes:
    """Reads a whole file.

    Args:
        path: The file.
        most_bytes: Size that it may have at most [bytes].
        remedy: What the user can do where it cannot be read.

    Returns:
        Its content.

    Raises:
        BadFile: It is missing, no regular file, not permitted, or too large.
    """
    require_regular(path, most_bytes=most_bytes, remedy=remedy)
    try:
        with path.open("rb") as file:
            content = file.read(most_bytes + 1)
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror})", remedy) from error
    if len(content) > most_bytes:
        raise BadFile(path, f"must have at most {size(most_bytes)}, got more", remedy)
    _log.debug("read %s, %s", path, size(len(content)))
    return content


def read_text(path: Path, *, most_bytes: int, remedy: str) -> str:
    """Reads a whole file of UTF-8 text, with or without a byte order mark.

    Args:
        path: The file.
        most_bytes: Size that it may have at most [bytes].
        remedy: What the user can do where it cannot be read.

    Returns:
        Its text.

    Raises:
        BadFile: See `read_bytes`; or it is no UTF-8, or holds zero bytes.
    """
    content = read_bytes(path, most_bytes=most_bytes, remedy=remedy)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise BadFile(path, "must be UTF-8 text, got UTF-16", "save it as UTF-8")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = f"must be UTF-8 text, got byte 0x{content[error.start]:02x} at place {error.start}"
        raise BadFile(path, what, remedy) from error
    if "\0" in text:
        raise BadFile(path, f"must be text, got a zero byte at place {text.index(chr(0))}", remedy)
    return text


def size(count: int) -> str:
    """A number of bytes for a message.

    Args:
        count: Number of bytes.

    Returns:
        It in the largest unit that leaves 1 or more.
    """
    for shift, unit in ((40, "TiB"), (30, "GiB"), (20, "MiB"), (10, "KiB")):
        if count >= 1 << shift:
            return f"{count / (1 << shift):.4g} {unit}"
    return f"{count} bytes"


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "folder"
    return "pipe" if stat.S_ISFIFO(mode) else "device" if stat.S_ISCHR(mode) or stat.S_ISBLK(mode) else "socket"
