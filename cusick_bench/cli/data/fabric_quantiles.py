"""`cusick-bench data fabric-quantiles`: quantiles that `identify` compares a cloth with, from a published table."""

from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import Json, output_option


@user_errors
def fabric_quantiles(
    table: Annotated[
        Path,
        typer.Argument(
            help="Published table of measured fabrics: density, linear warp, weft and diag stiffness.", metavar="TABLE"
        ),
    ],
    out: Annotated[Path | None, output_option(help="File to write; by default nothing is written.")] = None,
    as_json: Json = False,
) -> None:
    """Make quantiles of measured fabrics' stiffness, and say whether they are those that `identify` compares with."""
    from cusick_bench.identify.measured_fabrics import are_shipped, quantile_table
    from cusick_bench.runner.store import write_atomically

    text = quantile_table(table)
    shipped = are_shipped(text)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(out, text.encode())
    rows = sum(not line.startswith("#") for line in text.splitlines()) - 1
    if as_json:
        print_json({"table": table, "out": out, "rows": rows, "shipped": shipped})
    else:
        where = f"{rows} rows" if out is None else f"{rows} rows in {out}"
        output.print(f"{where}; {'the shipped ones' if shipped else 'other than the shipped ones'}")
