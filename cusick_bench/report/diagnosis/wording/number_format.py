"""Numbers as the page shows them: rounded, but never to a misleading 0 % or 100 %, with their units."""

import numpy as np

from cusick_bench.sim.units import shown_unit

UNKNOWN = "–"  # shown where a value is not known
_SPACE = "\u00a0"  # keeps a number and its unit on one line


def percent(share: float | None, digits: int = 0) -> str:
    """A share in per cent; a share near 0 or 1 is not rounded to 0 % or 100 %.

    Args:
        share: The share, None if unknown.
        digits: Number of decimals.

    Returns:
        Such as "31 %" or "< 1 %".
    """
    if share is None:
        return UNKNOWN
    least = 10.0 ** (-digits) / 2
    if 0 < 100 * share <= least:
        return f"<{_SPACE}{2 * least:g}{_SPACE}%"
    if 100 - least <= 100 * share < 100:
        return f">{_SPACE}{100 - 2 * least:g}{_SPACE}%"
    return signed(f"{100 * share:.{digits}f}{_SPACE}%")


def plain(value: float | None, digits: int = 2) -> str:
    """A number without exponent, unless it is below 1e-9 or above 1e9.

    Args:
        value: The number, None if unknown.
        digits: Significant digits.

    Returns:
        Such as "0.087" or "−12".
    """
    if value is None:
        return UNKNOWN
    if value == 0:
        return "0"
    if not 1e-9 < abs(value) < 1e9:
        return signed(f"{value:.{digits - 1}e}")
    places = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return signed(f"{value:.{places}f}")


def measure(value: float | None, unit: str, digits: int = 2) -> str:
    """A number with its unit; lengths in millimetres, angles with a degree sign.

    Args:
        value: The number in its unit, None if unknown.
        unit: The unit; "" or "1" for a pure number.
        digits: Significant digits.

    Returns:
        Such as "2.1 mm" or "40°".
    """
    if value is None:
        return UNKNOWN
    if unit.startswith("m") and unit in ("m", "m/rad"):
        return f"{plain(1e3 * value, digits)}{_SPACE}m{unit}"
    if unit == "deg":
        return f"{signed(f'{value:.{0 if abs(value) >= 10 else 1}f}')}°"
    shown = shown_unit(unit)
    return plain(value, digits) + (f"{_SPACE}{shown}" if shown else "")


def signed(digits: str) -> str:
    """A formatted number with a true minus sign, and none before a zero.

    Args:
        digits: The number as Python formats it.

    Returns:
        Such as "−0.5".
    """
    bare = digits.lstrip("-")
    if digits.startswith("-") and any(one in "123456789" for one in bare):
        return "−" + bare
    return bare
