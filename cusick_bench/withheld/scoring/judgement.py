"""Judgement of the answer to one case: what is right and what is wrong."""

from dataclasses import dataclass
from math import isfinite, nan

from cusick_bench.withheld.format import causes
from cusick_bench.withheld.format.answer import REFUSED, BaselineAnswer
from cusick_bench.withheld.format.fields import finite_or_nan
from cusick_bench.withheld.format.label import NULL, OUTSIDE, PAIR, SINGLE, Label
from cusick_bench.withheld.format.location import FULL_TURN, angular_overlap
from cusick_bench.withheld.scoring.calibration import brier_score, log_score

CLOSURE_TOLERANCE = 0.1
_NAMING = ("effect", "several", "ambiguous")  # verdicts that name effects


@dataclass(frozen=True)
class Judgement:
    """One case judged; a number is NaN where the question does not arise, a yes is 1 and a no 0.

    Attributes:
        case: Name of the case.
        kind: Kind of the label: `null`, `single`, `pair`, `unknown`.
        truth, truth_class: Effect and class of the label.
        multiple, level, unit: Severity, the nearest power of two to it, and what it is a multiple of.
        unlike: The part of its shift that no other effect makes, in detectable shifts.
        said, said_class: What the verdict amounts to, and its class; an ambiguous set of equivalents of the true effect
            has the class of the truth.
        verdict: Verdict of the answer.
        p, none: p-value, and stated probability of no effect.
        detected: Whether anything is said to be there.
        exact: Whether the first place is the true effect.
        class_right: Whether its class is the true one, or the set is one of equivalents of the true effect.
        exact_stated, class_stated: Probabilities that the answer gives to the effect and the class in that place.
        equivalent: Whether the set is one of equivalents of the true effect, with a measurement that tells more.
        covered, set_size: Whether the 90 % set holds the truth, and its size.
        abstained: Whether the answer to an effect of the list is `unknown`.
        recalled: Whether the answer to an effect outside the list is `unknown`.
        top_two, both: Share of a pair's effects in the first two places, and whether both are.
        told: Whether each of a pair's effects is in these places or in a group of look-alikes of which one acts.
        confidence, right: Largest probability, and whether it went to the truth.
        brier, surprise: Brier score and logarithmic score [nat].
        pointing, overlap: Whether a local effect was pointed at, and the angular intersection over union.
        localised_falsely: Whether an effect that acts nowhere in particular was localised.
        closure_close: Whether the closure is within `CLOSURE_TOLERANCE` of the true effect's.
        closure_covered: Whether the true effect's closure lies in the stated interval.
    """

    case: str
    kind: str
    truth: str
    truth_class: str
    multiple: float
    level: str
    unit: str
    unlike: float
    said: str
    said_class: str
    verdict: str
    p: float
    none: float
    detected: float
    exact: float = nan
    exact_stated: float = nan
    class_right: float = nan
    class_stated: float = nan
    equivalent: float = nan
    covered: float = nan
    set_size: float = nan
    abstained: float = nan
    recalled: float = nan
    top_two: float = nan
    both: float = nan
    told: float = nan
    confidence: float = nan
    right: float = nan
    brier: float = nan
    surprise: float = nan
    pointing: float = nan
    overlap: float = nan
    localised_falsely: float = nan
    closure_close: float = nan
    closure_covered: float = nan


def judgement_of(case: str, answer: BaselineAnswer, label: Label) -> Judgement:
    """Judges the answer to a case.

    Args:
        case: Name of the case.
        answer: The answer.
        label: The label.

    Returns:
        What is right and wrong in the answer.
    """
    label = label.without(answer.left_out)
    equivalent = label.kind == SINGLE and answers_with_equivalents(answer, label.effects[0])
    said_class = label.class_name if equivalent else causes.class_of(answer.leading)
    return Judgement(
        case=case,
        kind=label.kind,
        truth=label.truth,
        truth_class="pair" if label.kind == PAIR else label.class_name,
        multiple=label.multiple,
        level=label.level,
        unit=label.unit,
        unlike=label.unlike,
        said=answer.leading,
        said_class=said_class,
        verdict=answer.verdict,
        p=answer.p,
        none=answer.probability_of_none,
        detected=float(answer.verdict not in (causes.NONE, REFUSED)),
        **(_of_single(answer, label, equivalent) if label.kind == SINGLE else {}),
        **(_of_pair(answer, label) if label.kind == PAIR else _of_probabilities(answer, label)),
        **({"recalled": float(answer.verdict == causes.UNKNOWN)} if label.kind == OUTSIDE else {}),
        **({"abstained": float(answer.verdict == causes.UNKNOWN)} if label.kind in (SINGLE, PAIR) else {}),
        **(_of_place(answer, label) if label.kind == SINGLE else {}),
        **_of_closure(answer, label),
    )


