"""Fits from before other fabrics of the data set were changed, which need not be made again.

A cell's name has the hash of the whole data set, since cells of a grid are compared with each other. The fit of a
fabric follows from its own pictures and weight: OUT/fits.json holds the cell of each fit by the hash of these.
"""

from collections.abc import Mapping

from cusick_bench.datasets import DrapeDataset
from cusick_bench.files import BadFile, read_json_object
from cusick_bench.identify.workspace import Workspace
from cusick_bench.runner import Cell, Store, record_key
from cusick_bench.runner.store import disk_errors, write_json

_WHOLE = ("dataset", "dataset_hash", "problem_hash", "train", "test")
"""What a cell's record says of the whole data set and its folder, or by rows of the whole index."""


def key_of_own_data(dataset: DrapeDataset, cell: Cell) -> str:
    """Hash of all that decides the numbers of a fit.

    Args:
        dataset: The data set.
        cell: A cell of one of its cloths.

    Returns:
        20 hexadecimal digits, which pictures and weights of other cloths do not change, nor the name of the data set.
    """
    cloths = zip(dataset.table.index.tolist(), dataset.table["cloth"], strict=True)
    rows = [row for row, cloth in cloths if cloth == cell.cloth]
    own = {name: value for name, value in cell.record().items() if name not in _WHOLE}
    own |= {name: [rows.index(row) for row in getattr(cell, name)] for name in ("train", "test")}
    return record_key(own | {"data": dataset.select(cloth=cell.cloth).content_hash})


def keys_of_fits(dataset: DrapeDataset, cells: Mapping[str, Cell], workspace: Workspace) -> dict[str, str]:
    """Keys of the cells that hold, or shall hold, the fits of a plan; they are kept for the next time.

    Args:
        dataset: The data set.
        cells: Planned cells by cloth.
        workspace: Where fits lie.

    Returns:
        Keys by cloth: that of an earlier cell where it has finished with the same data of its own, of the planned cell
        else.

    Raises:
        RunnerError: The workspace cannot be written.
    """
    record, store, keys = workspace.fits_record, Store(workspace.run), {}
    try:
        kept = read_json_object(record, remedy="")
    except BadFile:
        kept = {}
    for cloth, cell in cells.items():
        own = key_of_own_data(dataset, cell)
        earlier = kept.get(own)
        useful = isinstance(earlier, str) and not store.is_done(cell.key) and store.is_done(earlier)
        keys[cloth] = kept[own] = earlier if useful else cell.key
    with disk_errors(workspace.out):
        write_json(record, kept)
    return keys
