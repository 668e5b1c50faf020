"""Real and simulated drapes side by side: silhouettes from above, and below them the drapes from the side.

On every predicted silhouette lies the real outline, so that a fold out of place is seen at once. A drape from the
side is the simulated mesh; where a method simulates nothing, or the real sample has no mesh, it is the ruled surface
over the silhouette, and is marked so.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import outline_pixels
from cusick_bench.leaderboard import Cells
from cusick_bench.metrics import mse, mse_pairs
from cusick_bench.report.drawing.pictures import drape_picture, silhouette_picture
from cusick_bench.report.figures import SHOWN_SAMPLES
from cusick_bench.report.figures.predictions import (
    Draws,
    Entrant,
    check_data,
    entrants,
    held_out_rows,
    load_draws,
    surface_of,
    train_row,
    turned_over,
)
from cusick_bench.report.figures.sheet import empty_sheet, heading, in_blocks

_REACH = 1.05  # flat radii about the plate's axis that are shown of a silhouette; drapes of the release reach 1.03
_SKY = 50  # [px] above a drape from the side
_OUTLINE = "#eb7319"

Progress = Callable[[str], None]
Pixels = tuple[Float[ndarray, " points"], Float[ndarray, " points"]]
"""Columns and rows of points of a picture."""


def _unwatched(message: str) -> None:
    """The progress of figures that nobody waits for."""


@dataclass(frozen=True, eq=False)
class Tile:
    """One drape in the sheet.

    Attributes:
        image: Its silhouette.
        surface: Its surface.
        ruled: Whether the surface is built from the silhouette alone.
        mse: MSE of the silhouette against the real one; None for the real one itself.
        remark: Further words below it.
    """

    image: Float[ndarray, "size size"]
    surface: trimesh.Trimesh
    ruled: bool
    mse: float | None = None
    remark: str = ""


@dataclass(frozen=True, eq=False)
class Strip:
    """A real drape and its predictions.

    Attributes:
        cloth: Its cloth.
        sample: Number of its sample.
        real: The real drape.
        predicted: Solver -> its prediction; solvers without one are left out.
        protocol: How the silhouettes are taken.
    """

    cloth: str
    sample: int
    real: Tile
    predicted: dict[str, Tile]
    protocol: Protocol = RELEASE

    def document(self) -> dict[str, Any]:
        """Plain numbers."""
        errors = {label: tile.mse for label, tile in self.predicted.items()}
        return {"cloth": self.cloth, "sample": self.sample, "mse": errors}


def fitted(
    cells: Cells, dataset: DrapeDataset, solvers: Sequence[str] | None = None, *, progress: Progress = _unwatched
) -> list[Strip]:
    """Training samples beside their fits, one strip a cloth; of several seeds and splits the first.

    Args:
        cells: Cells of the run's folder.
        dataset: The run's data.
        solvers: Which of its solvers; by default those that simulate, as the others copy the silhouette or guess it.
        progress: Called with the name of what is being read.

    Returns:
        A strip for each real drape that is shown.

    Raises:
        ReportError: Other data, an unknown solver, or a damaged prediction.
    """
    check_data(cells, dataset)
    chosen, strips = entrants(cells, solvers, kinds=("solver",)), []
    for cloth in sorted(set(cells.table["cloth"])):
        progress(f"fits of {cloth}")
        folders = _first_folders(chosen, cloth)
        if not folders:
            continue
        row = train_row(next(iter(folders.values())))
        real = _real(dataset, row)
        same = {label: folder for label, folder in folders.items() if train_row(folder) == row}
        fits = {label: load_draws(folder, dataset.protocol) for label, folder in same.items()}
        tiles = {label: _fit_tile(draws, real.image) for label, draws in fits.items()}
        strips.append(Strip(cloth, _sample(dataset, row), real, tiles, dataset.protocol))
    return strips


def held_out(
    cells: Cells,
    dataset: DrapeDataset,
    solvers: Sequence[str] | None = None,
    *,
    samples: int = SHOWN_SAMPLES,
    progress: Progress = _unwatched,
) -> list[Strip]:
    """Held-out samples beside the draw that fits each best; of several seeds and splits the first.

    Whoever picks the best draw has seen the sample, and the more draws there are the better it is: such strips show
    what a method can draw, not what it foretells.

    Args:
        cells: Cells of the run's folder.
        dataset: The run's data.
        solvers: Which of its solvers; by default all but oracles.
        samples: Most samples of a cloth.
        progress: Called with the name of what is being read.

    Returns:
        A strip for each real drape that is shown.

    Raises:
        ReportError: Other data, an unknown solver, or a damaged prediction.
    """
    check_data(cells, dataset)
    chosen, strips = entrants(cells, solvers, kinds=("solver", "null")), []
    for cloth in sorted(set(cells.table["cloth"])):
        progress(f"draws of {cloth}")
        unseen = next((one.unseen(cloth) for one in chosen if one.folders(cloth)), ())
        rows = (sorted(unseen) or held_out_rows(cells, cloth))[:samples]
        reals = [_real(dataset, row) for row in rows]
        predicted: list[dict[str, Tile]] = [{} for _ in rows]
        for entrant in (one for one in chosen if one.folders(cloth) and one.unseen(cloth) == unseen):
            draws = load_draws(
                entrant.folders(cloth)[0], dataset.protocol
            )  # one at a time: a thousand drapes have 65 MB
            errors = mse_pairs(draws.images, np.stack([real.image for real in reals]), dataset.protocol)
            own = _made_for(entrant, cloth, rows, len(draws.images))
            lying = turned_over(dataset, train_row(entrant.folders(cloth)[0]), rows)
            for place, other_face in enumerate(lying.tolist()):
                offered = draws.of_face(other_face)
                best = own[place] if own else int(offered[errors[offered, place].argmin()])
                words = "" if own else f"best of {len(offered)}" if len(offered) > 1 else "its only draw"
                predicted[place][entrant.label] = _draw_tile(draws, best, float(errors[best, place]), words)
        strips += [
            Strip(cloth, _sample(dataset, row), real, tiles, dataset.protocol)
            for row, real, tiles in zip(rows, reals, predicted, strict=True)
        ]
    return strips


def _first_folders(chosen: Sequence[Entrant], cloth: str) -> dict[str, Path]:
    """Folder of each solver's first seed and split."""
    return {entrant.label: folders[0] for entrant in chosen if (folders := entrant.folders(cloth))}


