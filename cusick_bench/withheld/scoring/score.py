"""Scores answers to withheld cases: every figure with its interval, beside those of chance and of simpler methods.

Chance is measured, not assumed: the same answers are assigned to the cases at random.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.withheld.format.answer import BaselineAnswer
from cusick_bench.withheld.format.causes import NONE
from cusick_bench.withheld.format.label import DETECTABLE, NULL, PAIR, SINGLE, TYPICAL, Label
from cusick_bench.withheld.scoring.figures import RESAMPLES, Figure, figures_of
from cusick_bench.withheld.scoring.judgement import judgement_of
from cusick_bench.withheld.scoring.labelled_answers import LabelledAnswers
from cusick_bench.withheld.scoring.measures import ALL, HIDDEN

ANSWERS, CHANCE = "answers", "chance"
DEALS = 40  # random assignments of answers to cases


@dataclass(frozen=True, eq=False)
class Scores:
    """All that is known of a set of answers.

    Attributes:
        figures: All figures, those of the answers first.
        cases: Judgements of the answers, a row a case, in the order of `Judgement`.
        detection: What detection is scored by.
        notes: Remarks for readers.
    """

    figures: tuple[Figure, ...]
    cases: pd.DataFrame
    detection: str
    notes: tuple[str, ...]

    def value(self, name: str, subset: str = ALL, method: str = ANSWERS) -> float:
        """Value of a figure.

        Args:
            name: Name of the figure.
            subset: Name of the subset of cases.
            method: `answers`, `chance`, or a baseline's name.

        Returns:
            The value; NaN if there is no such figure.
        """
        values = (f.value for f in self.figures if (f.name, f.subset, f.method) == (name, subset, method))
        return next(values, nan)


def score(
    answered: LabelledAnswers,
    seed: int = 0,
    *,
    resamples: int = RESAMPLES,
    deals: int = DEALS,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Scores:
    """Scores answers.

    Args:
        answered: Answers and labels, from `read_labelled_answers`.
        seed: Seed of resamples and of chance.
        resamples: Number of bootstrap samples.
        deals: Number of random assignments of answers to cases.
        progress: Called with the methods that are scored, chance among them, and their number.

    Returns:
        The scores.
    """
    generator = np.random.default_rng(seed)
    cases = _judged(answered.answers, answered.labels)
    baselines = _baselines(answered)
    methods = len(baselines) + 2
    figures = figures_of(ANSWERS, cases, generator, resamples)
    progress(1, methods)
    figures += _by_chance(answered, generator, deals)
    for done, (method, answers) in enumerate(baselines.items(), start=2):
        progress(done, methods)
        labels = {case: answered.labels[case] for case in answers}
        figures += figures_of(method, _judged(answers, labels), generator, resamples)
    return Scores(tuple(figures), cases, _detection(cases), (*answered.notes, *_notes(cases)))


def _judged(answers: Mapping[str, BaselineAnswer], labels: Mapping[str, Label]) -> pd.DataFrame:
    names = sorted(labels)
    table = pd.DataFrame([vars(judgement_of(case, answers[case], labels[case])) for case in names])
    return table.assign(evidence=_evidence(table, [answers[case] for case in names]))


def _baselines(answered: LabelledAnswers) -> dict[str, dict[str, BaselineAnswer]]:
    """Answers of each simpler method, on the cases where there is one."""
    methods = sorted({method for answer in answered.answers.values() for method in answer.baselines})
    return {
        method: {
            case: answer.baseline(method) for case, answer in answered.answers.items() if method in answer.baselines
        }
        for method in methods
    }


def _detection(cases: pd.DataFrame) -> str:
    """Scores of detection: p-values if there are any, otherwise probabilities, otherwise verdicts."""
    return next((column for column in ("p", "none") if np.isfinite(cases[column]).any()), "verdict")


def _evidence(cases: pd.DataFrame, answers: Sequence[BaselineAnswer]) -> Float[ndarray, " cases"]:
    """Certainty of an answer that something acts; an answer without one gets the worst.

    If an answer states causes but not `none`, the rest of the probability belongs to `none`.
    """
    column = _detection(cases)
    if column == "verdict":
        return cases["detected"].to_numpy(float)
    stated = cases[column].to_numpy(float)
    if column == "none":
        left = [answer.probabilities()[NONE] if answer.causes else nan for answer in answers]
        stated = np.where(np.isfinite(stated), stated, left)
    return np.where(np.isfinite(stated), 1 - stated, cases["kind"] == NULL)


def _by_chance(answered: LabelledAnswers, generator: np.random.Generator, deals: int) -> list[Figure]:
    """Figures of the same answers dealt at random: mean over deals, and between which values 95 % of them lie."""
    names = sorted(answered.labels)
    figures = [figure for _ in range(deals) for figure in figures_of(CHANCE, _dealt(names, answered, generator), None)]
    dealt: dict[tuple[str, str], list[Figure]] = {}
    for figure in (figure for figure in figures if isfinite(figure.value)):
        dealt.setdefault((figure.name, figure.subset), []).append(figure)
    return [_summary(values) for values in dealt.values()]


def _dealt(names: Sequence[str], answered: LabelledAnswers, generator: np.random.Generator) -> pd.DataFrame:
    order = generator.permutation(len(names))
    answers = {name: answered.answers[names[int(place)]] for name, place in zip(names, order, strict=True)}
    return _judged(answers, answered.labels)


def _summary(dealt: Sequence[Figure]) -> Figure:
    """One figure over all deals."""
    values = [figure.value for figure in dealt]
    low, high = (float(bound) for bound in np.percentile(values, [2.5, 97.5]))
    return replace(dealt[0], value=float(np.mean(values)), low=low, high=high, goal=None)


def _notes(cases: pd.DataFrame) -> list[str]:
    words = {"p": "1 - p of the base model", "none": "1 - probability of none", "verdict": "the verdict"}
    notes = [f"Detection is scored by {words[_detection(cases)]}."]
    if units := sorted(set(filter(None, cases["unit"]))):
        notes.append(_severities(cases, units))
    counts = Counter(cases["kind"])
    notes.append(f"Cases: {', '.join(f'{number} {kind}' for kind, number in counts.most_common())}.")
    return notes


def _severities(cases: pd.DataFrame, units: Sequence[str]) -> str:
    if len(units) == 1:
        return f"Severities are multiples of the {units[0]}."
    kinds = cases["kind"].to_numpy(str)[cases["unit"].to_numpy(str) == TYPICAL]
    singles, pairs = (np.count_nonzero(kinds == kind) for kind in (SINGLE, PAIR))
    text = f"Severities are multiples of the {DETECTABLE} in the case's own fabric."
    if singles:
        text += (
            f" {singles} single effects that no fabric shows as strongly as that have multiples of the {TYPICAL}: "
            f"`{HIDDEN}`, and in no level."
        )
    return f"{text} {pairs} pairs have such multiples, too, and are in no level." if pairs else text
