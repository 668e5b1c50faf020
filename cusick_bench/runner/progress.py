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
        """The grid starts: so many cells, of which so many are finished from earlier."""
        ...

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """A cell has spent a share of its budget (NaN: no limit) and has this smallest loss."""
        ...

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """A cell is finished."""
        ...


class Unwatched:
    """Says nothing."""

    def begin(self, cells: int, done: int) -> None:
        """Nothing."""

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """Nothing."""

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """Nothing."""


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
        """Shows the grid's bar."""
        note = f"{done} of {cells} cells were finished before" if done else ""
        self._grid = self._progress.add_task("grid", total=cells, completed=done, note=note)

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """Moves a cell's bar."""
        if cell not in self._cells:
            description = f"{cell.cloth} / {cell.solver} / {cell.seed}"
            self._cells[cell] = self._progress.add_task(description, total=1.0, note="")
        known = math.isfinite(fraction)
        note = " ".join([f"loss {loss:.4f}"] * math.isfinite(loss) + [message] * bool(message))
        self._progress.update(
            self._cells[cell], completed=fraction if known else 0.0, total=1.0 if known else None, note=note
        )

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """Removes a cell's bar and moves the grid's."""
        if cell in self._cells:
            self._progress.remove_task(self._cells.pop(cell))
        if self._grid is not None:
            self._progress.advance(self._grid)
        if failure:
            self._console.print(f"{cell.cloth} / {cell.solver} / {cell.seed}: {failure}", markup=False)
