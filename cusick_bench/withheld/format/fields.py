"""Kinds of values that documents hold: numbers, probabilities, names of causes, one value or one for each effect."""

from collections.abc import Collection
from math import isinf, nan
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    PlainSerializer,
    PlainValidator,
    StrictStr,
    Tag,
)
from pydantic_core import PydanticCustomError

from cusick_bench.sim.errors import did_you_mean
from cusick_bench.withheld.format import causes

T = TypeVar("T")

_ROUNDING = 1e-6


class Document(BaseModel):
    """A part of a document: frozen, with keys as on disk; keys that it does not know are kept as they are."""

    model_config = ConfigDict(frozen=True, extra="allow", populate_by_name=True)

    def content(self) -> dict[str, Any]:
        """The part as it is stored on disk.

        Returns:
            What `json` writes: keys that were given, in the model's order.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)


def broken_rule(sentence: str) -> PydanticCustomError:
    """An error that says itself what the rule is and what was found.

    Args:
        sentence: Rule, value and remedy.

    Returns:
        The error, to be raised by a validator.
    """
    return PydanticCustomError("broken_rule", "{sentence}", {"sentence": sentence})


def finite_or_nan(value: float | None) -> float:
    """A number of a document for computing with.

    Args:
        value: The number, or None.

    Returns:
        The same number, NaN for None.
    """
    return nan if value is None else float(value)


def _number(value: Any) -> float:
    """A number as it stands, so that what was sealed as 1 is not written as 1.0; NaN counts as not given."""
    if isinstance(value, bool) or not isinstance(value, int | float) or isinf(value):
        raise PydanticCustomError("number", "must be a finite number or null")
    return value


AS_IT_STANDS = PlainSerializer(lambda value: value, return_type=Any)
"""A value is written as it was given, so that what was sealed as 1 is not written as 1.0."""

Number = Annotated[float, PlainValidator(_number), AS_IT_STANDS]
"""A finite number, not a string and not a truth value."""


def _probability(value: Any) -> float:
    number = _number(value)
    if not 0 <= number <= 1 + _ROUNDING:
        raise PydanticCustomError("probability", "must lie between 0 and 1")
    return number


Probability = Annotated[float, PlainValidator(_probability), AS_IT_STANDS]
"""A number from 0 to 1."""


def known_name(name: str, choices: Collection[str]) -> str:
    """Checks that a name is one of some.

    Args:
        name: The name.
        choices: Names that may be.

    Returns:
        The name.

    Raises:
        PydanticCustomError: Another name; says which known name is most like it.
    """
    if name not in choices:
        remedy = did_you_mean(name, choices).rstrip() or f"use {', '.join(choices)}"
        raise PydanticCustomError("known_name", "must be a known name", {"remedy": remedy})
    return name


OutcomeName = Annotated[StrictStr, AfterValidator(lambda name: known_name(name, causes.outcomes()))]
"""An effect, `none` or `unknown`."""

SetMemberName = Annotated[
    StrictStr, AfterValidator(lambda name: known_name(name, (*causes.outcomes(), causes.STIFFNESS)))
]
"""What a 90 % set may hold: an outcome, or the base model's own ratio of stiffness to weight."""


def _how_many(value: Any) -> str:
    return "<several>" if isinstance(value, list | tuple) else "<one>"


OneOrSeveral = Annotated[
    Annotated[T, Tag("<one>")] | Annotated[tuple[T, ...], Tag("<several>")], Discriminator(_how_many)
]
"""A value, or a list of values: of a pair, one for each effect."""
