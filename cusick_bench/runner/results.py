"""Results of a grid as a sequence that is read from disk item by item instead of being kept in memory."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

from cusick_bench.runner.grid import Cell
from cusick_bench.runner.store import Store


@dataclass(frozen=True, eq=False)
class Results(Sequence[dict[str, Any]]):
    """Contents of the cells' `result.json`, in the order of the cells.

    Attributes:
        store: Folder that holds them.
        cells: Cells that the results are of.
    """

    store: Store
    cells: Sequence[Cell]

    def __len__(self) -> int:
        return len(self.cells)

    @overload
    def __getitem__(self, index: int) -> dict[str, Any]: ...

    @overload
    def __getitem__(self, index: slice) -> "Results": ...

    def __getitem__(self, index: int | slice) -> "dict[str, Any] | Results":
        if isinstance(index, slice):
            return Results(self.store, self.cells[index])
        return self.store.result(self.cells[index].key)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self.store.result(cell.key) for cell in self.cells)
