"""Identify cloth stiffness from the Cusick drape test, and compare the methods that do it."""

import gc
import os
import sys
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperGroup
from typer.main import get_command

from cusick_bench.cli.common import interruptible, stop_on_termination, whole_output
from cusick_bench.cli.verbosity import QUIET, VERBOSE, Version, message_options, messages, tell_less, tell_more
from cusick_bench.sim.errors import did_you_mean

PANELS = {
    "Data": {"data": "data.data", "datasets": "data.datasets"},
    "Simulate": {
        "simulate": "simulate.simulate",
        "effects": "simulate.effects",
        "garment": "simulate.garment",
        "convergence": "simulate.convergence",
        "fold-selection": "simulate.fold_selection",
        "mesh-error": "simulate.mesh_error",
        "pace": "simulate.pace",
        "plate-elements": "simulate.plate_elements",
        "robustness": "simulate.robustness",
        "benchmark": "simulate.benchmark",
    },
    "Fit": {
        "identify": "fit.identify",
        "run": "fit.run",
        "learning-curve": "fit.learning_curve",
        "solvers": "fit.solvers",
        "optimisers": "fit.optimisers",
        "paper": "fit.paper",
        "population": "fit.population",
        "posterior-calibration": "fit.posterior_calibration",
    },
    "Results": {
        "leaderboard": "results.leaderboard",
        "report": "results.report",
        "verify": "results.verify",
        "check": "results.check",
        "submit": "results.submit",
        "export": "export.export",
    },
    "Diagnose": {
        "diagnose": "diagnose.diagnose",
        "diagnose-controls": "diagnose.controls",
        "diagnose-turn-over": "diagnose.turn_over",
        "atlas": "diagnose.atlas",
        "withheld": "diagnose.withheld",
    },
}
"""The commands by panel of the help page, each with its module below this package, which is imported when needed."""

COMMANDS = {name: module for commands in PANELS.values() for name, module in commands.items()}
"""The module of every command."""

_MOST_THREADS = 1024
_GARBAGE = 20_000  # new objects between two searches for garbage; libraries make many while they are imported, all kept
_COMPLETION = ("install_completion", "show_completion")


class Commands(TyperGroup):
    """The commands, imported one at a time: nobody waits for plotting libraries to simulate a drape."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the help page."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name, or None."""
        if cmd_name not in COMMANDS:
            return None
        command: Any = get_command(import_module(f"{__name__}.{COMMANDS[cmd_name]}").app)
        command.name = cmd_name
        command.rich_help_panel = next(panel for panel, commands in PANELS.items() if cmd_name in commands)
        _tidy(command)
        return command

    def invoke(self, ctx: Any) -> Any:
        """Runs a command; Ctrl-C or SIGTERM ends it with a line instead of a traceback."""
        with interruptible("nothing was written"):
            return super().invoke(ctx)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is called for; a name that does not exist is answered with the nearest that does."""
        if args and args[0] not in COMMANDS and (hint := did_you_mean(args[0], COMMANDS)):
            ctx.fail(f"No such command {args[0]!r}; {hint.rstrip()}")
        return super().resolve_command(ctx, args)


def _tidy(command: Any) -> None:
    """Prepares a command: its help keeps units in brackets, and only the whole program offers shell completion."""
    command.params = [option for option in command.params if option.name not in _COMPLETION]
    for option in command.params:
        if getattr(option, "help", None):
            option.help = escape(option.help)  # otherwise rich takes `[m]` for a style and drops it
    inner = getattr(command, "commands", {})
    for one in inner.values():
        _tidy(one)
    if not inner:
        command.params += message_options()  # accepted before the command and after it


app = typer.Typer(
    name="cusick-bench",
    cls=Commands,
    help=__doc__,
    epilog="Begin with `simulate` (a drape), `run` (a fit) or `identify` (your own fabrics); see docs/first-run.md.",
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def _root(
    ctx: typer.Context,
    quiet: Annotated[bool, QUIET()] = False,
    verbose: Annotated[bool, VERBOSE()] = False,
    version: Version = False,
) -> None:
    """Identify cloth stiffness from the Cusick drape test, and compare the methods that do it."""
    ctx.with_resource(messages())
    tell_less(quiet)
    tell_more(verbose)


def main() -> None:
    """Entry point of the console script."""
    gc.set_threshold(_GARBAGE)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")  # help pages too where the encoding is ASCII
    stop_on_termination()
    _check_surroundings()
    with whole_output():
        app()


def _check_surroundings() -> None:
    """Refuses a number of threads that would end in a traceback of numba's."""
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not (threads.isascii() and threads.isdecimal() and 1 <= int(threads[:9]) <= _MOST_THREADS):
        rule = f"must be a whole number from 1 to {_MOST_THREADS}"
        sys.stderr.write(f"error: NUMBA_NUM_THREADS {rule}, got {threads[:40]!r}; correct or unset it\n")
        raise SystemExit(2)
