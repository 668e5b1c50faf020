"""Files of partial results: one for each case beside the file for all cases, so that a crash loses only one case.

The path contains a hash of everything that decides a result: the files of the case, the atlas, the options, the
versions of the numerics. So results of other inputs, such as another suite's case of the same name, are never reused.
"""

import hashlib
from collections.abc import Callable, Mapping
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, TypeVar

from cusick_bench.datasets.files.fabrics import FILE as FABRICS_FILE
from cusick_bench.datasets.files.layout import beside
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL_FILE
from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.files.digest import file_digest, folder_digest
from cusick_bench.runner.labels import numerics_text
from cusick_bench.runner.numerics import diagnosis_numerics
from cusick_bench.runner.processes import process_pool
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.label import LabelDocument
from cusick_bench.withheld.format.seal import (
    files_beside,
    require_one_suite,
    require_published_files,
    seals_beside,
)

Found = TypeVar("Found")

PARTS = ".parts"
"""What the name of a folder of partial results ends in."""


def gather(
    out: Path,
    parts: Mapping[str, Path],
    work: Callable[[str], tuple[Any, ...]],
    *,
    read: Callable[[Path], dict[str, Found]],
    write: Callable[[Path, dict[str, Found]], None],
    check: Callable[[str], None],
    workers: int,
    step: Callable[[str], None],
) -> dict[str, Found]:
    """Results of all cases, read from their parts where these exist; the file for all is written after every case.

    Args:
        out: File for all cases.
        parts: Where what is found of each case is kept, in the order in which they are done.
        work: A function that finds it in a process of its own, with its arguments.
        read: Reads a file of either kind.
        write: Writes one.
        check: Raises an error where a case is no longer what its part is named by (`require_unchanged`).
        workers: Number of processes.
        step: Called with the name of every case that is done.

    Returns:
        What was found, by case.
    """
    found: dict[str, Found] = {}
    for case, part in parts.items():
        if part.exists():
            found |= read(part)
            step(case)
    write(out, found)
    with process_pool(workers) as pool:
        futures = {pool.submit(*work(case)): case for case in parts if case not in found}
        for future in as_completed(futures):
            case = futures[future]
            found[case] = future.result()
            check(case)
            parts[case].parent.mkdir(parents=True, exist_ok=True)
            write(parts[case], {case: found[case]})
            write(out, found)
            step(case)
    return found


def require_labels_of(cases: Path, labels: Mapping[str, LabelDocument]) -> dict[str, str]:
    """Checks that labels are those of cases, and these those that were published, where seals lie beside them.

    Args:
        cases: Folder of the cases.
        labels: Content of labels.json.

    Returns:
        SHA-256 of what every labelled case that is there is read from (`case_digest`), by name.

    Raises:
        WithheldError: No labelled case there, labels of another suite, or a case with other files than the sealed ones.
    """
    carried = {case: label.sha256 for case, label in labels.items()}
    require_one_suite(carried, seals_beside(cases), "the labels", str(cases))
    found = {case: case_digest(cases / case) for case in labels if (cases / case).is_dir()}
    if labels and not found:
        raise WithheldError(f"{cases} has none of the {len(labels)} cases with a label; give the folder of these cases")
    require_published_files(found, files_beside(cases), str(cases))
    return found


def case_digest(folder: Path) -> str:
    """SHA-256 of what a case is read from.

    Args:
        folder: Folder of the case.

    Returns:
        That of its files (`folder_digest`); where its folder is named like one of a fabric or a sample, so that tables
        above it belong to it, that of both.
    """
    root = folder.resolve()
    tables = [beside(root, name) for name in (PROTOCOL_FILE, FABRICS_FILE)]
    above = [file_digest(path) for path in tables if path is not None and not path.is_relative_to(root)]
    own = folder_digest(folder)
    return hashlib.sha256(" ".join([own, *above]).encode()).hexdigest() if above else own


def case_part(out: Path, case: str, files: str, atlas: Path, *options: object) -> Path:
    """Path of the file with the result of one case.

    Args:
        out: File for all cases.
        case: Name of the case.
        files: SHA-256 of what it is read from (`case_digest`).
        atlas: Fitted atlas.
        options: What else decides it, each with a text that tells it from others.

    Returns:
        The file, which need not be there.
    """
    found_from = [numerics_text(answer_numerics()), file_digest(atlas), files, *map(str, options)]
    fingerprint = hashlib.sha256(" ".join(found_from).encode()).hexdigest()[:16]
    return out.with_name(out.name + PARTS) / fingerprint / f"{case}.json"


def require_unchanged(folder: Path, files: str, atlas: Path, atlas_sha256: str) -> None:
    """Makes sure that what was found of a case is of the files that its part is named by, before it is kept.

    Args:
        folder: Folder of the case.
        files: SHA-256 of what it is read from when the work began (`case_digest`).
        atlas: Fitted atlas.
        atlas_sha256: Its SHA-256 when the work began.

    Raises:
        WithheldError: The case or the atlas was changed meanwhile.
    """
    for path, began, now in ((folder, files, case_digest(folder)), (atlas, atlas_sha256, file_digest(atlas))):
        if began != now:
            raise WithheldError(
                f"{path} must stay as it is while cases are answered, but has changed; what was found of {folder.name} "
                "is not kept; repeat the command, which answers from the present files"
            )


def answer_numerics() -> dict[str, int]:
    """Versions of what decides an answer.

    Returns:
        Version of each part, by name.
    """
    return diagnosis_numerics(diagnosis=NUMERICS_VERSION)
