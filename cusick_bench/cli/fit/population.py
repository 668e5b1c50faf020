"""`cusick-bench population`: the priors of the space `field` again, from fabrics of the public release."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.options import LAW, MOST_CASES, Data, Json, Law, Vertices, simulation_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.sim.constants import VERTICES_OF_POPULATION

app = typer.Typer()


@app.command()
@user_errors
def population(
    data: Data = "cusick",
    law: Law = LAW,
    vertices: Vertices = VERTICES_OF_POPULATION,
    cloths: Annotated[
        int, simulation_option(min=1, max=MOST_CASES, help="Cloths that are draped for the regression.")
    ] = 1300,
    specimens: Annotated[
        int, simulation_option(min=1, max=MOST_CASES, help="Specimens that are draped of every fabric and face.")
    ] = 16,
    as_json: Json = False,
) -> None:
    """Derive the priors of `bdp-field` anew: in what cloths differ, and by how much samples of one cloth do.

    Some 1500 drapes. The numbers that `bdp-field` uses stand in `cusick_bench.problem.field_space`.
    """
    from cusick_bench.problem.population import PopulationPlan, derive_population

    plan = PopulationPlan(law.value, vertices, cloths, specimens)
    with progress_bar("draping", None) as bar, interruptible("nothing was written"):
        found = derive_population(data, plan, done=lambda drapes: bar.advance())
    if as_json:
        print_json({"law": law.value, "vertices": vertices, **found})
        return
    table = Table("number", "mean or median", "sd", title=f"population by law {law.value}, {vertices} vertices")
    for name, numbers in _rows(found):
        table.add_row(name, *(f"{number:.3g}" for number in numbers))
    output.print(table)
    output.print(f"log stiffness differs by {found['level']:.3g} between samples of one cloth")


def _rows(found: dict[str, Any]) -> list[tuple[str, tuple[float, float]]]:
    named = [(f"trait {name}", numbers) for name, numbers in found["traits"].items()]
    named.append(("correlation length of the laid shape [m]; sd of its log", found["length"]))
    return named + [(f"discrepancy of {name}", numbers) for name, numbers in found["discrepancy"].items()]
