"""Results of a grid as a sequence that is read from disk item by item instead of being kept in memory."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

from cusick_bench.runner.grid import Cell
from cusick_bench.runner.store import Store


@dataclass(frozen=True, eq=False)
class Results(Sequence[dict[str, Any]]):
    """Contents of the cells' `result.json`, in the order of the cells.

    Where samples are left out in turn, a result also has `left_out`, the number of the cell's sample.

    Attributes:
        store: Folder that holds them.
        cells: Cells that the results are of.
        left_out: Number of the sample that is left out, by the cell's key; none of cells of other splits.
    """

    store: Store
    cells: Sequence[Cell]
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.cells)

    @overload
    def __getitem__(self, index: int) -> dict[str, Any]: ...

    @overload
    def __getitem__(self, index: slice) -> "Results": ...

    def __getitem__(self, index: int | slice) -> "dict[str, Any] | Results":
        if isinstance(index, slice):
            return Results(self.store, self.cells[index], self.left_out)
        return self._read(self.cells[index].key)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self._read(cell.key) for cell in self.cells)

    def _read(self, key: str) -> dict[str, Any]:
        known = {"left_out": self.left_out[key]} if key in self.left_out else {}
        return self.store.result(key) | known
