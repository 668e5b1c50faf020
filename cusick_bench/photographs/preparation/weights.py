"""Weights and thicknesses of the fabrics: from options, or from a table that people fill in, in their own units."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from cusick_bench.datasets.files.fabrics import fabric_key
from cusick_bench.files import BadFile, read_csv
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.quantities import LENGTHS, WEIGHTS, quantity
from cusick_bench.sim.constants import HEAVIEST_CLOTH, LIGHTEST_CLOTH, THICKEST_CLOTH, THINNEST_CLOTH

TABLE = "weights.csv"
_MOST_BYTES = 1 << 20


def template(fabrics: Sequence[int]) -> str:
    """A table to fill in.

    Args:
        fabrics: Numbers of the fabrics.

    Returns:
        Its text.
    """
    return "fabric,weight,thickness\n" + "".join(f"{number},,\n" for number in fabrics)


def read_weights(path: Path) -> tuple[dict[int, float], dict[int, float]]:
    """Reads a table `fabric,weight,thickness`, such as `1,5.3 oz/yd2,0.4 mm`; empty fields are not known.

    Args:
        path: The table.

    Returns:
        Areal density [kg/m2] and thickness [m] by fabric.

    Raises:
        BadPhotograph: Not such a table; the line is named.
    """
    try:
        found = read_csv(
            path, remedy="write it as UTF-8 with commas", required=("fabric", "weight"), most_bytes=_MOST_BYTES
        )
    except BadFile as error:
        raise BadPhotograph(error.what, where=error.where, remedy=error.remedy, kind="bad-table") from error
    weights: dict[int, float] = {}
    thicknesses: dict[int, float] = {}
    named: set[int] = set()
    for line, cells in found.rows:
        text = fabric_key(cells["fabric"]).removeprefix("fabric").strip("_")
        where = f"{path}, line {line}"
        if not (text.isascii() and text.isdecimal()):
            raise BadPhotograph(
                f"fabric must be a number, got {cells['fabric'][:40]!r}",
                where=where, remedy="write the number in the pictures' names", kind="bad-table",
            )  # fmt: skip
        if int(text) in named:
            raise BadPhotograph(f"fabric {text} is given twice", where=where, remedy="keep one line", kind="bad-table")
        named.add(int(text))
        try:
            if cells["weight"].strip():
                weights[int(text)] = weight(cells["weight"])
            if cells.get("thickness", "").strip():
                thicknesses[int(text)] = thickness(cells["thickness"])
        except BadPhotograph as error:
            raise BadPhotograph(error.what, where=where, remedy=error.remedy, kind=error.kind) from error
    return weights, thicknesses


def weight(text: str) -> float:
    """Reads a weight.

    Args:
        text: Such as "180 g/m2" or "5.3 oz/yd2".

    Returns:
        Areal density [kg/m2].

    Raises:
        BadPhotograph: Not understood, or no cloth's.
    """
    return _within(quantity(text, WEIGHTS, "weight", "180 g/m2"), (LIGHTEST_CLOTH, HEAVIEST_CLOTH), "kg/m2", text)


def thickness(text: str) -> float:
    """Reads a thickness.

    Args:
        text: Such as "0.4 mm".

    Returns:
        Thickness [m].

    Raises:
        BadPhotograph: Not understood, or no cloth's.
    """
    return _within(quantity(text, LENGTHS, "thickness", "0.4 mm"), (THINNEST_CLOTH, THICKEST_CLOTH), "m", text)


def _within(value: float, bounds: tuple[float, float], unit: str, text: str) -> float:
    if not bounds[0] <= value <= bounds[1]:
        raise BadPhotograph(
            f"{text.strip()[:40]} are {value:.4g} {unit}; cloths have {bounds[0]:g} to {bounds[1]:g} {unit}",
            remedy="correct the number or its unit",
            kind="bad-quantity",
        )
    return value


def weights_of_options(
    texts: Sequence[str], fabrics: Sequence[int], table: Mapping[int, float] | None = None
) -> dict[int, float]:
    """Reads the values of `--weight`: one for all fabrics that have none of their own, or NUMBER=VALUE.

    Args:
        texts: Values as given.
        fabrics: Fabrics of the pictures.
        table: Areal density by fabric as a table has it [kg/m2]; NUMBER=VALUE goes before it.

    Returns:
        Areal density by fabric [kg/m2].

    Raises:
        BadPhotograph: A value or a fabric that is not there, or two values for the same.
    """
    common: dict[int, float] = {}
    found: dict[int, float] = {}
    for text in texts:
        number, equals, value = text.partition("=")
        named = int(number) if number.strip().isascii() and number.strip().isdecimal() else 0
        second = named in found if equals else bool(common)
        if second:
            raise BadPhotograph(
                f"--weight {text!r} is a second weight {f'of fabric {named}' if equals else 'of all fabrics'}",
                remedy="keep one of them", kind="bad-quantity",
            )  # fmt: skip
        if not equals:
            common = dict.fromkeys(fabrics, weight(text))
        elif named in fabrics:
            found[named] = weight(value)
        else:
            raise BadPhotograph(
                f"--weight {text!r} is for a fabric that no picture shows",
                remedy=f"fabrics are {', '.join(map(str, fabrics))}",
                kind="bad-quantity",
            )
    return common | dict(table or {}) | found
