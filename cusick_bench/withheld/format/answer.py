"""An answer to a withheld case: verdict, causes with their probabilities, where it lies, how far the gap shrinks."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from typing import Any

import numpy as np

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format import causes, location
from cusick_bench.withheld.format.checked_json import listed, mapping, number, one_of, strings
from cusick_bench.withheld.format.location import Region

VERDICTS = ("none", "effect", "ambiguous", "unknown")
SET_LEVEL = 0.9
_ROUNDING = 1e-6
_DIRECTION = "direction"  # kind of a place that is none: of a tilt, say


@dataclass(frozen=True)
class Answer:
    """What was said of one case, blind.

    Attributes:
        verdict: One of `VERDICTS`.
        causes: Names with probabilities, the likeliest first; may hold "none" and "unknown".
        set90: Names among which the cause is with a probability of 90 %.
        p: p-value of the base model; NaN if not given.
        region: Where the effect acts; None if not said.
        peak: Where the map points; None if there is no map.
        localisable: Whether the answer says that the effect can be localised.
        closure: Share of the gap that the named effect closes; NaN if not given.
        closure_interval: Its 90 % interval.
        measurements: What to measure next.
        without: Effects that the answerer was not offered; their cases are out of its list.
        baselines: Answers of simpler methods to the same case.
    """

    verdict: str
    causes: tuple[tuple[str, float], ...]
    set90: tuple[str, ...]
    p: float = nan
    region: Region | None = None
    peak: Region | None = None
    localisable: bool = False
    closure: float = nan
    closure_interval: tuple[float, float] = (nan, nan)
    measurements: tuple[str, ...] = ()
    without: frozenset[str] = frozenset()
    baselines: Mapping[str, "Answer"] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[str, ...]:
        """Named effects, the likeliest first."""
        return tuple(name for name, _ in self.causes if name not in (causes.NONE, causes.UNKNOWN))

    @property
    def leading(self) -> str:
        """What the verdict amounts to: the likeliest effect, `none` or `unknown`."""
        if self.verdict in (causes.NONE, causes.UNKNOWN):
            return self.verdict
        return self.effects[0] if self.effects else causes.UNKNOWN

    @property
    def probability_of_none(self) -> float:
        """As stated; NaN where "none" is not among the causes."""
        return dict(self.causes).get(causes.NONE, nan)

    def probabilities(self) -> dict[str, float]:
        """Probability of every outcome; sums to 1.

        What the stated causes leave belongs to "none" (or to "unknown", if that is the verdict), else to the other of
        the two, else to all effects not named alike.
        """
        stated = dict(self.causes)
        rest = 1 - sum(stated.values())
        order = (causes.UNKNOWN, causes.NONE) if self.verdict == causes.UNKNOWN else (causes.NONE, causes.UNKNOWN)
        others = [name for name in order if name not in stated][:1]
        others = others or [name for name in causes.outcomes() if name not in stated]
        if rest > 0 and others:
            stated |= dict.fromkeys(others, rest / len(others))
        total = sum(stated.values())
        return {name: stated.get(name, 0.0) / total for name in causes.outcomes()}


def read_answer(found: Any, where: str) -> Answer:
    """Checks one answer of `answers.json`.

    Args:
        found: Its value in the document.
        where: File and case, for messages.

    Raises:
        WithheldError: What breaks the format.
    """
    entry = mapping(found, where)
    answer = _judgement(entry, where)
    if "set90" not in entry:
        raise WithheldError(f"{where}: an answer must hold set90, the names of its 90 % set; freeze the answers anew")
    found_baselines = mapping(entry.get("baselines") or {}, f"{where}: baselines")
    baselines = {name: _judgement(mapping(item, where), f"{where}: {name}") for name, item in found_baselines.items()}
    return replace(answer, baselines={name: replace(item, without=answer.without) for name, item in baselines.items()})


def _judgement(entry: Mapping[str, Any], where: str) -> Answer:
    """An answer; a baseline's may lack all but its causes."""
    named = _causes(entry.get("causes"), where)
    verdict = one_of(entry.get("verdict", "effect" if named else "none"), VERDICTS, f"{where}: verdict")
    if verdict in ("effect", "ambiguous") and not named:
        raise WithheldError(f"{where}: a verdict of {verdict} must name causes, got none; answer none or unknown")
    gap = mapping(entry.get("gap") or {}, f"{where}: gap")
    p = number(gap.get("p"), f"{where}: gap.p")
    if isfinite(p) and not 0 <= p <= 1:
        raise WithheldError(f"{where}: gap.p must lie between 0 and 1, got {p:g}; it is a p-value")
    answer = Answer(verdict, named, _members(entry.get("set90"), verdict, named, where), p)
    closure = mapping(entry.get("closure") or {}, f"{where}: closure")
    low, high = listed(closure.get("ci90") or [None, None], 2, f"{where}: closure.ci90")
    return replace(
        _with_location(answer, mapping(entry.get("where") or {}, f"{where}: where"), where),
        closure=number(closure.get("fraction"), f"{where}: closure.fraction"),
        closure_interval=(number(low, f"{where}: closure.ci90"), number(high, f"{where}: closure.ci90")),
        measurements=_measurements(entry.get("next")),
        without=frozenset(strings(entry.get("without") or [], f"{where}: without")),
    )


