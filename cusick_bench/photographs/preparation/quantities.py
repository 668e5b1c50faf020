"""Lengths and weights as people write them: 300 mm, 11.8 in, 180 g/m2, 5.3 oz/yd2."""

import math
import re

from cusick_bench.photographs.errors import BadPhotograph

LENGTHS = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "um": 1e-6,
    "µm": 1e-6,
    "in": 0.0254,
    "inch": 0.0254,
    "inches": 0.0254,
    '"': 0.0254,
}
WEIGHTS = {
    "kg/m2": 1.0,
    "g/m2": 1e-3,
    "gsm": 1e-3,
    "oz/yd2": 0.028349523125 / 0.9144**2,
    "oz/sqyd": 0.028349523125 / 0.9144**2,
    "mg/cm2": 1e-2,
}
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(\S.*?)\s*", re.IGNORECASE | re.ASCII)


def quantity(text: str, units: dict[str, float], name: str, example: str) -> float:
    """Reads a number with its unit.

    Args:
        text: Such as "300 mm".
        units: Units that are understood, with what one of them is in SI units.
        name: What is measured, for the message.
        example: A usual quantity of that kind, for the message.

    Returns:
        The value in SI units.

    Raises:
        BadPhotograph: No number, not above 0, or no unit that is understood.
    """
    plain = " ".join(text.split())  # spreadsheets write blanks that do not break
    found = _QUANTITY.fullmatch(plain.replace("²", "2").replace("^2", "2").replace("μ", "u"))
    unit = found.group(2).lower().replace(" ", "") if found else ""
    value = float(found.group(1)) if found else math.nan
    if unit not in units or not (value > 0 and math.isfinite(value)):
        raise BadPhotograph(
            f"{name} must be a number > 0 with a unit ({', '.join(units)}), got {text[:40]!r}",
            remedy=f'write it as "{example}"',
            kind="bad-quantity",
        )
    return value * units[unit]
