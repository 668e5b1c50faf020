"""Definitions of the figures by which answers are scored: shares and means over judged cases, with their goals."""

from dataclasses import dataclass
from math import inf, isfinite

from cusick_bench.withheld.format.label import NULL, OUTSIDE, PAIR, SINGLE

ALL = "all"
CLEAR = ">= 2x"  # single effects of at least twice the detectable shift, for which the goals hold

HIDDEN = "typical"  # single effects with typical severities, in a suite where others have detectable shifts
CLEAR_FROM = 2 - 1e-6
DISTINCT = ">= 2x, unlike others"  # clear effects that no other effect imitates completely
DISTINCT_FROM = 1.0  # [detectable shifts] least remainder of an effect that no other one imitates
LEVELS = ("1x", "2x")  # those that a goal is about


@dataclass(frozen=True)
class Goal:
    """The goal of a figure.

    Attributes:
        low, high: Where it should lie.
        highest_bound: What the upper bound of its interval should not pass.
    """

    low: float = 0.0
    high: float = inf
    highest_bound: float = inf

    def __str__(self) -> str:
        if self.low and isfinite(self.high):
            return f"{self.low:g} to {self.high:g}"
        text = f">= {self.low:g}" if self.low else f"<= {self.high:g}"
        return text + (f", bound <= {self.highest_bound:g}" if isfinite(self.highest_bound) else "")

    def reached(self, value: float, upper: float) -> bool:
        """Whether a figure is as good as it should be.

        Args:
            value: The figure.
            upper: Upper bound of its interval.

        Returns:
            True if it is.
        """
        inside = self.low - 1e-9 <= value <= self.high + 1e-9
        return inside and not (isfinite(self.highest_bound) and upper > self.highest_bound)


@dataclass(frozen=True)
class Measure:
    """A share of cases or a mean over them.

    Attributes:
        name: Name of the figure.
        column: Attribute of `Judgement` that it is the mean of.
        kinds: Kinds of the cases that it is taken over.
        meaning: What it says, in a sentence.
        goals: What it should be, by subset of cases.
        is_share: Whether each case is a yes or a no.
        least, greatest: Between which the mean lies, whatever the cases are.
        by_severity: Whether it is also given for each level of severity.
    """

    name: str
    column: str
    kinds: tuple[str, ...]
    meaning: str
    goals: dict[str, Goal]
    is_share: bool = True
    least: float = 0.0
    greatest: float = 1.0
    by_severity: bool = True


AUROC = "detection AUROC"
AUROC_GOAL = Goal(low=0.98)
CALIBRATION = "expected calibration error"
CALIBRATION_GOAL = Goal(high=0.05)
CALIBRATION_BY_CHANCE = "calibration error if calibrated"

_EXCLUSIVE = (NULL, SINGLE, OUTSIDE)  # a pair is no one outcome

MEASURES = (
    Measure(
        "false positives",
        "detected",
        (NULL,),
        "nulls with another verdict than none or refused",
        {ALL: Goal(high=0.05, highest_bound=0.08)},
        by_severity=False,
    ),
    Measure(
        "power",
        "detected",
        (SINGLE,),
        "single effects with another verdict than none or refused",
        {"1x": Goal(low=0.7), "2x": Goal(low=0.9)},
    ),
    Measure(
        "exact effect",
        "exact",
        (SINGLE,),
        "the first place is the true effect (verdict effect, several or ambiguous)",
        {CLEAR: Goal(low=0.8)},
    ),
    Measure(
        "exact effect (stated)",
        "exact_stated",
        (SINGLE,),
        "probability that the answers themselves give to what they name",
        {},
        is_share=False,
    ),
    Measure(
        "class",
        "class_right",
        (SINGLE,),
        "the first place is of the true class, or the ambiguous set is all that silhouettes can tell",
        {CLEAR: Goal(low=0.9)},
    ),
    Measure(
        "class (stated)",
        "class_stated",
        (SINGLE,),
        "probability that the answers give to the class that they name",
        {},
        is_share=False,
    ),
    Measure(
        "told as far as possible",
        "equivalent",
        (SINGLE,),
        "the ambiguous set is all that silhouettes can tell, and what to measure is named: part of the row above",
        {},
    ),
    Measure("90 % set covers", "covered", (SINGLE,), "the set holds the true effect", {CLEAR: Goal(0.87, 0.93)}),
    Measure(
        "90 % set size",
        "set_size",
        (SINGLE,),
        "mean number of names in it",
        {CLEAR: Goal(high=2.0)},
        is_share=False,
        greatest=inf,
    ),
    Measure(
        "90 % set covers, any case",
        "covered",
        _EXCLUSIVE,
        "the same over nulls (none), single effects and those outside the list (unknown)",
        {},
        by_severity=False,
    ),
    Measure(
        "unknown recalled",
        "recalled",
        (OUTSIDE,),
        "effects outside the list with the verdict unknown",
        {ALL: Goal(low=0.75)},
    ),
    Measure(
        "false abstention",
        "abstained",
        (SINGLE,),
        "effects of the list with the verdict unknown",
        {CLEAR: Goal(high=0.1)},
    ),
    Measure(
        "Brier score",
        "brier",
        _EXCLUSIVE,
        "of the probabilities over all outcomes; 0 is perfect, 2 the worst",
        {},
        is_share=False,
        greatest=2.0,
        by_severity=False,
    ),
    Measure(
        "log score",
        "surprise",
        _EXCLUSIVE,
        "mean surprise at the truth [nat]",
        {},
        is_share=False,
        greatest=inf,
        by_severity=False,
    ),
    Measure(
        "pointing hit",
        "pointing",
        (SINGLE,),
        "local effects whose region the strongest cell of the map touches",
        {CLEAR: Goal(low=0.8)},
    ),
    Measure(
        "angular IoU",
        "overlap",
        (SINGLE,),
        "claimed and true directions of local effects, intersection over union",
        {CLEAR: Goal(low=0.5)},
        is_share=False,
    ),
    Measure("falsely localised", "localised_falsely", (SINGLE,), "effects that act nowhere in particular", {}),
    Measure(
        "closure within .1",
        "closure_close",
        (SINGLE,),
        "closure as large as that of the true effect, to .1; an answer without one is far off",
        {CLEAR: Goal(low=0.8)},
    ),
    Measure("closure interval covers", "closure_covered", (SINGLE,), "its 90 % interval holds the latter", {}),
    Measure("pairs: power", "detected", (PAIR,), "pairs with another verdict than none or refused", {}),
    Measure(
        "pairs: top-2 recall",
        "top_two",
        (PAIR,),
        "share of a pair's effects in the first two places: those of the named set, the likeliest of each group of "
        "look-alikes that acts beside it, what is likeliest else",
        {},
        is_share=False,
    ),
    Measure(
        "pairs: both found",
        "both",
        (PAIR,),
        "pairs whose effects hold the first two places; where shifts were measured, a pair's severity is that of the "
        "effect which shows least beside the other",
        {CLEAR: Goal(low=0.5)},
    ),
    Measure(
        "pairs: both told",
        "told",
        (PAIR,),
        "pairs each of whose effects is in these places or in such a group",
        {},
    ),
)
