"""Causes taken off one after the other, as a table: what a fabric needs until no further one shows."""

from dataclasses import dataclass

from cusick_bench.diagnosis.document.model import DiagnosisDocument, StepCause
from cusick_bench.diagnosis.inference.stepwise import MOST
from cusick_bench.report.diagnosis.causes import parameters_in_words
from cusick_bench.report.diagnosis.effect_words import parameter_units
from cusick_bench.report.diagnosis.number_format import percent, plain


@dataclass(frozen=True)
class StepTable:
    """The table.

    Attributes:
        words: What it shows, in sentences.
        rows: Model or cause, its parameters, the misfit that it leaves.
    """

    words: str
    rows: list[tuple[str, str, str]]


def step_table(document: DiagnosisDocument) -> StepTable | None:
    """Causes taken off one after the other.

    Args:
        document: The diagnosis.

    Returns:
        The table; None where one cause, or none, is enough.
    """
    steps = document.steps
    if len(steps.causes) < 2 or steps.misfit is None:
        return None
    rows = [("base model", "", plain(steps.misfit)), *(_row(one) for one in steps.causes)]
    return StepTable(_in_words(len(steps.causes), steps.closure, steps.ci90), rows)


def _row(step: StepCause) -> tuple[str, str, str]:
    words = parameters_in_words(step.parameters, parameter_units(step.effect))
    return step.effect, words, plain(step.misfit_left)


def _in_words(count: int, closure: float | None, interval: tuple[float, float] | None) -> str:
    least = "at least " if count >= MOST else ""
    words = (
        f"The base model needs {least}{count} causes, one after the other, before no further effect of the list shows. "
        "The order says which explains most of what is left, not which came first."
    )
    if closure is None:
        return words
    span = f" ({percent(interval[0])} to {percent(interval[1])})" if interval else ""
    return f"{words} All together close {percent(closure)}{span} of the gap on samples that were not fitted."
