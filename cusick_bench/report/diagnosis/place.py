"""Where a diagnosis puts the gap: on the cloth, in which statistics, at which stage of the making of a drape."""

from collections.abc import Mapping
from typing import Any

from cusick_bench.diagnosis.inference.localise import EDGES, SECTORS
from cusick_bench.report.diagnosis.graphs import Bar, Region, bars_graph, cloth_map
from cusick_bench.report.diagnosis.values import mapping, mappings, number, pair, percent, plain, table, text
from cusick_bench.report.diagnosis.words import GROUPS, STAGES, place_in_words
from cusick_bench.sim.effects import registered


def place_content(document: Mapping[str, Any]) -> dict[str, Any]:
    """What the page's template asks for on the place."""
    found = mapping(document.get("where"))
    shares = table(found.get("map"), len(EDGES) - 1, SECTORS)
    angle, radius = pair(found.get("angle_deg")), pair(found.get("radius_m"))
    region = _region(angle, radius) if found.get("localisable") else None
    arrow = _arrow(document) if text(found.get("kind")) == "direction" else None
    if region is not None:
        words = f"The cause sits in one place: {place_in_words(region.angle, region.radius)}."
        caption = "Cloth from above, face up. Outlined: the place that holds most of the probability."
    else:
        why = text(found.get("why_not")) or "no place was looked for"
        words = f"No place on the cloth can be named: {why}."
        if text(document.get("verdict")) == "none":
            words = "Nothing is missing, so there is no place to name."
        caption = "Cloth from above, face up. " + ("" if shares is None else "No place is named.")
    if arrow is not None:
        caption += f" Arrow: direction of the cause, {plain(arrow[0], 3)}° from warp."
    stages = _stages(found)
    likeliest = max(stages, key=lambda one: one.value or 0.0, default=None)
    if likeliest is not None and likeliest.value:
        words += f" Likeliest stage: {likeliest.name} ({percent(likeliest.value)})."
    groups = _groups(document)
    return {
        "words": words,
        "caption": caption,
        "map": cloth_map(shares, region, arrow, f"Map of the cloth. {words}"),
        "stages": bars_graph(stages, _told("Probability by stage", stages, shares=True), percents=True)
        if stages
        else None,
        "groups": bars_graph(groups, _told("Gap by kind of statistic", groups)) if groups else None,
        "floors": any(one.mark is not None for one in groups),
    }


def _region(angle: tuple[float, float] | None, radius: tuple[float, float] | None) -> Region | None:
    """The place that is named; None where its edges are no place on a cloth."""
    if angle is not None and not (-360 <= angle[0] <= angle[1] <= angle[0] + 360 <= 1080):
        angle = None
    if radius is not None and not 0 <= radius[0] < radius[1] <= 2 * EDGES[-1]:
        radius = None
    return Region(angle, radius) if angle or radius else None


def _arrow(document: Mapping[str, Any]) -> tuple[float, bool] | None:
    """Direction of the likeliest effect [deg], and whether its opposite is the same."""
    for entry in mappings(document.get("causes")):
        effect = registered().get(text(entry.get("effect")))
        if effect is None:
            continue
        name = next((p.name for p in effect.parameters if p.role == "direction"), None)
        value = number(mapping(mapping(entry.get("parameters")).get(name)).get("value")) if name else None
        return None if value is None else (value % 360, effect.located == "direction" and effect.signed)
    return None


def _stages(found: Mapping[str, Any]) -> list[Bar]:
    stages = {name: number(value) for name, value in mapping(found.get("stage")).items()}
    most = max((value for value in stages.values() if value is not None), default=0.0)
    order = [name for name in STAGES if name in stages] + [name for name in stages if name not in STAGES]
    return [
        Bar(STAGES.get(name, name), stages[name], "base" if stages[name] == most and most > 0 else "pale")
        for name in order
    ]


def _groups(document: Mapping[str, Any]) -> list[Bar]:
    groups = mapping(mapping(document.get("gap")).get("groups"))
    order = [name for name in GROUPS if name in groups] + [name for name in groups if name not in GROUPS]
    bars = []
    for name in order:
        entry = mapping(groups[name])
        value, floor = number(entry.get("gap")), number(entry.get("floor"))
        above = value is not None and floor is not None and value > max(2 * floor, 0.0)
        bars.append(Bar(GROUPS.get(name, name), value, "base" if above else "pale", floor))
    return bars


def _told(what: str, bars: list[Bar], *, shares: bool = False) -> str:
    """Bars in words, largest first."""
    known = sorted((one for one in bars if one.value is not None), key=lambda one: -(one.value or 0.0))
    show = percent if shares else plain
    return f"{what}: " + (", ".join(f"{one.name} {show(one.value)}" for one in known) or "not known")
