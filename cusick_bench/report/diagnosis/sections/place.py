"""Where the gap lies according to a diagnosis: on the cloth, in which statistics, at which stage of the experiment."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from cusick_bench.diagnosis.document.model import DiagnosisDocument, MappedLocation, Resolution
from cusick_bench.diagnosis.inference.single_effects.localise import EDGES
from cusick_bench.report.diagnosis.graphs.bars import Bar, bars_graph
from cusick_bench.report.diagnosis.graphs.cloth_map import Arrow, Region, cloth_map
from cusick_bench.report.diagnosis.wording.number_format import percent, plain
from cusick_bench.report.diagnosis.wording.words import GROUPS, STAGES, place_in_words
from cusick_bench.report.drawing.inline_svg import inline_svg
from cusick_bench.report.drawing.palette import MODEL, PALE
from cusick_bench.sim.effects import registered


@dataclass(frozen=True)
class PlaceSection:
    """Where the gap lies.

    Attributes:
        words: The answer in sentences.
        map: Map of the cloth.
        caption: What the map shows.
        null_map: Map of noise alone; None where no local patch is named.
        groups: The gap by group of statistics; None where nothing was simulated.
        has_floors: Whether `groups` shows floors.
        stages: Probability by stage of the making of a drape; None where it is not known.
    """

    words: str
    map: Markup
    caption: str
    null_map: Markup | None
    groups: Markup | None
    has_floors: bool
    stages: Markup | None


def place_section(document: DiagnosisDocument) -> PlaceSection:
    """Where the gap lies.

    Args:
        document: The diagnosis.

    Returns:
        The content of the section.
    """
    where = document.where
    region = _region(where.angle_deg, where.radius_m) if where.localisable else None
    arrow = _arrow(document) if where.kind == "direction" else None
    stages, groups = _stages(where.stage), _groups(document)
    words = _in_words(document, region, stages)
    shares = None if where.map is None else np.array(where.map, dtype=np.float64)
    null_map = None
    if where.null_map is not None and where.kind == "patch":
        words_of_null = "mean of the maps of noise alone"
        drawn = cloth_map(np.array(where.null_map, dtype=np.float64), None, None, key=words_of_null)
        null_map = inline_svg(drawn, f"Map of the cloth: {words_of_null}.", "map small")
    return PlaceSection(
        words=words,
        map=inline_svg(cloth_map(shares, region, arrow), f"Map of the cloth. {words}", "map"),
        caption=" ".join(_caption(where, region, arrow)),
        null_map=null_map,
        groups=_bars(groups, "Gap by group of statistics", plain) if groups else None,
        has_floors=any(one.mark is not None for one in groups),
        stages=_bars(stages, "Probability by stage", percent, percents=True) if stages else None,
    )


def _in_words(document: DiagnosisDocument, region: Region | None, stages: Sequence[Bar]) -> str:
    if region is not None:
        words = f"The cause sits in one place: {place_in_words(region.angle, region.radius)}."
    elif document.verdict == "none":
        words = "Nothing is missing, so there is no place to name."
    else:
        words = f"No place on the cloth can be named: {document.where.why_not or 'no place was looked for'}."
    likeliest = max(stages, key=lambda one: one.value or 0.0, default=None)
    if likeliest is not None and likeliest.value:
        words += f" Likeliest stage: {likeliest.name} ({percent(likeliest.value)})."
    return words


def _caption(where: MappedLocation, region: Region | None, arrow: Arrow | None) -> Iterator[str]:
    """What the map shows, in sentences."""
    yield "Cloth from above, face up."
    if region is not None:
        yield "Outlined: the place that holds most of the probability."
    elif where.map is not None:
        yield "No place is named."
    if where.null_p is not None:
        yield f"Noise alone gives so narrow a map in {percent(where.null_p)} of cases."
    if region is not None and where.resolution is not None:
        yield from _resolution_in_words(where.resolution)
    if arrow is not None:
        yield f"Arrow: direction of the cause, {arrow.angle:.0f}° from warp."


def _resolution_in_words(resolution: Resolution) -> Iterator[str]:
    angle, radius = resolution.angle_deg or 0.0, resolution.radius_m or 0.0
    if 0 < angle <= 360 and 0 < radius <= EDGES[-1]:
        yield (
            f"In other samples the same patch would be placed to within {angle:.0f}° and {1e3 * radius:.0f} mm of "
            "radius (median)."
        )


def _region(angle: tuple[float, float] | None, radius: tuple[float, float] | None) -> Region | None:
    """The place that is named; None where its edges are no place on a cloth."""
    if angle is not None and not (-360 <= angle[0] <= angle[1] <= angle[0] + 360 <= 1080):
        angle = None
    if radius is not None and not 0 <= radius[0] < radius[1] <= 2 * EDGES[-1]:
        radius = None
    return Region(angle, radius) if angle or radius else None


def _arrow(document: DiagnosisDocument) -> Arrow | None:
    """Direction of the named effect with the largest shift, which the place is about; None where it has none."""
    placed = next((name for name in document.held_together if name in document.effects), None)
    for cause in document.causes:
        effect = registered().get(cause.effect)
        if effect is None or placed not in (None, cause.effect):
            continue
        name = next((p.name for p in effect.parameters if p.role == "direction"), None)
        value = cause.parameters[name].value if name in cause.parameters else None
        both_ways = effect.located == "direction" and effect.signed
        return None if value is None else Arrow(value % 360, both_ways)
    return None


def _stages(stages: dict[str, float]) -> list[Bar]:
    likeliest = max(stages.values(), default=0.0)
    return [
        Bar(STAGES.get(name, name), stages[name], MODEL if stages[name] == likeliest > 0 else PALE)
        for name in _in_order(stages, STAGES)
    ]


def _groups(document: DiagnosisDocument) -> list[Bar]:
    groups, bars = document.gap.groups, []
    for name in _in_order(groups, GROUPS):
        gap, floor = groups[name].gap, groups[name].floor
        above = gap is not None and floor is not None and gap > floor
        bars.append(Bar(GROUPS.get(name, name), gap, MODEL if above else PALE, floor))
    return bars


def _in_order(names: Iterable[str], known: Iterable[str]) -> list[str]:
    """Known names in their usual order, then the others."""
    names, known = list(names), list(known)
    return sorted(names, key=lambda name: known.index(name) if name in known else len(known))


def _bars(bars: list[Bar], title: str, words: Callable[[float | None], str], *, percents: bool = False) -> Markup:
    """Bars with a description that lists them, the largest first."""
    largest_first = sorted((one for one in bars if one.value is not None), key=lambda one: -(one.value or 0.0))
    listed = ", ".join(f"{one.name} {words(one.value)}" for one in largest_first) or "not known"
    return inline_svg(bars_graph(bars, percents=percents), f"{title}: {listed}")
