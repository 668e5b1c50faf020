"""Where what is found of each case is kept: one file a case beside the file for all, so that a crash loses one.

The path tells what it was found from: the files of the case, the atlas, the options, the versions of the numerics. What
was found from others, as from another suite's case of the same name, is not taken over.
"""

import hashlib
from pathlib import Path

from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.runner.labels import numerics_text
from cusick_bench.runner.numerics import diagnosis_numerics


def case_part(out: Path, folder: Path, atlas: Path, *options: object) -> Path:
    """Where what is found of one case is kept.

    Args:
        out: File for all cases.
        folder: Folder of the case.
        atlas: Fitted atlas.
        options: What else decides it, each with a text that tells it from others.

    Returns:
        The file, which need not be there.
    """
    found_from = [numerics_text(answer_numerics()), file_digest(atlas), _folder_digest(folder), *map(str, options)]
    fingerprint = hashlib.sha256(" ".join(found_from).encode()).hexdigest()[:16]
    return out.with_name(out.name + ".parts") / fingerprint / f"{folder.name}.json"


def answer_numerics() -> dict[str, int]:
    """Versions of what decides an answer.

    Returns:
        Version of each part, by name.
    """
    return diagnosis_numerics(diagnosis=NUMERICS_VERSION)


def file_digest(path: Path) -> str:
    """SHA-256 of a file.

    Args:
        path: The file.

    Returns:
        Its digest in hexadecimal digits.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _folder_digest(folder: Path) -> str:
    """SHA-256 of the names and bytes of all files in a folder."""
    files = {path.relative_to(folder).as_posix(): file_digest(path) for path in folder.rglob("*") if path.is_file()}
    return hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()
