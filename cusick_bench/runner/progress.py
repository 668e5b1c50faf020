"""Watchers of a grid, which are told of its progress."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from cusick_bench.runner.grid import Cell


@runtime_checkable
class Watcher(Protocol):
    """Whoever wants to know how a grid gets on."""

    def begin(self, cells: Sequence[Cell], waiting: Sequence[Cell]) -> None:
        """The grid starts.

        Args:
            cells: All of its cells.
            waiting: Those that are not finished from earlier.
        """
        ...

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """A cell has done a share of its work (NaN: no limit) and has this smallest loss.

        Args:
            cell: The cell.
            fraction: Share of its work that is done, in [0, 1]; NaN without a limit.
            loss: Smallest loss so far; infinite before the first.
            message: What the solver does now.
        """
        ...

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """A cell is finished.

        Args:
            cell: The cell.
            status: "done" or "failed".
            failure: Why it failed, "" where it did not.
        """
        ...


class Unwatched:
    """Says nothing."""

    def begin(self, cells: Sequence[Cell], waiting: Sequence[Cell]) -> None:
        """Nothing.

        Args:
            cells: Not used.
            waiting: Not used.
        """

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """Nothing.

        Args:
            cell: Not used.
            fraction: Not used.
            loss: Not used.
            message: Not used.
        """

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """Nothing.

        Args:
            cell: Not used.
            status: Not used.
            failure: Not used.
        """
