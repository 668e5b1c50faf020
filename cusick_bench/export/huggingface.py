"""A data set as the library `datasets` of Hugging Face reads it: Parquet with the images inside, and a card.

    DIR/README.md                                what it is, for people, and its head for the hub
    DIR/data/train-00000-of-00001.parquet        a row a silhouette

`load_dataset(DIR)` gives the column `image` as pictures, since the table says of its columns what they are in the
library's own words (schema metadata `huggingface`, Hugging Face, Datasets: Features). Nothing of that library is needed
to write it, only pyarrow.
"""

from __future__ import annotations

import json
from collections import Counter
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from cusick_bench import __version__
from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.registry import registered_in
from cusick_bench.datasets.splits import paper_cloths
from cusick_bench.export.errors import ExportError
from cusick_bench.export.written import fill, literal, require_new, write_files
from cusick_bench.files.table_file import require_pyarrow

if TYPE_CHECKING:
    import pyarrow

COLUMNS = {
    "cloth": ("string", "name of the cloth"),
    "fabric": ("int64", "number of the fabric"),
    "sample": ("int64", "number of the specimen"),
    "capture": ("int64", "number of the picture of that specimen"),
    "observation": ("int64", "number in a series of pictures of one lying cloth over time, 0 where there is none"),
    "side": ("string", "face that lies up: up or down, empty where unknown"),
    "areal_density": ("float64", "mass per area [kg/m2], null where unknown"),
    "thickness": ("float64", "thickness [m], null where unknown"),
    "paper_split": ("string", "train or test by the paper's protocol, empty for pictures that it does not use"),
}
"""Columns beside `image`: type and meaning."""

_LEVELS = 255


def write_huggingface(dataset: DrapeDataset, folder: Path, *, command: str = "cusick-bench export huggingface") -> int:
    """Writes a data set into a new folder.

    Args:
        dataset: Silhouettes with their index.
        folder: Where it is to be; made if it is not there.
        command: What the card says it was written by.

    Returns:
        Number of rows.

    Raises:
        ExportError: The folder is not empty, or the data set has no silhouette.
        MissingLibrary: pyarrow is not installed.
        DataError: An image cannot be read.
    """
    require_pyarrow("a data set for Hugging Face")
    require_new(folder, "a data set")
    if not len(dataset):
        raise ExportError(f"{dataset.name} has no silhouette to write; see `cusick-bench data audit`")
    content = _parquet(_table(dataset))
    write_files(
        {folder / "data" / "train-00000-of-00001.parquet": content, folder / "README.md": _card(dataset, command)}
    )
    return len(dataset)


def _table(dataset: DrapeDataset) -> pyarrow.Table:
    """A row a silhouette, in the order of the index."""
    import pyarrow

    index = dataset.index.assign(paper_split=_paper_split(dataset))
    pictures = [
        {"bytes": _png(dataset.image(row).numpy()), "path": f"{index['cloth'].iat[row]}-{row:05d}.png"}
        for row in range(len(dataset))
    ]
    picture = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
    columns = {"image": pyarrow.array(pictures, picture)}
    for name, (kind, _) in COLUMNS.items():
        columns[name] = pyarrow.array(index[name].tolist(), pyarrow.type_for_alias(kind), from_pandas=True)
    features: dict[str, Any] = {"image": {"_type": "Image"}}
    features |= {name: {"dtype": kind, "_type": "Value"} for name, (kind, _) in COLUMNS.items()}
    words = json.dumps({"info": {"features": features}})
    return pyarrow.table(columns).replace_schema_metadata({"huggingface": words})


def _paper_split(dataset: DrapeDataset) -> list[str]:
    """Part of each row; none where a cloth has a single sample, which cannot be split."""
    words = [""] * len(dataset)
    samples = Counter(cloth for cloth, _ in set(zip(dataset.table["cloth"], dataset.table["sample"], strict=True)))
    for split in dataset.split("paper", [cloth for cloth in paper_cloths(dataset.cloths) if samples[cloth] > 1]):
        for row in split.train:
            words[row] = "train"
        for row in split.test:
            words[row] = "test"
    return words


def _png(image: np.ndarray) -> bytes:
    buffer = BytesIO()
    Image.fromarray(np.round(_LEVELS * image).astype(np.uint8)).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _parquet(table: pyarrow.Table) -> bytes:
    from pyarrow import parquet

    buffer = BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def _card(dataset: DrapeDataset, command: str) -> str:
    known, protocol = registered_in(dataset.root), dataset.protocol
    return fill(
        "huggingface/README.md",
        name=dataset.name,
        title=literal(f"Cusick drape silhouettes: {dataset.name}"),
        licence="apache-2.0" if known is not None and known.licence == "Apache-2.0" else "unknown",
        terms=known.licence if known is not None else "",
        citation=known.citation if known is not None else "",
        rows=len(dataset),
        cloths=len(dataset.cloths),
        size=protocol.image_size_px,
        px_per_m=protocol.px_per_m,
        cloth_radius=protocol.cloth_radius_m,
        plate_radius=protocol.plate_radius_m,
        centre=protocol.centre_px,
        image_y=protocol.image_y,
        camera_height=protocol.camera_height_m if protocol.projection == "pinhole" else None,
        columns={name: meaning for name, (_, meaning) in COLUMNS.items()},
        command=command,
        version=__version__,
        content_hash=dataset.content_hash,
    )
