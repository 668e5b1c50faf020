"""Measured fabrics that a cloth is compared with: quantiles of their bending stiffness and bending length.

Feng and others published the areal density and the bending stiffness of warp, weft and bias of 618 fabrics, from
cantilever tests. Their table has no licence that would allow shipping it. The shipped `measured_fabrics.csv` is derived
from it: nine quantiles of each quantity over all fabrics and over ranges of weight. It is made by

    cusick-bench data fabric-quantiles fabrics618.csv --out measured_fabrics.csv

Stiffness there is that of small curvatures. This project's value is a mean over curvatures up to 40 /m, where the same
fabrics are a tenth less stiff, which changes percentiles by 1 to 3. Drapes suggest that stiffness rises with curvature
(trait `hardening` in `cusick_bench.problem.cloth_prior`): percentiles at rest would be far lower.

References:
    Feng, Huang, Xu, Wang. Learning-Based Bending Stiffness Parameter Estimation by a Drape Tester. ACM TOG 41(6),
    2022 (the table).
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import inf, log
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Literal

import numpy as np

from cusick_bench.files import BadFile, CsvTable, read_csv
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.metrics.stiffness import BENDING, bending_length

if TYPE_CHECKING:
    from pandas import DataFrame

SHIPPED = Path(__file__).with_name("measured_fabrics.csv")
"""The shipped quantiles."""

Quantity = Literal["bending", "bending_length"]
QUANTITIES: dict[Quantity, str] = {"bending": "N m", "bending_length": "m"}
"""What is compared, and its unit in the table."""

DIRECTIONS = (*BENDING, "mean")
"""Warp, weft and bias, and the geometric mean of warp and weft."""

LEVELS = (0.01, 0.05, 0.10, 0.25, 0.50, 0.75, 0.90, 0.95, 0.99)
"""Shares of fabrics below each quantile."""

WEIGHTS = (0.0, 0.08, 0.14, 0.20, 0.26, 0.35, inf)
"""Bounds of the ranges of weight [kg/m2]: each holds 78 to 125 of the 618 fabrics, enough for their quantiles."""

_COLUMNS = ("density", "linear warp", "linear weft", "linear diag")  # how columns of the published table begin
_LINEAR_UNIT = 1e-9  # [N m] of the published table's stiffness
_LEAST_FABRICS = 20  # in a range of weight: of fewer no quantiles are given
_SCORES = tuple(NormalDist().inv_cdf(level) for level in LEVELS)
_KEYS = ("quantity", "direction", "least_kg_m2", "most_kg_m2", "fabrics")
_QUANTILES = tuple(f"q{100 * level:02.0f}" for level in LEVELS)


@dataclass(frozen=True)
class FabricRange:
    """Quantiles of one quantity over a group of fabrics.

    Attributes:
        quantity: Bending stiffness or bending length.
        direction: One of `DIRECTIONS`.
        least: Weight from which fabrics belong to the group [kg/m2]; 0 of all.
        most: Weight below which they do [kg/m2]; infinity of all.
        fabrics: How many there are.
        quantiles: Values [N m or m], one for each of `LEVELS`; none falls below the one before.
    """

    quantity: Quantity
    direction: str
    least: float
    most: float
    fabrics: int
    quantiles: tuple[float, ...]

    def percent_below(self, value: float) -> float:
        """Share of the group's fabrics that lie below a value.

        Between quantiles the logarithm is interpolated over the normal score of the share, which is exact where it is
        normal. Beyond the outer quantiles nothing is known but the bound.

        Args:
            value: The value, > 0 [N m or m].

        Returns:
            The share, from 1 (which may be less) to 99 (which may be more) [%].
        """
        if value <= self.quantiles[0]:
            return 100 * LEVELS[0]
        if value >= self.quantiles[-1]:
            return 100 * LEVELS[-1]
        score = float(np.interp(log(value), np.log(self.quantiles), _SCORES))
        return 100 * NormalDist().cdf(score)


@cache
def fabric_ranges(path: Path = SHIPPED) -> tuple[FabricRange, ...]:
    """Reads quantiles.

    Args:
        path: Table as `fabric_quantiles` makes it; the shipped one by default.

    Returns:
        A range for each quantity, direction and group of fabrics.

    Raises:
        BadFile: The table cannot be read, or a number in it is none.
    """
    remedy = "make it again with `cusick-bench data fabric-quantiles`"
    found = read_csv(path, remedy=remedy, required=(*_KEYS, *_QUANTILES), comment="#")
    return tuple(_range(path, number, cells, remedy) for number, cells in found.rows)


def _range(path: Path, number: int, cells: dict[str, str], remedy: str) -> FabricRange:
    quantity: Quantity | None = next((one for one in QUANTITIES if one == cells["quantity"]), None)
    try:
        least, most = (float(cells[name]) for name in ("least_kg_m2", "most_kg_m2"))
        fabrics, quantiles = int(cells["fabrics"]), tuple(float(cells[name]) for name in _QUANTILES)
    except ValueError as error:
        raise BadFile(f"{path}, line {number}", str(error), remedy) from error
    if quantity is None or cells["direction"] not in DIRECTIONS or quantiles[0] <= 0 or (np.diff(quantiles) < 0).any():
        what = "needs a known quantity and direction, and quantiles > 0 that do not fall"
        raise BadFile(f"{path}, line {number}", what, remedy)
    return FabricRange(quantity, cells["direction"], least, most, fabrics, quantiles)


def compared_ranges(quantity: Quantity, direction: str, areal_density: float) -> tuple[FabricRange, FabricRange]:
    """Ranges of fabrics for the comparison with a fabric.

    Args:
        quantity: Bending stiffness or bending length.
        direction: One of `DIRECTIONS`.
        areal_density: The fabric's mass per area [kg/m2].

    Returns:
        The range of all fabrics, and that of fabrics of similar weight.
    """
    ranges = [one for one in fabric_ranges() if (one.quantity, one.direction) == (quantity, direction)]
    (every,) = (one for one in ranges if (one.least, one.most) == (WEIGHTS[0], WEIGHTS[-1]))
    (similar,) = (one for one in ranges if one is not every and one.least <= areal_density < one.most)
    return every, similar


def quantile_table(path: Path) -> str:
    """Text of the shipped table, made from the published one.

    Args:
        path: See `fabric_quantiles`.

    Returns:
        Two lines that say what it is, then CSV.

    Raises:
        BadFile: See `fabric_quantiles`.
        IdentifyError: See `fabric_quantiles`.
    """
    from cusick_bench.files.csv_text import csv_text

    table = fabric_quantiles(path)
    return (
        f"# Quantiles of {table['fabrics'].max()} fabrics (Feng, Huang, Xu, Wang, ACM TOG 41(6), 2022): bending "
        f"stiffness [N m] and bending length [m].\n# Made by: cusick-bench data fabric-quantiles {path.name}\n"
        f"{csv_text(table, float_format='%.4g')}"
    )


def are_shipped(text: str, shipped: Path = SHIPPED) -> bool:
    """Whether a table holds the quantiles that fabrics are compared with.

    Args:
        text: From `quantile_table`.
        shipped: The table in use.

    Returns:
        True for the same numbers, whatever the file that they were made from is called.
    """
    ours, theirs = (
        [line for line in table.splitlines() if not line.startswith("#")]
        for table in (shipped.read_text(encoding="utf-8"), text)
    )
    return ours == theirs


def fabric_quantiles(path: Path) -> "DataFrame":
    """Makes the table of quantiles from the published table.

    Args:
        path: Its columns begin with density [kg/m2], linear warp, linear weft and linear diag [1e-9 N m].

    Returns:
        The table, a row for each quantity, direction and group of fabrics.

    Raises:
        BadFile: The published table cannot be read, or lacks a column.
        IdentifyError: A number is missing or not positive, or a range of weight holds too few fabrics.
    """
    from pandas import DataFrame

    density, *bending = _published(path)
    directions = dict(zip(DIRECTIONS, (*bending, np.sqrt(bending[0] * bending[1])), strict=True))
    rows = []
    for least, most in ((WEIGHTS[0], WEIGHTS[-1]), *pairwise(WEIGHTS)):
        chosen = (density >= least) & (density < most)
        if chosen.sum() < _LEAST_FABRICS:
            raise IdentifyError(
                f"{path}: {chosen.sum()} fabrics weigh {least:g} to {most:g} kg/m2, and quantiles need "
                f"{_LEAST_FABRICS} at least; give the whole table"
            )
        for direction, stiffness in directions.items():
            length = bending_length(stiffness, density)
            for quantity, values in zip(QUANTITIES, (stiffness, length), strict=True):
                quantiles = zip(_QUANTILES, np.quantile(values[chosen], LEVELS), strict=True)
                keys = zip(_KEYS, (quantity, direction, least, most, int(chosen.sum())), strict=True)
                rows.append({**dict(keys), **dict(quantiles)})
    return DataFrame(rows)


def _published(path: Path) -> list[np.ndarray]:
    """Density [kg/m2], and stiffness of warp, weft and bias [N m], of every fabric of the published table."""
    found = read_csv(path, remedy="give the published table of fabrics (see docs/drape-meter.md)")
    columns = [np.array([_positive(path, found, line, begin) for line in found.rows]) for begin in _COLUMNS]
    return [columns[0], *(_LINEAR_UNIT * column for column in columns[1:])]


def _positive(path: Path, found: CsvTable, line: tuple[int, dict[str, str]], begin: str) -> float:
    name = next((name for name in found.header if name.lower().startswith(begin)), None)
    if name is None:
        what = f"needs a column whose name begins with {begin!r}"
        raise BadFile(path, what, "give the published table of fabrics (see docs/drape-meter.md)")
    number, cells = line
    try:
        value = float(cells[name])
    except ValueError:
        value = 0.0
    if not 0 < value < inf:
        raise IdentifyError(f"{path}, line {number}: {name} must be a number > 0, got {cells[name][:40]!r}; correct it")
    return value
