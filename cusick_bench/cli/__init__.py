"""Identify cloth stiffness from the Cusick drape test, and compare the methods that do it."""

import typer

from cusick_bench.cli import data, run, solvers
from cusick_bench.cli.convergence import convergence
from cusick_bench.cli.leaderboard import leaderboard
from cusick_bench.cli.report import report
from cusick_bench.cli.simulate import simulate
from cusick_bench.cli.synthetic import synthetic

app = typer.Typer(
    name="cusick-bench",
    help=__doc__,
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
data.app.command()(synthetic)
app.add_typer(data.app, name="data")
app.command()(simulate)
app.add_typer(run.app)
app.command()(leaderboard)
app.command()(report)
app.add_typer(solvers.app)
app.command()(convergence)


def main() -> None:
    """Entry point of the console script."""
    app()
