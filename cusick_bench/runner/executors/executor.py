"""Interface of what runs cells: the pool of processes, executors of the user, and clusters."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from cusick_bench.runner.grid import Cell
from cusick_bench.runner.progress import Watcher
from cusick_bench.runner.source import Source
from cusick_bench.runner.store import Store


@runtime_checkable
class CellExecutor(Protocol):
    """Runs cells somewhere."""

    @property
    def death(self) -> str:
        """Record of a cell whose process ended without a reason: the likely reason and the remedy."""
        ...

    def run(self, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher) -> list[Cell]:
        """Runs cells; the failure of one cancels no other.

        Args:
            source: Where the data come from.
            cells: What to run.
            store: Where results lie, as the workers see it, too.
            watcher: Told of the grid's progress.

        Returns:
            Cells whose process died before they were finished; an executor that can try them again has done so.
        """
        ...
