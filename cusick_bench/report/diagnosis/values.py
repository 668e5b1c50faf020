"""Reading a diagnosis' document without trusting it: what is missing, odd or not finite is read as unknown."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

UNKNOWN = "–"  # shown where a value is not known
_SPACE = "\u00a0"  # keeps a number and its unit on one line


def mapping(value: Any) -> Mapping[str, Any]:
    """The value, or an empty mapping where it is none."""
    return value if isinstance(value, Mapping) else {}


def items(value: Any) -> Sequence[Any]:
    """The value, or an empty sequence where it is no list."""
    return value if isinstance(value, list | tuple) else ()


def mappings(value: Any) -> list[Mapping[str, Any]]:
    """The mappings in a list."""
    return [one for one in items(value) if isinstance(one, Mapping)]


def text(value: Any) -> str:
    """A text as one line, a finite number as text, "" for anything else."""
    if not isinstance(value, str):
        value = "" if number(value) is None else f"{value:g}"
    return " ".join(value.split())


def texts(value: Any) -> list[str]:
    """The lines in a list."""
    return [line for line in map(text, items(value)) if line]


def number(value: Any) -> float | None:
    """The value, or None where it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return None
    try:
        return float(value) if isfinite(value) else None
    except OverflowError:  # an integer of more than 300 digits
        return None


def pair(value: Any) -> tuple[float, float] | None:
    """Two finite numbers, or None."""
    found = [number(one) for one in items(value)]
    return (found[0], found[1]) if len(found) == 2 and found[0] is not None and found[1] is not None else None


def table(value: Any, rows: int, columns: int) -> Float[ndarray, "rows columns"] | None:
    """A table of finite numbers, or None where its shape is another."""
    found = [[number(one) for one in items(row)] for row in items(value)]
    if len(found) != rows or any(len(row) != columns or None in row for row in found):
        return None
    return np.array(found, dtype=np.float64)


def percent(share: float | None, digits: int = 0) -> str:
    """A share in per cent; what is not quite nothing or all is not rounded to it."""
    if share is None:
        return UNKNOWN
    least = 10.0 ** (-digits) / 2
    if 0 < 100 * share < least:
        return f"<{_SPACE}{2 * least:g}{_SPACE}%"
    if 100 - least < 100 * share < 100:
        return f">{_SPACE}{100 - 2 * least:g}{_SPACE}%"
    return signed(f"{100 * share:.{digits}f}{_SPACE}%")


def plain(value: float | None, digits: int = 2) -> str:
    """A number with so many significant digits, and no exponent but for monsters."""
    if value is None:
        return UNKNOWN
    if value == 0:
        return "0"
    if not 1e-9 < abs(value) < 1e9:
        return signed(f"{value:.{digits - 1}e}")
    places = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return signed(f"{value:.{places}f}")


def measure(value: float | None, unit: str, digits: int = 2) -> str:
    """A number with its unit; lengths in millimetres, angles with a degree sign."""
    if value is None:
        return UNKNOWN
    if unit.startswith("m") and unit in ("m", "m/rad"):
        return f"{plain(1e3 * value, digits)}{_SPACE}m{unit}"
    if unit == "deg":
        return f"{signed(f'{value:.{0 if abs(value) >= 10 else 1}f}')}°"
    return plain(value, digits) + ("" if unit in ("", "1") else f"{_SPACE}{unit}")


def signed(digits: str) -> str:
    """With a true minus sign, and none before a zero."""
    bare = digits.lstrip("-")
    if digits.startswith("-") and any(one in "123456789" for one in bare):
        return "−" + bare
    return bare
