"""Progress on a terminal: a bar for the grid and one for every cell under way, with loss and time left."""

import math
from types import TracebackType
from typing import Protocol, runtime_checkable

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from cusick_bench.runner.grid import Cell


@runtime_checkable
class Watcher(Protocol):
    """Whoever wants to know how a grid gets on."""

    def begin(self, cells: int, done: int) -> None:
        """The grid starts: so many cells, of which so many are finished from earlier.

        Args:
            cells: Number of cells.
            done: How many of them are finished from earlier.
        """
        ...

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """A cell has spent a share of its budget (NaN: no limit) and has this smallest loss.

        Args:
            cell: The cell.
            fraction: Share of its budget that is spent, in [0, 1]; NaN without a limit.
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

    def begin(self, cells: int, done: int) -> None:
        """Nothing.

        Args:
            cells: Not used.
            done: Not used.
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


class ProgressBars:
    """Bars on a console; a context manager."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
            console=console,
        )
        self._grid: TaskID | None = None
        self._cells: dict[Cell, TaskID] = {}

    def __enter__(self) -> "ProgressBars":
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def begin(self, cells: int, done: int) -> None:
        """Shows the grid's bar.

        Args:
            cells: Number of cells.
            done: How many of them are finished from earlier.
        """
        note = f"{done} of {cells} cells were finished before" if done else ""
        self._grid = self._progress.add_task("grid", total=cells, completed=done, note=note)

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """Moves a cell's bar.

        Args:
            cell: The cell.
            fraction: Share of its budget that is spent, in [0, 1]; NaN without a limit.
            loss: Smallest loss so far; infinite before the first.
            message: What the solver does now.
        """
        if cell not in self._cells:
            description = f"{cell.cloth} / {cell.solver} / {cell.seed}"
            self._cells[cell] = self._progress.add_task(description, total=1.0, note="")
        known = math.isfinite(fraction)
        note = " ".join([f"loss {loss:.4f}"] * math.isfinite(loss) + [message] * bool(message))
        self._progress.update(
            self._cells[cell], completed=fraction if known else 0.0, total=1.0 if known else None, note=note
        )

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """Removes a cell's bar and moves the grid's.

        Args:
            cell: The cell.
            status: "done" or "failed".
            failure: Printed where the cell failed.
        """
        if cell in self._cells:
            self._progress.remove_task(self._cells.pop(cell))
        if self._grid is not None:
            self._progress.advance(self._grid)
        if failure:
            self._console.print(f"{cell.cloth} / {cell.solver} / {cell.seed}: {failure}", markup=False)
