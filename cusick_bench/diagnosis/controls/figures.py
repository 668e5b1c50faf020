"""Shares of hits and of false alarms, each with a 95 % interval.

Controls of one fabric tend to go well or badly together. So the interval is Wilson's, of as many cases as the scatter
between fabrics leaves: their number over the design effect (Rao and Scott), where that exceeds 1. Where a share is 0 or
1, or every fabric has one case, nothing shows the scatter and all cases count.

References:
    E. B. Wilson. Probable inference, the law of succession, and statistical inference. Journal of the American
        Statistical Association 22 (1927), 209.
    J. N. K. Rao, A. J. Scott. A simple method for the analysis of clustered binary data. Biometrics 48 (1992), 577.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from math import nan, sqrt
from statistics import NormalDist
from typing import Any, Literal

from cusick_bench.diagnosis.controls.judgement import Judgement
from cusick_bench.diagnosis.controls.reading import REFUSED

VISIBLE = 3.0  # standard errors by which the silhouettes must change to show what was planted
LEAST_HITS, MOST_REJECTED = 0.8, 0.1
"""Goals: share of hits at the larger strength, share of halves that are rejected."""


@dataclass(frozen=True)
class ControlFigure:
    """A share of judgements.

    Attributes:
        name: What is counted.
        level: Strength or level of the controls that are counted; "" for all.
        count: Number of judgements that are hits or false alarms: the numerator.
        cases: Number of judgements in all: the denominator.
        value, low, high: The share and the bounds of its 95 % interval; NaN without cases.
        goal: The goal in words; "" for no goal.
        reached: `yes`, `no`, or "" without goal or cases.
    """

    name: str
    level: str
    count: int
    cases: int
    value: float
    low: float
    high: float
    goal: str = ""
    reached: str = ""

    def record(self) -> dict[str, Any]:
        """The figure as a row of a table."""
        return asdict(self)


def figures(judgements: Sequence[Judgement]) -> list[ControlFigure]:
    """The shares over all fabrics.

    Args:
        judgements: Verdict on every control of every fabric.

    Returns:
        First the shares that have goals, then one for each control and strength, then false alarms.
    """
    planted = [one for one in judgements if one.kind == "planted"]
    larger = [one for one in planted if one.strength == "larger"]
    smaller = [one for one in planted if one.strength == "smaller"]
    visible = [one for one in larger if one.largest_shift >= VISIBLE]
    halves = [one for one in judgements if one.kind == "null" and one.hit]
    real = [one for one in judgements if one.kind == "real"]
    summary = [
        _hits("planted effects found", "larger", larger, "at least"),
        _hits("planted effects found, where silhouettes show them", "larger", visible),
        _hits("planted effects found", "smaller", smaller),
        _share(
            "strength of planted effects estimated, named or not",
            "larger",
            [(one.fabric, one.estimate_right == "yes") for one in larger if one.estimate_right],
        ),
        _share("halves of one face rejected", "", [(one.fabric, one.false_alarm) for one in halves], "at most"),
        _hits("known effects of the data found", "", real),
        _hits("pictures that are no drape left out", "", [one for one in judgements if one.kind == "slip"]),
        _share(
            "another effect named beside what was planted",
            "",
            [(one.fabric, one.false_alarm) for one in planted if one.verdict != REFUSED],
        ),
        _alarms("effects named that cannot be there", judgements, "absent"),
        _alarms("effects named for a mirrored face", judgements, "outside"),
    ]
    return [figure for figure in summary if figure.cases] + list(_by_control(judgements))


def _by_control(judgements: Sequence[Judgement]) -> Iterable[ControlFigure]:
    groups: dict[tuple[str, str], list[Judgement]] = {}
    for one in judgements:
        if one.hit:
            level = one.level if one.kind in ("planted", "outside") or one.strength else ""
            groups.setdefault((one.control, level), []).append(one)
    return (_hits(control, level, group) for (control, level), group in groups.items())


def _hits(name: str, level: str, judgements: Sequence[Judgement], goal: Literal["", "at least"] = "") -> ControlFigure:
    return _share(name, level, [(one.fabric, one.hit == "yes") for one in judgements if one.hit], goal)


def _alarms(name: str, judgements: Sequence[Judgement], kind: str) -> ControlFigure:
    return _share(name, "", [(one.fabric, one.false_alarm) for one in judgements if one.kind == kind and one.hit])


def _share(
    name: str, level: str, counted: Sequence[tuple[str, bool]], goal: Literal["", "at least", "at most"] = ""
) -> ControlFigure:
    """The share of cases, each given with its fabric, that count."""
    count, cases = sum(counts for _, counts in counted), len(counted)
    if not cases:
        return ControlFigure(name, level, 0, 0, nan, nan, nan)
    value = count / cases
    low, high = _wilson(value, cases / max(_design_effect(counted), 1.0))
    words, good = {
        "": ("", True),
        "at least": (f">= {100 * LEAST_HITS:g} %", value >= LEAST_HITS),
        "at most": (f"<= {100 * MOST_REJECTED:g} %", value <= MOST_REJECTED),
    }[goal]
    reached = "" if not goal else "yes" if good else "no"
    return ControlFigure(name, level, count, cases, value, low, high, words, reached)


def _design_effect(counted: Sequence[tuple[str, bool]]) -> float:
    """Variance of the share by the scatter between fabrics, over that of as many independent cases."""
    fabrics: dict[str, list[bool]] = {}
    for fabric, counts in counted:
        fabrics.setdefault(fabric, []).append(counts)
    cases, number = len(counted), len(fabrics)
    share = sum(counts for _, counts in counted) / cases
    if share in (0.0, 1.0) or not 1 < number < cases:
        return 1.0
    squares = sum((sum(one) - share * len(one)) ** 2 for one in fabrics.values())
    return number / (number - 1) * squares / (cases * share * (1 - share))


def _wilson(share: float, cases: float) -> tuple[float, float]:
    """95 % interval of a share of so many cases, which need not be a whole number."""
    z = NormalDist().inv_cdf(0.975)
    middle = share + z * z / (2 * cases)
    half = z * sqrt(share * (1 - share) / cases + (z / (2 * cases)) ** 2)
    whole = 1 + z * z / cases
    return max(0.0, (middle - half) / whole), min(1.0, (middle + half) / whole)
