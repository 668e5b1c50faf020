"""The order in which cells are run: one that another process runs has its turn again after the others.

Two commands with one results folder share the work so: each passes over what the other is running, and comes back to
it, to find it finished, or to go on with it where the other was stopped.
"""

import logging
import math
import time
from collections import deque
from collections.abc import Iterable, Iterator

from cusick_bench.runner.grid import Cell
from cusick_bench.runner.progress import Unwatched, Watcher

WAIT_SECONDS = 5.0  # between looks at a cell that another process runs

_log = logging.getLogger(__name__)


class Turns(Iterator[Cell]):
    """Cells that are left to run; as an iterator, it waits for those that another process runs."""

    def __init__(self, cells: Iterable[Cell], watcher: Watcher | None = None) -> None:
        self._left = deque(cells)
        self._due: dict[str, float] = {}  # when a cell that was put off has its turn again, by the clock of `monotonic`
        self._watcher = watcher or Unwatched()

    def __len__(self) -> int:
        return len(self._left)

    def __next__(self) -> Cell:
        while self._left:
            if (cell := self.due()) is not None:
                return cell
            time.sleep(max(0.0, self._due[self._left[0].key] - time.monotonic()))
        raise StopIteration

    def due(self) -> Cell | None:
        """The cell whose turn it is, which is taken out; None where no cell is left but those that are waited for."""
        if not self._left or self._due.get(self._left[0].key, 0.0) > time.monotonic():
            return None
        return self._left.popleft()

    def put_off(self, cell: Cell) -> None:
        """Puts a cell that another process is running behind the others, and says so, once.

        Args:
            cell: The cell, which had its turn.
        """
        if cell.key not in self._due:
            _log.warning(
                "another process is running %s on %s, seed %d (cell %s); it is waited for after the other cells; stop "
                "that process to have it run here",
                *(cell.solver, cell.cloth, cell.seed, cell.key),
            )
        self._watcher.update(cell, 0.0, math.inf, "another process is running it")
        self._due[cell.key] = time.monotonic() + WAIT_SECONDS
        self._left.append(cell)

    def rest(self) -> list[Cell]:
        """The cells that are left, which are taken out."""
        rest, self._left = list(self._left), deque()
        return rest
