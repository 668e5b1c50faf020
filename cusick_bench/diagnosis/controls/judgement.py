"""Rules for what is a hit and what is a false alarm.

A diagnosis *shows* an effect if it names the effect or another one that silhouettes do not tell from it, or if it gives
them together a probability of at least .6.

    planted  If it was not shown before, a hit if it is shown afterwards. If it was shown before, a hit if its estimated
             strength changes by what was planted, with a tolerance of half of it (as a vector where it has a
             direction), since the fabric may already have the effect, or its opposite.
             A false alarm if another effect is named that was not named before.
    real     A hit if shown.
    absent   A false alarm if an effect is shown that cannot be there.
    outside  A false alarm if an effect is named that was not named before.
    null     A false alarm (the halves are *rejected*) if the halves show an effect that turns over with the cloth, and
             the face as a whole does not.
    slip     A hit if the picture was left out for the right reason.

A diagnosis that is refused shows nothing: it counts as a miss where something had to be shown, and is not judged
elsewhere.

How much of what was planted is visible in the silhouettes is measured without any model, by the largest change of a
statistic's mean over its standard error between samples. For instance, a turn of cloth that is equally stiff along warp
and weft is not visible.
"""

from collections.abc import Set
from dataclasses import dataclass
from math import cos, nan, radians, sin

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.controls.known_answers import Amount, Control
from cusick_bench.diagnosis.controls.reading import REFUSED, Estimate, Reading
from cusick_bench.diagnosis.inference.single_effects.equivalents import EQUIVALENTS
from cusick_bench.diagnosis.measure.statistics import RESOLUTION

SHOWN = 0.6  # probability from which on an effect counts as shown although it is not named
_TOLERANCE = 0.5  # largest error of an estimate, as a share of what was planted


@dataclass(frozen=True)
class Judgement:
    """A control and what the diagnosis made of it.

    Attributes:
        fabric, control, level, strength, kind: As in `Control`.
        effects: Right answers; for kinds `absent` and `null` the wrong ones.
        hit: `yes`, `no`, or "" where nothing can be judged.
        false_alarm: Whether something was named that is not there.
        verdict_before, verdict: Without and with what was planted; "" where there is nothing without.
        named_before, named: Effects that are named.
        newly_named: Effects that were not named before and are no right answer.
        probability_before, probability: Probability that any of `effects` acts; NaN where refused.
        planted: Severity of what was planted, in the unit of the effect's parameter; NaN for none.
        estimated: Change of its estimate along what was planted; NaN where there is no estimate.
        estimate_right: `yes` if the estimate changes by what was planted, with a tolerance of half of it, whether the
            effect is named or not; "" where there is no estimate.
        largest_shift: Largest change of a statistic's mean from the pictures without what was planted, if there are any
            [standard errors]; NaN where nothing was planted.
        p: p-value of the base model with what was planted; NaN where refused.
        note: Why the fabric was refused.
    """

    fabric: str
    control: str
    level: str
    strength: str
    kind: str
    effects: str
    hit: str
    false_alarm: bool
    verdict_before: str
    verdict: str
    named_before: str
    named: str
    newly_named: str
    probability_before: float
    probability: float
    planted: float
    estimated: float
    estimate_right: str
    largest_shift: float
    p: float
    note: str


def judge(control: Control, before: Reading, after: Reading, largest_shift: float) -> Judgement:
    """Judges a diagnosis.

    Args:
        control: The control.
        before: Reading of the diagnosis without what was planted; where nothing was planted, of the data as they are.
        after: Reading of the diagnosis with it.
        largest_shift: From `largest_shift`.

    Returns:
        The judgement.
    """
    new = _newly_named(control, before, after)
    hit, alarm = _verdict(control, before, after, new)
    amount = control.amount
    is_reference = control.kind in ("real", "slip")
    return Judgement(
        control.fabric, control.name, control.level, control.strength, control.kind, _words(control.effects), hit,
        alarm, "" if is_reference else before.verdict, after.verdict,
        "" if is_reference else _words(before.named), _words(after.named), "" if is_reference else _words(new),
        nan if is_reference else _probability(before, control.effects), _probability(after, control.effects),
        nan if amount is None else amount.severity, _along(amount, before, after),
        _estimate_right(control, before, after), largest_shift,
        nan if after.p is None else after.p,
        "; ".join(after.notes) if after.verdict == REFUSED else "",
    )  # fmt: skip


