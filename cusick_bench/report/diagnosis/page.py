"""One self-contained HTML page of one diagnosis: verdict, gap, place, causes, before and after, what to do next."""

from dataclasses import dataclass
from pathlib import Path

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.report.diagnosis.sections.before_after import ProfileSection, profile_section
from cusick_bench.report.diagnosis.sections.budget import BudgetTable, budget_table
from cusick_bench.report.diagnosis.sections.causes import CauseSection, cause_section
from cusick_bench.report.diagnosis.sections.gap import ClosureSection, GapSection, closure_section, gap_section
from cusick_bench.report.diagnosis.sections.next_steps import NextSection, next_section
from cusick_bench.report.diagnosis.sections.place import PlaceSection, place_section
from cusick_bench.report.diagnosis.sections.statistics import StatisticTable, statistic_table
from cusick_bench.report.diagnosis.sections.verdict import VerdictBox, verdict_box
from cusick_bench.report.diagnosis.wording.words import cloth_in_words
from cusick_bench.report.page_template import render_page, write_html

_FITTED_ALONE, _FITTED_TOGETHER = "Fitted without any cause.", "Fitted together with the likeliest causes."
_PROVENANCE = {"command": "Command", "version": "Version", "atlas": "Atlas"}


@dataclass(frozen=True)
class DiagnosisPage:
    """What the page holds, section by section.

    Attributes:
        fabric: Name of the fabric.
        verdict: The verdict, with the most important numbers.
        gap: Whether simulation and data differ.
        place: Where the difference lies.
        causes: What may cause it.
        statistics: The statistics that differ most.
        profiles: Drapes of data and models.
        closure: How far the named effects close the gap.
        budget: Which share of the gap each effect takes.
        next: What to measure next, and what no measurement here can tell.
        cloth: Parameters of the base model: name, value, meaning.
        cloth_fitted: Whether causes took part in their fit, in a sentence.
        provenance: Name and value of what made the document.
    """

    fabric: str
    verdict: VerdictBox
    gap: GapSection
    place: PlaceSection
    causes: CauseSection
    statistics: StatisticTable
    profiles: ProfileSection
    closure: ClosureSection
    budget: BudgetTable | None
    next: NextSection
    cloth: list[tuple[str, str, str]]
    cloth_fitted: str
    provenance: list[tuple[str, str]]


def write_diagnosis_page(document: DiagnosisDocument, path: Path) -> Path:
    """Writes the page.

    Args:
        document: The diagnosis. What it does not know is shown as unknown.
        path: HTML file to write.

    Returns:
        The file written.
    """
    page = render_page("diagnosis.html.j2", page=diagnosis_page(document))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_html(path, page)
    return path


def diagnosis_page(document: DiagnosisDocument) -> DiagnosisPage:
    """What the page of a diagnosis holds.

    Args:
        document: The diagnosis.

    Returns:
        Its sections, with their graphs.
    """
    causes = cause_section(document)
    made = document.provenance
    return DiagnosisPage(
        fabric=document.fabric or "unnamed fabric",
        verdict=verdict_box(document, causes),
        gap=gap_section(document),
        place=place_section(document),
        causes=causes,
        statistics=statistic_table(document),
        profiles=profile_section(document),
        closure=closure_section(document),
        budget=budget_table(document),
        next=next_section(document),
        cloth=cloth_in_words(document.base, document.data),
        cloth_fitted=_FITTED_TOGETHER if document.with_effect or document.effects else _FITTED_ALONE,
        provenance=[(name, getattr(made, key)) for key, name in _PROVENANCE.items() if getattr(made, key)],
    )
