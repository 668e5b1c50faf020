"""Where on the cloth a local cause acts: how likely each place of a 4 x 16 map is.

The map has four rings of the hanging part, from the plate's edge to the rim, and 16 sectors counter-clockwise from
warp, face up. The value of a place is the probability of a stiffer or heavier patch there, given that there is a patch
anywhere. It is meaningful only where a patch explains the data at all, and where the map is narrower than under noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import logsumexp

from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import RINGS
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

SECTORS = 16
EDGES = (PLATE_RADIUS, 0.105, 0.12, 0.135, CLOTH_RADIUS)
"""Radii between the rings [m], of the atlas' cloth, to which silhouettes of any other are scaled."""
_LEVEL = 0.8  # probability of the region that is named
_NARROW = 3.0  # least probability of the likeliest place of a patch that is named, over that of an even map
_WIDE = "it acts in one place, but the map is nearly as wide as under noise"


@dataclass(frozen=True, eq=False)
class Place:
    """Where an effect acts.

    Attributes:
        map: Probability of each ring and sector.
        kind: `patch`, `ring`, `direction` or "".
        angle: First and second edge, counter-clockwise from warp [deg], or None.
        radius: Inner and outer [m], or None.
        localisable: Whether there is a place to name.
        why_not: Why there is none, in words.
    """

    map: Float[ndarray, "4 16"]
    kind: str
    angle: tuple[float, float] | None
    radius: tuple[float, float] | None
    localisable: bool
    why_not: str = ""


def patch_map(white: Float[ndarray, "kept"], grids: Sequence[Grid], only: str | None = None) -> Float[ndarray, "4 16"]:
    """Probability of each place, given that a patch acts somewhere.

    Args:
        white: What the base model leaves.
        grids: All hypotheses.
        only: One effect; by default all patches together.

    Returns:
        By ring and sector; adds up to 1.
    """
    cells: dict[tuple[int, int], list[float]] = {}
    for grid in grids:
        if grid.hypothesis.effect.located != "patch" or (only is not None and grid.hypothesis.name != only):
            continue
        values = grid.values
        likelihood = grid.log_likelihood(white)
        ring = np.array([int(np.argmin(np.abs(np.array(RINGS) - r))) for r in values["radius"]])
        first = values["direction"] * SECTORS / 360
        for row, value in enumerate(likelihood):
            # A direction between the middles of two sectors is shared between both.
            for sector in {int(np.floor(first[row])) % SECTORS, int(np.floor(first[row] - 1e-9)) % SECTORS}:
                cells.setdefault((ring[row], sector), []).append(float(value))
    table = np.full((len(RINGS), SECTORS), -np.inf)
    for (ring_number, sector), logs in cells.items():
        table[ring_number, sector] = logsumexp(logs) - np.log(len(logs))
    if not np.isfinite(table).any():
        return np.full((len(RINGS), SECTORS), 1 / (len(RINGS) * SECTORS))
    return np.exp(table - logsumexp(table))


def place(candidate: Candidate | None, white: Float[ndarray, "kept"], grids: Sequence[Grid]) -> Place:
    """Where the named cause acts.

    Args:
        candidate: The named cause with its parameters, or None.
        white: What the base model leaves.
        grids: All hypotheses.

    Returns:
        The place; not localisable where no cause is named, or the cause has no place.
    """
    if candidate is None:
        return Place(patch_map(white, grids), "", None, None, False, "no single cause is named")
    effect, value = candidate.hypothesis.effect, candidate.value
    if effect.located == "patch":
        table = patch_map(white, grids, effect.name)
        narrow = bool(table.max() > _NARROW / table.size)
        return Place(table, "patch", _sector(table), _rings(table), narrow, "" if narrow else _WIDE)
    if effect.located == "ring":
        width = next((value[p.name] for p in effect.parameters if p.role == "size"), 0.0)
        table = np.zeros((len(RINGS), SECTORS))
        table[-1] = 1 / SECTORS
        if width:
            return Place(table, "ring", (0.0, 360.0), (EDGES[-1] - 2 * width, EDGES[-1]), True)
        return Place(table, "ring", None, None, False, "it acts all around")
    table = np.full((len(RINGS), SECTORS), 1 / (len(RINGS) * SECTORS))
    if effect.located == "direction":
        return Place(table, "direction", None, None, False, "it acts along a direction, not in a place")
    return Place(table, "", None, None, False, "it acts everywhere on the cloth")


def _sector(table: Float[ndarray, "4 16"]) -> tuple[float, float]:
    """The narrowest run of sectors that holds `_LEVEL`; edges may exceed 360 [deg]."""
    share, width = table.sum(0), 360 / SECTORS
    for count in range(1, SECTORS + 1):
        runs = np.array([np.take(share, range(first, first + count), mode="wrap").sum() for first in range(SECTORS)])
        if runs.max() >= _LEVEL:
            first = int(np.argmax(runs))
            return first * width, (first + count) * width
    return 0.0, 360.0


def _rings(table: Float[ndarray, "4 16"]) -> tuple[float, float]:
    """The fewest rings that hold `_LEVEL` [m]."""
    share = table.sum(1)
    for count in range(1, len(RINGS) + 1):
        runs = [share[first : first + count].sum() for first in range(len(RINGS) - count + 1)]
        if max(runs) >= _LEVEL:
            first = int(np.argmax(runs))
            return EDGES[first], EDGES[first + count]
    return EDGES[0], EDGES[-1]