def largest_shift(
    before: Float[ndarray, "samples faces statistics"], after: Float[ndarray, "others faces statistics"]
) -> float:
    """Largest change of a statistic's mean over its standard error between samples.

    Args:
        before: Statistics of every sample and face, from `measure.statistics`; NaN where there are none.
        after: Statistics of every sample and face of other pictures.

    Returns:
        The change [standard errors]; NaN without two samples of one face in both.
    """
    shifts = [nan]
    for face in range(min(before.shape[1], after.shape[1])):
        first, second = (values[np.isfinite(values[:, face]).min(axis=1), face] for values in (before, after))
        if len(first) > 1 and len(second) > 1:
            spread = np.maximum(first.std(0, ddof=1), RESOLUTION)
            shifts.append(float((np.abs(second.mean(0) - first.mean(0)) / spread).max() * np.sqrt(len(first))))
    known = [shift for shift in shifts if shift == shift]
    return max(known, default=nan)


def _verdict(control: Control, before: Reading, after: Reading, new: Set[str]) -> tuple[str, bool]:
    """Whether it is a hit, and whether a false alarm."""
    if control.kind == "slip":
        return _yes(any(all(part in note for part in control.note) for note in after.notes)), False
    if after.verdict == REFUSED and control.kind not in ("planted", "real"):
        return "", False
    shown = _shown(after, control.effects)
    if control.kind == "planted":
        known = _shown(before, control.effects)
        return _yes(_estimate_right(control, before, after) == "yes" if known else shown), bool(new)
    if control.kind == "real":
        return _yes(shown), False
    wrong = {"absent": shown, "outside": bool(new), "null": shown and not _shown(before, control.effects)}[control.kind]
    return _yes(not wrong), wrong


def _shown(reading: Reading, effects: Set[str]) -> bool:
    return bool(reading.named & effects) or reading.probability(effects) >= SHOWN


def _newly_named(control: Control, before: Reading, after: Reading) -> frozenset[str]:
    """Effects that are named afterwards, without those that were named or planted and those that look like them."""
    expected = before.named | (control.effects if control.kind in ("planted", "real") else frozenset())
    for group in EQUIVALENTS:
        expected |= group.effects if group.effects & expected else frozenset()
    return after.named - expected


def _change(amount: Amount, before: Reading, after: Reading) -> complex | None:
    """Change of the estimate of what was planted; None without estimates."""
    if amount.effect not in before.estimates or amount.effect not in after.estimates:
        return None
    return _vector(after.estimates[amount.effect]) - _vector(before.estimates[amount.effect])


def _estimate_right(control: Control, before: Reading, after: Reading) -> str:
    amount = control.amount
    if amount is None or (change := _change(amount, before, after)) is None:
        return ""
    planted = _vector(Estimate(amount.severity, amount.direction))
    return _yes(abs(change - planted) <= _TOLERANCE * abs(planted))


def _along(amount: Amount | None, before: Reading, after: Reading) -> float:
    """Change of the estimate along what was planted, in the unit of the severity; NaN without estimates."""
    if amount is None or (change := _change(amount, before, after)) is None:
        return nan
    return (change * _vector(Estimate(1.0, amount.direction)).conjugate()).real


def _vector(estimate: Estimate) -> complex:
    """A strength with its direction; without one, a real number."""
    angle = radians(estimate.direction or 0.0)
    return estimate.severity * complex(cos(angle), sin(angle))


def _probability(reading: Reading, effects: Set[str]) -> float:
    return nan if reading.verdict == REFUSED or not effects else reading.probability(effects)


def _words(names: Set[str]) -> str:
    return " ".join(sorted(names))


def _yes(right: bool) -> str:
    return "yes" if right else "no"
