"""An answer to a withheld case: verdict, causes with their probabilities, where it lies, how far the gap shrinks.

The models are the form of `answers.json`. Answers may come from anywhere: what an answer leaves out, or gives as null,
is not known; keys that are not listed here are kept.
"""

from functools import cached_property
from math import nan
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter, model_validator

from cusick_bench.withheld.format import causes, location
from cusick_bench.withheld.format.checked_json import entries, read_object, validated
from cusick_bench.withheld.format.fields import (
    Document,
    Number,
    OneOrSeveral,
    OutcomeName,
    Probability,
    SetMemberName,
    broken_rule,
    finite_or_nan,
    known_name,
)
from cusick_bench.withheld.format.location import Region
from cusick_bench.withheld.format.place import Place

REFUSED = "refused"
"""Verdict of an answer that says nothing of the case."""
VERDICTS = ("none", "effect", "several", "ambiguous", "unknown", REFUSED)
SET_LEVEL = 0.9

_ROUNDING = 1e-6
_DIRECTION = "direction"  # kind of a place that is none: of a tilt, say
_ANSWERS = ("answers", "cases")  # keys under which they may stand in a document


def _for_null(stands: Any) -> BeforeValidator:
    """Null means left out: what then stands in its place."""
    return BeforeValidator(lambda value: stands if value is None else value)


def _empty_tuple_for_null(value: Any) -> Any:
    return value or ()


def _listed(value: Any) -> Any:
    """One measurement is a list of one."""
    if isinstance(value, str | dict):
        return [value] if value else []
    return value if isinstance(value, list | tuple) else []


def _verdict_of(answer: dict[str, Any]) -> Any:
    """The verdict that an answer gives, or else what it amounts to by the rest of it, which is not checked yet."""
    if answer.get("verdict") is not None:
        return answer["verdict"]
    if answer.get("refused"):
        return REFUSED
    listed = answer.get("causes")
    stated = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list | tuple) else []
    known = [one for one in stated if isinstance(one.get("probability"), int | float)]
    likeliest = max(known, key=lambda one: one["probability"], default={"effect": causes.NONE}).get("effect")
    named = answer.get("effects") or answer.get("groups") or likeliest not in (causes.NONE, causes.UNKNOWN)
    return "effect" if named else likeliest


Verdict = Annotated[str, BeforeValidator(lambda name: known_name(str(name), VERDICTS))]
MapRow = Annotated[tuple[Number | None, ...], Field(min_length=location.SECTORS, max_length=location.SECTORS)]
MapOfCells = Annotated[tuple[MapRow, ...], Field(min_length=location.RINGS, max_length=location.RINGS)]


class StatedCause(Document):
    """A cause with its probability.

    Attributes:
        effect: Name of the effect, `none` or `unknown`.
        class_name: Class of the effect.
        probability: Probability of the cause.
        parameters: Its parameters, by name.
    """

    effect: OutcomeName
    class_name: str | None = Field(default=None, alias="class")
    probability: Probability
    parameters: Annotated[dict[str, Any], _for_null({})] = Field(default_factory=dict)


class Gap(Document):
    """The gap between data and simulation.

    Attributes:
        base: Gap of the base model.
        floor: Gap that chance alone would leave.
        p: p-value of the base model.
    """

    base: Number | None = None
    floor: Number | None = None
    p: Probability | None = None


class Where(Place):
    """Where the gap lies.

    Attributes:
        stage: Probability of each stage of the pipeline.
        map: Weight of each cell of the cloth, rings from the plate to the rim.
        localisable: Whether the answer says that the effect can be localised.
    """

    stage: Annotated[dict[str, Number | None], _for_null({})] = Field(default_factory=dict)
    map: MapOfCells | None = None
    localisable: Annotated[bool, _for_null(False)] = False


class Closure(Document):
    """How far the named effects close the gap.

    Attributes:
        effect: The named effect.
        fraction: Share of the gap that it closes.
        ci90: 90 % interval of that share.
    """

    effect: OneOrSeveral[str] | None = None
    fraction: Number | None = None
    ci90: tuple[Number | None, Number | None] | None = None


