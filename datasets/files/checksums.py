"""SHA-256 of every file of a data set, as `sha256.json` lists them."""

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from cusick_bench.datasets.errors import BadTable, DataError
from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.measure import content_hash
from cusick_bench.datasets.files.object_file import read_object

CHECKSUMS = "sha256.json"
_MOST_BYTES = 64 << 20  # a line a file
_ADDED = f"is not listed in {CHECKSUMS}"


def verify_checksums(layout: Layout) -> None:
    """Checks every file that `sha256.json` lists, and that it lists every silhouette and mesh.

    Args:
        layout: Files of the data set.

    Raises:
        BadTable: No such list, or a malformed one.
        DataError: A file is missing, differs or was added.
    """
    for name, what in changed_files(layout):
        remedy = "remove it" if what == _ADDED else "reinstall the data set"
        raise DataError(what, where=layout.root / name, remedy=remedy, kind="checksum")


def changed_files(layout: Layout) -> Iterator[tuple[str, str]]:
    """Finds files that are not as `sha256.json` says, and silhouettes and meshes that it does not list.

    Args:
        layout: Files of the data set.

    Yields:
        Relative path, and what is wrong with the file.

    Raises:
        BadTable: No such list, or a malformed one.
    """
    path = layout.root / CHECKSUMS
    listed = read_object(path, "checksum", most_bytes=_MOST_BYTES)
    for name, digest in listed.items():
        inside = PurePosixPath(name)
        well_formed = isinstance(digest, str) and re.fullmatch(r"[0-9a-f]{64}", digest)
        if not well_formed or inside.is_absolute() or ".." in inside.parts or "\\" in name:
            raise BadTable(f"bad entry {name[:80]!r}", where=path, remedy="reinstall the data set", kind="checksum")
        if what := _fault(layout.root / inside, digest):
            yield name, what
    for entry in (*layout.silhouettes, *layout.meshes):
        if entry.path not in listed:
            yield entry.path, _ADDED


def _fault(file: Path, digest: str) -> str:
    """What is wrong with a file; empty if nothing is."""
    try:
        if not file.is_file():
            return "is missing"
        return "" if content_hash(file) == digest else "differs from its SHA-256"
    except DataError as error:
        return error.what
    except OSError as error:  # of a name that is too long, or a folder that may not be looked into
        return f"cannot be read ({error.strerror or error})"
