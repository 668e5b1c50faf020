"""Where on the cloth a local cause acts: how likely each place of a 4 x 16 map is.

The map has four rings of the hanging part, from the plate's edge to the rim, and 16 sectors counter-clockwise from
warp, face up. The value of a place is the probability of a stiffer or heavier patch there, given that there is a patch
anywhere. It is meaningful only where a patch explains the data at all, and where the map is narrower than under noise:
so maps of noise alone are made beside it, and maps of the named patch under fresh noise, whose regions are as wide as
the silhouettes resolve.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
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
_NOISES = 99  # maps of fresh noise
_EVEN = np.full((len(RINGS), SECTORS), 1 / (len(RINGS) * SECTORS))


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
        null_map: Mean of the maps of noise alone; None where the map is none of a patch.
        null_p: p of noise alone: share of its maps whose likeliest place is at least as likely as that of `map`.
        resolution: Median width of the region of the named patch under fresh noise: angle [deg], radius [m]; None
            where none is named.
    """

    map: Float[ndarray, "4 16"]
    kind: str
    angle: tuple[float, float] | None
    radius: tuple[float, float] | None
    localisable: bool
    why_not: str = ""
    null_map: Float[ndarray, "4 16"] | None = None
    null_p: float | None = None
    resolution: tuple[float, float] | None = None


def _cells(grid: Grid) -> tuple[Int[ndarray, "entries"], Int[ndarray, "entries"]]:
    """Points of a grid of patches and the cells of the map that they lie in, numbered sector by sector, ring by ring.

    A point in a direction on the border of two sectors lies in both, and comes twice.
    """
    names = _by_role(grid)
    ring = np.argmin(np.abs(np.array(RINGS)[:, None] - grid.values[names["radius"]]), axis=0)
    position = grid.values[names["direction"]] * SECTORS / 360
    sector, before = (np.floor(position - distance).astype(int) % SECTORS for distance in (0.0, 1e-9))
    point, on_border = np.arange(len(position)), before != sector
    return (
        np.concatenate([point, point[on_border]]),
        np.concatenate([ring * SECTORS + sector, (ring * SECTORS + before)[on_border]]),
    )


def _by_role(grid: Grid) -> dict[str, str]:
    """Names of an effect's parameters by their roles."""
    return {parameter.role: parameter.name for parameter in grid.hypothesis.effect.parameters}


class PatchMaps:
    """Maps from the patches of all hypotheses whose parameters tell direction and radius, one for each vector of
    residuals.

    Args:
        grids: All hypotheses.
        only: One effect; by default all patches together.
    """

    def __init__(self, grids: Sequence[Grid], only: str | None = None) -> None:
        self._grids = [
            grid
            for grid in grids
            if grid.hypothesis.effect.located == "patch"
            and only in (None, grid.hypothesis.name)
            and _by_role(grid).keys() >= {"direction", "radius"}
        ]
        points, cells, first = [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)], 0
        for grid in self._grids:
            point, cell = _cells(grid)
            points.append(first + point)
            cells.append(cell)
            first += len(grid.shift)
        cell = np.concatenate(cells)
        order = np.argsort(cell, kind="stable")
        self._rows = np.concatenate(points)[order]  # points of all grids, in the order of their cells
        self._cells, self._starts, self._counts = np.unique(cell[order], return_index=True, return_counts=True)

    def of(self, white: Float[ndarray, "kept"]) -> Float[ndarray, "4 16"]:
        """Probability of each place, given that a patch acts somewhere.

        Args:
            white: What the base model leaves.

        Returns:
            By ring and sector; adds up to 1; even where no hypothesis is a patch.
        """
        logs = np.full(len(RINGS) * SECTORS, -np.inf if self._grids else 0.0)
        if self._grids:
            likelihood = np.concatenate([grid.log_likelihood(white) for grid in self._grids])[self._rows]
            most = np.maximum.reduceat(likelihood, self._starts)
            likelihood -= np.repeat(most, self._counts)
            logs[self._cells] = most + np.log(np.add.reduceat(np.exp(likelihood), self._starts) / self._counts)
        return np.exp(logs - logsumexp(logs)).reshape(len(RINGS), SECTORS)

    def of_noise(self, white: Float[ndarray, "kept"]) -> Iterator[Float[ndarray, "4 16"]]:
        """Maps of a vector of residuals under fresh noise, the same noise at every call.

        Args:
            white: What an effect shifts, in standard deviations of noise; zeros for noise alone.

        Yields:
            Maps.
        """
        generator = np.random.default_rng(0)
        for _ in range(_NOISES):
            yield self.of(white + generator.standard_normal(len(white)))


def place(
    candidate: Candidate | None,
    white: Float[ndarray, "kept"],
    grids: Sequence[Grid],
    shift: Float[ndarray, "kept"] | None = None,
) -> Place:
    """Where the named cause acts.

    Args:
        candidate: The named cause with its parameters, or None.
        white: What the base model leaves.
        grids: All hypotheses.
        shift: What the named cause shifts, in the units of `white`; without it no resolution is found.

    Returns:
        The place; not localisable where no cause is named, or the cause has no place.
    """
    if candidate is None:
        maps = PatchMaps(grids)
        found = Place(maps.of(white), "", None, None, False, "no single cause is named")
        return _beside_null(found, maps, len(white))
    effect, value = candidate.hypothesis.effect, candidate.value
    if effect.located == "patch":
        maps = PatchMaps(grids, effect.name)
        table = maps.of(white)
        narrow = bool(table.max() > _NARROW / table.size)
        found = Place(table, "patch", _sector(table), _rings(table), narrow, "" if narrow else _WIDE)
        resolution = None if shift is None else _resolution(maps, shift)
        return replace(_beside_null(found, maps, len(white)), resolution=resolution)
    if effect.located == "ring":
        width = next((value[p.name] for p in effect.parameters if p.role == "size"), 0.0)
        table = np.zeros((len(RINGS), SECTORS))
        table[-1] = 1 / SECTORS
        if width:
            return Place(table, "ring", (0.0, 360.0), (EDGES[-1] - 2 * width, EDGES[-1]), True)
        return Place(table, "ring", None, None, False, "it acts all around")
    if effect.located == "direction":
        return Place(_EVEN, "direction", None, None, False, "it acts along a direction, not in a place")
    return Place(_EVEN, "", None, None, False, "it acts everywhere on the cloth")


def _beside_null(found: Place, maps: PatchMaps, kept: int) -> Place:
    """The place, with what maps of as many residuals of noise alone look like."""
    noise = np.array(list(maps.of_noise(np.zeros(kept))))
    as_narrow = int((noise.max((1, 2)) >= found.map.max()).sum())
    return replace(found, null_map=noise.mean(0), null_p=(1 + as_narrow) / (1 + _NOISES))


def _resolution(maps: PatchMaps, shift: Float[ndarray, "kept"]) -> tuple[float, float]:
    """Median width of the region that is named where the same patch acts under fresh noise [deg, m]."""
    widths = [
        (angle[1] - angle[0], radius[1] - radius[0])
        for table in maps.of_noise(shift)
        for angle, radius in [(_sector(table), _rings(table))]
    ]
    angle, radius = np.median(widths, axis=0)
    return float(angle), float(radius)


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
