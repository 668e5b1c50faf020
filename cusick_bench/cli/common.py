"""What every command shares: notes on standard error, one JSON document on standard output, exit codes.

Exit status 0: done. 1: a check failed, or the reader of standard output has left. 2: bad usage or bad input. 3: nothing
could be decided (`check`). 130: interrupted (Ctrl-C). 143: terminated (SIGTERM).
"""

from __future__ import annotations

import functools
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import typer
from rich.text import Text

from cusick_bench.cli.screen import Screen, harmless
from cusick_bench.files.json_text import json_text
from cusick_bench.files.shell_word import shell_word
from cusick_bench.sim.errors import CusickError, failure_text, stop_behind

if TYPE_CHECKING:
    from cusick_bench.leaderboard import Cells

READER_LEFT = 1  # exit status where nobody reads standard output any more
BAD_INPUT = 2
INTERRUPTED = 130  # exit status: 128 + SIGINT, as shells have it
TERMINATED = 143  # exit status: 128 + SIGTERM
UNDECIDED = 3  # exit status of a check that had too little to compare

console = Screen(stderr=True)
output = Screen()

P = ParamSpec("P")
R = TypeVar("R")


def print_json(document: dict[str, Any]) -> None:
    """Writes one JSON document to standard output; NaN and infinities become null.

    Args:
        document: What it holds.
    """
    output.file.write(json_text(document, indent=2))


def quiet() -> bool:
    """Whether only results and errors are wanted (`--quiet`)."""
    return logging.getLogger("cusick_bench").level >= logging.ERROR


def tell(text: str) -> None:
    """Prints a note on standard error, such as what was written or what to do next; nothing with `--quiet`.

    Args:
        text: A line.
    """
    if not quiet():
        console.print(text, soft_wrap=True)


def tell_damaged(cells: Cells) -> None:
    """Tells which cells are left out since they are damaged, or were edited after they had finished.

    Args:
        cells: From `load_cells`, where what is made of them lists no cells that are left out.
    """
    for cell in cells.skipped:
        if cell.status == "damaged":
            tell(cell.note)


def fail(text: str) -> None:
    """Prints an error on standard error; further lines are indented, so that none looks like another message.

    Args:
        text: The rule, the value, the remedy.
    """
    lines = harmless(text).replace("\n", "\n  ")
    console.print(Text.assemble(("error:", "bold red"), " ", lines), soft_wrap=True)


def command_line() -> str:
    """The command line of this process, as it can be typed again."""
    return command_with(*sys.argv[1:])


def command_with(*words: object) -> str:
    """A command that can be typed into a shell, with quotes where they are needed.

    Args:
        words: What follows the program's name.

    Returns:
        The line.
    """
    return " ".join(map(shell_word, ("cusick-bench", *words)))


@contextmanager
def whole_output() -> Iterator[None]:
    """Ends the program with a status of this page where standard output cannot take all that was printed.

    What is short reaches a pipe or a file only when the program ends, and help pages and the version are printed by no
    command.

    Raises:
        SystemExit: The program has ended.
    """
    told = False  # by the command itself
    try:
        try:
            yield
        except SystemExit as ended:
            told = ended.code == BAD_INPUT
            if sys.stdout is not None:
                sys.stdout.flush()
            raise
    except BrokenPipeError as error:
        _give_up_output()
        raise SystemExit(READER_LEFT) from error
    except OSError as error:
        if error.filename is not None:  # not standard output, which is open already
            raise
        _give_up_output()
        if not told:
            fail(f"{error.strerror or error}; let standard output go elsewhere, or free some space")
        raise SystemExit(BAD_INPUT) from error


def _give_up_output() -> None:
    """Lets what is left go nowhere, or Python would try again to write it, and complain."""
    if sys.stdout is None:
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


class Terminated(KeyboardInterrupt):
    """SIGTERM: a batch system or an operator ends the program, which stops as cleanly as on Ctrl-C."""


def _terminate(number: int, frame: object) -> None:
    raise Terminated


def stop_on_termination() -> None:
    """Makes SIGTERM stop this program as Ctrl-C does: workers are ended, and a message says how to go on."""
    signal.signal(signal.SIGTERM, _terminate)


def interrupted(stop: KeyboardInterrupt, kept: str, go_on: bool = False) -> typer.Exit:
    """Prints on standard error what an interrupted command leaves behind.

    Args:
        stop: The interruption.
        kept: What the command has written, in words.
        go_on: Whether the same command resumes from there.

    Returns:
        The exit to raise.
    """
    word, status = ("terminated", TERMINATED) if isinstance(stop, Terminated) else ("interrupted", INTERRUPTED)
    console.print(f"\n{word}: {kept}", soft_wrap=True)
    if go_on:
        console.print(f"go on with: {command_line()}", soft_wrap=True)
    return typer.Exit(status)


@contextmanager
def interruptible(kept: str | Callable[[], str], *, go_on: bool = False) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the command with a line that says what is kept.

    Commands that write nothing before they end do not need it.

    Args:
        kept: What is written by then, in words; a function if that is only known at the interruption.
        go_on: Whether the same command resumes from there.

    Raises:
        typer.Exit: Ctrl-C was pressed, or SIGTERM sent.
    """
    try:
        yield
    except (KeyboardInterrupt, SystemError) as error:
        if not isinstance(stop := stop_behind(error), KeyboardInterrupt):
            raise
        raise interrupted(stop, kept if isinstance(kept, str) else kept(), go_on) from stop


_LONGEST_PATH = 300  # characters of a path that a message shows


def _of_file(error: OSError, form: str) -> str:
    """The file of an error in a given form of words, shortened if its path is very long; "" if the error names none."""
    if error.filename is None:
        return ""
    text = str(error.filename)
    return form.format(text if len(text) <= _LONGEST_PATH else f"...{text[-_LONGEST_PATH:]}")


@contextmanager
def _output_of_results_alone() -> Iterator[None]:
    """What is printed in a command goes to standard error, except by `output` and `print_json`.

    Solvers and effects of other packages print where they like: while they are imported, made or asked for a draw.
    """
    with output.writing_to(sys.stdout), redirect_stdout(sys.stderr):
        yield


def user_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Turns errors that the user can correct into one message and exit status 2; bugs keep their traceback.

    Nothing but the command's results goes to standard output.

    Args:
        command: What a command runs.

    Returns:
        The same, guarded.
    """

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            with _output_of_results_alone():
                return command(*args, **kwargs)
        except SystemExit as error:  # no command ends like this by itself
            message, cause = failure_text(error), error
        except CusickError as error:
            message, cause = str(error), error
        except BrokenPipeError:
            raise  # the reader of the output has closed it, which is not an error of a file
        except PermissionError as error:
            message, cause = (
                f"no permission{_of_file(error, ' for {}')}; choose another folder or change its mode",
                error,
            )
        except OSError as error:
            what = error.strerror or str(error)
            message, cause = f"{what}{_of_file(error, ' ({})')}; choose another folder or free some space", error
        except MemoryError as error:
            message, cause = f"not enough memory ({error}); take fewer vertices, draws, samples or workers", error
        except BrokenExecutor as error:
            message = "a worker process was killed, probably out of memory; repeat the command with fewer --workers"
            cause = error
        fail(message)
        raise typer.Exit(BAD_INPUT) from cause

    return guarded
