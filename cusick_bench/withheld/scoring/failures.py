"""Failures case by case, and confusion tables: which effect was taken for which."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from cusick_bench.withheld.format import causes
from cusick_bench.withheld.format.answer import REFUSED, BaselineAnswer
from cusick_bench.withheld.format.label import NULL, OUTSIDE, PAIR, Label
from cusick_bench.withheld.scoring.labelled_answers import LabelledAnswers

CLASSES = (causes.NONE, *causes.CLASSES, "pair", causes.UNKNOWN)
"""Rows of the confusion by class; its columns have no pair, but refusals."""

_FAULTS = {
    "covered": "not in the 90 % set",
    "recalled": "taken for a known effect",
    "both": "pair not found",
    "pointing": "wrong place",
    "closure_close": "closure off",
}
_CAUSES_SHOWN = 3  # of an answer


@dataclass(frozen=True)
class Failure:
    """A case in which something is wrong.

    Attributes:
        case: Name of the case.
        faults: What is wrong, in words.
        label: The truth, in a few words.
        answer: The answer, in a few words.
    """

    case: str
    faults: tuple[str, ...]
    label: str
    answer: str


def failures(answered: LabelledAnswers, cases: pd.DataFrame) -> list[Failure]:
    """Every case in which something is wrong: nulls first, then the most severe.

    Args:
        answered: Answers and labels.
        cases: Their judgements, of `Scores`.

    Returns:
        The failures.
    """
    order = cases.assign(first=cases["kind"] != NULL).sort_values(
        ["first", "multiple", "case"], ascending=[True, False, True]
    )
    listed = []
    for row in order.to_dict("records"):
        if faults := _faults(row):
            case = row["case"]
            answer = answered.answers[case]
            label = answered.labels[case].without(answer.left_out)
            listed.append(Failure(case, faults, described_label(label), described_answer(answer)))
    return listed


def _faults(row: dict[Hashable, Any]) -> tuple[str, ...]:
    """Faults of an answer in words, the worst first; consequences of a missed effect are not listed again."""
    if row["kind"] == NULL:
        return ("false positive",) if row["detected"] else ()
    if row["verdict"] == causes.NONE:
        return ("missed",)
    if row["verdict"] == REFUSED:
        return ("refused",)
    if row["abstained"] == 1:
        first = "abstained"
    elif row["class_right"] == 0:
        first = "wrong class"
    else:
        first = "" if row["equivalent"] == 1 or row["exact"] != 0 else "wrong effect"
    others = (words for column, words in _FAULTS.items() if row[column] == 0)
    return tuple(filter(None, (first, *others)))


def described_label(label: Label) -> str:
    """Describes a label in a few words.

    Args:
        label: The truth.

    Returns:
        Effect and severity.
    """
    severity = f" {label.multiple:.2g}x" if np.isfinite(label.multiple) else ""
    hint = f" ({label.hidden})" if label.kind == OUTSIDE and label.hidden else ""
    joined = " + ".join(label.effects) if label.kind == PAIR else label.truth
    return f"{joined}{severity}{hint}"


def described_answer(answer: BaselineAnswer) -> str:
    """Describes an answer in a few words.

    Args:
        answer: The answer.

    Returns:
        Verdict, first causes with their probabilities, 90 % set, p-value.
    """
    named = ", ".join(f"{name} {probability:.2f}" for name, probability in answer.causes[:_CAUSES_SHOWN])
    parts = [f"{answer.verdict}: {named}" if named else answer.verdict, "{" + ", ".join(answer.set90) + "}"]
    if np.isfinite(answer.p):
        parts.append(f"p {answer.p:.2g}")
    return "; ".join(parts)


def confusion_by_class(cases: pd.DataFrame) -> pd.DataFrame:
    """Number of cases of a row's class that were taken for a column's class.

    Args:
        cases: Judgements, of `Scores`.

    Returns:
        The counts; pairs have no column, and refusals no row.
    """
    counts = pd.crosstab(cases["truth_class"], cases["said_class"])
    columns = [*(name for name in CLASSES if name != "pair"), REFUSED]
    return counts.reindex(index=list(CLASSES), columns=columns, fill_value=0)


def confusion_by_effect(cases: pd.DataFrame) -> pd.DataFrame:
    """Number of cases of a row's effect that were taken for a column's effect; pairs are left out.

    Args:
        cases: Judgements, of `Scores`.

    Returns:
        The counts, a row for each truth that there is, a column for each answer that there is.
    """
    known = cases.loc[cases["kind"] != PAIR]
    counts = pd.crosstab(known["truth"], known["said"])
    order = {name: place for place, name in enumerate((*causes.outcomes(), REFUSED))}
    return counts.loc[sorted(counts.index, key=order.__getitem__), sorted(counts.columns, key=order.__getitem__)]
