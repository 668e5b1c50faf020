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
