"""Scores answers to withheld cases: every figure with its interval, beside what chance and simpler methods reach.

Shares have Wilson's interval, which does not collapse where all cases went well; all other figures have a percentile
bootstrap over cases. Chance is measured, not assumed: the same answers, dealt to the cases at random.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite, nan

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.withheld.format.answer import Answer
from cusick_bench.withheld.format.label import DETECTABLE, NULL, OUTSIDE, SINGLE, TYPICAL, Label
from cusick_bench.withheld.scoring.calibration import (
    calibration_error,
    calibration_error_by_chance,
    separation,
    wilson,
)
from cusick_bench.withheld.scoring.judgement import judge
from cusick_bench.withheld.scoring.measures import (
    ALL,
    AUROC,
    AUROC_GOAL,
    CALIBRATION,
    CALIBRATION_BY_CHANCE,
    CALIBRATION_GOAL,
    CLEAR,
    CLEAR_FROM,
    DISTINCT,
    DISTINCT_FROM,
    HIDDEN,
    LEVELS,
    MEASURES,
    Goal,
    Measure,
)
from cusick_bench.withheld.scoring.revealed import Revealed

ANSWERS, CHANCE = "answers", "chance"
RESAMPLES = 1000
DEALS = 40  # random assignments of answers to cases
_DIFFERENT = 2  # cases below which nothing can be resampled


@dataclass(frozen=True)
class Figure:
    """One number of the table.

    Attributes:
        method: `answers`, `chance`, or a baseline's name.
        name: What is measured.
        subset: Which cases: `all`, a level of severity as `2x`, `>= 2x`, or those of the latter that no other effect
            makes.
        value: The figure; NaN without cases.
        low, high: Its 95 % interval.
        cases: How many cases it is taken over.
        goal: What it should be, if anything.
    """

    method: str
    name: str
    subset: str
    value: float
    low: float
    high: float
    cases: int
    goal: Goal | None = None

    @property
    def reached(self) -> str:
        """`yes`, `no`, or "" where there is no goal or no case."""
        if self.goal is None or not isfinite(self.value):
            return ""
        return "yes" if self.goal.reached(self.value, self.high) else "no"

    def record(self) -> dict[str, object]:
        """Flat, for CSV and JSON."""
        goal = "" if self.goal is None else str(self.goal)
        return {**asdict(self), "goal": goal, "reached": self.reached}


@dataclass(frozen=True, eq=False)
class Scores:
    """All that is known of a set of answers.

    Attributes:
        figures: A number each, those of the answers first.
        cases: Judgements of the answers, a row a case, in the order of `Judgement`.
        detection: What detection is scored by.
        notes: What a reader must know.
    """

    figures: tuple[Figure, ...]
    cases: pd.DataFrame
    detection: str
    notes: tuple[str, ...]

    def value(self, name: str, subset: str = ALL, method: str = ANSWERS) -> float:
        """A figure's value; NaN if there is none."""
        found = (f.value for f in self.figures if (f.name, f.subset, f.method) == (name, subset, method))
        return next(found, nan)


def score(revealed: Revealed, seed: int = 0) -> Scores:
    """Scores answers.

    Args:
        revealed: Answers and labels, from `reveal`.
        seed: Of resamples and of chance.
    """
    generator = np.random.default_rng(seed)
    cases = _judged(revealed.answers, revealed.labels)
    found = _figures(ANSWERS, cases, generator) + _by_chance(revealed, generator)
    for name, answers in _baselines(revealed.answers).items():
        labels = {case: revealed.labels[case] for case in answers}
        found += _figures(name, _judged(answers, labels), generator)
    return Scores(tuple(found), cases, _detection(cases), (*revealed.notes, *_notes(cases)))


def _judged(answers: Mapping[str, Answer], labels: Mapping[str, Label]) -> pd.DataFrame:
    table = pd.DataFrame([vars(judge(case, answers[case], labels[case])) for case in sorted(labels)])
    return table.assign(evidence=_evidence(table))


def _baselines(answers: Mapping[str, Answer]) -> dict[str, dict[str, Answer]]:
    """Answers of each simpler method, on the cases where there is one."""
    names = sorted({name for answer in answers.values() for name in answer.baselines})
    return {
        name: {case: answer.baselines[name] for case, answer in answers.items() if name in answer.baselines}
        for name in names
    }


def _detection(cases: pd.DataFrame) -> str:
    """What detection is scored by: p-values where there are any, else probabilities, else verdicts."""
    return next((column for column in ("p", "none") if np.isfinite(cases[column]).any()), "verdict")


def _evidence(cases: pd.DataFrame) -> Float[ndarray, " cases"]:
    """How sure an answer is that something is there. An answer that does not say counts against its giver."""
    column = _detection(cases)
    if column == "verdict":
        return cases["detected"].to_numpy(float)
    stated = cases[column].to_numpy(float)
    return np.where(np.isfinite(stated), 1 - stated, cases["kind"] == NULL)


def _figures(method: str, cases: pd.DataFrame, generator: np.random.Generator | None) -> list[Figure]:
    """All figures of one method; without a generator, the values alone."""
    kind, evidence = cases["kind"].to_numpy(str), cases["evidence"].to_numpy(float)
    subsets, found = _subsets(cases), []
    for measure in MEASURES:
        values = cases[measure.column].to_numpy(float)
        asked = np.isin(kind, measure.kinds) & np.isfinite(values)
        for subset in subsets if measure.by_severity else (ALL,):
            found.append(_figure(method, measure, subset, values[asked & subsets[subset]], generator))
    for subset, within in subsets.items():
        positives, goal = evidence[(kind == SINGLE) & within], AUROC_GOAL if subset == CLEAR else None
        found.append(_auroc(method, subset, positives, evidence[kind == NULL], goal, generator))
    return found + _calibration(method, cases, generator)


