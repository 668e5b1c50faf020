"""`cusick-bench solvers`: what is registered."""

from dataclasses import MISSING
from typing import Any

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import Json

app = typer.Typer()


@app.command("solvers")
@user_errors
def solvers(
    json: Json = False,
) -> None:
    """List the registered solvers with their options and references.

    Options are set in the name: --solver null:random-phase,draws=100. NLopt's other algorithms work as nlopt:NAME.
    """
    from cusick_bench.solvers.registry import default_options, registered

    rows = [
        {
            "name": name,
            "kind": solver.kind,
            "summary": solver.summary,
            "space": solver.space or "any",
            "needs_gradient": solver.needs_gradient,
            "options": {name: _usual(value) for name, value in default_options(solver).items()},
            "reference": solver.reference,
        }
        for name, solver in registered().items()
    ]
    if json:
        print_json({"solvers": rows})
        return
    table = Table("name", "kind", "space", "what it is", "options", "reference")
    for row in rows:
        options = ", ".join(f"{key}={value}" for key, value in row["options"].items())
        table.add_row(row["name"], row["kind"], row["space"], row["summary"], options, row["reference"])
    output.print(table)


def _usual(value: Any) -> Any:
    """An option's default as JSON has it; other packages' may be of any type."""
    if value is MISSING:
        return "(must be given)"
    return value if value is None or isinstance(value, str | int | float) else str(value)
