"""Points of all effects' grids in the rotated rows of the misfit, with the variance that another law adds.

Another law for the same effect moves the same statistics, but not equally far and not in exactly the same proportions.
Its shift differs from ours, d, by e d_k in row k (along), and by f times the root mean square of d over the rows of the
same sort (across, `Misfit.across`), since symmetry is the same for all laws. Each effect has its own e and f.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.sets.misfit import Misfit
from cusick_bench.diagnosis.inference.single_effects.evidence import Grid
from cusick_bench.diagnosis.inference.single_effects.finer import finer_grid

_MOST_DOUBT = 0.1
"""Largest share of a shift's square that the atlas' own variance may add; an effect with more could stand for noise."""
Mismatch = Callable[[str], tuple[float, float]]
"""Along and across, by an effect's name."""


@dataclass(frozen=True, eq=False)
class EffectPoints:
    """Points of grids, one after the other.

    Attributes:
        names: Effects, each once.
        grids: Their grids, by hypothesis.
        effect: Effect of each point, as a place in `names`.
        grid: Grid of each point, as a place in `grids`.
        row: Row of each point in its grid.
        shift: Shift of the turned rows.
        variance: Variance that another law and the atlas' own uncertainty add to each row.
        log_prior: Log prior of each point within its effect.
    """

    names: tuple[str, ...]
    grids: tuple[Grid, ...]
    effect: Int[ndarray, "points"]
    grid: Int[ndarray, "points"]
    row: Int[ndarray, "points"]
    shift: Float[ndarray, "points kept"]
    variance: Float[ndarray, "points kept"]
    log_prior: Float[ndarray, "points"]

    def __len__(self) -> int:
        return len(self.effect)

    @cached_property
    def cell(self) -> Float[ndarray, "points"]:
        """Share of a cell of its own grid that every point stands for, as in `Grid`."""
        cell = np.ones(len(self))
        for number, grid in enumerate(self.grids):
            own = self.grid == number
            cell[own] = grid.cell[self.row[own]]
        return cell

    def densest(self, effect: int, weight: Float[ndarray, "points"]) -> int:
        """An effect's point of largest density: parts of a cell share its weight, points beside them have more of it.

        Args:
            effect: The effect, as a place in `names`.
            weight: Weight of every point.

        Returns:
            Index of the point.
        """
        own = np.flatnonzero(self.effect == effect)
        return int(own[np.argmax(weight[own] / self.cell[own])])

    def value(self, point: int) -> dict[str, float]:
        """Parameters at a point.

        Args:
            point: Index of the point.

        Returns:
            Values by name.
        """
        values = self.grids[self.grid[point]].values
        return {name: float(column[self.row[point]]) for name, column in values.items()}

    def name(self, point: int) -> str:
        """Effect of a point.

        Args:
            point: Index of the point.

        Returns:
            Its name.
        """
        return self.names[self.effect[point]]

    def size(self) -> Float[ndarray, "points"]:
        """|d| of every point."""
        return np.linalg.norm(self.shift, axis=1)


def law_variance(
    misfit: Misfit, shares: tuple[float, float], shift: Float[ndarray, "*points kept"]
) -> Float[ndarray, "*points kept"]:
    """Variance that other laws for an effect add to each row (see the module).

    Args:
        misfit: Rows in which effects are compared.
        shares: How far laws differ, along a shift and across it.
        shift: Shifts of the turned rows by the effect.

    Returns:
        The variance.
    """
    along, across = shares
    return along**2 * shift**2 + across**2 * misfit.across(shift)


def effect_points(grids: Sequence[Grid], misfit: Misfit, mismatch: Mismatch, *, weak: bool = False) -> EffectPoints:
    """Points of several grids.

    Args:
        grids: All hypotheses.
        misfit: Rows in which they are compared.
        mismatch: How far other laws may differ.
        weak: Whether to keep points that are too weak to be detected.

    Returns:
        Their points; without `weak` those that have a prior.
    """
    names = tuple(dict.fromkeys(grid.hypothesis.name for grid in grids))
    rows = [np.arange(len(g.shift)) if weak else np.flatnonzero(np.isfinite(g.log_prior)) for g in grids]
    kept = len(misfit.rotation)
    shift, variance = [np.zeros((0, kept))], [np.zeros((0, kept))]
    for grid, chosen in zip(grids, rows, strict=True):
        turned = misfit.turned(grid.shift[chosen])
        doubt = np.minimum(grid.variance[chosen] / np.maximum((turned**2).mean(1), 1e-12), _MOST_DOUBT)
        shift.append(turned)
        variance.append(
            law_variance(misfit, mismatch(grid.hypothesis.name), turned) + doubt[:, None] * misfit.across(turned)
        )
    counts = [len(one) for one in rows]
    return EffectPoints(
        names,
        tuple(grids),
        np.repeat([names.index(grid.hypothesis.name) for grid in grids], counts).astype(int),
        np.repeat(np.arange(len(grids)), counts),
        np.concatenate([np.zeros(0, dtype=int), *rows]),
        np.concatenate(shift),
        np.concatenate(variance),
        np.concatenate([np.zeros(0), *(grid.log_prior[chosen] for grid, chosen in zip(grids, rows, strict=True))]),
    )


def finer_points(
    points: EffectPoints,
    chosen: Collection[int],
    emulator: Emulator,
    residual: Residual,
    misfit: Misfit,
    mismatch: Mismatch,
    *,
    weak: bool = False,
) -> EffectPoints:
    """Points, with finer grids about some of them.

    Args:
        points: Points of grids.
        chosen: Points about which the grids are finer.
        emulator: The atlas.
        residual: What the base model leaves, where the grids were made.
        misfit: Rows in which they are compared.
        mismatch: How far other laws may differ.
        weak: As in `effect_points`.

    Returns:
        Points of as many grids, in their order.
    """
    grids = []
    for number, grid in enumerate(points.grids):
        near = [points.value(point) for point in chosen if points.grid[point] == number]
        grids.append(finer_grid(emulator, residual, grid, near))
    return effect_points(grids, misfit, mismatch, weak=weak)
