"""`--quiet`, `--verbose`, `--version`: how much a command tells, and which code it is.

The log is the standard library's, logger `cusick_bench`, written to standard error. Its level is the one place that
knows how much is wanted; it holds for one command and is given back afterwards.
"""

import logging
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.main import get_command

from cusick_bench.cli.common import console, output, quiet

PACKAGE = Path(__file__).resolve().parents[1]
_BESIDE = ("sim", "solvers", "datasets")  # parts of the package that a checkout keeps beside it


def tell_less(wanted: bool) -> None:
    """Only results and errors from now on.

    Args:
        wanted: Whether `--quiet` was given.
    """
    if wanted:
        logging.getLogger("cusick_bench").setLevel(logging.ERROR)


def tell_more(wanted: bool) -> None:
    """A log of what is done from now on, and the warnings of Python.

    Args:
        wanted: Whether `--verbose` was given.
    """
    if wanted:
        logging.getLogger("cusick_bench").setLevel(logging.DEBUG)
        _set_level_of_libraries(logging.WARNING)
        warnings.simplefilter("default")


def _set_level_of_libraries(level: int) -> None:
    """Sets the level from which libraries without a log handler of their own, such as matplotlib, are logged."""
    if logging.lastResort is not None:
        logging.lastResort.setLevel(level)


def show_version(wanted: bool) -> None:
    """Prints the version, and the commit where the code runs from a checkout.

    Args:
        wanted: Whether `--version` was given.

    Raises:
        typer.Exit: It was: nothing else is done.
    """
    if wanted:
        from cusick_bench.runner.environment import code_state  # only here, as it loads the simulator

        code = code_state()
        commit = f", commit {code['commit']}{' (changed)' if code['dirty'] else ''}" if code["commit"] else ""
        output.print(f"cusick-bench {code['package']}{commit}")
        raise typer.Exit


_option = partial(typer.Option, rich_help_panel="Messages")
QUIET = partial(_option, "--quiet", "-q", help="Only results and errors.")
VERBOSE = partial(_option, "--verbose", "-v", help="Also a log of what is done, and warnings.")
Version = Annotated[
    bool, _option("--version", help="Print version and commit, and exit.", callback=show_version, is_eager=True)
]


def message_options() -> list[Any]:
    """`--quiet` and `--verbose` as options of any command; they act on their own, and no function takes them."""
    app = typer.Typer(add_completion=False)

    @app.command()
    def command(
        quiet: Annotated[bool, QUIET(callback=tell_less, expose_value=False)] = False,
        verbose: Annotated[bool, VERBOSE(callback=tell_more, expose_value=False)] = False,
    ) -> None:
        """Nothing."""

    return [option for option in get_command(app).params if option.name in ("quiet", "verbose")]


class _ScreenHandler(logging.Handler):
    """Writes records to standard error, after the seconds since the command began."""

    def __init__(self) -> None:
        super().__init__()
        self._began = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.WARNING:
            console.print(f"{record.levelname.lower()}: {record.getMessage()}", soft_wrap=True)
        else:
            console.print(f"[{time.monotonic() - self._began:7.2f} s] {record.getMessage()}", soft_wrap=True)


@contextmanager
def messages() -> Iterator[None]:
    """Log and warnings of one command go to standard error; at the end all is as it was before."""
    logger, handler = logging.getLogger("cusick_bench"), _ScreenHandler()
    before = logger.level
    logger.addHandler(handler)
    _set_level_of_libraries(logging.ERROR)
    with warnings.catch_warnings():
        warnings.showwarning = _shown_once()
        try:
            yield
        finally:
            logger.removeHandler(handler)
            logger.setLevel(before)
            _set_level_of_libraries(logging.WARNING)


def _shown_once() -> Callable[..., None]:
    """Shows each warning once: what another package registers is read again and again, and is as wrong each time."""
    shown: set[tuple[str, str]] = set()

    def show(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any) -> None:
        if (str(message), filename) not in shown:
            shown.add((str(message), filename))
            _show_warning(message, category, filename, lineno)

    return show


def _show_warning(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any) -> None:
    """A line for a warning: the package's own always, those of libraries under `--verbose`."""
    if logging.getLogger("cusick_bench").level == logging.DEBUG:
        console.print(f"warning: {message} ({category.__name__}, {filename}:{lineno})", soft_wrap=True)
    elif _is_own(Path(filename)) and not quiet():
        console.print(f"warning: {message}", soft_wrap=True)


def _is_own(file: Path) -> bool:
    """Whether a file is the package's."""
    folders = (PACKAGE, *((PACKAGE / name).resolve() for name in _BESIDE))
    return any(file.resolve().is_relative_to(folder) for folder in folders)
