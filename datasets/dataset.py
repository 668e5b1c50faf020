"""The data set as solvers, metrics and torch see it: a frozen table of silhouettes, and samples read on demand."""

from __future__ import annotations

import hashlib
import math
import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.files.fabrics import FILE as FABRICS_FILE
from cusick_bench.datasets.files.fabrics import fabric_name
from cusick_bench.datasets.files.image import read_silhouette, without_specks
from cusick_bench.datasets.files.layout import beside, inside_root
from cusick_bench.datasets.files.measure import content_hash
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.profile import Profile
from cusick_bench.datasets.published import CLOTHS
from cusick_bench.datasets.splits import Split, split_rows

if TYPE_CHECKING:
    import trimesh
    from torch import Tensor

    from cusick_bench.datasets.audit.audit import Audit


@dataclass(frozen=True, eq=False)
class DrapeSample:
    """One drape.

    Attributes:
        image: Silhouette, cloth = 1.
        profile: Radius-angle profile of the image.
        row: Its row of the index.
        mesh_path: File of its mesh, None if there is none.
    """

    image: Float[Tensor, "size size"]
    profile: Profile
    row: pd.Series
    mesh_path: Path | None

    @cached_property
    def mesh(self) -> trimesh.Trimesh | None:
        """The mesh [m], turned as the index says; None if there is none.

        Raises:
            BadMesh: The file cannot be read.
        """
        if self.mesh_path is None:
            return None
        import trimesh  # here, as it takes longer to import than a data set to load

        mesh = read_mesh(self.mesh_path)
        turn = round(float(self.row.to_dict()["mesh_rotation_deg"]) / 90) % 4
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn]
        rotation = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]], dtype=np.float64)
        return trimesh.Trimesh(mesh.vertices @ rotation, mesh.faces, process=False)


