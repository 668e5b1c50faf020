"""Where commands may write: anywhere but into the installed package, which other users may share."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import typer

import cusick_bench

PACKAGE = Path(cusick_bench.__file__).resolve().parent


def outside_package(value: Any) -> Any:
    """Checks what an option that says where to write was given; the callback of such options.

    Args:
        value: A path, several, or anything else, which is let pass.

    Returns:
        The same.

    Raises:
        typer.BadParameter: A path lies in the installed package.
    """
    for path in value if isinstance(value, Iterable) and not isinstance(value, str) else [value]:
        if isinstance(path, Path) and path.expanduser().resolve().is_relative_to(PACKAGE):
            raise typer.BadParameter(
                f"{path} lies in the installed package, which no command writes to; give a path outside of {PACKAGE}"
            )
    return value
