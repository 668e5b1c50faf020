"""Fingerprints of files."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from cusick_bench.files.hidden import is_hidden_file


def file_digest(path: Path) -> str:
    """SHA-256 of a file.

    Args:
        path: The file.

    Returns:
        Its digest in hexadecimal digits.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def digests_below(folder: Path) -> dict[str, str]:
    """SHA-256 of all files below a folder but those that belong to no data, such as .DS_Store of macOS.

    Args:
        folder: The folder.

    Returns:
        Hexadecimal digits by path, relative to it.
    """
    paths = {path.relative_to(folder): path for path in folder.rglob("*") if path.is_file()}
    return {name.as_posix(): file_digest(path) for name, path in paths.items() if not is_hidden_file(name)}


def folder_digest(folder: Path) -> str:
    """SHA-256 of the names and bytes of all files in a folder, as of `digests_below`.

    Args:
        folder: The folder.

    Returns:
        Its digest in hexadecimal digits.
    """
    return names_digest(digests_below(folder))


def names_digest(digests: Mapping[str, str]) -> str:
    """SHA-256 of names with the digest of each.

    Args:
        digests: Digests by name.

    Returns:
        One digest of all in hexadecimal digits.
    """
    return hashlib.sha256(repr(sorted(digests.items())).encode()).hexdigest()