@dataclass(frozen=True, eq=False, repr=False)
class DrapeDataset:
    """Silhouettes of drapes with their meshes and what is known of the cloth; made by `load`.

    It has a length and items, which is all that torch's loaders ask of a data set; `load` gives one that is a
    `torch.utils.data.Dataset` by type too.

    Attributes:
        name: Name of the data set.
        root: Folder of its files.
        protocol: Nominal values of the experiment.
        corrected: Corrections that were applied.
        table: See `index`.
    """

    name: str
    root: Path
    protocol: Protocol
    corrected: tuple[str, ...]
    table: pd.DataFrame = field(repr=False)

    def __repr__(self) -> str:
        return f"DrapeDataset({self.name!r}, {len(self)} silhouettes of {len(self.cloths)} cloths, {str(self.root)!r})"

    @property
    def index(self) -> pd.DataFrame:
        """A copy of the table, one row per silhouette.

        Columns:
            dataset, fabric (number), cloth (a named set, or e.g. `fabric_9`), sample, capture
            side: "up", "down", or "" if unknown
            observation: number in a series over time, else 0
            image, mesh: paths below `root`; "" for no mesh
            same_as: in a named set, the identical image of a fabric, else ""
            mesh_rotation_deg: turn about z that `sample` applies to the mesh
            image_shift_columns_px, image_shift_rows_px: shift that `sample` applies to the image
            areal_density: [kg/m2], thickness: [m]; NaN if unknown
            notes: every correction and doubt
        """
        return self.table.copy()

    def _place(self, i: int) -> int:
        """A row's number from 0, of a whole number of any kind, such as a tensor of torch's samplers."""
        try:
            place = operator.index(i)
        except TypeError as error:
            what = f"a row must be one whole number, got {type(i).__name__}"
            raise TypeError(f"{what}; choose several with `select` or torch.utils.data.Subset") from error
        if not -len(self) <= place < len(self):
            raise IndexError(f"row must be from {-len(self)} to {len(self) - 1}, got {place}")
        return place % len(self)

    def _row(self, i: int) -> dict[str, Any]:
        return {str(name): value for name, value in self.table.iloc[self._place(i)].items()}

    @property
    def cloths(self) -> list[str]:
        """Names of the sets, in the table's order."""
        return list(dict.fromkeys(self.table["cloth"]))

    @property
    def fabrics(self) -> dict[str, str]:
        """Names of the fabrics by those of the sets: captures, series over time and named set of one share its name."""
        owners = zip(self.table["fabric"], self.table["cloth"], strict=True)
        return {cloth: fabric_name(int(number), cloth) for number, cloth in owners}

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, i: int) -> dict[str, Any]:
        row = self._row(i)
        return {
            "image": self.image(i),
            "index": self._place(i),
            **{name: row[name] for name in ("cloth", "side")},
            **{name: int(row[name]) for name in ("fabric", "sample", "capture", "observation")},
            **{name: float(row[name]) for name in ("areal_density", "thickness")},
        }

    def image(self, i: int) -> Float[Tensor, "size size"]:
        """Reads the silhouette of a row.

        Args:
            i: Row of the index.

        Returns:
            Coverage, float64 in [0, 1], cloth = 1; specks beside the cloth are taken for background.

        Raises:
            BadImage: The file cannot be used.
        """
        import torch
        from scipy.ndimage import shift

        row = self._row(i)
        pixels = without_specks(read_silhouette(inside_root(self.root, row["image"]), self.protocol))
        columns, rows = float(row["image_shift_columns_px"]), float(row["image_shift_rows_px"])
        if columns or rows:
            pixels = np.clip(shift(pixels, (rows, columns), order=1), 0, 1)
        return torch.from_numpy(np.array(pixels))

    def sample(self, i: int) -> DrapeSample:
        """Reads the drape of a row.

        Args:
            i: Row of the index.

        Returns:
            Its image, profile and mesh; the mesh is read when it is first used.

        Raises:
            BadImage: The image cannot be used.
        """
        image, mesh = self.image(i), self._row(i)["mesh"]
        profile = profile_of(image.numpy(), self.protocol)
        row = self.table.iloc[self._place(i)]
        return DrapeSample(image, profile, row, inside_root(self.root, mesh) if mesh else None)

    def select(self, **conditions: Any) -> DrapeDataset:
        """The part whose rows have the given values, e.g. `select(cloth="cotton_blue", sample=[1, 2])`.

        Args:
            **conditions: Column of the index = value, or values, that it may have; NaN or None where it is not known.

        Returns:
            The data set with these rows alone, numbered anew from 0.

        Raises:
            DataError: An unknown column, or nothing is left.
        """
        keep = np.ones(len(self), dtype=bool)
        for column, value in conditions.items():
            if column not in self.table:
                known = ", ".join(self.table.columns)
                raise DataError(f"unknown column {column!r}", where=self.name, remedy=f"use one of {known}")
            single = isinstance(value, str) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0
            values = [value] if single else list(value)
            chosen = np.array([cell in values for cell in self.table[column]], dtype=bool)
            if any(one is None or one != one for one in values):  # what is not known equals nothing, not even itself
                chosen |= self.table[column].isna().to_numpy()
            keep &= chosen
        if not keep.any():
            raise DataError(
                f"no silhouette with {conditions}", where=self.name, remedy=f"cloths are {', '.join(self.cloths)}"
            )
        return replace(self, table=self.table.iloc[np.flatnonzero(keep)].reset_index(drop=True))

    def split(
        self,
        protocol: str = "paper",
        cloths: Sequence[str] | None = None,
        *,
        generator: np.random.Generator | None = None,
    ) -> list[Split]:
        """Splits each cloth's samples.

        `paper`: one silhouette of one sample trains, one silhouette of every other sample tests, of the same face if
        there is one. In the paper's
        named sets the training sample is the published one, elsewhere the first, or a random one if a generator is
        given. `leave-one-sample-out`: one split per sample; all its silhouettes test, all others train.

        Args:
            protocol: One of `PROTOCOLS`.
            cloths: Set or sets to split. By default all; with `paper`, the named sets alone if there are any.
            generator: Draws the training sample of sets that have no published one.

        Returns:
            One split for each cloth; with `leave-one-sample-out` one for each sample of each cloth.

        Raises:
            DataError: Unknown protocol or cloth, or a cloth with fewer than two samples.
        """
        return split_rows(self.table, protocol, cloths, generator)

    def repeats(self, i: int) -> list[int]:
        """Rows that show the drape of row i again: other captures of the same sample and face of its fabric.

        For a row of a named set these are captures of the fabric in which the identical image lies (`same_as`);
        a named image that is in no fabric has none. Observations of one drape over time are no repeats.

        Args:
            i: Row of the index.

        Returns:
            Other rows of the index.
        """
        row, table = self._row(i), self.table
        if row["same_as"]:
            known = [other for other, image in enumerate(table["image"]) if image == row["same_as"]]
            if not known:
                return []
            row = self._row(known[0])
        elif row["cloth"] in CLOTHS:
            return []
        if row["observation"] or not row["side"]:
            return []
        same = (table["cloth"] == row["cloth"]) & (table["sample"] == row["sample"]) & (table["side"] == row["side"])
        return [int(other) for other in table.index[same & (table["capture"] != row["capture"])]]

    def repeat_pairs(self, cloth: str) -> list[tuple[int, int]]:
        """All pairs of rows that show one drape twice; for a named set, in the fabric that holds its images.

        Their mean difference is the floor of any score.

        Args:
            cloth: Name of a set.

        Returns:
            Pairs of rows of the index; none where no drape was captured again.
        """
        same_as = set(self.table["same_as"][self.table["cloth"] == cloth])
        sources = {cloth} | {
            owner for owner, image in zip(self.table["cloth"], self.table["image"], strict=True) if image in same_as
        }
        rows = [row for row, owner in enumerate(self.table["cloth"]) if owner in sources - CLOTHS.keys()]
        return [(row, other) for row in rows for other in self.repeats(row) if other > row]

    def require_density(self, i: int) -> float:
        """Areal density of a row, which must be known.

        Args:
            i: Row of the index.

        Returns:
            Areal density [kg/m2].

        Raises:
            DataError: It is not known.
        """
        row = self._row(i)
        density = float(row["areal_density"])
        if not density > 0 or not math.isfinite(density):
            line = f"{self.fabrics[row['cloth']]},<kg/m2>,"
            table = beside(self.root, FABRICS_FILE) or self.root / FABRICS_FILE
            raise DataError(
                f"areal density of {row['cloth']} must be > 0 kg/m2, got {density}",
                where=self.root,
                remedy=f"weigh the cloth and add `{line}` to {table} (columns "
                "fabric,areal_density_kg_m2,thickness_m), or to the table that --fabrics-csv names; where the fabric "
                "has a line already, fill in that one",
                kind="density-missing",
            )
        return density

    def audit(self) -> Audit:
        """Every irregularity of the files in `root`."""
        from cusick_bench.datasets.audit.audit import audit

        return audit(self.root)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over the files in use and over how they are used (corrections, densities, protocol but its notes)."""
        digest = hashlib.sha256(repr(replace(self.protocol, extra={})).encode())
        if self.protocol.projection == "pinhole":
            digest.update(repr(self.protocol.camera_height_m).encode())
        for i in range(len(self)):
            row = self._row(i)
            files = [content_hash(inside_root(self.root, row[name])) for name in ("image", "mesh") if row[name]]
            values = [*files, *(row[name] for name in row if name not in ("dataset", "notes"))]
            digest.update(f"[{', '.join(map(_hashed_text, values))}]".encode())
        return digest.hexdigest()


def _hashed_text(value: Any) -> str:
    """A value as it goes into `content_hash`.

    Numbers are written as NumPy 2 shows them, since recorded hashes have them so, but not by NumPy itself: what it
    shows depends on its version and on `numpy.set_printoptions`.
    """
    if isinstance(value, str):
        return repr(value)
    kind, number = ("int64", int(value)) if isinstance(value, Integral) else ("float64", float(value))
    return f"np.{kind}({number!r})"
