"""The verdict of a diagnosis, with the most important numbers beside it."""

from dataclasses import dataclass

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.report.diagnosis.sections.causes import CauseSection
from cusick_bench.report.diagnosis.wording.named_causes import are_several
from cusick_bench.report.diagnosis.wording.number_format import percent, plain
from cusick_bench.report.diagnosis.wording.words import STAGES, VERDICTS, data_in_words, times_floor

_MOST_NAMED = 3  # effects that have a place beside the verdict

Fact = tuple[str, str, str]
"""Name, value, and what the value is to be read with."""


@dataclass(frozen=True)
class VerdictBox:
    """The first part of the page.

    Attributes:
        style: The verdict as the document names it.
        name: The verdict in words.
        sentence: What it says of these drapes.
        facts: The most important numbers.
        data: How much data there is.
    """

    style: str
    name: str
    sentence: str
    facts: list[Fact]
    data: str


def verdict_box(document: DiagnosisDocument, causes: CauseSection) -> VerdictBox:
    """The verdict in words.

    Args:
        document: The diagnosis.
        causes: Its causes as the page shows them.

    Returns:
        The content of the section.
    """
    name, sentence = VERDICTS[document.verdict]
    facts = [*_gap_fact(document), *_cause_facts(document, causes)]
    if document.next:
        facts.append(("measure next", document.next[0].name, ""))
    return VerdictBox(document.verdict, name, document.headline or sentence, facts, data_in_words(document.data))


def _gap_fact(document: DiagnosisDocument) -> list[Fact]:
    base, floor = document.gap.base, document.gap.floor
    if base is None or floor is None:
        return []
    if base <= floor:
        return [("gap", "none", "above its floor")]
    if ratio := times_floor(base, floor):
        return [("gap", f"{plain(ratio)} ×", "its floor")]
    return [("gap", plain(base), f"floor {plain(floor)}")]


def _cause_facts(document: DiagnosisDocument, causes: CauseSection) -> list[Fact]:
    facts = []
    named = [card for card in causes.cards if card.name in document.effects][:_MOST_NAMED]
    for card in named or causes.cards[:1]:
        facts.append(("acts" if named else "likeliest", STAGES.get(card.name, card.name), card.shown_probability))
    if document.verdict == "ambiguous":
        facts.append(("possible", f"{len(document.set90)} causes", "in the 90 % set"))
    if document.closure.fraction is not None:
        name = "causes close" if are_several(document) else "cause closes"
        facts.append((name, percent(document.closure.fraction), "of the gap"))
    if document.share_left is not None:
        facts.append(("unexplained", percent(max(document.share_left, 0.0)), "of the gap"))
    return facts
