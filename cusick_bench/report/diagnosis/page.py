"""One self-contained HTML page of one diagnosis: verdict, gap, place, causes, before and after, what to do next."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from cusick_bench.report.diagnosis.before_after import before_after
from cusick_bench.report.diagnosis.causes import (
    CauseCard,
    cause_cards,
    named_cause,
    named_causes,
    rest_in_words,
    statistic_rows,
    with_cause,
)
from cusick_bench.report.diagnosis.graphs import Bar, closure_graph, gap_graph
from cusick_bench.report.diagnosis.place import place_content
from cusick_bench.report.diagnosis.steps import steps_content
from cusick_bench.report.diagnosis.template import DIAGNOSIS_PAGE
from cusick_bench.report.diagnosis.values import (
    UNKNOWN,
    mapping,
    mappings,
    number,
    pair,
    percent,
    plain,
    text,
    texts,
)
from cusick_bench.report.diagnosis.words import (
    STAGES,
    TWO_CAUSES,
    VERDICTS,
    chance,
    cloth_in_words,
    data_in_words,
    entropy_of,
    gap_in_words,
    times_floor,
    worth,
)
from cusick_bench.report.errors import ReportError


def write_diagnosis_page(document: Mapping[str, Any], path: Path) -> Path:
    """Writes the page.

    Args:
        document: JSON document of one diagnosis. What it lacks, or what is no number where one belongs, is shown as
            unknown. Profiles are as the camera sees them.
        path: HTML file to write.

    Returns:
        The file written.

    Raises:
        ReportError: The document is none, or its verdict is no verdict.
    """
    if not isinstance(document, Mapping):
        raise ReportError(f"a diagnosis must be one JSON object, got {type(document).__name__}; see `diagnose --json`")
    verdict = text(document.get("verdict"))
    if verdict not in VERDICTS:
        known = ", ".join(name for name in VERDICTS if name)
        raise ReportError(f"verdict must be one of {known}, got {verdict!r}; is this file a diagnosis?")
    page = _template().render(**_content(document, verdict))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8", errors="replace")
    return path


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    return environment.from_string(DIAGNOSIS_PAGE)


def _content(document: Mapping[str, Any], verdict: str) -> dict[str, Any]:
    """What the template asks for."""
    fabric = text(document.get("fabric")) or "unnamed fabric"
    cards = cause_cards(document)
    data = {name: number(value) for name, value in mapping(document.get("data")).items()}
    base = {name: number(value) for name, value in mapping(document.get("base")).items()}
    made = mapping(document.get("made"))
    return {
        "title": f"Drape diagnosis: {fabric}",
        "fabric": fabric,
        "verdict": _verdict(document, verdict, data, cards),
        "gap": _gap(document),
        "where": place_content(document),
        "causes": {"shown": cards, "rest": rest_in_words(document, cards)},
        "statistics": _statistics(document),
        "profiles": before_after(document),
        "closure": _closure(document, verdict),
        "steps": steps_content(document),
        "next": _next(document),
        "no_next": _NO_NEXT.get(verdict, "No measurement on the list would lower the doubt."),
        "indistinguishable": [
            {"effects": ", ".join(texts(one.get("effects"))), "why": text(one.get("why"))}
            for one in mappings(document.get("indistinguishable"))
        ],
        "told_apart": _TOLD_APART.get(verdict, "Nothing among the likely causes."),
        "without": ", ".join(texts(document.get("without"))),
        "notes": texts(document.get("notes")),
        "cloth": cloth_in_words(base, data.get("areal_density_kg_m2")),
        "made": [(name, text(made.get(key))) for key, name in _MADE.items() if text(made.get(key))],
    }


_MADE = {"command": "Command", "version": "Version", "atlas": "Atlas"}


def _statistics(document: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the table of statistics, and which of its columns hold anything."""
    rows = statistic_rows(document)
    faces = {face: any(getattr(row, face) != UNKNOWN for row in rows) for face in ("up", "down")}
    return {"rows": rows, "with_cause": _with_cause(document), **faces}


def _with_cause(document: Mapping[str, Any]) -> str:
    """End of the statistics' caption; "" where none of them has a value with the cause."""
    known = any(number(entry.get("effect")) is not None for entry in mappings(document.get("statistics")))
    return f", and what it would be with {named_cause(document) or 'the cause'}" if known else ""


def _verdict(
    document: Mapping[str, Any], verdict: str, data: Mapping[str, float | None], cards: list[CauseCard]
) -> dict[str, Any]:
    both = verdict == "effect" and len(named_causes(document)) > 1
    name, sentence = TWO_CAUSES if both else VERDICTS[verdict]
    return {
        "style": verdict,
        "name": name,
        "sentence": text(document.get("headline")) or sentence,
        "facts": _facts(document, verdict, cards),
        "data": data_in_words(data),
    }


