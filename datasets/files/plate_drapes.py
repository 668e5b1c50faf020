"""Reference drapes of an ideal elastic plate: a table of static drapes that any consistent simulator converges to.

    folds,ln_bending,poisson,drape_coefficient,rim_min_mm,rim_max_mm,rim_lowest_mm,accuracy

A row is one drape of a disc on the standard's plate: bending stiffness exp(ln_bending) in units of rho g R^3, Poisson's
ratio, and the number of folds with which it was laid down; then its drape coefficient, the least and largest radius and
the lowest height of its rim, and the error that the coefficient has itself. Rows without folds are axisymmetric.
`cusick_bench.benchmark.convergence.reference` simulates them.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from cusick_bench.datasets.errors import BadTable
from cusick_bench.files import BadFile, read_csv

COLUMNS = (
    "folds", "ln_bending", "poisson", "drape_coefficient", "rim_min_mm", "rim_max_mm", "rim_lowest_mm", "accuracy",
)  # fmt: skip
_MOST_BYTES = 1 << 20
_MOST_FOLDS = 24
_LIMITS = {
    "folds": (0, _MOST_FOLDS),
    "ln_bending": (-12, 4),
    "poisson": (-0.99, 0.99),
    "drape_coefficient": (0, 1),
    "rim_min_mm": (0, 1000),
    "rim_max_mm": (0, 1000),
    "rim_lowest_mm": (-1000, 0),
    "accuracy": (0, 0.1),
}
"""Least and largest value of each column: beyond them a value has another unit or stands in another column."""


@dataclass(frozen=True)
class PlateDrape:
    """One reference drape.

    Attributes:
        folds: Number of folds with which the cloth was laid down; 0 for the flat cloth.
        ln_bending: ln of bending stiffness over rho g R^3.
        poisson: Poisson's ratio of the bending.
        drape_coefficient: Drape coefficient of the projected rim.
        rim_min_mm, rim_max_mm: Least and largest radius of the projected rim [mm].
        rim_lowest_mm: Lowest height of the rim [mm], negative below the plate.
        accuracy: Error of the reference's own drape coefficient.
    """

    folds: int
    ln_bending: float
    poisson: float
    drape_coefficient: float
    rim_min_mm: float
    rim_max_mm: float
    rim_lowest_mm: float
    accuracy: float


def read_plate_drapes(path: Path) -> tuple[PlateDrape, ...]:
    """Reads reference drapes.

    Args:
        path: The table, CSV.

    Returns:
        The drapes, in the order of the file.

    Raises:
        BadTable: It is no such table, has no row, or a row is given twice or cannot be a drape; file and line are
            named.
    """
    try:
        found = read_csv(
            path, remedy="give a table of reference drapes", required=COLUMNS, comment="#", most_bytes=_MOST_BYTES
        )
    except BadFile as error:
        raise _bad(error.where, error.what, error.remedy) from error
    drapes: dict[tuple[int, float, float], PlateDrape] = {}
    for number, cells in found.rows:
        where = f"{path}, line {number}"
        drape = _drape({name: _number(cells[name], name, where) for name in COLUMNS}, where)
        key = (drape.folds, drape.ln_bending, drape.poisson)
        if key in drapes:
            what = f"has the drape of {key[0]} folds, ln_bending {key[1]:g} and poisson {key[2]:g} again"
            raise _bad(where, what, "keep one of them")
        drapes[key] = drape
    if not drapes:
        raise _bad(path, "has no drape", "give at least one row below the names of the columns")
    return tuple(drapes.values())


def _number(text: str, name: str, where: str) -> float:
    low, high = _LIMITS[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise _bad(where, f"{name} must be a number from {low:g} to {high:g}, got {text[:40]!r}", "correct it")
    return value


def _drape(values: dict[str, float], where: str) -> PlateDrape:
    folds = values.pop("folds")
    if folds != int(folds):
        raise _bad(where, f"folds must be a whole number, got {folds:g}", "correct it")
    if values["rim_min_mm"] > values["rim_max_mm"]:
        least, most = values["rim_min_mm"], values["rim_max_mm"]
        raise _bad(where, f"rim_min_mm must not exceed rim_max_mm, got {least:g} and {most:g}", "correct them")
    return PlateDrape(int(folds), **values)


def _bad(where: object, what: str, remedy: str) -> BadTable:
    return BadTable(what, where=where, remedy=remedy, kind="plate-drapes-invalid")
