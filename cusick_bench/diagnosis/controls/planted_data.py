"""Data sets with changed pictures, pictures drawn from meshes, or permuted labels; the files stay as they are."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.diagnosis.controls.pictures import PictureChange, View

if TYPE_CHECKING:
    import pandas as pd
    from torch import Tensor


@dataclass(frozen=True, eq=False, repr=False)
class PlantedData(DrapeDataset):
    """A data set whose pictures are changed when they are read.

    Attributes:
        change: What is done to every picture.
    """

    change: PictureChange

    def image(self, i: int) -> Tensor:
        """The changed silhouette of a row, cloth = 1."""
        import torch

        picture = super().image(i).numpy()
        row = self.table.iloc[i]
        view = View(int(row["sample"]), str(row["side"]), self.protocol)
        return torch.from_numpy(self.change(picture, view))


@dataclass(frozen=True, eq=False, repr=False)
class RenderedData(DrapeDataset):
    """A data set whose pictures are drawn from its meshes.

    Attributes:
        inverse_height: Inverse height of the camera's eye over the plate [1/m]; 0 for a parallel projection.
    """

    inverse_height: float = 0.0

    def image(self, i: int) -> Tensor:
        """The mesh of a row as the camera sees it, at the protocol's scale in the plane of the plate."""
        import torch

        from cusick_bench.sim.render.silhouette import render

        mesh = DrapeDataset(**_values(self)).sample(i).mesh
        assert mesh is not None, "rows without a mesh are left out by `rendered`"
        camera = camera_of(self._seen_by())
        vertices = torch.tensor(np.asarray(mesh.vertices), dtype=torch.float64)
        faces = np.asarray(mesh.faces, dtype=np.int64)
        return render(vertices, faces, camera, size=self.protocol.image_size_px)

    def _seen_by(self) -> Any:
        if self.inverse_height == 0:
            return replace(self.protocol, projection="parallel")
        return replace(self.protocol, projection="pinhole", camera_height_m=1 / self.inverse_height)


def planted(dataset: DrapeDataset, change: PictureChange) -> PlantedData:
    """A data set with changed pictures.

    Args:
        dataset: The data.
        change: What is done to every picture.

    Returns:
        The same rows, with changed pictures.
    """
    return PlantedData(**_values(dataset), change=change)


def rendered(dataset: DrapeDataset, inverse_height: float) -> RenderedData:
    """A data set drawn from its meshes, without the rows that have none.

    The protocol stays as it is, so that a camera which differs from it acts as an effect.

    Args:
        dataset: The data; at least one row has a mesh.
        inverse_height: Inverse height of the camera's eye over the plate [1/m]; 0 for a parallel projection.

    Returns:
        The rows with a mesh, with drawn pictures.
    """
    table = dataset.table.iloc[np.flatnonzero(dataset.table["mesh"])].reset_index(drop=True)
    return RenderedData(**(_values(dataset) | {"table": table}), inverse_height=inverse_height)


def captures_shuffled(dataset: DrapeDataset, generator: np.random.Generator, *, across_faces: bool) -> DrapeDataset:
    """Permutes at random in which order the pictures of each sample were taken.

    Args:
        dataset: Data of one fabric.
        generator: Random generator.
        across_faces: Whether faces are permuted as well; otherwise every picture keeps its own.

    Returns:
        The same pictures of the same samples; the labels of each sample (and face) permuted.
    """
    labels = ["capture", "observation", *(["side"] if across_faces else [])]
    source = np.arange(len(dataset))
    for group in dataset.table.groupby(["sample"] if across_faces else ["sample", "side"]).indices.values():
        rows = np.array(group, dtype=np.int64)
        source[rows] = generator.permutation(rows)
    dealt = {label: dataset.table[label].to_numpy()[source] for label in labels}
    return _labelled(dataset, dataset.table.assign(**dealt))


def one_face(dataset: DrapeDataset, side: str) -> DrapeDataset:
    """The pictures of one face.

    Args:
        dataset: Data of one fabric that has this face.
        side: `up` or `down`.

    Returns:
        Its rows.
    """
    return dataset.select(side=side)


def halves_as_faces(dataset: DrapeDataset, side: str, generator: np.random.Generator) -> DrapeDataset:
    """One face, whose samples are divided at random into two halves that are called its faces.

    Args:
        dataset: Data of one fabric that has this face.
        side: `up` or `down`.
        generator: Random generator.

    Returns:
        The rows of this face; half of the samples are said to lie face up, the others face down.
    """
    face = one_face(dataset, side)
    numbers = np.unique(face.table["sample"].to_numpy())
    up = generator.permutation(numbers)[: len(numbers) // 2]
    return _labelled(face, face.table.assign(side=np.where(face.table["sample"].isin(up.tolist()), "up", "down")))


def two_observations(dataset: DrapeDataset, first: int, second: int) -> DrapeDataset:
    """Two pictures of a series over time.

    Args:
        dataset: Data of one fabric.
        first, second: Numbers of the observations.

    Returns:
        Their rows.
    """
    return dataset.select(observation=[first, second])


def _values(dataset: DrapeDataset) -> dict[str, Any]:
    return {item.name: getattr(dataset, item.name) for item in fields(DrapeDataset)}


def _labelled(dataset: DrapeDataset, table: pd.DataFrame) -> DrapeDataset:
    return replace(dataset, table=table)