def _facts(document: Mapping[str, Any], verdict: str, cards: list[CauseCard]) -> list[tuple[str, str, str]]:
    """The page in a line: name, value, and what the value is to be read with."""
    gap, closure = mapping(document.get("gap")), mapping(document.get("closure"))
    base, floor, closed = number(gap.get("base")), number(gap.get("floor")), number(closure.get("fraction"))
    facts = []
    if base is not None and floor is not None:
        if base <= floor:
            facts.append(("gap", "none", "above its floor"))
        elif ratio := times_floor(base, floor):
            facts.append(("gap", f"{plain(ratio)} ×", "its floor"))
        else:
            facts.append(("gap", plain(base), f"floor {plain(floor)}"))
    if cards:
        facts.append(("likeliest", STAGES.get(cards[0].name, cards[0].name), cards[0].probability))
    if verdict == "ambiguous":
        facts.append(("possible", f"{len(texts(document.get('set90')))} causes", "in the 90 % set"))
    if closed is not None:
        facts.append((_by_number(document, "cause closes", "both close"), percent(closed), "of the gap"))
    step = next((text(step.get("name")) for step in mappings(document.get("next"))), "")
    return [*facts, ("measure next", step, "")] if step else facts


def _gap(document: Mapping[str, Any]) -> dict[str, Any]:
    found = mapping(document.get("gap"))
    base, floor, effect = (number(found.get(key)) for key in ("base", "floor", "effect"))
    words = gap_in_words(base, floor, effect, causes=len(named_causes(document)))
    below = any(value is not None and value < 0 for value in (base, floor, effect))
    bars = [Bar("base model", base, "base")]
    if effect is not None:
        bars.append(Bar(with_cause(document), effect, "cause"))
    if floor is not None:
        bars.append(Bar("floor", floor, "floored"))
    graph = None if base is None else gap_graph(bars, floor, f"Bars of the gap. {words}")
    return {
        "words": words,
        "chance": chance(number(found.get("p"))),
        "graph": graph,
        "floor": floor is not None,
        "below": below,
    }


_NO_NEXT = {
    "none": "Nothing is open that a measurement on the list would settle.",
    "unknown": "The measurements on the list separate known causes, and this is none of them. The statistics that "
    "differ most say what to look for in the sample and on the bench.",
}
_TOLD_APART = {"ambiguous": "None by their nature: the likely causes differ, but not enough in these drapes."}
_OPEN = {
    "none": "There is no gap to close.",
    "ambiguous": "Not given: no single cause was named that could be simulated.",
    "unknown": "Not given: no known cause was named that could be simulated.",
}


def _closure(document: Mapping[str, Any], verdict: str) -> dict[str, Any]:
    found = mapping(document.get("closure"))
    fraction, interval = number(found.get("fraction")), pair(found.get("ci90"))
    cause = named_cause(document) or "the cause"
    if fraction is None:
        return {"words": _no_closure(document, verdict), "graph": None, "interval": ""}
    closes = _by_number(document, "closes", "close")
    over, words = "", f"On samples that were not fitted, {cause} {closes} {percent(fraction)} of the gap"
    if interval is not None:
        over = ", with its 90 % interval over samples"
        words += f"; between {percent(interval[0])} and {percent(interval[1])} with 90 % confidence"
        if interval[0] <= 0:
            words += f", so {_by_number(document, 'it', 'they')} may close nothing at all"
    return {"words": words + ".", "graph": closure_graph(fraction, interval, words), "interval": over}


def _no_closure(document: Mapping[str, Any], verdict: str) -> str:
    """Why no share of the gap is given."""
    gap = mapping(document.get("gap"))
    base, floor = number(gap.get("base")), number(gap.get("floor"))
    if verdict == "none" and base is not None and floor is not None and base > floor:
        return "Not given: no cause was found that could close it."
    return _OPEN.get(verdict, "Not given: the cause was not simulated, or there is no gap above the floor.")


def _by_number(document: Mapping[str, Any], one: str, both: str) -> str:
    """The words for the causes that are named: one, or two that act together."""
    return both if len(named_causes(document)) > 1 else one


def _next(document: Mapping[str, Any]) -> list[dict[str, str]]:
    probabilities = [number(one.get("probability")) for one in mappings(document.get("causes"))]
    entropy = entropy_of([p for p in probabilities if p is not None and 0 <= p <= 1])
    return [
        {
            "name": text(step.get("name")) or "measure",
            "what": text(step.get("what")),
            "worth": worth(number(step.get("bits")), entropy),
            "about": ", ".join(texts(step.get("about"))),
        }
        for step in mappings(document.get("next"))
    ]
