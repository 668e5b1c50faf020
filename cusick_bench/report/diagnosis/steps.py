"""Causes taken off one after the other, as a table: what a fabric needs until no further one shows."""

from collections.abc import Mapping
from typing import Any

from cusick_bench.diagnosis.inference.stepwise import MOST
from cusick_bench.report.diagnosis.values import mapping, mappings, measure, number, pair, percent, plain, text
from cusick_bench.sim.effects import registered


def steps_content(document: Mapping[str, Any]) -> dict[str, Any]:
    """What the page's template asks for; no rows where one cause, or none, is enough."""
    found = mapping(document.get("steps"))
    causes = mappings(found.get("causes"))
    start = number(found.get("misfit"))
    if len(causes) < 2 or start is None:
        return {"rows": [], "words": ""}
    rows = [("base model", "", plain(start))]
    rows += [(text(one.get("effect")), _parameters(one), plain(number(one.get("misfit_left")))) for one in causes]
    return {"rows": rows, "words": _together(len(causes), number(found.get("closure")), pair(found.get("ci90")))}


def _parameters(step: Mapping[str, Any]) -> str:
    """Its parameters with their units."""
    effect = registered().get(text(step.get("effect")))
    units = {p.name: p.unit for p in effect.parameters} if effect else {}
    known = {name: number(value) for name, value in mapping(step.get("parameters")).items()}
    return ", ".join(f"{name} {measure(value, units.get(name, ''))}" for name, value in known.items())


def _together(count: int, closure: float | None, interval: tuple[float, float] | None) -> str:
    least = "at least " if count >= MOST else ""
    words = (
        f"The base model needs {least}{count} causes, one after the other, before no further effect of the list shows. "
        "The order says which explains most of what is left, not which came first."
    )
    if closure is None:
        return words
    span = f" ({percent(interval[0])} to {percent(interval[1])})" if interval else ""
    return f"{words} All together close {percent(closure)}{span} of the gap on samples that were not fitted."
