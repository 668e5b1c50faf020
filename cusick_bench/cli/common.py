"""What every command shares: logs on standard error, one JSON document on standard output, exit codes.

Exit status 0: done. 1: a check failed. 2: bad usage or bad input.
"""

import functools
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
import typer
from rich.console import Console

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
