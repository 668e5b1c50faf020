"""SHA-256 of every file of a data set, as `sha256.json` lists them."""

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from cusick_bench.datasets.errors import BadTable, DataError
from cusick_bench.datasets.files.measure import content_hash
from cusick_bench.datasets.files.object_file import read_object

CHECKSUMS = "sha256.json"
_MOST_BYTES = 64 << 20  # a line a file


def verify_checksums(root: Path) -> None:
    """Checks every file that `sha256.json` lists.

    Args:
        root: Folder of the data set.

    Raises:
        BadTable: No such list, or a malformed one.
        DataError: A file is missing or differs.
    """
    for name, what in changed_files(root):
        raise DataError(what, where=root / name, remedy="reinstall the data set", kind="checksum")


def changed_files(root: Path) -> Iterator[tuple[str, str]]:
    """Finds files that are not as `sha256.json` says.

    Args:
        root: Folder of the data set.

    Yields:
        Relative path, and what is wrong with the file.

    Raises:
        BadTable: No such list, or a malformed one.
    """
    path = root / CHECKSUMS
    for name, digest in read_object(path, "checksum", most_bytes=_MOST_BYTES).items():
        inside = PurePosixPath(name)
        well_formed = isinstance(digest, str) and re.fullmatch(r"[0-9a-f]{64}", digest)
        if not well_formed or inside.is_absolute() or ".." in inside.parts or "\\" in name:
            raise BadTable(f"bad entry {name[:80]!r}", where=path, remedy="reinstall the data set", kind="checksum")
        file = root / inside
        if not file.is_file():
            yield name, "is missing"
        elif content_hash(file) != digest:
            yield name, "differs from its SHA-256"
