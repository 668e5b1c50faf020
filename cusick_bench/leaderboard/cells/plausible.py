"""Checks of a row: names must not be empty, and metrics must lie within the limits that their meaning sets.

A mean squared error of coverages lies in [0, 1], a distance is not negative, a drape coefficient is no further outside
[0, 1] than a silhouette may be that `cusick_bench.datasets.impossible` lets pass. A number outside is a fault of a file
or of a program, never a score, and would rank first.
"""

import re
from math import inf, isfinite, isnan
from typing import Any

_NOWHERE = ("", "nan", "none", "null", "undefined")
_SLACK = 1e-9  # of rounding, beyond a limit
_TALLEST = 10.0  # [m]: no drape is larger
_LEAST_DC, _MOST_DC = -0.6, 2.5
"""Limits of a drape coefficient by a scale that may be wrong. Silhouettes are used that hold a circle of .75 of the
plate and reach to 1.2 of the flat cloth: -.56 to 2.01 for the standard's cloth of 24 cm. A whole picture of the release
has 2.2, by `--force`."""
_LIMITS = tuple(
    (re.compile(pattern), low, high)
    for pattern, low, high in (
        (r"(^|_)mse($|_)|_iou($|_)|_cover_\d+$|_p$", 0.0, 1.0),
        (r"_m$", 0.0, _TALLEST),
        (r"_dc(_target)?$", _LEAST_DC, _MOST_DC),
        (r"_dc_(error|crps)$", 0.0, _MOST_DC - _LEAST_DC),
        (r"_folds($|_)", 0.0, 180.0),  # a fold a degree and a valley between them
        (r"energy_distance|variogram_score", -10.0, inf),  # unbiased, so that they may lie a little below 0
        (r"^spent_|^draws$|_score$|_bias$", 0.0, inf),
    )
)


def implausible(name: str, value: float) -> str:
    """Why a value of a metric is none.

    Args:
        name: Name of the metric or cost.
        value: Its value; NaN stands for one that was not measured.

    Returns:
        The rule and the value; "" where the value is one.
    """
    if isnan(value):
        return ""
    if not isfinite(value):
        return f"{name} must be finite, got {value}"
    for pattern, low, high in _LIMITS:
        if pattern.search(name):
            if low - _SLACK <= value <= high + _SLACK:
                return ""
            limits = f"lie in [{low:g}, {high:g}]" if isfinite(high) else f"be at least {low:g}"
            return f"{name} must {limits}, got {value:g}"
    return ""


def largest(name: str) -> float:
    """Largest value that a metric or cost can have.

    Args:
        name: Its name.

    Returns:
        The value; infinity where there is none.
    """
    return next((high for pattern, _, high in _LIMITS if pattern.search(name)), inf)


def name_of(what: str, value: Any) -> str:
    """A name that stands in a file.

    Args:
        what: What it names, such as `solver`.
        value: Value in the file.

    Returns:
        The name.

    Raises:
        ValueError: It is none, but empty, null or no text.
    """
    if not isinstance(value, str) or value.strip().lower() in _NOWHERE:
        raise ValueError(f"{what} must be a name, got {value!r}")
    return value


def whole_number_of(name: str, value: Any) -> int:
    """A seed, or another number >= 0 of at most 18 digits, that stands in a file.

    Args:
        name: What it is.
        value: What the file holds: a whole number, or its text.

    Returns:
        The number.

    Raises:
        ValueError: It is no whole number of at least 0.
    """
    text = str(value).strip()
    if isinstance(value, bool) or not re.fullmatch(r"\d{1,18}(\.0+)?", text):
        raise ValueError(f"{name} must be a whole number >= 0, got {value!r}")
    return int(text.partition(".")[0])


def metric_of(name: str, value: Any) -> float:
    """A metric that stands in a file.

    Args:
        name: Name of the metric.
        value: What the file holds; None or an empty text where it was not measured.

    Returns:
        The number; NaN where it was not measured.

    Raises:
        ValueError: It is no number, or one that this metric cannot have.
    """
    if value is None or value == "":
        return float("nan")
    try:
        if isinstance(value, bool):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} must be a number, got {value!r}") from error
    if isnan(number):
        raise ValueError(f"{name} must be finite, got {value}")
    if rule := implausible(name, number):
        raise ValueError(rule)
    return number
