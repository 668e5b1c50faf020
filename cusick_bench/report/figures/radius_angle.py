"""Radius over angle of real drapes and draws, and a classifier's answer to the question to which cloth a draw belongs.

The answer is a number. A classifier learns the cloths from the phase-free statistics of their held-out samples; those
that the draws were fitted to are left out, or a copy of one would be at home by construction. The share of draws
that it takes for their own cloth stands beside the share of real samples that it recognises without having seen them,
and so does the share that it takes for no cloth at all. Draws that are all alike, in the middle of their cloth, can be
recognised more often than real samples: these shares say whether draws look right, not whether they vary as they must.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.leaderboard import Cells
from cusick_bench.metrics import (
    PHASE_FREE,
    STATISTICS,
    Classifier,
    Confusion,
    Shape,
    drape_statistics,
    learn,
    ranks,
    standardised,
)
from cusick_bench.report.drawing.radius_over_angle import WHOLE_TURN, draw_levels, draw_turn
from cusick_bench.report.errors import ReportError
from cusick_bench.report.figures import CLASSIFIED_DRAWS
from cusick_bench.report.figures.predictions import (
    Entrant,
    check_data,
    entrants,
    held_out_rows,
    load_draws,
    train_row,
    train_rows,
    turned_over,
)
from cusick_bench.report.figures.sheet import empty_sheet, heading, in_blocks

_LINES = 12  # drawn in a panel
_REAL, _DRAWN = "#c85a00", "#1c63b7"
_ROOM = (8, 14)  # between the limits of the radius and the plate, the flat cloth [mm]


@dataclass(frozen=True, eq=False)
class Group:
    """Drapes of every cloth from one source: the real ones, or a solver's draws.

    Attributes:
        label: The source.
        radii: Cloth -> profiles [m].
        statistics: Cloth -> statistics, in the order of `STATISTICS`.
        confusion: What the drapes are taken for.
        sides: Cloth -> face that lies up; "" where it is not known, or a draw predicts any face.
    """

    label: str
    radii: dict[str, Float[ndarray, "drapes angles"]]
    statistics: dict[str, Float[ndarray, "drapes statistics"]]
    confusion: Confusion
    sides: dict[str, ndarray] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Plain numbers."""
        counts, cloths = self.confusion.counts, self.confusion.cloths
        own = dict(zip(cloths, self.confusion.accuracies.tolist(), strict=True))
        return {
            "accuracy": self.confusion.accuracy,
            "accuracy_of": own,
            "none_of_them": self.confusion.strangers,
            "drapes": int(counts.sum()),
            "taken_for": {
                cloth: dict(zip((*cloths, "none"), row, strict=True))
                for cloth, row in zip(cloths, counts.tolist(), strict=True)
            },
        }


@dataclass(frozen=True, eq=False)
class RadiusAngle:
    """The figure's content.

    Attributes:
        real: Held-out samples.
        drawn: Draws of each solver.
        protocol: How the silhouettes are taken.
    """

    real: Group
    drawn: tuple[Group, ...]
    protocol: Protocol = RELEASE

    @property
    def cloths(self) -> tuple[str, ...]:
        """Cloths, in order."""
        return self.real.confusion.cloths

    def document(self) -> dict[str, Any]:
        """Plain numbers: who is taken for what, and ranks of held-out drape coefficients among draws of their face."""
        return {
            "question": "which cloth does a drape belong to, judged by its phase-free statistics",
            "cloths": list(self.cloths),
            "chance": 1 / len(self.cloths),
            "real": self.real.document(),
            "draws": {group.label: group.document() for group in self.drawn},
            "dc_ranks": {
                group.label: {cloth: _ranks(group, self.real, cloth).tolist() for cloth in group.statistics}
                for group in self.drawn
            },
        }


