"""Fingerprints of files."""

import hashlib
from pathlib import Path


def file_digest(path: Path) -> str:
    """SHA-256 of a file.

    Args:
        path: The file.

    Returns:
        Its digest in hexadecimal digits.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def folder_digest(folder: Path) -> str:
    """SHA-256 of the names and bytes of all files in a folder.

    Args:
        folder: The folder.

    Returns:
        Its digest in hexadecimal digits.
    """
    files = {path.relative_to(folder).as_posix(): file_digest(path) for path in folder.rglob("*") if path.is_file()}
    return hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()