def _causes(found: Any, where: str) -> tuple[tuple[str, float], ...]:
    stated: dict[str, float] = {}
    for item in listed(found or [], None, f"{where}: causes"):
        cause = mapping(item, f"{where}: causes")
        name = one_of(cause.get("effect"), causes.outcomes(), f"{where}: effect")
        if name in stated:
            raise WithheldError(f"{where}: each cause must stand once, got {name} twice; give it its total probability")
        p = number(cause.get("probability"), f"{where}: probability of {name}")
        if not 0 <= p <= 1 + _ROUNDING:
            raise WithheldError(f"{where}: the probability of {name} must lie between 0 and 1, got {p:g}; correct it")
        stated[name] = p
    if sum(stated.values()) > 1 + 1e-3:
        raise WithheldError(f"{where}: probabilities must sum to at most 1, got {sum(stated.values()):.4g}; rescale")
    return tuple(sorted(stated.items(), key=lambda cause: -cause[1]))


def _members(found: Any, verdict: str, named: tuple[tuple[str, float], ...], where: str) -> tuple[str, ...]:
    """The stated set; where none is stated, the fewest causes that hold 90 %, and at least the verdict itself."""
    allowed = (*causes.outcomes(), causes.STIFFNESS)
    members = [one_of(name, allowed, f"{where}: set90") for name in strings(found or [], f"{where}: set90")]
    if found is None:
        total = 0.0
        for name, p in named:
            if total < SET_LEVEL - _ROUNDING:
                members.append(name)
                total += p
    if not members and verdict in (causes.NONE, causes.UNKNOWN):
        members = [verdict]
    return tuple(dict.fromkeys(members))


def _measurements(found: Any) -> tuple[str, ...]:
    """Names of what to measure next; an entry may be a string or an object that describes one."""
    entries = [found] if isinstance(found, str | dict) else found if isinstance(found, list) else []
    return tuple(str(entry) for entry in entries if entry)


def _with_location(answer: Answer, where: Mapping[str, Any], place: str) -> Answer:
    kind = str(where.get("kind") or "")
    region = read_region(where, f"{place}: where") if kind in location.KINDS else None
    peak = None
    if where.get("map") is not None:
        rows = listed(where["map"], location.RINGS, f"{place}: where.map")
        values = [
            [number(value, f"{place}: where.map") for value in listed(row, location.SECTORS, f"{place}: where.map")]
            for row in rows
        ]
        peak = location.peak(np.array(values), kind)
    localisable = bool(where.get("localisable")) and kind != _DIRECTION
    return replace(answer, region=region, peak=peak, localisable=localisable)


def read_region(found: Mapping[str, Any], where: str) -> Region | None:
    """Reads `kind`, `angle_deg` and `radius_m`: each of the two a range, or a single number for half a cell around it.

    What is left out is the whole turn, or the whole width of the overhang.

    Raises:
        WithheldError: Values that are no numbers, or a range of radii whose ends stand in the wrong order.
    """
    one_of(found.get("kind"), location.KINDS, f"{where}: kind")
    start, width = _arc(found, where)
    inner, outer = _radii(found.get("radius_m"), f"{where}: radius_m")
    return Region(start, width, inner, outer)


def _arc(found: Mapping[str, Any], where: str) -> tuple[float, float]:
    angles = found.get("angle_deg")
    if angles is None or found["kind"] == "ring":
        return 0.0, location.FULL_TURN
    if isinstance(angles, list):
        first, second = (_finite(angle, f"{where}: angle_deg") for angle in listed(angles, 2, f"{where}: angle_deg"))
        return location.arc((first, second))
    return location.around(_finite(angles, f"{where}: angle_deg"), location.FULL_TURN / location.SECTORS / 2)


def _radii(found: Any, where: str) -> tuple[float, float]:
    if found is None:
        return location.PLATE_EDGE, location.RIM
    if isinstance(found, list):
        inner, outer = (_finite(radius, where) for radius in listed(found, 2, where))
    else:
        half = (location.RIM - location.PLATE_EDGE) / location.RINGS / 2
        inner, outer = _finite(found, where) - half, _finite(found, where) + half
    if outer < inner:
        raise WithheldError(f"{where} must be [inner, outer] in metres, got [{inner:g}, {outer:g}]; swap them")
    return inner, outer


def _finite(found: Any, where: str) -> float:
    value = number(found, where)
    if not isfinite(value):
        raise WithheldError(f"{where} must be a number, got {found!r}; leave the key out where it is not known")
    return value
