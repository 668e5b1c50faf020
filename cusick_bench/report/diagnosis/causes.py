"""The ranked causes of a diagnosis and the statistics that speak for them, ready for the page."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign
from typing import Any

from markupsafe import Markup

from cusick_bench.report.diagnosis.graphs import score_bar, share_bar
from cusick_bench.report.diagnosis.values import (
    UNKNOWN,
    mapping,
    mappings,
    measure,
    number,
    pair,
    percent,
    plain,
    signed,
    text,
    texts,
)
from cusick_bench.report.diagnosis.words import STAGES, claim, parameter_meaning, physics, signature, statistic_name
from cusick_bench.sim.effects import registered

_LEAST, _MOST, _ALWAYS = 0.02, 8, 3  # probability from which a cause is shown; at most, and at least so many
_ROWS = 10  # statistics
_SHORT = 26  # letters of a name that a heading has room for
_ROUNDING = 1e-9  # share of a row's largest value below which another one is 0 but for rounding
_MILLIMETRES = {"m": "mm", "m/rad": "mm/rad"}


@dataclass(frozen=True)
class CauseCard:
    """One cause.

    Attributes:
        name: Of the effect, or `none`, `unknown`.
        kind: Its stage in words.
        summary: What it says happened.
        probability: In per cent.
        bar: The same as a bar.
        chips: What else is to be known at a glance.
        parameters: Name, value, meaning.
        signature: What it would show.
        physics: What it does, with its equation; of likely causes only.
    """

    name: str
    kind: str
    summary: str
    probability: str
    bar: Markup
    chips: list[str]
    parameters: list[tuple[str, str, str]]
    signature: str
    physics: str


@dataclass(frozen=True)
class StatisticRow:
    """One statistic, its values as text and its z value as number and bar."""

    name: str
    unit: str
    up: str
    down: str
    base: str
    effect: str
    z: str
    bar: Markup


def named_causes(document: Mapping[str, Any]) -> list[str]:
    """The registered effects that were simulated: none, one, or two that act together.

    A pair's probability stands with its likelier half, which need not be the half that the closure names.
    """
    simulated, ranked = text(mapping(document.get("closure")).get("effect")), _ranked(document)
    likeliest = next(iter(ranked), {})
    carries = text(document.get("verdict")) == "effect" and (number(likeliest.get("probability")) or 0.0) > 0.5
    halves = [one for one in ranked if text(one.get("effect")) == simulated or (carries and one is likeliest)]
    names = [simulated, *(text(one.get(key)) for one in halves for key in ("effect", "pair_with"))]
    return [name for name in dict.fromkeys(names) if name in registered()]


def named_cause(document: Mapping[str, Any]) -> str:
    """The same in words; "" without any."""
    return " + ".join(named_causes(document))


def with_cause(document: Mapping[str, Any]) -> str:
    """Name of the model with the causes, short enough for a heading."""
    named = named_causes(document)
    if named and len(words := " + ".join(named)) <= _SHORT:
        return f"with {words}"
    return "with both causes" if len(named) > 1 else "with the cause"


def cause_cards(document: Mapping[str, Any]) -> list[CauseCard]:
    """The causes worth showing, likeliest first."""
    likely = set(texts(document.get("set90")))
    entries = _ranked(document)
    shown = [
        entry
        for place, entry in enumerate(entries[:_MOST])
        if place < _ALWAYS or text(entry.get("effect")) in likely or (number(entry.get("probability")) or 0) >= _LEAST
    ]
    return [_card(entry, document, text(entry.get("effect")) in likely) for entry in shown]


def _ranked(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    entries = [entry for entry in mappings(document.get("causes")) if text(entry.get("effect"))]
    return sorted(entries, key=lambda entry: -(number(entry.get("probability")) or 0.0))


def _card(entry: Mapping[str, Any], document: Mapping[str, Any], likely: bool) -> CauseCard:
    name, share = text(entry.get("effect")), number(entry.get("probability"))
    chips = ["in the 90 % set"] if likely else []
    if other := text(entry.get("pair_with")):
        chips.append(f"acts together with {other}")
    closure = mapping(document.get("closure"))
    fraction, interval = number(closure.get("fraction")), pair(closure.get("ci90"))
    named = named_causes(document)
    if fraction is not None and name in named:
        span = f" ({percent(interval[0])} to {percent(interval[1])})" if interval else ""
        chips.append(f"{'they close' if len(named) > 1 else 'closes'} {percent(fraction)} of the gap{span}")
    parameters = [
        (
            key,
            measure(number(mapping(value).get("value")), text(mapping(value).get("unit"))),
            parameter_meaning(name, key),
        )
        for key, value in mapping(entry.get("parameters")).items()
    ]
    kind = text(entry.get("class"))
    return CauseCard(
        name,
        STAGES.get(kind, kind),
        text(entry.get("summary")) or claim(name),
        percent(share),
        share_bar(share, "base" if likely else "pale"),
        chips,
        parameters if likely else [],
        signature(name) if likely else "",
        physics(name) if likely else "",
    )


def rest_in_words(document: Mapping[str, Any], cards: list[CauseCard]) -> str:
    """What the causes that are not shown add up to."""
    shown = {card.name for card in cards}
    rest = [entry for entry in _ranked(document) if text(entry.get("effect")) not in shown]
    together = sum(number(entry.get("probability")) or 0.0 for entry in rest)
    count = "1 further cause" if len(rest) == 1 else f"{len(rest)} further causes together"
    words = f"{count}: {percent(together)}. " if rest else ""
    likely = texts(document.get("set90"))
    if all(name in ("none", "unknown") for name in likely):
        return words
    return f"{words}The true cause is among these with 90 % probability: {', '.join(likely)}."


def statistic_rows(document: Mapping[str, Any]) -> list[StatisticRow]:
    """The statistics that differ most from the base model."""
    scored = [(entry, number(entry.get("z"))) for entry in mappings(document.get("statistics"))]
    known = sorted(((e, z) for e, z in scored if z is not None), key=lambda item: -abs(item[1]))[:_ROWS]
    most = max((abs(z) for _, z in known), default=1.0) or 1.0
    return [_row(entry, z, most) for entry, z in known]


def _row(entry: Mapping[str, Any], z: float, most: float) -> StatisticRow:
    unit = text(entry.get("unit"))
    factor = 1e3 if unit in _MILLIMETRES else 1.0
    values = {key: number(entry.get(key)) for key in ("up", "down", "base", "effect")}
    rounding = _ROUNDING * max((abs(found) for found in values.values() if found is not None), default=0.0)

    def value(key: str) -> str:
        found = values[key]
        return UNKNOWN if found is None else plain(factor * found if abs(found) > rounding else 0.0, 3)

    z = _towards(entry, z)
    score = signed(f"{z:.1f}")
    return StatisticRow(
        name=statistic_name(text(entry.get("name"))),
        unit="" if unit == "1" else _MILLIMETRES.get(unit, unit),
        up=value("up"),
        down=value("down"),
        base=value("base"),
        effect=value("effect"),
        z=score if z < 0 else f"+{score}",
        bar=score_bar(z, most),
    )


def _towards(entry: Mapping[str, Any], z: float) -> float:
    """z with the sign of data minus base model, of the face that differs more; it may come without one."""
    base = number(entry.get("base"))
    faces = [value for key in ("up", "down") if (value := number(entry.get(key))) is not None]
    if z < 0 or base is None or not faces:
        return z
    return copysign(z, max((value - base for value in faces), key=abs))
