"""The statistics in which data and base model differ most, as a table."""

from dataclasses import dataclass
from math import copysign

from cusick_bench.diagnosis.document.model import DiagnosisDocument, StatisticRow
from cusick_bench.report.diagnosis.wording.named_causes import named_cause
from cusick_bench.report.diagnosis.wording.number_format import UNKNOWN, plain, signed
from cusick_bench.report.diagnosis.wording.words import statistic_name
from cusick_bench.sim.units import shown_unit

_MOST_ROWS = 10
_ROUNDING = 1e-9  # share of a row's largest value below which another one is 0 but for rounding
_MILLIMETRES = {"m": "mm", "m/rad": "mm/rad"}


@dataclass(frozen=True)
class ShownStatistic:
    """One statistic, its values as text.

    Attributes:
        name: Name in words.
        unit: Unit of the values.
        up: Mean of the data, face up.
        down: The same, face down.
        base: Mean of the base model.
        effect: Mean of the base model with the cause.
        z: Data minus base model in standard errors.
        bar: Length of the bar of `z`, from -1 to 1.
    """

    name: str
    unit: str
    up: str
    down: str
    base: str
    effect: str
    z: str
    bar: float


@dataclass(frozen=True)
class StatisticTable:
    """The table.

    Attributes:
        rows: The statistics that differ most, the largest difference first.
        cause: The named cause; None where no statistic has a value with it.
        up: Whether a statistic has a value face up.
        down: The same, face down.
    """

    rows: list[ShownStatistic]
    cause: str | None
    up: bool
    down: bool


def statistic_table(document: DiagnosisDocument) -> StatisticTable:
    """The statistics that differ most from the base model.

    Args:
        document: The diagnosis.

    Returns:
        The table.
    """
    scored = [(row, row.z) for row in document.statistics]
    known = sorted(((row, z) for row, z in scored if z is not None), key=lambda item: -abs(item[1]))[:_MOST_ROWS]
    if all(z >= 0 for _, z in scored if z is not None):  # files of earlier versions hold absolute values
        known = [(row, _with_sign(row, z)) for row, z in known]
    largest = max((abs(z) for _, z in known), default=1.0) or 1.0
    rows = [_shown(row, z, largest) for row, z in known]
    with_cause = any(row.effect is not None for row in document.statistics)
    return StatisticTable(
        rows,
        cause=(named_cause(document) or "the cause") if with_cause else None,
        up=any(row.up != UNKNOWN for row in rows),
        down=any(row.down != UNKNOWN for row in rows),
    )


def _shown(row: StatisticRow, z: float, largest: float) -> ShownStatistic:
    factor = 1e3 if row.unit in _MILLIMETRES else 1.0
    values = [value for value in (row.up, row.down, row.base, row.effect) if value is not None]
    rounding = _ROUNDING * max(map(abs, values), default=0.0)

    def shown(value: float | None) -> str:
        return UNKNOWN if value is None else plain(factor * value if abs(value) > rounding else 0.0, 3)

    score = signed(f"{z:.1f}")
    return ShownStatistic(
        name=statistic_name(row.name),
        unit=_MILLIMETRES.get(row.unit, shown_unit(row.unit)),
        up=shown(row.up),
        down=shown(row.down),
        base=shown(row.base),
        effect=shown(row.effect),
        z=score if z < 0 else f"+{score}",
        bar=z / largest,
    )


def _with_sign(row: StatisticRow, z: float) -> float:
    """|z| with the sign of data minus base model, of the face that differs more."""
    faces = [value for value in (row.up, row.down) if value is not None]
    base = row.base
    if base is None or not faces:
        return z
    return copysign(z, max((value - base for value in faces), key=abs))