def radius_angle(
    cells: Cells,
    dataset: DrapeDataset,
    solvers: Sequence[str] | None = None,
    *,
    draws: int = CLASSIFIED_DRAWS,
    progress: Callable[[str], None] = lambda message: None,
) -> RadiusAngle:
    """Compares a run's draws with the held-out samples of all its cloths.

    Args:
        cells: Cells of the run's folder.
        dataset: The run's data.
        solvers: Which of its solvers; by default all but oracles.
        draws: Most draws of a cell to look at.
        progress: Called with the name of what is being measured.

    Returns:
        The figure's content.

    Raises:
        ReportError: Other data, an unknown solver, a damaged prediction, or a cloth of which all samples train.
        MetricError: Fewer than two cloths, or too few samples.
    """
    check_data(cells, dataset)
    chosen = entrants(cells, solvers, kinds=("solver", "null"))
    cloths = sorted(set(cells.table["cloth"]))
    shapes: dict[str, list[Shape]] = {}
    unseen: dict[str, list[int]] = {}
    samples: list[int] = []
    for cloth in cloths:
        progress(f"real samples of {cloth}")
        unseen[cloth] = rows = _unseen_rows(cells, dataset, chosen, cloth)
        shapes[cloth] = [Shape(dataset.image(row), protocol=dataset.protocol) for row in rows]
        samples += [int(dataset.table["sample"].iloc[row]) for row in rows]
    statistics = {cloth: drape_statistics(own) for cloth, own in shapes.items()}
    features, owners = _features(statistics)
    judge, confusion = learn(features, owners, samples)
    side = dataset.table["side"].to_numpy(dtype=str)
    real = Group("real samples", _radii(shapes), statistics, confusion, {one: side[unseen[one]] for one in cloths})
    drawn = tuple(_drawn(entrant, dataset, unseen, judge, draws, progress) for entrant in chosen)
    return RadiusAngle(real, drawn, dataset.protocol)


def _unseen_rows(cells: Cells, dataset: DrapeDataset, chosen: Sequence[Entrant], cloth: str) -> list[int]:
    """Index rows of the held-out samples of a cloth that none of these solvers was trained on, in any of its cells."""
    samples = dataset.table["sample"].tolist()
    trained = {samples[row] for entrant in chosen for folder in entrant.folders(cloth) for row in train_rows(folder)}
    rows = [row for row in held_out_rows(cells, cloth) if samples[row] not in trained]
    if not rows:
        raise ReportError(
            f"draws are judged beside samples that no fit has seen, and every sample of {cloth} trains some fit of "
            f"{cells.folder} (samples were left out in turn); give a run of --protocol paper"
        )
    return rows


def _drawn(
    entrant: Entrant,
    dataset: DrapeDataset,
    unseen: Mapping[str, Sequence[int]],
    judge: Classifier,
    count: int,
    progress: Callable[[str], None],
) -> Group:
    """A solver's draws, of all seeds, with either face up as often as unseen samples."""
    shapes: dict[str, list[Shape]] = {}
    sides: dict[str, ndarray] = {}
    for cloth, rows in unseen.items():
        progress(f"{entrant.label} on {cloth}")
        for folder in entrant.folders(cloth):
            draws, trained = load_draws(folder), train_row(folder)
            numbers = draws.evenly(count, turned_over(dataset, trained, rows))
            own = [Shape(image / 255, protocol=dataset.protocol) for image in draws.images[numbers]]
            own_sides = draws.sides(str(dataset.table["side"].iloc[trained]))[numbers]
            shapes[cloth] = shapes.get(cloth, []) + own
            sides[cloth] = np.append(sides.get(cloth, []), own_sides)
    statistics = {cloth: drape_statistics(own) for cloth, own in shapes.items()}
    return Group(entrant.label, _radii(shapes), statistics, judge.confusion(*_features(statistics)), sides)


def _ranks(drawn: Group, real: Group, cloth: str) -> Float[ndarray, " samples"]:
    """Ranks of drape coefficients of real samples among draws with the same face up; of any, where it has none."""
    column = STATISTICS.index("drape_coefficient")
    draws, samples = drawn.statistics[cloth][:, column], real.statistics[cloth][:, column]
    found = np.zeros(len(samples))
    for side in np.unique(real.sides[cloth]):
        own, at = np.isin(drawn.sides[cloth], [side, ""]), real.sides[cloth] == side
        found[at] = ranks(draws[own] if own.any() else draws, samples[at])
    return found


def _features(statistics: dict[str, ndarray]) -> tuple[Float[ndarray, "drapes statistics"], list[str]]:
    """Phase-free statistics of all drapes, and their cloths."""
    owners = [cloth for cloth, own in statistics.items() for _ in own]
    return standardised(np.concatenate(list(statistics.values())), PHASE_FREE), owners


def _radii(shapes: dict[str, list[Shape]]) -> dict[str, ndarray]:
    return {cloth: np.stack([shape.profile.radii for shape in own]) for cloth, own in shapes.items()}


def save_radius_angle(study: RadiusAngle, path: Path) -> None:
    """Writes `radius_angle_figure` as PNG.

    Args:
        study: The figure's content.
        path: File to write.
    """
    radius_angle_figure(study).savefig(path)


