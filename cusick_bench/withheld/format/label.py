"""The label of a withheld case: what acted, how severe it was, and where.

`LabelDocument` is the form of an entry of `labels.json`, which is what is sealed; `Label` is the truth that it states,
in the terms of the scores.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite, log2, nan
from pathlib import Path
from typing import Any

from pydantic import Field, TypeAdapter, field_validator, model_validator

from cusick_bench.withheld.format import causes
from cusick_bench.withheld.format.checked_json import entries, read_object, validated
from cusick_bench.withheld.format.fields import (
    Document,
    Number,
    OneOrSeveral,
    OutcomeName,
    broken_rule,
    finite_or_nan,
    known_name,
)
from cusick_bench.withheld.format.location import KINDS, Region
from cusick_bench.withheld.format.place import Place

NULL, SINGLE, PAIR, OUTSIDE = "null", "single", "pair", "unknown"
DETECTABLE, TYPICAL = "detectable shift", "typical severity"
_LABELS = ("labels", "cases")  # keys under which they may stand in a document
_MOST_EFFECTS = 2  # of a case
_LOWEST, _HIGHEST = -3, 4  # powers of two
_ROUNDING = 1e-3  # of severities as they are written, relative to themselves


class LabelPlace(Place):
    """Where a local effect acts.

    Attributes:
        kind: `sector`, `ring` or `patch`.
    """

    kind: str | None = Field()

    @field_validator("kind")
    @classmethod
    def _known_kind(cls, kind: str | None) -> str:
        return known_name(str(kind), KINDS)


class LabelDocument(Document):
    """A label as it is sealed; of a pair, effect, class, severity, parameters and location are lists.

    Attributes:
        effect: Name of the effect, `none`, or `unknown` for one outside the list.
        class_name: Its class.
        name: Name of an effect outside the list.
        severity: Severity in the effect's own unit.
        parameters: All its parameters; scores use none of them, so other programs may write what they like.
        location: Where it acts; None for nowhere in particular.
        oracle_closure: Share of the gap that the true effect closes; None if not known.
        kind: What the case is for.
        reference: What the severity is a multiple of, `detectable` or `typical`.
        multiple: Severity in detectable shifts.
        multiple_of_typical: Severity in typical severities.
        salt: Salt of the seal.
        sha256: The seal.
    """

    effect: OneOrSeveral[OutcomeName]
    class_name: OneOrSeveral[str] | None = Field(default=None, alias="class")
    name: str | None = None
    severity: OneOrSeveral[Number | None] = None
    parameters: OneOrSeveral[dict[str, Any] | None] = Field(default_factory=dict)
    location: OneOrSeveral[LabelPlace | None] = None
    oracle_closure: Number | None = None
    kind: str | None = None
    reference: str | None = None
    multiple: OneOrSeveral[Number | None] = None
    multiple_of_typical: OneOrSeveral[Number | None] = None
    salt: str | None = None
    sha256: str | None = None

    @field_validator("effect")
    @classmethod
    def _known_effects(cls, effect: str | tuple[str, ...]) -> str | tuple[str, ...]:
        names = _as_tuple(effect)
        if not names or (len(names) > 1 and set(names) & {causes.NONE, causes.UNKNOWN}):
            raise broken_rule(f"effect must be a name or a list of effects, got {list(names)}; correct it")
        if len(names) > _MOST_EFFECTS:
            raise broken_rule(f"a case has at most {_MOST_EFFECTS} effects, got {len(names)}; correct it")
        return effect

    @model_validator(mode="after")
    def _one_value_for_each_effect(self) -> "LabelDocument":
        for key in ("severity", "parameters", "location", "multiple", "multiple_of_typical"):
            value = getattr(self, key)
            if isinstance(value, tuple) and len(value) != len(self.effects):
                raise broken_rule(f"{key} must be a list of {len(self.effects)}, got one of {len(value)}; correct it")
        for key in ("multiple", "multiple_of_typical"):
            if any(one is not None and one < 0 for one in _as_tuple(getattr(self, key))):
                raise broken_rule(f"{key} must be at least 0, got {getattr(self, key)}; give the size alone")
        return self

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of all that acts, `none` and `unknown` included."""
        return _as_tuple(self.effect)

    @property
    def parameters_of_effects(self) -> tuple[dict[str, float], ...]:
        """Parameters of each effect, as far as they are numbers."""
        return tuple(
            {name: value for name, value in (one or {}).items() if _is_number(value)}
            for one in _as_tuple(self.parameters)
        )

    def unsealed(self) -> dict[str, Any]:
        """The label without its salt and seal.

        Returns:
            Its content as it is stored on disk.
        """
        return {key: value for key, value in self.content().items() if key not in ("salt", "sha256")}


