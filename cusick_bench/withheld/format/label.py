"""The revealed label of a withheld case: what acted, how severe it was, and where."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, isfinite, log2, nan
from typing import Any

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format import causes
from cusick_bench.withheld.format.answer import read_region
from cusick_bench.withheld.format.checked_json import entries, listed, mapping, number, one_of
from cusick_bench.withheld.format.location import Region

NULL, SINGLE, PAIR, OUTSIDE = "null", "single", "pair", "unknown"
DETECTABLE, TYPICAL = "detectable shift", "typical severity"
LABELS = ("labels", "cases")  # keys under which they may stand in a document
_LOWEST, _HIGHEST = -3, 4  # powers of two


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
        unlike: What is left of its shift when the other listed effect that is most like it is taken off, in multiples
            of the detectable one; NaN where that was not measured.
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

    def without(self, left_out: frozenset[str]) -> "Label":
        """The label as it is for an answerer who was not offered some effects: theirs lie outside the list."""
        if self.kind != SINGLE or not left_out & set(self.effects):
            return self
        return Label((), OUTSIDE, causes.UNKNOWN, self.multiple, self.unit, hidden=f"{self.truth}, left out")


def read_labels(document: Mapping[str, Any], where: str) -> dict[str, Label]:
    """Checks all labels of a `labels.json`.

    Args:
        document: Content of the file.
        where: Its path, for messages.

    Raises:
        WithheldError: What breaks the format.
    """
    return {case: read_label(entry, f"{where}: {case}") for case, entry in entries(document, LABELS).items()}


def read_label(found: Any, where: str) -> Label:
    """Checks one label of `labels.json`.

    Args:
        found: Its value in the document.
        where: File and case, for messages.

    Raises:
        WithheldError: What breaks the format.
    """
    entry = mapping(found, where)
    named = _named(entry.get("effect"), where)
    kind = {causes.NONE: NULL, causes.UNKNOWN: OUTSIDE}.get(named[0], SINGLE if len(named) == 1 else PAIR)
    effects = tuple(named) if kind in (SINGLE, PAIR) else ()
    multiple, unit = _severity(entry, effects, where)
    place = _only(entry.get("location")) if kind == SINGLE else None
    region = read_region(mapping(place, f"{where}: location"), f"{where}: location") if place else None
    return Label(
        effects=effects,
        kind=kind,
        class_name=causes.class_of(named[0]),
        multiple=multiple,
        unit=unit,
        location=region,
        location_kind=place["kind"] if place else "",
        oracle_closure=number(entry.get("oracle_closure"), f"{where}: oracle_closure"),
        hidden=str(entry.get("name") or entry.get("hidden") or "") if kind == OUTSIDE else "",
    )


def _named(found: Any, where: str) -> list[str]:
    names = found if isinstance(found, list) else [found]
    effects = [one_of(name, causes.outcomes(), f"{where}: effect") for name in names]
    if not effects or (len(effects) > 1 and set(effects) & {causes.NONE, causes.UNKNOWN}):
        raise WithheldError(f"{where}: effect must be a name or a list of effects, got {effects}; correct it")
    return effects


def _only(found: Any) -> Any:
    """The one member of a list of one; anything else as it is."""
    return found[0] if isinstance(found, list) and len(found) == 1 else found


def _severity(entry: Mapping[str, Any], effects: tuple[str, ...], where: str) -> tuple[float, str]:
    """Severity of the weakest effect: as a multiple if the label has one, else in typical severities."""
    if not effects:
        return nan, ""
    for key, unit in (("multiple", DETECTABLE), ("multiple_of_typical", TYPICAL)):
        multiples = _numbers(entry.get(key), len(effects), f"{where}: {key}")
        if all(map(isfinite, multiples)):
            return min(map(abs, multiples)), unit
    severities = _numbers(entry.get("severity"), len(effects), f"{where}: severity")
    shares = [abs(value) / causes.typical_severity(name) for value, name in zip(severities, effects, strict=True)]
    return (min(shares), TYPICAL) if all(map(isfinite, shares)) else (nan, "")


def _numbers(found: Any, length: int, where: str) -> list[float]:
    values = listed(found, length, where) if isinstance(found, list) else [found] * length
    return [number(value, where) for value in values]