class BaselineAnswer(Document):
    """A blind answer to one case, by a diagnosis or by a simpler method.

    Attributes:
        verdict: One of `VERDICTS`; where none is given, what the answer amounts to: `refused` if it says why, `effect`
            if it names effects or an effect is the likeliest of its causes, `unknown` if that is, else `none`.
        gap: The gap between data and simulation.
        named: The set of effects that act together, where it is stated.
        groups: Look-alikes of which one acts beside the named set, the likeliest of each first.
        stated: The causes as they stand in the document.
        stated_set: Names of the 90 % set as they stand there.
        where: Where the gap lies.
        closure: How far it shrinks.
        measurements: What to measure next, names or descriptions.
        left_out: Effects that the answerer was not offered; their cases are out of its list.
    """

    verdict: Verdict
    gap: Annotated[Gap, _for_null({})] = Gap()
    named: Annotated[tuple[OutcomeName, ...], BeforeValidator(_empty_tuple_for_null)] = Field(
        default=(), alias="effects"
    )
    groups: Annotated[tuple[tuple[OutcomeName, ...], ...], BeforeValidator(_empty_tuple_for_null)] = ()
    stated: Annotated[tuple[StatedCause, ...], BeforeValidator(_empty_tuple_for_null)] = Field(
        default=(), alias="causes"
    )
    stated_set: tuple[SetMemberName, ...] | None = Field(default=None, alias="set90")
    where: Annotated[Where, _for_null({})] = Where()
    closure: Annotated[Closure, _for_null({})] = Closure()
    measurements: Annotated[tuple[str | dict[str, Any], ...], BeforeValidator(_listed)] = Field(
        default=(), alias="next"
    )
    left_out: Annotated[tuple[str, ...], BeforeValidator(_empty_tuple_for_null)] = Field(default=(), alias="without")

    @model_validator(mode="before")
    @classmethod
    def _default_verdict(cls, value: Any) -> Any:
        return {**value, "verdict": _verdict_of(value)} if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _check_causes(self) -> "BaselineAnswer":
        names = [cause.effect for cause in self.stated]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise broken_rule(f"each cause must stand once, got {twice} twice; give it its total probability")
        total = sum(cause.probability for cause in self.stated)
        if total > 1 + 1e-3:
            raise broken_rule(f"probabilities must sum to at most 1, got {total:.4g}; rescale")
        if self.verdict in ("effect", "several", "ambiguous") and not names:
            raise broken_rule(f"a verdict of {self.verdict} must name causes, got none; answer none or unknown")
        return self

    @cached_property
    def causes(self) -> tuple[tuple[str, float], ...]:
        """Names with probabilities, the likeliest first; may hold "none" and "unknown"."""
        named = [(cause.effect, float(cause.probability)) for cause in self.stated]
        return tuple(sorted(named, key=lambda cause: -cause[1]))

    @cached_property
    def set90(self) -> tuple[str, ...]:
        """Names among which the cause is with a probability of 90 %.

        Where none are stated, the fewest causes that hold 90 %, and at least the verdict itself.
        """
        members = list(self.stated_set or ())
        if self.stated_set is None:
            total = 0.0
            for name, p in self.causes:
                if total >= SET_LEVEL - _ROUNDING:
                    break
                members.append(name)
                total += p
        if not members and self.verdict in (causes.NONE, causes.UNKNOWN):
            members = [self.verdict]
        return tuple(dict.fromkeys(members))

    @property
    def p(self) -> float:
        """p-value of the base model; NaN if not given."""
        return finite_or_nan(self.gap.p)

    @cached_property
    def peak(self) -> Region | None:
        """Place with the largest value of the map; None if there is no map, or a flat one."""
        if self.where.map is None:
            return None
        values = np.array([[finite_or_nan(value) for value in row] for row in self.where.map])
        return location.peak(values, self.where.kind or "")

    @property
    def localisable(self) -> bool:
        """Whether the answer says that the effect can be localised; a direction alone is no place."""
        return self.where.localisable and self.where.kind != _DIRECTION

    @property
    def closure_interval(self) -> tuple[float, float]:
        """90 % interval of the closure; NaN if not given."""
        low, high = self.closure.ci90 or (None, None)
        return finite_or_nan(low), finite_or_nan(high)

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects: the named set (or the likeliest), the likeliest of each group beside it, then all by probability."""
        likely = [name for name, _ in self.causes if name not in (causes.NONE, causes.UNKNOWN)]
        first = sorted(self.named, key=lambda name: likely.index(name) if name in likely else len(likely))
        first = first or likely[:1]
        beside = [group[0] for group in self.groups if group and not {*group} & {*first}]
        return tuple(dict.fromkeys((*first, *beside, *likely)))

    @property
    def leading(self) -> str:
        """The verdict as one name: the likeliest effect, `none`, `unknown` or `refused`."""
        if self.verdict in (causes.NONE, causes.UNKNOWN, REFUSED):
            return self.verdict
        return self.effects[0] if self.effects else causes.UNKNOWN

    @property
    def probability_of_none(self) -> float:
        """As stated; NaN where "none" is not among the causes."""
        return dict(self.causes).get(causes.NONE, nan)

    def probabilities(self) -> dict[str, float]:
        """Probability of every outcome.

        What the stated causes leave belongs to "none" (or to "unknown", if that is the verdict), else to the other of
        the two, else to all effects not named alike. A refusal says nothing: what it leaves belongs to all alike.

        Returns:
            The probability by name; they sum to 1.
        """
        stated = dict(self.causes)
        rest = 1 - sum(stated.values())
        order = (causes.UNKNOWN, causes.NONE) if self.verdict == causes.UNKNOWN else (causes.NONE, causes.UNKNOWN)
        others = [name for name in order if name not in stated][:1] if self.verdict != REFUSED else []
        others = others or [name for name in causes.outcomes() if name not in stated]
        if rest > 0 and others:
            stated |= dict.fromkeys(others, rest / len(others))
        total = sum(stated.values())
        if not total:  # every outcome has a probability of 0, which says as little as a refusal
            return dict.fromkeys(causes.outcomes(), 1 / len(causes.outcomes()))
        return {name: stated.get(name, 0.0) / total for name in causes.outcomes()}


class Answer(BaselineAnswer):
    """The answer to one case.

    Attributes:
        stated_set: Names of the 90 % set; an answer must give them, unless it is a refusal.
        baselines: Answers of simpler methods to the same case, by method.
        refused: Why the case could not be diagnosed; "" where it was.
    """

    stated_set: tuple[SetMemberName, ...] | None = Field(alias="set90")
    baselines: Annotated[dict[str, BaselineAnswer], _for_null({})] = Field(default_factory=dict)
    refused: Annotated[str, _for_null("")] = ""

    @model_validator(mode="before")
    @classmethod
    def _no_set_of_a_refusal(cls, value: Any) -> Any:
        return {"set90": [], **value} if isinstance(value, dict) and _verdict_of(value) == REFUSED else value

    def baseline(self, method: str) -> BaselineAnswer:
        """The answer of a simpler method, which was not offered what this one was not offered either.

        Args:
            method: Its name.

        Returns:
            The answer.
        """
        return self.baselines[method].model_copy(update={"left_out": self.left_out})


class LeaveOut(Document):
    """That every case was answered without its own effect.

    Attributes:
        least: From which severity on effects were left out.
    """

    least: Number


class AnswersDocument(Document):
    """Content of `answers.json`.

    Attributes:
        code_version: Version of the code that gave the answers.
        atlas_sha256: SHA-256 of the atlas that they were given with.
        leave_out: Given where every case was answered without its own effect.
        seals: The seals that lay beside the cases when they were answered: these tell which suite they are of.
        files: SHA-256 of the files of each case when it was answered; empty in older documents.
        answers: The answer of each case.
    """

    code_version: str | int | float | None = None
    atlas_sha256: str | None = None
    leave_out: LeaveOut | None = None
    seals: dict[str, str] = Field(default_factory=dict)
    files: dict[str, str] = Field(default_factory=dict)
    answers: dict[str, Answer]


_ANSWER = TypeAdapter(Answer)
_DOCUMENT = TypeAdapter(AnswersDocument)


def read_answer(content: Any, where: str) -> Answer:
    """Checks one answer of `answers.json`.

    Args:
        content: Its value in the document.
        where: File and case, for messages.

    Returns:
        The answer.

    Raises:
        WithheldError: What breaks the format.
    """
    return validated(_ANSWER, content, where)


def read_answers(path: Path) -> AnswersDocument:
    """Reads `answers.json`.

    Args:
        path: The file; the answers stand under `answers` or `cases`, or are all that it holds.

    Returns:
        Its content.

    Raises:
        WithheldError: A file that cannot be read, or what breaks the format.
    """
    content = read_object(path, "give the answers as they were frozen")
    answers = {case: read_answer(entry, f"{path}: {case}") for case, entry in entries(content, _ANSWERS).items()}
    facts = {key: value for key, value in content.items() if key not in (*_ANSWERS, *answers)}
    return validated(_DOCUMENT, {**facts, "answers": answers}, str(path))
