"""The gap between data and simulation, and the share of it that the named cause closes."""

from dataclasses import dataclass

from markupsafe import Markup

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.report.diagnosis.graphs.bars import Bar, closure_graph, gap_graph
from cusick_bench.report.diagnosis.wording.named_causes import (
    are_several,
    model_with_cause,
    named_cause,
    named_causes,
    stand_ins,
)
from cusick_bench.report.diagnosis.wording.number_format import percent
from cusick_bench.report.diagnosis.wording.words import chance, gap_in_words
from cusick_bench.report.drawing.inline_svg import inline_svg
from cusick_bench.report.drawing.palette import CAUSE, FLOOR, MODEL

_NO_CLOSURE = {
    "none": "There is no gap to close.",
    "effect": "Not given: the cause was not simulated, samples are too few, or there is no gap above the floor.",
    "several": "Not given: the causes were not simulated, samples are too few, or there is no gap above the floor.",
    "ambiguous": "Not given: no single cause was named that could be simulated.",
    "unknown": "Not given: no known cause was named that could be simulated.",
    "refused": "Not given: nothing was simulated.",
}


@dataclass(frozen=True)
class GapSection:
    """Whether simulation and data differ.

    Attributes:
        words: The answer in sentences.
        graph: The gap of each model; None where nothing was simulated.
        has_floor: Whether the graph shows the floor.
        has_negative: Whether an estimate is below 0.
    """

    words: str
    graph: Markup | None
    has_floor: bool
    has_negative: bool


@dataclass(frozen=True)
class ClosureSection:
    """How far the named cause closes the gap.

    Attributes:
        words: The answer in a sentence.
        graph: The closed share; None where it is not known.
        has_interval: Whether the graph shows its interval.
    """

    words: str
    graph: Markup | None = None
    has_interval: bool = False


def gap_section(document: DiagnosisDocument) -> GapSection:
    """The gap of base model and model with the cause, against the floor.

    Args:
        document: The diagnosis.

    Returns:
        The content of the section.
    """
    gap = document.gap
    words = gap_in_words(gap.base, gap.floor, gap.effect, several=are_several(document))
    bars = [Bar("base model", gap.base, MODEL)]
    if gap.effect is not None:
        bars.append(Bar(model_with_cause(document), gap.effect, CAUSE))
    if gap.floor is not None:
        bars.append(Bar("floor", gap.floor, FLOOR))
    graph = None if gap.base is None else inline_svg(gap_graph(bars, gap.floor), f"Bars of the gap. {words}", "wide")
    negative = any(bar.value is not None and bar.value < 0 for bar in bars)
    return GapSection(f"{words} {chance(gap.p)}", graph, gap.floor is not None, negative)


def closure_section(document: DiagnosisDocument) -> ClosureSection:
    """The share of the gap that the named cause closes on samples that were not fitted.

    Args:
        document: The diagnosis.

    Returns:
        The content of the section.
    """
    fraction, interval = document.closure.fraction, document.closure.ci90
    if fraction is None:
        return ClosureSection(_why_no_closure(document))
    both = are_several(document)
    cause, closes = named_cause(document) or "the cause", "close" if both else "closes"
    words = f"On samples that were not fitted, {cause} {closes} {percent(fraction)} of the gap"
    if interval is not None:
        words += f"; between {percent(interval[0])} and {percent(interval[1])} with 90 % confidence"
        if interval[0] <= 0:
            words += f", so {'they' if both else 'it'} may close nothing at all"
    graph = inline_svg(closure_graph(fraction, interval), words, "wide")
    return ClosureSection(" ".join([f"{words}.", *_alike(document)]), graph, interval is not None)


def _alike(document: DiagnosisDocument) -> list[str]:
    """A sentence for each group of look-alikes out of which one was simulated."""
    simulated = named_causes(document)
    return [
        f"Here {name} stands for one of {', '.join(group)}: where another of them came nearer to the fitted samples, "
        "it may have been simulated in its place."
        for name, group in stand_ins(document).items()
        if name in simulated
    ]


def _why_no_closure(document: DiagnosisDocument) -> str:
    base, floor = document.gap.base, document.gap.floor
    if document.verdict == "none" and base is None:
        return "Not given: the gap was not measured."
    if document.verdict == "none" and base is not None and floor is not None and base > floor:
        return "Not given: no cause was found that could close it."
    if document.verdict in ("ambiguous", "unknown") and document.held_together:
        return _NO_CLOSURE["several" if are_several(document) else "effect"]
    return _NO_CLOSURE[document.verdict]
