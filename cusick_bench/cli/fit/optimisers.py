"""`cusick-bench optimisers`: the gradient-free solvers on test functions, beside published results."""

from __future__ import annotations

from itertools import product
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.benchmark.optimisers.runs import Plan, compare
from cusick_bench.cli.common import command_line, interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_solver
from cusick_bench.cli.options import Json, Seed, output_option
from cusick_bench.cli.progress import progress_bar

if TYPE_CHECKING:
    from cusick_bench.benchmark.optimisers.table import RunFile


app = typer.Typer()


@app.command()
@user_errors
def optimisers(
    function: Annotated[str, typer.Option(help="Test function: branin or hartmann6.")] = Plan.function,
    dimension: Annotated[
        int, typer.Option(min=1, max=100_000, help="Number of coordinates; the function depends on a few of them.")
    ] = Plan.dimension,
    evaluations: Annotated[
        int, typer.Option(min=0, max=100_000, help="Evaluations of a run; 0 for the published number.")
    ] = Plan.evaluations,
    runs: Annotated[int, typer.Option(min=1, max=10_000, help="Runs of each method.")] = Plan.runs,
    solver: Annotated[
        list[str] | None,
        typer.Option(
            "--solver",
            "--method",
            help="Solver without gradients; repeatable; by default all.",
            autocompletion=complete_solver,
        ),
    ] = None,
    seed: Seed = Plan.seed,
    out: Annotated[Path | None, output_option(help="Folder for finished runs, and a table of them.")] = None,
    json: Json = False,
) -> None:
    """Minimise a test function hidden in many dimensions, and compare with published results.

    z is the difference from the published mean in standard errors of that difference; beyond 2, of few runs beyond
    Student's t at 5 %, the two are said to differ. With --out, repeating the command goes on where it was stopped, and
    other functions and methods join the same table.
    """
    from cusick_bench.benchmark.optimisers.table import RunFile, table_rows, write_table

    plan = Plan(function, dimension, evaluations, runs, tuple(solver or Plan.methods), seed)
    file = None if out is None else RunFile(out)
    document = _compare(plan, file)
    if file is not None:
        for path in write_table(table_rows(file.read()), file.out, [_provenance()]):
            tell(f"wrote {path}")
    if json:
        print_json(document)
        return
    _print_table(document)


def _compare(plan: Plan, file: RunFile | None) -> dict[str, Any]:
    """Makes the runs that the file lacks."""
    known = [] if file is None else file.read()
    made = sum(any(run.answers(plan, *asked) for run in known) for asked in product(plan.methods, range(plan.runs)))
    kept = interruptible(
        "nothing was written" if file is None else f"finished runs are kept in {file.out}", go_on=file is not None
    )
    with progress_bar("starting", (len(plan.methods) * plan.runs - made) * plan.spent) as bar, kept:

        def told(name: str, run: int) -> None:
            bar.say(f"{name}, run {run + 1}")
            bar.advance()

        return compare(plan, told, known=known, keep=(lambda run: None) if file is None else file.keep)


def _provenance() -> str:
    """Provenance of the last runs of a table."""
    from cusick_bench.runner.environment import code_text, environment

    made = environment()
    return (
        f"Last command: `{command_line()}`. Hardware: {made['processor']}, {made['platform']}, {made['cores']} cores. "
        f"Code: {code_text(made)}."
    )


def _print_table(document: dict[str, Any]) -> None:
    from cusick_bench.benchmark.optimisers.table import mean_in_words

    title = (
        f"best of {document['evaluations']} evaluations of {document['function']} in {document['dimension']} "
        f"dimensions, {document['runs']} runs (optimum {document['optimum']:.3f})"
    )
    table = Table("method", title=title)
    for name in ("mean ± s.e.", "median", "published mean ± s.e.", "median", "z", "seconds a run"):
        table.add_column(name, justify="right")
    for row in document["methods"]:
        theirs = row["published"]
        table.add_row(
            row["method"],
            mean_in_words(row["mean"], row["standard_error"]),
            f"{row['median']:.3f}",
            mean_in_words(theirs["mean"], theirs["standard_error"]) if theirs else "",
            f"{theirs['median']:.3f}" if theirs and theirs["median"] is not None else "",
            f"{row['z']:+.1f}" if isfinite(row["z"]) else "",
            f"{row['seconds_per_run']:.1f}",
        )
    output.print(table)
