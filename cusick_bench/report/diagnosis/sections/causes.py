"""The ranked causes of a diagnosis, as the page shows them."""

from dataclasses import dataclass

from cusick_bench.diagnosis.document.answer import BudgetShare
from cusick_bench.diagnosis.document.model import Cause, DiagnosisDocument, ParameterValue
from cusick_bench.report.diagnosis.wording.effect_words import claim, parameter_meaning, physics, signature
from cusick_bench.report.diagnosis.wording.named_causes import are_several, named_causes
from cusick_bench.report.diagnosis.wording.number_format import measure, percent
from cusick_bench.report.diagnosis.wording.words import STAGES

_LEAST, _MOST, _ALWAYS = 0.05, 8, 3  # least probability of a shown cause; most and fewest causes that are shown


@dataclass(frozen=True)
class Parameter:
    """An estimated parameter of a cause.

    Attributes:
        name: Name of the parameter.
        value: Its value with unit.
        meaning: What it is.
    """

    name: str
    value: str
    meaning: str


@dataclass(frozen=True)
class CauseCard:
    """One cause.

    Attributes:
        name: Name of the effect, or `none`, `unknown`.
        stage: Its stage in words.
        summary: What would have happened if it acts.
        probability: That it acts, alone or with others; of `none` and `unknown`, that it is so.
        shown_probability: The same in per cent.
        likely: Whether it is named or in the 90 % set.
        remarks: Short remarks.
        parameters: Its estimated parameters; of likely causes only.
        signature: How it would show; for likely causes only.
        physics: Its physics, with the equation; for likely causes only.
    """

    name: str
    stage: str
    summary: str
    probability: float
    shown_probability: str
    likely: bool
    remarks: list[str]
    parameters: list[Parameter]
    signature: str
    physics: str


@dataclass(frozen=True)
class CauseSection:
    """What may cause the gap.

    Attributes:
        cards: The causes worth showing: named ones first, then by the probability that they act.
        rest: How likely the others are.
    """

    cards: list[CauseCard]
    rest: str


def cause_section(document: DiagnosisDocument) -> CauseSection:
    """The causes worth showing, and how likely the others are.

    Args:
        document: The diagnosis.

    Returns:
        The content of the section.
    """
    ranked = document.ranked_causes
    shown = [
        cause
        for place, cause in enumerate(ranked[:_MOST])
        if place < _ALWAYS or _is_likely(cause, document) or cause.likelihood_of_acting >= _LEAST
    ]
    rest = [cause for cause in ranked if cause not in shown]
    return CauseSection([_card(cause, document) for cause in shown], _rest_in_words(rest, document))


def _is_likely(cause: Cause, document: DiagnosisDocument) -> bool:
    return cause.effect in document.set90 or cause.effect in document.effects


def _card(cause: Cause, document: DiagnosisDocument) -> CauseCard:
    likely, probability = _is_likely(cause, document), cause.likelihood_of_acting
    return CauseCard(
        name=cause.effect,
        stage=STAGES.get(cause.stage, cause.stage),
        summary=cause.summary or claim(cause.effect),
        probability=probability,
        shown_probability=percent(probability),
        likely=likely,
        remarks=_remarks(cause, document),
        parameters=_parameters(cause) if likely else [],
        signature=signature(cause.effect, cause.turns_with_cloth) if likely else "",
        physics=physics(cause.effect) if likely else "",
    )


def _remarks(cause: Cause, document: DiagnosisDocument) -> list[str]:
    remarks = ["named"] if cause.effect in document.effects else []
    remarks += ["in the 90 % set"] if cause.effect in document.set90 else []
    if cause.effect in document.effects and percent(cause.likelihood_of_acting) != percent(cause.probability):
        remarks.append(f"accounts for most with probability {percent(cause.probability)}")
    group = next((group for group in document.groups if cause.effect in group), ())
    first = next(iter(group), "")
    if cause.shared:
        which = f"one of {', '.join(group)} is " if first == cause.effect else ""
        remarks.append(f"{which}shown by all fabrics of this laboratory")
    elif any(one.effect == first and one.shared for one in document.causes):
        remarks.append(f"may be what all fabrics of this laboratory show, instead of {first}")
    remarks += [_share_in_words(one) for one in document.budget if one.effect == cause.effect]
    fraction, interval = document.closure.fraction, document.closure.ci90
    if fraction is not None and cause.effect in named_causes(document):
        span = f" ({percent(interval[0])} to {percent(interval[1])})" if interval else ""
        alone = "this or a look-alike closes" if group else "closes"
        remarks.append(f"{'they close' if are_several(document) else alone} {percent(fraction)} of the gap{span}")
    return remarks


def _share_in_words(one: BudgetShare) -> str:
    span = f" ({percent(one.ci90[0])} to {percent(one.ci90[1])})" if one.ci90 else ""
    return f"takes {percent(one.share)}{span} of the gap"


def _parameters(cause: Cause) -> list[Parameter]:
    return [
        Parameter(name, _with_interval(one), parameter_meaning(cause.effect, name))
        for name, one in cause.parameters.items()
    ]


def _with_interval(one: ParameterValue) -> str:
    words = measure(one.value, one.unit)
    if one.ci90 is None:
        return words
    return f"{words} ({measure(one.ci90[0], one.unit)} to {measure(one.ci90[1], one.unit)})"


def _rest_in_words(rest: list[Cause], document: DiagnosisDocument) -> str:
    words = ""
    if rest:
        count = "1 further cause was" if len(rest) == 1 else f"{len(rest)} further causes were"
        words = f"{count} weighed, at most {percent(max(cause.likelihood_of_acting for cause in rest))} likely. "
    if set(document.set90) <= {"none", "unknown"}:
        return words
    return f"{words}The true cause is among these with 90 % probability: {', '.join(document.set90)}."
