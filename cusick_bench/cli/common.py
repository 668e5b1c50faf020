"""What every command shares: logs on standard error, one JSON document on standard output, exit codes.

Exit status 0: done. 1: a check failed. 2: bad usage or bad input.
"""

import functools
import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress, TaskID, TimeElapsedColumn, TimeRemainingColumn

from cusick_bench.sim.errors import CusickError

console = Console(stderr=True)
output = Console()

P = ParamSpec("P")
R = TypeVar("R")


def plain(value: Any) -> Any:
    """Turns numpy scalars, arrays, paths and non-finite numbers into what JSON can hold."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def print_json(document: dict[str, Any]) -> None:
    """Writes one JSON document to standard output; NaN and infinities become null."""
    sys.stdout.write(json.dumps(plain(document), indent=2, allow_nan=False) + "\n")


@dataclass(frozen=True)
class Bar:
    """What a command's work shows of itself while it lasts."""

    _progress: Progress
    _task: TaskID

    def advance(self, count: float = 1) -> None:
        """So much more is done."""
        self._progress.advance(self._task, count)

    def show(self, done: float, total: float | None = None) -> None:
        """So much is done in all, of a total that may only be known now."""
        self._progress.update(self._task, completed=done, total=total)

    def say(self, what: str) -> None:
        """What is being done now."""
        self._progress.update(self._task, description=what)


@contextmanager
def progress_bar(what: str, total: float | None = None) -> Iterator[Bar]:
    """A bar with the time spent and left on standard error, none where that is no terminal; gone when the work is done.

    Args:
        what: What is being done.
        total: Number of steps, None if not known yet.
    """
    columns = (*Progress.get_default_columns()[:-1], TimeElapsedColumn(), "left", TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield Bar(progress, progress.add_task(what, total=total))


def user_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Turns errors that the user can mend into one message and exit status 2; bugs keep their traceback."""

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except CusickError as error:
            message, cause = str(error), error
        except PermissionError as error:
            message, cause = f"no permission for {error.filename}; choose another folder or change its mode", error
        except OSError as error:
            message, cause = f"{error.strerror} ({error.filename}); choose another folder or free some space", error
        console.print("[bold red]error:[/]", end=" ")
        console.print(message, markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from cause

    return guarded
