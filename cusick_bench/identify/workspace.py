"""The folder of an identification: its parts, and records of their inputs, which tell whether a part is up to date.

OUT/data          data set made from photographs; OUT/data.json holds its inputs
OUT/run           fits, as `run` writes them; fits.json holds their cells by the hash of all that decides their numbers
OUT/diagnosis     a document and a page for each fabric; inputs.json holds their inputs
OUT/identify.json, OUT/identify.csv, OUT/identify.html
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cusick_bench.files import BadFile, read_json_object
from cusick_bench.files.digest import digests_below
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.runner.store import disk_errors, write_json


@dataclass(frozen=True)
class Workspace:
    """Paths of an identification.

    Attributes:
        out: Its folder.
    """

    out: Path

    @property
    def data(self) -> Path:
        """Data set made of photographs."""
        return self.out / "data"

    @property
    def data_record(self) -> Path:
        """Record of the inputs of the data set."""
        return self.out / "data.json"

    @property
    def run(self) -> Path:
        """Results folder of the fits."""
        return self.out / "run"

    @property
    def fits_record(self) -> Path:
        """Record of which cell holds which fit."""
        return self.out / "fits.json"

    @property
    def diagnosis(self) -> Path:
        """Documents and pages of the diagnosis."""
        return self.out / "diagnosis"

    @property
    def diagnosis_record(self) -> Path:
        """Record of the inputs of the diagnosis."""
        return self.diagnosis / "inputs.json"

    @property
    def document(self) -> Path:
        """The answer."""
        return self.out / "identify.json"

    @property
    def table(self) -> Path:
        """The answer as a table, a row for each fabric."""
        return self.out / "identify.csv"

    @property
    def page(self) -> Path:
        """The answer to be read."""
        return self.out / "identify.html"

    def prepare(self) -> None:
        """Creates the folder.

        Raises:
            IdentifyError: It is a file, or lies under one.
            RunnerError: It cannot be written.
        """
        try:
            with disk_errors(self.out):
                self.out.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            raise IdentifyError(f"--out {self.out} is (or lies under) a file; choose a folder") from error


def fingerprint(content: Mapping[str, Any], files: Iterable[Path] = ()) -> str:
    """Hash of all that a part is made of.

    Args:
        content: Options and whatever else can be written as JSON.
        files: Files that it is made of; their content counts, and their names.

    Returns:
        64 hexadecimal digits.
    """
    digest = hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode())
    for path in files:
        with path.open("rb") as file:
            digest.update(f"\n{path.name} {hashlib.file_digest(file, 'sha256').hexdigest()}".encode())
    return digest.hexdigest()


def recorded(record: Path) -> dict[str, Any]:
    """What a record says, whatever its part was made of.

    Args:
        record: The file.

    Returns:
        Its content; empty where it is something else, damaged or not there.
    """
    try:
        found = read_json_object(record, remedy="")
    except BadFile:
        return {}
    return found if "inputs" in found else {}


def kept(record: Path, key: str) -> dict[str, Any] | None:
    """Record of a finished part.

    Args:
        record: Its record.
        key: Hash of what it would be made of now.

    Returns:
        Its record; None where it is of something else, damaged or not there, so that the part has to be made.
    """
    found = recorded(record)
    return found if found.get("inputs") == key else None


def edited(folder: Path, written: Mapping[str, str]) -> list[str]:
    """Files of a folder that were changed, added or removed since it was written.

    Args:
        folder: The folder.
        written: Its `digests_below` of then.

    Returns:
        Their paths, relative to it.
    """
    present = digests_below(folder)
    return sorted(name for name in written.keys() | present.keys() if written.get(name) != present.get(name))


def keep(record: Path, key: str, content: Mapping[str, Any]) -> None:
    """Says that a part is finished.

    Args:
        record: Its record, written whole or not at all.
        key: Hash of what it was made of.
        content: What else it says of itself.
    """
    with disk_errors(record.parent):
        write_json(record, {"inputs": key, **content})
