"""Seals labels: whoever made the cases is bound to them before anybody answers.

A label's seal is SHA-256 of its salt and the label in canonical JSON (keys sorted, no spaces), both in UTF-8. The salt
keeps the few possible labels from being tried one by one; it lies with the labels, never with the cases.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

_NOT_SEALED = ("salt", "sha256")


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
