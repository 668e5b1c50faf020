"""How far effects lie apart in a fabric's features, and which statistics that rests on.

With d_e the shift of the whitened residual by an effect (see `residual`: a shift that the base parameters could have
made is no shift), the separation of effect a from effect b is

    min over b's severities, directions and places of |d_a - d_b|,

with b's shift taken as a ray, so that its severity is projected out: the number of standard deviations of noise between
a fabric with a and the nearest fabric with b. It is |d_a| where b moves other statistics, and 0 where b moves the same
statistics in the same proportions. The separation of a pair is the smaller one of the two directions. Each effect has
the severity that can just be detected (`power.NEEDED`) by the remaining statistics, or the largest that a diagnosis
considers where even that is not detected.

References:
    Fisher. The use of multiple measurements in taxonomic problems. Annals of Eugenics 7, 1936.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.detectability.power import NEEDED, expected_features
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import GROUPS

LEVELS = (-8.5, -7.0, -5.5)
"""theta's bending, ln B / (rho g R^3), of limp, middle and stiff cloth."""
NEW_GROUPS = ("slopes", "asymmetry", "outline", "sides")
"""Groups of statistics that are left out by default, to see what they contribute."""
_OTHER_FRAME = 0.5  # least prior of a hypothesis: an effect in a frame that it rarely keeps to is left out


@dataclass(frozen=True)
class Separation:
    """How far two effects lie apart at one stiffness.

    Attributes:
        level: theta's bending.
        first, second: The effects.
        without: Separation by the other statistics alone [sd of noise].
        full: By all statistics, at the same severities.
    """

    level: float
    first: str
    second: str
    without: float
    full: float


@dataclass(frozen=True, eq=False)
class _Moved:
    """Whitened shifts of one effect over its grid, and the points at which it can just be detected."""

    shift: Float[ndarray, "points kept"]
    chosen: ndarray


def separations(
    emulator: Emulator, level: float, *, left_out: Collection[str] = NEW_GROUPS, samples: int = 12
) -> list[Separation]:
    """Separations of all pairs of effects, without some groups of statistics and with all.

    Args:
        emulator: The atlas.
        level: theta's bending; the other base parameters are the prior's means.
        left_out: Groups of statistics.
        samples: Samples of the fabric, draped on both sides.

    Returns:
        One for each pair.

    Raises:
        DiagnosisError: No such group, or nothing left.
    """
    if not set(left_out) < GROUPS.keys():
        raise DiagnosisError(f"groups to leave out must be some of {', '.join(GROUPS)}, got {', '.join(left_out)}")
    theta = PRIOR_MEAN.copy()
    theta[0] = level
    every = expected_features(emulator, theta, samples)
    few = _only(every, left_out)
    listed = [one for one in hypotheses(emulator) if one.prior >= _OTHER_FRAME]
    full, without = (against_base(emulator, one, start=theta, fixed=True) for one in (every, few))
    before = {one.name: _moved(emulator, one, without, None) for one in listed}
    after = {one.name: _moved(emulator, one, full, before[one.name].chosen) for one in listed}
    return [
        Separation(level, a, b, _apart(before[a], before[b]), _apart(after[a], after[b]))
        for a, b in combinations(before, 2)
    ]


def _only(features: Features, left_out: Collection[str]) -> Features:
    """Features without what belongs to some groups of statistics."""
    columns = [column for name in left_out for column in GROUPS[name]]
    contrast, order, spread = features.contrast.copy(), features.order.copy(), features.spread.copy()
    contrast[:, columns] = np.nan
    order[np.isin(ORDERS, columns)] = np.nan
    spread[[set(columns).issuperset(own) for _, own in SPREADS]] = np.nan
    return replace(features, contrast=contrast, order=order, spread=spread)


def _moved(emulator: Emulator, hypothesis: Hypothesis, residual: Residual, chosen: ndarray | None) -> _Moved:
    moved = shifts(emulator, hypothesis, residual.theta, residual.sd, residual.drift).features
    shift = residual.whiten(moved)
    if chosen is None:
        severity, size = np.abs(hypothesis.severity()), np.linalg.norm(shift, axis=1)
        levels = np.unique(severity)
        middle = np.array([np.median(size[severity == one]) for one in levels])
        seen = np.flatnonzero(middle >= NEEDED)
        chosen = np.flatnonzero(severity == (levels[seen[0]] if len(seen) else levels[-1]))
    return _Moved(shift, chosen)


def _apart(first: _Moved, second: _Moved) -> float:
    return min(_median_distance(first, second), _median_distance(second, first))


def _median_distance(first: _Moved, second: _Moved) -> float:
    """Median over directions and places of the first effect's distance from the nearest ray of the second's."""
    own = first.shift[first.chosen]
    size = np.linalg.norm(second.shift, axis=1)
    rays = second.shift[size > 0] / size[size > 0, None]
    along = np.maximum((own @ rays.T).max(1), 0.0) if len(rays) else np.zeros(len(own))
    return float(np.median(np.sqrt(np.maximum((own**2).sum(1) - along**2, 0.0))))


def summary(found: Sequence[Separation], least: float = 2.0) -> Mapping[str, float]:
    """Summary of a list of separations.

    Args:
        found: Pairs.
        least: Below it a pair counts as alike [sd of noise].

    Returns:
        Medians, and shares of alike pairs, without some statistics and with all.
    """
    without, full = np.array([one.without for one in found]), np.array([one.full for one in found])
    return {
        "median_without": float(np.median(without)),
        "median_full": float(np.median(full)),
        "alike_without": float((without < least).mean()),
        "alike_full": float((full < least).mean()),
    }
