"""`cusick-bench optimisers`: the gradient-free solvers on test functions, beside published results."""

from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from cusick_bench.benchmark.optimisers import Plan, compare
from cusick_bench.cli.common import console, output, print_json, user_errors

app = typer.Typer()


@app.command()
@user_errors
def optimisers(
    function: Annotated[str, typer.Option(help="branin or hartmann6.")] = Plan.function,
    dimension: Annotated[int, typer.Option(help="Coordinates; only those of the function matter.")] = Plan.dimension,
    evaluations: Annotated[int, typer.Option(help="Of each run; 0 for as many as published.")] = Plan.evaluations,
    runs: Annotated[int, typer.Option(help="Of each method.")] = Plan.runs,
    method: Annotated[list[str] | None, typer.Option(help="Repeat for several; all by default.")] = None,
    seed: Annotated[int, typer.Option(help="Of everything.")] = Plan.seed,
    json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Minimises a test function hidden in many dimensions, and compares with published results.

    z is the difference from the published mean in standard errors of that difference; beyond 3 the two disagree.
    """
    plan = Plan(function, dimension, evaluations, runs, tuple(method or Plan.methods), seed)
    columns = (
        TextColumn("{task.description}"), BarColumn(bar_width=24), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=len(plan.methods) * plan.runs * plan.spent)
        document = compare(
            plan, lambda name, run: progress.update(task, advance=1, description=f"{name}, run {run + 1}")
        )
    if json:
        print_json(document)
        return
    _print_table(document)


def _print_table(document: dict[str, Any]) -> None:
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
            f"{row['mean']:.3f} ± {row['standard_error']:.3f}",
            f"{row['median']:.3f}",
            f"{theirs['mean']:.3f} ± {theirs['standard_error']:.3f}" if theirs else "",
            f"{theirs['median']:.3f}" if theirs and theirs["median"] is not None else "",
            f"{row['z']:+.1f}" if theirs else "",
            f"{row['seconds_per_run']:.1f}",
        )
    output.print(table)
