"""Seals labels and cases: whoever made them is bound to both before anybody answers.

A label's seal is SHA-256 of its salt and the label in canonical JSON (keys sorted, no spaces), both in UTF-8. The salt
keeps the few possible labels from being tried one by one; it lies with the labels, never with the cases. A case is
sealed by SHA-256 of its files, once all cases are made; older commitments seal labels only.

Cases of all suites have the same names, so seals also tell which suite cases, answers and labels are of.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.checked_json import read_object

COMMITMENT = "commitment.json"
"""File with the seals, which lies beside the cases."""
FILES = "files"
"""Key under which it has the SHA-256 of each case's files."""

_NOT_SEALED = ("salt", "sha256")
_DIGITS = 64  # of a seal
_LACKING = f"give the {COMMITMENT} that was published with the cases"


def salt_of(seed: int, case: str) -> str:
    """The salt of a case.

    Args:
        seed: Seed of the suite.
        case: Name of the case.

    Returns:
        32 hexadecimal digits that only the seed tells.
    """
    return hashlib.sha256(f"withheld salt {seed} {case}".encode()).hexdigest()[:32]


def seal(label: Mapping[str, Any], salt: str) -> str:
    """Computes the seal of a label.

    Args:
        label: The label as it is stored on disk; its own `salt` and `sha256` are left out.
        salt: The salt.

    Returns:
        SHA-256 of salt + label.
    """
    kept = {key: value for key, value in label.items() if key not in _NOT_SEALED}
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256((salt + text).encode()).hexdigest()


def sealed(label: Mapping[str, Any], salt: str) -> dict[str, Any]:
    """Seals a label.

    Args:
        label: The label as it is stored on disk.
        salt: The salt.

    Returns:
        The label with its salt and its seal.
    """
    return {**label, "salt": salt, "sha256": seal(label, salt)}


def holds(label: Mapping[str, Any], commitment: str) -> bool:
    """Whether a label is the one that was sealed.

    Args:
        label: The label as it is stored on disk, with its salt and seal.
        commitment: The seal that was published.

    Returns:
        True if seal, label and commitment agree.
    """
    return seal(label, str(label.get("salt", ""))) == commitment == label.get("sha256")


def published_seals(path: Path) -> dict[str, str]:
    """Reads the seals of a suite as they were published.

    Args:
        path: File with the seals by case, in the first object that holds any, or at its top.

    Returns:
        The seal of each case.

    Raises:
        WithheldError: A file that cannot be read.
    """
    document = read_object(path, _LACKING)
    inner = (_digests(value) for key, value in document.items() if isinstance(value, dict) and key != FILES)
    return next(filter(None, inner), _digests(document))


def published_files(path: Path) -> dict[str, str]:
    """Reads by which files the cases of a suite were published.

    Args:
        path: File with the seals.

    Returns:
        SHA-256 of the files of each case (`folder_digest`); empty where only labels are sealed, as they were at first.

    Raises:
        WithheldError: A file that cannot be read.
    """
    files = read_object(path, _LACKING).get(FILES)
    of_cases = files.items() if isinstance(files, dict) else ()
    return {case: digest for case, digest in of_cases if isinstance(digest, str)}


def _digests(entries: Mapping[str, Any]) -> dict[str, str]:
    """What of an object is a SHA-256, which facts about the file are not."""
    return {case: one for case, one in entries.items() if isinstance(one, str) and len(one) == _DIGITS}


def require_published_files(found: Mapping[str, str], published: Mapping[str, str], where: str) -> None:
    """Checks that cases are those that were published, as far as they were sealed.

    Args:
        found: SHA-256 of the files of each case.
        published: The same as it was published.
        where: What the cases are, for the message.

    Raises:
        WithheldError: A case with other files.
    """
    for case, digest in found.items():
        if published.get(case, digest) != digest:
            raise WithheldError(
                f"{where} must be the cases that were published, but the files of {case} have another SHA-256: they "
                "were changed, or are not complete; fetch cases and commitment anew"
            )


def seals_beside(cases: Path) -> dict[str, str]:
    """The seals that lie beside cases.

    Args:
        cases: Folder of the cases.

    Returns:
        The seal of each case; empty where none lie there.

    Raises:
        WithheldError: A file of seals that cannot be read.
    """
    return _beside(cases, published_seals)


def files_beside(cases: Path) -> dict[str, str]:
    """The seals of files that lie beside cases.

    Args:
        cases: Folder of the cases.

    Returns:
        SHA-256 of the files of each case; empty where none lie there.

    Raises:
        WithheldError: A file of seals that cannot be read.
    """
    return _beside(cases, published_files)


def _beside(cases: Path, read: Callable[[Path], dict[str, str]]) -> dict[str, str]:
    path = cases / COMMITMENT
    return read(path) if path.exists() else {}


def require_one_suite(carried: Mapping[str, str | None], seals: Mapping[str, str], labels: str, cases: str) -> None:
    """Checks that labels are of the suite that some cases are of, as far as both have seals.

    Args:
        carried: The seal that each label carries, by case.
        seals: The seals of the cases.
        labels, cases: What these are, for the message.

    Raises:
        WithheldError: A label with another seal than its case.
    """
    for case, seal_of_label in carried.items():
        if seal_of_label is not None and seals.get(case, seal_of_label) != seal_of_label:
            raise WithheldError(
                f"{labels} and {cases} must be of one suite, but the label of {case} has another seal than the case; "
                "give the files of one suite (cases of all suites have the same names)"
            )
