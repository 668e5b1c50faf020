"""Leave-one-effect-out: cases with one effect, answered again by a diagnosis that is not offered just that effect.

The right answer is then `unknown`. The effect to leave out is known from the labels, so this is done after the answers
are frozen. Only cases whose effect is strong enough to be seen are used: what cannot be seen cannot be called unknown.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path

from cusick_bench.diagnosis.inference.single_effects.equivalents import ABSORBED
from cusick_bench.diagnosis.options import Options
from cusick_bench.withheld.answers.blind import answer_each
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import AnswersDocument, LeaveOut
from cusick_bench.withheld.format.label import DETECTABLE, SINGLE, TYPICAL, Label

_ROUNDING = 1e-6


def left_out_effects(labels: Mapping[str, Label], least: float) -> dict[str, str]:
    """Chooses the cases that take part, and the effect to leave out of each.

    Severities count as in the scores: in detectable shifts where any label is given in them, else in typical ones.
    An effect that the base model's own parameters absorb takes no part: without it, these are the right answer.

    Args:
        labels: The truth of each case.
        least: Severity from which on an effect takes part, in multiples of that unit.

    Returns:
        The effect to leave out, by case.

    Raises:
        WithheldError: A severity that is none, or no effect as severe as that.
    """
    if not isfinite(least) or least < 0:
        raise WithheldError(
            f"the least severity must be a number >= 0, got {least:g}; 2 is twice the unit of the labels"
        )
    singles = {
        case: label
        for case, label in labels.items()
        if label.kind == SINGLE and label.effects[0] not in ABSORBED.effects
    }
    unit = DETECTABLE if any(label.unit == DETECTABLE for label in singles.values()) else TYPICAL
    strong = {
        case: label.effects[0]
        for case, label in singles.items()
        if label.unit == unit and label.multiple >= least - _ROUNDING
    }
    if not strong:
        raise WithheldError(
            f"at least one case must have a single effect of {least:g} times the {unit} or more, got none of "
            f"{len(singles)}; lower --minimum-severity"
        )
    return strong


def answer_left_out(
    cases: Path,
    labels: Mapping[str, Label],
    out: Path,
    atlas: Path,
    options: Options,
    least: float,
    *,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> AnswersDocument:
    """Answers every such case without its effect, or resumes an interrupted run.

    Args:
        cases: Folder of the cases.
        labels: The truth of each case.
        out: File for the answers; single answers lie beside it.
        atlas: Fitted atlas.
        options: How to diagnose; what they leave out stays out.
        least: Severity from which on an effect takes part.
        workers: Number of processes.
        step: Called with the name of every answered case.

    Returns:
        The document that was written.

    Raises:
        WithheldError: No effect as severe as that, or a label whose case is not there.
    """
    effects = left_out_effects(labels, least)
    if absent := [case for case in effects if not (cases / case).is_dir()]:
        raise WithheldError(f"every label must have its case, got none for {absent[0]} in {cases}; give these cases")
    asked = {
        cases / case: replace(options, without=tuple(dict.fromkeys((*options.without, effect))))
        for case, effect in effects.items()
    }
    return answer_each(asked, out, atlas, leave_out=LeaveOut(least=least), workers=workers, step=step)


def labels_to_answer(document: AnswersDocument, labels: Mapping[str, Label]) -> dict[str, Label]:
    """Labels of the cases that a document must answer: all of them, or those of leave-one-effect-out, then `unknown`.

    Args:
        document: The answers.
        labels: The truth of each case.

    Returns:
        The truth of each case that must be answered.

    Raises:
        WithheldError: Leave-one-effect-out of no case, or an answerer who was offered what was to be left out.
    """
    if document.leave_out is None:
        return dict(labels)
    effects = left_out_effects(labels, document.leave_out.least)
    for case in effects.keys() & document.answers.keys():
        if effects[case] not in document.answers[case].left_out:
            raise WithheldError(
                f"with leave_out every case must be answered without its own effect, got {case} with "
                f"{effects[case]!r} among its causes; make the answers anew by `withheld leave-out`"
            )
    return {case: labels[case].without((effect,)) for case, effect in effects.items()}
