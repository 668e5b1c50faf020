"""Areal density and thickness of fabrics: a table that the user supplies, and the five values that are published."""

import math
import re
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path

from cusick_bench.datasets.errors import BadTable
from cusick_bench.files import BadFile, read_csv
from cusick_bench.sim.constants import HEAVIEST_CLOTH, LIGHTEST_CLOTH, THICKEST_CLOTH, THINNEST_CLOTH

FILE = "fabrics.csv"
_MAXIMUM_BYTES = 1 << 20
_REQUIRED = ("fabric", "areal_density_kg_m2")
_COLUMNS = ("fabric", "areal_density_kg_m2", "thickness_m")
_THICKNESSES = (THINNEST_CLOTH, THICKEST_CLOTH)
_DENSITIES = (LIGHTEST_CLOTH, HEAVIEST_CLOTH)
_NUMBERED = re.compile(r"(?:fabric_*)?(\d{1,18})(?:\.0+)?(_observations)?")  # a spreadsheet's 2 may be 2.0
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Fabric:
    """Row of a table for one fabric.

    Attributes:
        areal_density: [kg/m2], NaN if unknown.
        thickness: [m], NaN if unknown.
        source: File and line, or publication, that the values are from.
        extra: Other columns, as found.
    """

    areal_density: float = math.nan
    thickness: float = math.nan
    source: str = ""
    extra: dict[str, str] = field(default_factory=dict)


def fabric_key(name: str) -> str:
    """One spelling for a fabric: `2`, `2.0`, `Fabric 2` and `fabric_02` are all `fabric_2`; other names in lower case.

    Blanks may be of any kind, such as the unbreakable ones of spreadsheets, and accents composed or not.

    Args:
        name: Name of a fabric as somebody wrote it.

    Returns:
        The key under which tables hold it.
    """
    key = "_".join(unicodedata.normalize("NFC", name.lower()).split()).replace("-", "_")
    numbered = _NUMBERED.fullmatch(key)
    return f"fabric_{int(numbered[1])}{numbered[2] or ''}" if numbered else key


def fabric_name(number: int, cloth: str) -> str:
    """Name of the fabric that a set shows: its number, or the set's name where it has none.

    Args:
        number: Number of the fabric; 0 of a named set whose captures are not there.
        cloth: Name of the set.

    Returns:
        The name, the same for all sets of a fabric, spelt as `fabric_key` does.
    """
    return f"fabric_{number}" if number else cloth


def read_fabrics(path: Path) -> dict[str, Fabric]:
    """Reads `fabric,areal_density_kg_m2,thickness_m,...`; an empty field means unknown.

    Args:
        path: The table.

    Returns:
        Fabrics by `fabric_key`.

    Raises:
        BadTable: Missing columns, a fabric given twice, or a density or thickness that is <= 0, not a number or
            clearly in another unit; file and line are named.
    """
    try:
        found = read_csv(path, remedy="write it as UTF-8 with commas", required=_REQUIRED, most_bytes=_MAXIMUM_BYTES)
    except BadFile as error:
        raise _bad(error.where, error.what, error.remedy) from error
    table: dict[str, Fabric] = {}
    for number, cells in found.rows:
        key = fabric_key(cells["fabric"])
        if not key or key in table:
            raise _bad(f"{path}, line {number}", f"fabric {cells['fabric']!r} is empty or given twice", "correct it")
        where = f"{path}, line {number}"
        table[key] = Fabric(
            _value(cells.get("areal_density_kg_m2", ""), "areal density", "kg/m2", _DENSITIES, where),
            _value(cells.get("thickness_m", ""), "thickness", "m", _THICKNESSES, where),
            where,
            {name: cell for name, cell in cells.items() if name not in _COLUMNS},
        )
    return table


def _value(text: str, name: str, unit: str, limits: tuple[float, float], where: str) -> float:
    if not text:
        return math.nan
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not value > 0:
        raise _bad(where, f"{name} must be a number > 0 {unit}, got {text[:40]}", "correct it or leave the field empty")
    least, most = limits
    if value < least:
        raise _bad(where, f"{name} must be at least {least} {unit}, got {text[:40]}", f"give it in {unit}")
    if value > most:
        raise _bad(where, f"{name} must be at most {most} {unit}, got {text[:40]}", f"give it in {unit}")
    return value


def _bad(where: object, what: str, remedy: str) -> BadTable:
    return BadTable(what, where=where, remedy=remedy, kind="fabrics-invalid")