def radius_angle_figure(study: RadiusAngle) -> Figure:
    """Radius over angle: a row for each cloth, solvers side by side, in blocks that begin with the real samples.

    Args:
        study: The figure's content.

    Returns:
        The figure.
    """
    blocks, cloths = in_blocks(study.drawn), study.cloths
    rows, columns = len(cloths) * len(blocks), 1 + max(map(len, blocks))
    figure, axes = empty_sheet(0.8 + 2.9 * columns, 1.2 + 1.5 * rows, rows, columns, sharex=True, sharey=True)
    for number, block in enumerate(blocks):
        _block(axes[number * len(cloths) :][: len(cloths)], cloths, [study.real, *block], study.protocol)
    figure.suptitle(
        f"radius over angle of up to {_LINES} drapes each (dotted: radius of the plate and of the flat cloth)",
        fontsize=10,
    )
    return figure


def _block(axes: ndarray, cloths: Sequence[str], groups: Sequence[Group], protocol: Protocol) -> None:
    """Draws groups side by side, the real one first."""
    for column, group in enumerate(groups):
        axes[0, column].set_title(
            f"{heading(group.label)}\n{_at_home(group.confusion.accuracy)}", fontsize=9, parse_math=False
        )
        for row, cloth in enumerate(cloths):
            axis = axes[row, column]
            axis.set_axis_on()
            axis.tick_params(labelleft=column == 0, labelbottom=row == len(cloths) - 1)
            colour, accuracy = _DRAWN if column else _REAL, group.confusion.accuracies[row]
            _panel(axis, group.radii.get(cloth), accuracy, colour, protocol)
        axes[-1, column].set_xlabel("angle from warp [deg]", fontsize=8)
    for row, cloth in enumerate(cloths):
        axes[row, 0].set_ylabel(f"{cloth}\nradius [mm]", fontsize=8, parse_math=False)


def save_confusion(study: RadiusAngle, path: Path) -> None:
    """Draws as PNG what real samples and draws are taken for, in per cent of each cloth's drapes.

    Args:
        study: The figure's content.
        path: File to write.
    """
    groups = [study.real, *study.drawn]
    columns = min(len(groups), 4)
    rows = -(-len(groups) // columns)
    figure, axes = empty_sheet(1.2 + 2.9 * columns, 1.0 + 2.5 * rows, rows, columns)
    for axis, group in zip(axes.ravel(), groups, strict=False):
        axis.set_axis_on()
        _matrix(axis, group.confusion)
        axis.set_title(f"{heading(group.label)}\n{_at_home(group.confusion.accuracy)}", fontsize=9, parse_math=False)
        axis.set_xticks(
            range(len(study.cloths) + 1), (*study.cloths, "none"), rotation=45, ha="right", fontsize=8, parse_math=False
        )
        axis.set_xlabel("taken for", fontsize=8)
        axis.set_ylabel("drapes of", fontsize=8)
        axis.set_yticks(range(len(study.cloths)), study.cloths, fontsize=8, parse_math=False)
    figure.savefig(path)


def _panel(axis: Axes, radii: ndarray | None, accuracy: float, colour: str, protocol: Protocol) -> None:
    low, high = 1e3 * protocol.plate_radius_m - _ROOM[0], 1e3 * protocol.cloth_radius_m + _ROOM[1]
    axis.set(xlim=(0, 360), xticks=WHOLE_TURN, ylim=(low, high))
    draw_levels(axis, colour="0.5", protocol=protocol)
    axis.tick_params(labelsize=7)
    if radii is None:
        axis.text(180, (low + high) / 2, "no cell", ha="center", fontsize=8, color="0.5")
        return
    for index in np.unique(np.linspace(0, len(radii) - 1, _LINES).astype(int)):
        draw_turn(axis, radii[index], color=colour, linewidth=0.7, alpha=0.55)
    text = f"{len(radii)} drape{'s' * (len(radii) > 1)}, {_at_home(accuracy)}"
    behind = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1}
    axis.text(356, high - 2, text, ha="right", va="top", fontsize=6.5, color="0.3", bbox=behind)


def _matrix(axis: Axes, confusion: Confusion) -> None:
    total = confusion.counts.sum(1, keepdims=True)
    shares = confusion.counts / np.maximum(total, 1)
    axis.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for (row, column), share in np.ndenumerate(shares):
        if total[row, 0]:
            colour = "white" if share > 0.6 else "0.25"
            axis.text(column, row, f"{100 * share:.0f}", ha="center", va="center", fontsize=8, color=colour)


def _at_home(accuracy: float) -> str:
    return f"{100 * accuracy:.0f} % taken for their cloth" if isfinite(accuracy) else ""