def _subsets(cases: pd.DataFrame) -> dict[str, Bool[ndarray, " cases"]]:
    """Which cases are in a subset: all, clear ones, each level of severity that there is or that has a goal.

    Where shifts were measured, clear ones that no other effect makes are a subset too.

    Single effects whose severity is in another unit than the levels' form a subset of their own.
    """
    level, single = levels(cases), cases["kind"].to_numpy(str) == SINGLE
    known = {*filter(None, level[np.isin(cases["kind"].to_numpy(str), (SINGLE, OUTSIDE))]), *LEVELS}
    distinct = clear(cases) & (cases["unlike"].to_numpy(float) >= DISTINCT_FROM)
    others = single & (level == "") & (cases["level"].to_numpy(str) != "")
    return {
        ALL: np.ones(len(cases), bool),
        CLEAR: clear(cases),
        **({DISTINCT: distinct} if distinct.any() else {}),
        **{name: level == name for name in sorted(known, key=lambda name: float(name.rstrip("x")))},
        **({HIDDEN: others} if others.any() else {}),
    }


def levels(cases: pd.DataFrame) -> np.ndarray:
    """Level of severity of every case; "" where it has none, or one in another unit.

    Where any single effect has multiples of the detectable shift, only these count: who gives typical severities beside
    them does so because the effect is not known to be detectable.
    """
    unit, single = cases["unit"].to_numpy(str), cases["kind"].to_numpy(str) == SINGLE
    mixed = bool((unit[single] == DETECTABLE).any())
    return np.where((unit == DETECTABLE) | (not mixed), cases["level"].to_numpy(str), "")


def clear(cases: pd.DataFrame) -> Bool[ndarray, " cases"]:
    """Whether a case's severity is at least twice the unit of the levels."""
    return (cases["multiple"].to_numpy(float) >= CLEAR_FROM) & (levels(cases) != "")


def _figure(
    method: str,
    measure: Measure,
    subset: str,
    values: Float[ndarray, " cases"],
    generator: np.random.Generator | None,
) -> Figure:
    mean = float(values.mean()) if len(values) else nan
    low, high = nan, nan
    if generator is not None:
        low, high = wilson(float(values.sum()), len(values)) if measure.is_share else _bootstrap(values, generator)
    return Figure(method, measure.name, subset, mean, low, high, len(values), measure.goals.get(subset))


def _bootstrap(values: ndarray, generator: np.random.Generator) -> tuple[float, float]:
    """95 % interval of a mean."""
    if len(values) < _DIFFERENT:
        return nan, nan
    drawn = generator.choice(values, size=(RESAMPLES, len(values)))
    low, high = np.percentile(drawn.mean(1), [2.5, 97.5])
    return float(low), float(high)


def _auroc(
    method: str,
    subset: str,
    positives: ndarray,
    nulls: ndarray,
    goal: Goal | None,
    generator: np.random.Generator | None,
) -> Figure:
    number = len(positives) + len(nulls)
    if not len(positives) or not len(nulls):
        return Figure(method, AUROC, subset, nan, nan, nan, number, goal)
    low, high = nan, nan
    if generator is not None and min(len(positives), len(nulls)) >= _DIFFERENT:
        drawn = (generator.choice(values, size=(RESAMPLES, len(values))) for values in (positives, nulls))
        low, high = (float(bound) for bound in np.percentile(separation(*drawn), [2.5, 97.5]))
    return Figure(method, AUROC, subset, float(separation(positives, nulls)), low, high, number, goal)


def _calibration(method: str, cases: pd.DataFrame, generator: np.random.Generator | None) -> list[Figure]:
    known = cases.loc[cases["confidence"].notna()]
    confidence, right = known["confidence"].to_numpy(float), known["right"].to_numpy(float)
    if not len(known):
        return []
    low, high, chance = nan, nan, []
    if generator is not None:
        drawn = generator.integers(len(known), size=(RESAMPLES, len(known)))
        errors = [calibration_error(confidence[rows], right[rows]) for rows in drawn]
        low, high = (float(bound) for bound in np.percentile(errors, [2.5, 97.5]))
        value = calibration_error_by_chance(confidence, generator)
        chance = [Figure(method, CALIBRATION_BY_CHANCE, ALL, value, nan, nan, len(known))]
    error = calibration_error(confidence, right)
    return [Figure(method, CALIBRATION, ALL, error, low, high, len(known), CALIBRATION_GOAL), *chance]


def _by_chance(revealed: Revealed, generator: np.random.Generator) -> list[Figure]:
    """Figures of the same answers dealt at random: mean over deals, and between which values 95 % of them lie."""
    names = sorted(revealed.labels)
    deals = [_figures(CHANCE, _dealt(names, revealed, generator), None) for _ in range(DEALS)]
    dealt: dict[tuple[str, str], list[Figure]] = {}
    for figure in (figure for deal in deals for figure in deal if isfinite(figure.value)):
        dealt.setdefault((figure.name, figure.subset), []).append(figure)
    return [_summary(found) for found in dealt.values()]


def _dealt(names: Sequence[str], revealed: Revealed, generator: np.random.Generator) -> pd.DataFrame:
    order = generator.permutation(len(names))
    answers = {name: revealed.answers[names[int(place)]] for name, place in zip(names, order, strict=True)}
    return _judged(answers, revealed.labels)


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
    others = np.count_nonzero((cases["unit"].to_numpy(str) == TYPICAL) & (cases["kind"].to_numpy(str) == SINGLE))
    return (
        f"Severities are multiples of the {DETECTABLE} in the case's own fabric. {others} single effects that no "
        f"fabric shows as strongly as that have multiples of the {TYPICAL}: `{HIDDEN}`, and in no level."
    )
