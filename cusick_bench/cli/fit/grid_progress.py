"""How far a grid of cells is: bars with loss and time left on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from cusick_bench.cli.common import console, quiet
from cusick_bench.cli.progress import INTERVAL, Lines, Tally, live
from cusick_bench.cli.screen import Screen, harmless

if TYPE_CHECKING:
    from cusick_bench.runner import Cell


MOST_CELLS = 3  # largest number of running cells that a line names
ALMOST = 0.99  # share of a cell that is done except for scoring
_INSTANT = 1.0  # work of a cell without drapes, in units of a drape


class GridProgress:
    """Watches a grid and shows how it gets on; a context manager.

    Attributes:
        cells: Number of cells, as far as known.
        finished: How many of them are finished.
        failed: How many of these have failed, which are run again when the command is repeated.
    """

    def __init__(self, screen: Screen = console, interval: float = INTERVAL) -> None:
        self.cells = self.finished = self.failed = 0
        self._screen = screen
        self._tally = Tally("cells")
        self._work: dict[Cell, float] = {}
        self._worked = 0.0  # work of the cells that are finished
        self._notes: dict[Cell, tuple[float, str]] = {}  # share and what is said of the cells under way
        self._ended: set[Cell] = set()
        self._open = ExitStack()
        self._bars = _Bars(screen) if live(screen) and not quiet() else None
        self._lines = Lines(self.line, screen, interval) if self._bars is None and not quiet() else None

    def __enter__(self) -> GridProgress:
        for shown in (self._bars, self._lines):
            if shown is not None:
                self._open.enter_context(shown)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def begin(self, cells: Sequence[Cell], waiting: Sequence[Cell]) -> None:
        """Shows the grid.

        Args:
            cells: All of its cells.
            waiting: Those that are not finished from earlier.
        """
        self.cells, self.finished, self.failed = len(cells), len(cells) - len(waiting), 0
        self._work, self._notes, self._ended = _work(cells), {}, set()
        total = sum(self._work.values())
        self._worked = total - sum(self._work[cell] for cell in waiting)
        self._tally = Tally("cells", total, self._worked)
        if self._bars is not None:
            self._bars.begin(total, self._worked, self._counted)

    def update(self, cell: Cell, fraction: float, loss: float, message: str) -> None:
        """Shows a cell that is under way.

        Args:
            cell: The cell.
            fraction: Share of its work that is done, in [0, 1]; NaN without a limit.
            loss: Smallest loss so far; infinite before the first.
            message: What the solver does now.
        """
        if cell in self._ended:  # a worker's message takes another way than its result, and may come after it
            return
        words = " ".join([f"loss {loss:.4f}"] * math.isfinite(loss) + [message] * bool(message))
        self._notes[cell] = (fraction, words)
        self._mark()
        if self._bars is not None:
            self._bars.update(cell, fraction, words)

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """A cell is finished.

        Args:
            cell: The cell.
            status: "done" or "failed".
            failure: Printed where the cell failed.
        """
        self._notes.pop(cell, None)
        self._ended.add(cell)
        self.finished += 1
        self.failed += status == "failed"
        self._worked += self._work[cell]
        self._mark()
        if self._bars is not None:
            self._bars.end(cell, self._counted)
        if failure:
            self._screen.print(f"{_name(cell)}: {failure}", soft_wrap=True)

    def line(self) -> str:
        """What a log shows of the grid and of the first cells under way."""
        under_way = [
            f"{_name(cell)} {f'{100 * share:.0f} % ' if math.isfinite(share) else ''}{words}".rstrip()
            for cell, (share, words) in list(self._notes.items())[:MOST_CELLS]
        ]
        return "; ".join([self._tally.line(self._counted), *under_way])

    @property
    def _counted(self) -> str:
        return f"{self.finished} of {self.cells}"

    def _mark(self) -> None:
        parts = [(cell, share) for cell, (share, _) in list(self._notes.items()) if math.isfinite(share)]
        self._tally.mark(self._worked + sum(self._work[cell] * min(share, ALMOST) for cell, share in parts))
        if self._bars is not None:
            self._bars.move(self._tally.done)


def _work(cells: Sequence[Cell]) -> dict[Cell, float]:
    """Share of each cell in the work, in drapes; equal for all if one has no budget of drapes."""
    from cusick_bench.solvers.registry import make_solver

    work: dict[Cell, float] = {}
    for cell in cells:
        solver, budget = make_solver(cell.solver), cell.settings.budget.forward_equivalents
        if solver.kind != "solver":
            work[cell] = _INSTANT
        elif budget is None:
            return dict.fromkeys(cells, 1.0)
        else:
            work[cell] = budget + solver.drapes_of_prediction
    return work


def cells_kept(grid: GridProgress, out: Path) -> str:
    """What a grid that is interrupted leaves behind, in words.

    Args:
        grid: How far it was.
        out: Its results folder.
    """
    failed = f", {grid.failed} failed and will be run again" if grid.failed else ""
    return (
        f"{grid.finished - grid.failed} of {grid.cells} cells are finished and kept in {out}{failed}; what the others "
        "have spent is kept, too"
    )


class _Bars:
    """A bar for the grid and one for every cell under way; a context manager."""

    def __init__(self, screen: Screen) -> None:
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}", markup=False),
            console=screen,
        )
        self._grid: TaskID | None = None
        self._cells: dict[Cell, TaskID] = {}

    def __enter__(self) -> _Bars:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def begin(self, total: float, done: float, counted: str) -> None:
        """Shows the grid's bar."""
        self._grid = self._progress.add_task("grid", total=total, completed=round(done), note=f"{counted} cells")

    def move(self, done: float) -> None:
        """Moves the grid's bar."""
        if self._grid is not None:
            self._progress.update(self._grid, completed=done)

    def update(self, cell: Cell, fraction: float, note: str) -> None:
        """Moves a cell's bar."""
        if cell not in self._cells:
            self._cells[cell] = self._progress.add_task(_name(cell), total=1.0, note="")
        known = math.isfinite(fraction)
        self._progress.update(
            self._cells[cell],
            completed=fraction if known else 0.0,
            total=1.0 if known else None,
            note=harmless(note),
        )

    def end(self, cell: Cell, counted: str) -> None:
        """Removes a cell's bar; so many are finished."""
        if cell in self._cells:
            self._progress.remove_task(self._cells.pop(cell))
        if self._grid is not None:
            self._progress.update(self._grid, note=f"{counted} cells")


def _name(cell: Cell) -> str:
    return harmless(f"{cell.cloth} / {cell.solver} / {cell.seed}")