def answers_with_equivalents(answer: BaselineAnswer, effect: str) -> bool:
    """Whether an answer says all that silhouettes can tell of an effect, and what would tell more.

    Args:
        answer: The answer.
        effect: The true effect.

    Returns:
        True for an ambiguous answer whose set is within the effect's group of equivalents, with a measurement.
    """
    return (
        answer.verdict == "ambiguous" and bool(answer.measurements) and causes.is_equivalent_set(effect, answer.set90)
    )


def _of_single(answer: BaselineAnswer, label: Label, equivalent: bool) -> dict[str, float]:
    leading = answer.leading
    kind = causes.class_of(leading)
    of_class = {name: p for name, p in answer.probabilities().items() if causes.class_of(name) == kind}
    named = leading in causes.effect_classes()
    return {
        "exact": float(leading == label.effects[0]),
        "exact_stated": of_class[leading] if named else 0.0,
        "class_right": float(kind == label.class_name or equivalent),
        "class_stated": sum(of_class.values()) if named else 0.0,
        "equivalent": float(equivalent),
    }


def _of_pair(answer: BaselineAnswer, label: Label) -> dict[str, float]:
    if answer.verdict not in _NAMING:
        return {"top_two": 0.0, "both": 0.0, "told": 0.0}
    first = answer.effects[: len(label.effects)]
    share = sum(name in first for name in label.effects) / len(label.effects)
    told = {*first}.union(*answer.groups)
    return {"top_two": share, "both": float(share == 1), "told": float(told.issuperset(label.effects))}


def _of_probabilities(answer: BaselineAnswer, label: Label) -> dict[str, float]:
    probabilities = answer.probabilities()
    most = max(probabilities.values())
    likeliest = [name for name, probability in probabilities.items() if probability == most]
    return {
        "covered": float(label.truth in answer.set90),
        "set_size": float(len(answer.set90)),
        "confidence": most,
        "right": (label.truth in likeliest) / len(likeliest),  # a refusal holds all alike for likeliest
        "brier": brier_score(probabilities, label.truth),
        "surprise": log_score(probabilities, label.truth),
    }


def _of_place(answer: BaselineAnswer, label: Label) -> dict[str, float]:
    if label.location is None:
        return {"localised_falsely": float(answer.localisable)}
    pointed = answer.peak or (answer.where.region and answer.where.region.middle)
    hit = answer.localisable and pointed is not None and pointed.overlaps(label.location)
    if label.location_kind == "ring":
        return {"pointing": float(hit)}
    hit = hit and pointed is not None and pointed.width < FULL_TURN  # a ring points in no direction
    claimed = answer.where.region if answer.localisable else None
    return {
        "pointing": float(hit),
        "overlap": angular_overlap(claimed, label.location) if claimed else 0.0,
    }


def _of_closure(answer: BaselineAnswer, label: Label) -> dict[str, float]:
    """An answer without a closure is not close: NaN compares with nothing."""
    if not isfinite(label.oracle_closure) or label.kind in (NULL, OUTSIDE):
        return {}
    low, high = answer.closure_interval
    return {
        "closure_close": float(
            abs(finite_or_nan(answer.closure.fraction) - label.oracle_closure) <= CLOSURE_TOLERANCE + 1e-9
        ),
        "closure_covered": float(low <= label.oracle_closure <= high) if isfinite(low + high) else nan,
    }