@dataclass(frozen=True)
class Label:
    """The truth of a case.

    Attributes:
        effects: What acts; none for a null and for an effect outside the list.
        kind: `null`, `single`, `pair` or `unknown` (an effect outside the list).
        class_name: Class of the effect; of a pair, that of the first.
        multiple: Severity of the weakest effect in multiples of `unit`; NaN where there is none. Where shifts were
            measured (`withheld twins`), theirs.
        unit: `DETECTABLE`, `TYPICAL`, or "" if not known.
        location: Where the effect acts; None if nowhere in particular, and for pairs.
        location_kind: `sector`, `ring`, `patch` or "".
        oracle_closure: Share of the gap that the true effect closes; NaN if not known.
        unlike: What is left of its shift when the other listed effects that are most like it are taken off, in
            multiples of the detectable one; NaN where that was not measured.
        hidden: Name of an effect outside the list, if the label has it.
    """

    effects: tuple[str, ...]
    kind: str
    class_name: str
    multiple: float = nan
    unit: str = ""
    location: Region | None = None
    location_kind: str = ""
    oracle_closure: float = nan
    unlike: float = nan
    hidden: str = ""

    @property
    def truth(self) -> str:
        """The one name that an answer must find: `none`, an effect, `unknown`; of a pair both effects."""
        if self.kind == NULL:
            return causes.NONE
        return "+".join(self.effects) if self.effects else causes.UNKNOWN

    @property
    def level(self) -> str:
        """The nearest power of two to the severity, as `2x`; "" where there is none."""
        if not isfinite(self.multiple) or self.multiple <= 0:
            return ""
        return f"{2.0 ** min(max(floor(log2(self.multiple) + 0.5 + 1e-9), _LOWEST), _HIGHEST):g}x"

    def without(self, left_out: Sequence[str]) -> "Label":
        """The label as it is for an answerer who was not offered some effects: theirs lie outside the list.

        Args:
            left_out: Names of these effects.

        Returns:
            The label.
        """
        if self.kind != SINGLE or not set(left_out) & set(self.effects):
            return self
        hidden = f"{self.truth}, left out"
        return Label((), OUTSIDE, causes.UNKNOWN, self.multiple, self.unit, unlike=self.unlike, hidden=hidden)


_LABEL = TypeAdapter(LabelDocument)


def read_label_documents(path: Path) -> dict[str, LabelDocument]:
    """Reads `labels.json`.

    Args:
        path: The file; the labels stand under `labels` or `cases`, or are all that it holds.

    Returns:
        The label of each case, as it is sealed.

    Raises:
        WithheldError: A file that cannot be read, or what breaks the format.
    """
    found = entries(read_object(path, "give labels.json as it was written"), _LABELS)
    return {case: validated(_LABEL, entry, f"{path}: {case}") for case, entry in found.items()}


def read_label(content: Any, where: str) -> Label:
    """Checks one label of `labels.json`.

    Args:
        content: Its value in the document.
        where: File and case, for messages.

    Returns:
        The truth that it states.

    Raises:
        WithheldError: What breaks the format.
    """
    return truth_of(validated(_LABEL, content, where))


def truth_of(label: LabelDocument) -> Label:
    """The truth that a label states, as the scores need it.

    Args:
        label: The label.

    Returns:
        The truth of the case.
    """
    named = label.effects
    kind = {causes.NONE: NULL, causes.UNKNOWN: OUTSIDE}.get(named[0], SINGLE if len(named) == 1 else PAIR)
    effects = named if kind in (SINGLE, PAIR) else ()
    multiple, unit = _severity(label, effects)
    places = _as_tuple(label.location)
    place = places[0] if kind == SINGLE and len(places) == 1 else None
    return Label(
        effects=effects,
        kind=kind,
        class_name=causes.class_of(named[0]),
        multiple=multiple,
        unit=unit,
        location=place.region if place else None,
        location_kind=(place.kind or "") if place else "",
        oracle_closure=finite_or_nan(label.oracle_closure),
        hidden=_hidden_name(label) if kind == OUTSIDE else "",
    )


def _as_tuple(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _hidden_name(label: LabelDocument) -> str:
    """Name of an effect outside the list, under either key that labels have it."""
    return str(label.name or (label.model_extra or {}).get("hidden") or "")


def _severity(label: LabelDocument, effects: tuple[str, ...]) -> tuple[float, str]:
    """Severity of the weakest effect: as a multiple if the label has one, else in typical severities.

    Multiples of what is typical are what was asked for; an effect that cannot be so severe has its largest severity.
    """
    if not effects:
        return nan, ""
    multiples = _for_each(label.multiple, len(effects))
    if all(map(isfinite, multiples)):
        return min(map(abs, multiples)), DETECTABLE
    severities = _for_each(label.severity, len(effects))
    shares = [abs(value) / causes.typical_severity(name) for value, name in zip(severities, effects, strict=True)]
    multiples = _for_each(label.multiple_of_typical, len(effects))
    if all(map(isfinite, multiples)):
        pairs = zip(shares, multiples, strict=True)
        shares = [share if share < (1 - _ROUNDING) * multiple else multiple for share, multiple in pairs]
    return (min(shares), TYPICAL) if all(map(isfinite, shares)) else (nan, "")


def _for_each(given: Any, count: int) -> list[float]:
    """A number for each effect; one number counts for all."""
    values = given if isinstance(given, tuple) else (given,) * count
    return [finite_or_nan(value) for value in values]
