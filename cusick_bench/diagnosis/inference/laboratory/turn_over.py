"""Which way up the pictures of the lower face are: as the protocol says, or turned or mirrored.

Each face by itself looks right whichever way its cloth was turned over. The two together do not: what stays where it is
when the cloth is turned over (a camera beside its place, a plate out of level) and what turns with the cloth (its rest
shape, its grain) lie at angles that the protocol's `turn_over` relates. With another relation both need effects that
they would not need with the right one. So pictures of the lower face are read in each of four ways, and the joint
densities of the likeliest sets of effects are compared. They are of the same numbers in another order, so that the
densities compare without any factor; all ways have the same prior.

All fabrics of a laboratory are turned over alike, and their log densities add up. Cloth that looks the same from all
sides, on a level plate under a camera in its place, says nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.sets.fabric_data import fabric_data
from cusick_bench.diagnosis.inference.sets.fabric_sets import best_log_joint
from cusick_bench.diagnosis.measure.captures import ANGLES, Captures

Way = Literal["as-said", "other-axis", "mirrored-x", "mirrored-y"]
"""How pictures of the lower face are: as the protocol says, of cloth that was turned over about the other axis (turned
by 180 degrees), mirror images right for left, or top for bottom."""

_DEGREES = np.arange(ANGLES)
_SEEN_AT: Final[Mapping[Way, np.ndarray]] = {
    "as-said": _DEGREES,
    "other-axis": (_DEGREES + ANGLES // 2) % ANGLES,
    "mirrored-x": (ANGLES // 2 - _DEGREES) % ANGLES,
    "mirrored-y": -_DEGREES % ANGLES,
}
WAYS: Final = tuple(_SEEN_AT)

_LEAST = 10.0
"""Nat by which one fabric has to prefer a way, times the square root of the number of fabrics: what the base model gets
wrong makes single fabrics prefer a wrong way by up to six (`docs/diagnosis-results.md`)."""


@dataclass(frozen=True)
class TurnOver:
    """How well each way explains the pictures of a laboratory.

    Attributes:
        by_fabric: For each fabric, by way, ln of the joint density less that of `as-said` [nat].
        refused: Why other fabrics tell nothing, by name.
    """

    by_fabric: Mapping[str, Mapping[Way, float]]
    refused: Mapping[str, str]

    @property
    def total(self) -> Mapping[Way, float]:
        """Sums over the fabrics [nat]."""
        return {way: float(sum(one[way] for one in self.by_fabric.values())) for way in WAYS}

    @property
    def least(self) -> float:
        """By how much the best way has to be ahead of all others to be told [nat]."""
        return _LEAST * float(np.sqrt(max(len(self.by_fabric), 1)))

    @property
    def told(self) -> Way | None:
        """The way that is clearly ahead of the three others; None where none is."""
        total = self.total
        first, second = sorted(WAYS, key=lambda way: -total[way])[:2]
        return first if total[first] - total[second] >= self.least else None

    @property
    def wrong(self) -> bool:
        """Whether another way is clearly ahead of what the protocol says, be it told from the others or not."""
        total = self.total
        return max(total.values()) - total["as-said"] >= self.least


@threadpool_limits.wrap(limits=1, user_api="blas")  # of matrices so small, threads only wait for each other
def turn_over(
    captures: Sequence[Captures],
    emulator: Emulator,
    calibration: Calibration,
    *,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> TurnOver:
    """Compares the four ways.

    Args:
        captures: Silhouettes of each fabric of a laboratory.
        emulator: The atlas.
        calibration: Calibration of its probabilities.
        progress: Called to tell which fabric is looked at, and the share that is over.

    Returns:
        What they say.
    """
    found: dict[str, Mapping[Way, float]] = {}
    refused: dict[str, str] = {}
    for number, fabric in enumerate(captures):
        if missing := {"up", "down"} - set(fabric.side.tolist()):
            refused[fabric.fabric] = f"no pictures face {' or '.join(sorted(missing))}"
            continue
        log_joint: dict[Way, float] = {}
        try:
            for place, way in enumerate(WAYS):
                progress(f"{fabric.fabric}: {way}", (number + place / len(WAYS)) / len(captures))
                _, data, _ = fabric_data(read_as(fabric, way), emulator, calibration)
                log_joint[way] = best_log_joint(data, data.against())
        except Refused as refusal:
            refused[fabric.fabric] = str(refusal)
            continue
        found[fabric.fabric] = {way: log_joint[way] - log_joint["as-said"] for way in WAYS}
    return TurnOver(found, refused)


def read_as(captures: Captures, way: Way) -> Captures:
    """Captures whose lower face is read in one of the ways.

    Args:
        captures: Silhouettes of a fabric.
        way: How the pictures of its lower face are taken to be.

    Returns:
        The captures as the protocol says they should have been.
    """
    radii = captures.radii.copy()
    down = captures.side == "down"
    radii[down] = radii[down][:, _SEEN_AT[way]]
    return replace(captures, radii=radii)
