"""Predictions of a run's cells, solver by solver, with the real drapes: the common source of the figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import trimesh
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.index import OTHER_FACE
from cusick_bench.leaderboard import Cells, variants
from cusick_bench.leaderboard.cells.variants import method_label, of_boards
from cusick_bench.report.cell_view import shown_surface
from cusick_bench.report.errors import ReportError
from cusick_bench.report.prediction_file import check_mesh, read_prediction
from cusick_bench.runner.cell_files import load_cell
from cusick_bench.runner.store import CELL_FILE

_KINDS = {"solver": 0, "null": 1, "oracle": 2}


@dataclass(frozen=True, eq=False)
class Entrant:
    """A solver of a run, with its settings and its split where several are in it.

    Attributes:
        label: Name as it is shown.
        kind: "solver", "null" or "oracle".
        cells: Its rows of the table of cells.
    """

    label: str
    kind: str
    cells: pd.DataFrame

    def on(self, cloth: str) -> pd.DataFrame:
        """Its cells on a cloth.

        Args:
            cloth: Name of the cloth.

        Returns:
            Their rows, by seed and split: the first is of the same split for all solvers of one protocol.
        """
        return self.cells.loc[self.cells["cloth"] == cloth].sort_values(by=["seed", "repeat"])

    def folders(self, cloth: str) -> list[Path]:
        """Folders of its cells on a cloth.

        Args:
            cloth: Name of the cloth.

        Returns:
            The folders, by seed and split.
        """
        return [Path(folder) for folder in self.on(cloth)["folder"]]

    def unseen(self, cloth: str) -> tuple[int, ...]:
        """Index rows of the samples that the first of these cells has not seen.

        Args:
            cloth: Name of the cloth.

        Returns:
            The rows in the order of the split; none without such a cell.
        """
        return next(iter(self.on(cloth)["test"]), ())


@dataclass(frozen=True, eq=False)
class Draws:
    """Prediction of a cell.

    Attributes:
        fit: Silhouette of the training sample.
        images: Silhouettes for unseen samples, in bytes.
        fit_vertices: Drape behind `fit` [m], None where nothing was simulated.
        vertices: Drapes behind `images` [m], None where there are none.
        faces: Triangles of both.
        protocol: How the silhouettes are taken.
        turned: Which of `images` lie with the other face up than the training sample; None where all predict any face.
    """

    fit: Float[ndarray, "size size"]
    images: UInt8[ndarray, "draws size size"]
    fit_vertices: Float[ndarray, "vertices 3"] | None = None
    vertices: Float[ndarray, "draws vertices 3"] | None = None
    faces: Int[ndarray, "faces 3"] | None = None
    protocol: Protocol = RELEASE
    turned: Bool[ndarray, " draws"] | None = None

    def of_face(self, turned: bool) -> Int[ndarray, " own"]:
        """Numbers of the draws that predict samples with one face up.

        Args:
            turned: Whether it is the other face than the training sample's.

        Returns:
            Numbers of the draws, from 0.
        """
        return np.arange(len(self.images)) if self.turned is None else np.flatnonzero(self.turned == turned)

    def evenly(self, count: int, lying: Bool[ndarray, " samples"]) -> Int[ndarray, " chosen"]:
        """Some of the draws, evenly spaced, as they may be in order, such as rotations; faces as often as in samples.

        Args:
            count: How many at most.
            lying: Which of the samples that they are compared with lie with the other face up than the training sample.

        Returns:
            Numbers of the draws, from 0.
        """
        if self.turned is None:
            return _spaced(np.arange(len(self.images)), count)
        faces, samples = np.unique(lying, return_counts=True)
        own, shares = [self.of_face(bool(face)) for face in faces], samples / samples.sum()
        total = min(count, *(len(draws) / share for draws, share in zip(own, shares, strict=True)))
        sizes = np.maximum(np.round(total * shares).astype(int), 1).tolist()
        return np.sort(np.concatenate([_spaced(draws, size) for draws, size in zip(own, sizes, strict=True)]))

    def sides(self, trained: str) -> ndarray:
        """Face that lies up in each draw.

        Args:
            trained: That of the training sample.

        Returns:
            "up" or "down"; "" where it is not known, or the draw predicts any face.
        """
        if self.turned is None:
            return np.full(len(self.images), "")
        return np.where(self.turned, OTHER_FACE.get(trained, ""), trained)

    def fit_surface(self) -> trimesh.Trimesh:
        """The drape behind `fit`, or the ruled surface over it where nothing was simulated."""
        return surface_of(self.fit, self.fit_vertices, self.faces, self.protocol)

    def surface(self, draw: int) -> trimesh.Trimesh:
        """The drape behind a draw, or the ruled surface over it where nothing was simulated.

        Args:
            draw: Number of the draw, from 0.

        Returns:
            The surface [m].
        """
        vertices = None if self.vertices is None else self.vertices[draw]
        return surface_of(self.images[draw] / 255, vertices, self.faces, self.protocol)


def entrants(
    cells: Cells, solvers: Sequence[str] | None = None, *, kinds: Sequence[str] = tuple(_KINDS)
) -> list[Entrant]:
    """The solvers of a run: those that simulate, those that do not, those that have seen the answer.

    Args:
        cells: Cells of the run's folder.
        solvers: Names of the solvers to keep, in this order, a name without options standing for all that it has;
            those of the kinds by default.
        kinds: Kinds to keep where no solver is named; all where the run has none of them.

    Returns:
        The solvers, each with its cells.

    Raises:
        ReportError: A solver that is not in the run.
    """
    found = [
        Entrant(method_label(solver, variant) + apart, str(group["kind"].iloc[0]), group)
        for apart, board in of_boards(cells.table)
        for (solver, variant), group in variants(board)
    ]
    if solvers is None:
        wanted = [entrant for entrant in found if entrant.kind in kinds] or found
        return sorted(wanted, key=lambda entrant: (_KINDS.get(entrant.kind, 3), entrant.label))
    present = sorted(set(cells.table["solver"]))
    if missing := [name for name in solvers if not any(_named(solver, name) for solver in present)]:
        raise ReportError(f"no {', '.join(missing)} in {cells.folder}; --solver takes any of: {', '.join(present)}")
    return [entrant for name in solvers for entrant in found if _named(entrant.cells["solver"].iloc[0], name)]


def _named(solver: str, name: str) -> bool:
    return name in (solver, solver.partition(",")[0])


def check_data(cells: Cells, dataset: DrapeDataset) -> None:
    """Makes sure that a run was made with these data.

    Args:
        cells: Cells of the run's folder.
        dataset: The data.

    Raises:
        ReportError: It was not.
    """
    hashes = sorted(set(cells.table["dataset_hash"]))
    if hashes != [dataset.content_hash]:
        raise ReportError(
            f"the data {dataset.name} ({dataset.content_hash[:12]}) must be those of the run, which used "
            f"{', '.join(sorted(set(cells.table['dataset'])))} ({', '.join(text[:12] for text in hashes)}); "
            "give the run's --data and --fabrics-csv"
        )


def held_out_rows(cells: Cells, cloth: str) -> list[int]:
    """Index rows of the held-out samples of a cloth.

    Args:
        cells: Cells of the run's folder.
        cloth: Name of the cloth.

    Returns:
        The rows, sorted.

    Raises:
        ReportError: There are none.
    """
    own = cells.table.loc[cells.table["cloth"] == cloth, "test"]
    held_out = sorted({row for rows in own for row in rows})
    if not held_out:
        raise ReportError(f"{cloth} must have held-out samples, and the run in {cells.folder} has none; run a split")
    return held_out


def train_row(folder: Path) -> int:
    """Index row of the sample that a cell was fitted to.

    Args:
        folder: The cell's folder.

    Returns:
        The row.

    Raises:
        ReportError: The cell's description is missing or damaged.
    """
    return train_rows(folder)[0]


def train_rows(folder: Path) -> tuple[int, ...]:
    """Index rows of all samples that a cell was trained on, the one that it was fitted to first.

    Args:
        folder: The cell's folder.

    Returns:
        The rows, one at least.

    Raises:
        ReportError: The cell's description is missing or damaged.
    """
    try:
        first, *others = map(int, load_cell(folder)["train"])
        return first, *others
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ReportError(f"cannot read {folder / CELL_FILE} ({error}); delete its folder and run it again") from error


def turned_over(dataset: DrapeDataset, trained: int, rows: Sequence[int]) -> Bool[ndarray, " samples"]:
    """Which samples are known to lie with the other face up than a training sample.

    Args:
        dataset: The data.
        trained: Index row of the training sample.
        rows: Index rows of the samples.

    Returns:
        Whether each does.
    """
    sides = dataset.table["side"].to_numpy(dtype=str)
    return sides[list(rows)] == OTHER_FACE.get(str(sides[trained]), "none")


def load_draws(folder: Path, protocol: Protocol = RELEASE) -> Draws:
    """Reads `prediction.npz` of a finished cell, without trusting it.

    Args:
        folder: The cell's folder.
        protocol: How the data's silhouettes were taken.

    Returns:
        The prediction.

    Raises:
        ReportError: It is missing, damaged or oversized.
    """
    return read_prediction(folder, lambda arrays: _draws(arrays, protocol))


def surface_of(
    image: Float[ndarray, "size size"],
    vertices: Float[ndarray, "vertices 3"] | None,
    faces: Int[ndarray, "faces 3"] | None,
    protocol: Protocol = RELEASE,
) -> trimesh.Trimesh:
    """A mesh, or where there is none the ruled surface over a silhouette.

    Args:
        image: The silhouette.
        vertices: Positions [m], None where there is no mesh.
        faces: Triangles, None where there is no mesh.
        protocol: How the silhouette was taken.

    Returns:
        The surface.
    """
    if vertices is None or faces is None:
        return shown_surface(profile_of(image, protocol), protocol)
    return trimesh.Trimesh(vertices, faces, process=False)


def _spaced(numbers: Int[ndarray, " draws"], count: int) -> Int[ndarray, " chosen"]:
    return numbers[np.unique(np.linspace(0, len(numbers) - 1, count).astype(int))]


def _draws(arrays: Mapping[str, ndarray], protocol: Protocol) -> Draws:
    fit, images = np.asarray(arrays["train_image"], dtype=np.float64), arrays["draws"]
    if fit.ndim != 2 or images.dtype != np.uint8 or images.shape != (len(images), *fit.shape) or len(images) == 0:
        raise ValueError(f"its images have shapes {fit.shape} and {images.shape}, type {images.dtype}")
    vertices, drawn, faces = (arrays.get(name) for name in ("vertices", "draw_vertices", "faces"))
    for drapes in (vertices, drawn):
        if drapes is not None:
            check_mesh(drapes, faces)
    if drawn is not None and len(drawn) != len(images):
        raise ValueError(f"{len(drawn)} drapes stand behind {len(images)} draws")
    turned = arrays.get("draw_turned")
    if turned is not None and (turned.dtype != bool or turned.shape != (len(images),)):
        raise ValueError(f"its faces of {len(images)} draws have shape {turned.shape}, type {turned.dtype}")
    return Draws(fit, images, vertices, drawn, faces, protocol, turned)
