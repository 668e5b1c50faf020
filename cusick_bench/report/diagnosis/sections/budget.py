"""Budget of the gap as a table: which share each effect takes, and what stays unexplained."""

from dataclasses import dataclass

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.report.diagnosis.wording.named_causes import stand_ins
from cusick_bench.report.diagnosis.wording.number_format import percent

_UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class BudgetTable:
    """The table.

    Attributes:
        words: What it shows, in sentences.
        rows: Effect, its share, the 90 % interval; the unexplained share last.
    """

    words: str
    rows: list[tuple[str, str, str]]


def budget_table(document: DiagnosisDocument) -> BudgetTable | None:
    """Shares of the gap.

    Args:
        document: The diagnosis.

    Returns:
        The table; None where no effect takes a share.
    """
    if document.share_left is None:
        return None
    rows = [(one.effect, percent(one.share), _interval(one.ci90)) for one in document.budget]
    rows.append((_UNEXPLAINED, percent(document.share_left), _interval(document.unexplained.ci90)))
    alike = [f"{name} stands for one of {', '.join(group)}" for name, group in stand_ins(document).items()]
    words = (
        "Share of the gap, in units of noise, that each effect takes on samples that its severity was not fitted to, "
        "the mean over all orders in which effects can be taken off."
    )
    return BudgetTable(" ".join([words, *(f"{one[0].upper()}{one[1:]}." for one in alike)]), rows)


def _interval(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{percent(ends[0])} to {percent(ends[1])}"
