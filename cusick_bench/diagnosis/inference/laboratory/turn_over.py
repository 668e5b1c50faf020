"""Whether the pictures of the lower face are oriented as the protocol says, or turned or mirrored.

Each face by itself looks right whichever way its cloth was turned over. Both together do not: what stays in place when
the cloth is turned over (a camera off its place, a plate out of level) and what turns with the cloth (its rest shape,
its grain) lie at angles that are related by the protocol's `turn_over`. A wrong relation needs effects that the right
one does not need. So pictures of the lower face are read in each of four ways, and the joint densities of the likeliest
sets of effects are compared. All ways only permute the same radii, so their densities are comparable without any
factor; all have the same prior.

All fabrics of a laboratory are turned over in the same way, so their log densities are added. Cloth that looks the same
from all sides, on a level plate under a camera in its place, gives no information.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.laboratory.shared_effects import least_lead
from cusick_bench.diagnosis.inference.sets.fabric_data import fabric_data
from cusick_bench.diagnosis.inference.sets.fabric_sets import best_log_joint
from cusick_bench.diagnosis.measure.captures import ANGLES, Captures

Way = Literal["as-said", "other-axis", "mirrored-x", "mirrored-y"]
"""Orientation of the pictures of the lower face: as the protocol says; of cloth that was turned over about the other
axis (a picture turned by 180 degrees); mirrored left to right; mirrored top to bottom."""

_DEGREES = np.arange(ANGLES)
_SEEN_AT: Final[Mapping[Way, np.ndarray]] = {
    "as-said": _DEGREES,
    "other-axis": (_DEGREES + ANGLES // 2) % ANGLES,
    "mirrored-x": (ANGLES // 2 - _DEGREES) % ANGLES,
    "mirrored-y": -_DEGREES % ANGLES,
}
WAYS: Final = tuple(_SEEN_AT)


@dataclass(frozen=True)
class TurnOver:
    """Log densities of the pictures of a laboratory for each way in which the lower face may be oriented.

    Attributes:
        by_fabric: For each fabric and way, ln of the joint density minus that of `as-said` [nat].
        refused: Reasons why other fabrics are left out, by name.
    """

    by_fabric: Mapping[str, Mapping[Way, float]]
    refused: Mapping[str, str]

    @property
    def total(self) -> Mapping[Way, float]:
        """Sums over the fabrics [nat]."""
        return {way: float(sum(one[way] for one in self.by_fabric.values())) for way in WAYS}

    @property
    def least(self) -> float:
        """Least lead of the best way over all others with which it is named [nat]."""
        return least_lead(len(self.by_fabric))

    @property
    def told(self) -> Way | None:
        """The way that is clearly ahead of the three others; None where none is."""
        total = self.total
        first, second = sorted(WAYS, key=lambda way: -total[way])[:2]
        return first if total[first] - total[second] >= self.least else None

    @property
    def wrong(self) -> bool:
        """Whether another way is clearly ahead of what the protocol says, even if it is not clear which one."""
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
        progress: Called with the name of the fabric and the share that is done.

    Returns:
        The log densities.
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
