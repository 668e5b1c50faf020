"""The answer to a withheld case: the part of a diagnosis that can be judged against a label."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from cusick_bench.diagnosis.document.part import Interval, Map, Part, Probability
from cusick_bench.diagnosis.inference.findings.verdict import Verdict


def _names(value: Any) -> Any:
    """A list of names; files of earlier versions hold one name, or null."""
    if value is None:
        return ()
    return (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value


class StatedCause(Part):
    """A cause as an answer states it.

    Attributes:
        effect: Name of a registered effect, `none` or `unknown`.
        stage: Class of the effect: material, history, boundary, contact or imaging; "" for `none` and `unknown`. The
            file's key is `class`.
        probability: That it accounts for most; those of all causes add up to 1.
        acting: That it acts, alone or with others; None for `none` and `unknown`.
        parameters: Best estimates by name, in the units of the effect's registered parameters.
    """

    effect: str
    stage: str = Field(default="", validation_alias="class", serialization_alias="class")
    probability: Probability
    acting: Probability | None = None
    parameters: dict[str, float] = Field(default_factory=dict)


class StatedGap(Part):
    """The gap as an answer states it: squared energy distances of statistics in units of their standard deviations.

    Attributes:
        base: Between data and base model, on samples that were not fitted [1]; None where nothing was simulated.
        floor: What chance alone exceeds in one of twenty cases [1].
        p: p-value of the base model.
    """

    base: float | None = None
    floor: float | None = None
    p: Annotated[float, Field(ge=0, le=1)] | None = None


class Location(Part):
    """Where the cause acts.

    Attributes:
        stage: Probability of each class of effects, of `none` and of `unknown`.
        map: Probability of each place on the overhang, given that the cause acts at one place.
        kind: `patch`, `ring`, `direction` or "".
        angle_deg: First and second edge of the named region, counter-clockwise from warp, face up [deg].
        radius_m: Its inner and outer radius [m].
        localisable: Whether there is a place to name.
        why_not: Why there is none, in words.
    """

    stage: dict[str, Probability] = Field(default_factory=dict)
    map: Map | None = None
    kind: str = ""
    angle_deg: Interval | None = None
    radius_m: Interval | None = None
    localisable: bool = False
    why_not: str = ""


class Closure(Part):
    """How far the named effects close the gap on samples that were not fitted.

    Attributes:
        effect: Names of the effects that were simulated together.
        fraction: (gap of the base model - gap with them) / gap of the base model, where that exceeds its floor.
        ci90: Its 90 % interval over samples.
    """

    effect: Annotated[tuple[str, ...], BeforeValidator(_names)] = ()
    fraction: float | None = None
    ci90: Interval | None = None


class BudgetShare(Part):
    """Share of the gap that an effect takes, on samples that its severity was not fitted to.

    Attributes:
        effect: Its name.
        share: The share; below 0 where unseen samples fit worse with it.
        ci90: Its 90 % interval over halves of the samples.
    """

    effect: str
    share: float
    ci90: Interval | None = None


class Unexplained(Part):
    """Share of the gap that no effect of the budget takes.

    Attributes:
        share: The share; None where there is no gap to share.
        ci90: Its 90 % interval over halves of the samples.
    """

    share: float | None = None
    ci90: Interval | None = None


class NextMeasurement(Part):
    """A measurement that would lower the doubt.

    Attributes:
        name: Short name.
        what: What to do, in a sentence.
        bits: Expected drop of the entropy of the causes [bit].
        about: The likely causes that it speaks about.
    """

    name: str
    what: str = ""
    bits: float | None = None
    about: tuple[str, ...] = ()


class Baseline(Part):
    """Answer of a simpler method to the same fabric.

    Attributes:
        verdict: `effect` or `none`.
        causes: At most five, the likeliest first; their parameters are not estimated.
        set90: The likeliest one.
    """

    verdict: Verdict
    causes: tuple[StatedCause, ...] = ()
    set90: tuple[str, ...] = ()


class Answer(Part):
    """The answer to a withheld case.

    Attributes:
        verdict: What is found: no effect, one, several, one of some, or something that is not on the list.
        effects: The named set, the likeliest first.
        groups: Look-alikes of which one acts beside the named set.
        budget: Which share of the gap each effect takes: the named ones, and the likeliest of each group.
        unexplained: What they leave.
        gap: How far the simulation is from the data.
        causes: Those that are named, act with 2 % or account for most with 0.5 %; by the latter, the likeliest first.
        set90: The fewest causes that hold 90 % of the probability.
        where: Where the cause acts.
        closure: How far the named effects close the gap.
        next: What to measure next, the most informative first.
        baselines: Answers of simpler methods, by their names.
        without: Effects that were not considered.
        refused: Why there is no diagnosis, where there is none.
    """

    verdict: Verdict
    effects: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    budget: tuple[BudgetShare, ...] = ()
    unexplained: Unexplained = Unexplained()
    gap: StatedGap = StatedGap()
    causes: tuple[StatedCause, ...] = ()
    set90: tuple[str, ...] = ()
    where: Location = Location()
    closure: Closure = Closure()
    next: tuple[NextMeasurement, ...] = ()
    baselines: dict[str, Baseline] = Field(default_factory=dict)
    without: tuple[str, ...] = ()
    refused: str | None = None