def _sample(dataset: DrapeDataset, row: int) -> int:
    return int(dataset.table["sample"].iloc[row])


def _real(dataset: DrapeDataset, row: int) -> Tile:
    sample = dataset.sample(row)
    image, mesh = sample.image.numpy(), sample.mesh
    surface = mesh if mesh is not None else surface_of(image, None, None, dataset.protocol)
    return Tile(image, surface, mesh is None)


def _fit_tile(draws: Draws, real: ndarray) -> Tile:
    return Tile(draws.fit, draws.fit_surface(), draws.fit_vertices is None, mse(draws.fit, real, draws.protocol))


def _made_for(entrant: Entrant, cloth: str, rows: Sequence[int], count: int) -> list[int]:
    """Which draws an oracle made for these held-out samples; none where draws are for all samples alike."""
    made = list(entrant.unseen(cloth))
    paired = entrant.kind == "oracle" and count == len(made) and set(rows) <= set(made)
    return [made.index(row) for row in rows] if paired else []


def _draw_tile(draws: Draws, best: int, error: float, remark: str) -> Tile:
    return Tile(draws.images[best] / 255, draws.surface(best), draws.vertices is None, error, remark)


def save_strips(strips: Sequence[Strip], path: Path, title: str) -> None:
    """Writes `strips_figure` as PNG.

    Args:
        strips: At least one.
        path: File to write.
        title: Line above them.
    """
    strips_figure(strips, title).savefig(path)


def strips_figure(strips: Sequence[Strip], title: str) -> Figure:
    """Strips one below the other; where there are many methods, in blocks that repeat the real drapes.

    Args:
        strips: At least one.
        title: Line above them.

    Returns:
        The figure.
    """
    blocks = in_blocks(list(dict.fromkeys(label for strip in strips for label in strip.predicted)))
    columns, rows = 1 + max(map(len, blocks)), len(blocks) * len(strips)
    heights = [1.45, 1.0] * rows
    figure, axes = empty_sheet(0.5 + 2.1 * columns, 0.6 + 3.55 * rows, 2 * rows, columns, height_ratios=heights)
    for number, labels in enumerate(blocks):
        for index, strip in enumerate(strips, start=number * len(strips)):
            _strip(axes[2 * index : 2 * index + 2], strip, labels)
        for axis, label in zip(axes[2 * number * len(strips)], ["real", *labels], strict=False):
            axis.set_title(heading(label), fontsize=9, parse_math=False)
    figure.suptitle(title, fontsize=10)
    return figure


def _strip(axes: ndarray, strip: Strip, labels: Sequence[str]) -> None:
    """Draws a real drape and some of its predictions, from above into the first row of axes, from the side below."""
    outline = outline_pixels(strip.real.image, strip.protocol)
    for column, label in enumerate(["real", *labels]):
        tile = strip.predicted.get(label) if column else strip.real
        if tile is not None:
            _from_above(axes[0, column], tile, outline if column else None, strip.protocol)
            _from_side(axes[1, column], tile, strip.cloth, strip.protocol)
    words, corner = f"{strip.cloth}\nsample {strip.sample}", axes[0, 0]
    corner.text(
        -0.05,
        0.5,
        words,
        transform=corner.transAxes,
        fontsize=8,
        ha="right",
        va="center",
        rotation=90,
        parse_math=False,
    )


def _from_above(axis: Axes, tile: Tile, outline: Pixels | None, protocol: Protocol) -> None:
    axis.imshow(silhouette_picture(tile.image))
    (column, row), reach = protocol.centre_px, _REACH * protocol.cloth_radius_m * protocol.px_per_m
    axis.set(xlim=(column - reach, column + reach), ylim=(row + reach, row - reach))
    if outline is None:
        return
    axis.plot(*outline, color=_OUTLINE, linewidth=0.8)
    words = f"MSE {tile.mse:.4f}" + f", {tile.remark}" * bool(tile.remark)
    axis.text(0.5, 0.0, words, transform=axis.transAxes, ha="center", va="top", fontsize=7, color="0.3")


def _from_side(axis: Axes, tile: Tile, cloth: str, protocol: Protocol) -> None:
    vertices, faces = np.asarray(tile.surface.vertices), np.asarray(tile.surface.faces)
    axis.imshow(drape_picture(vertices, faces, cloth, protocol=protocol)[_SKY:])
    if tile.ruled:
        axis.text(
            0.5,
            0,
            "surface over the silhouette",
            transform=axis.transAxes,
            ha="center",
            va="top",
            fontsize=6,
            color="0.4",
        )
