"""`cusick-bench population`: the priors of the space `field` again, from fabrics of the public release."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.options import LAW, MOST_CASES, Data, Json, Law, Vertices, output_option, simulation_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.files.json_text import json_text
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.constants import VERTICES_OF_POPULATION

app = typer.Typer()


@app.command()
@user_errors
def population(
    data: Data = "cusick",
    law: Law = LAW,
    vertices: Vertices = VERTICES_OF_POPULATION,
    cloths: Annotated[
        int,
        simulation_option(min=1, max=MOST_CASES, help="Cloths for the regression, every second one draped twice."),
    ] = 2048,
    specimens: Annotated[
        int, simulation_option(min=2, max=MOST_CASES, help="Specimens that are draped of every fabric and face.")
    ] = 16,
    out: Annotated[
        Path | None,
        output_option(
            help="Folder for tables, a picture, and `expected_statistics.npz`, which `bdp-field` begins with."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Derive the priors of `bdp-field` again: how cloths differ, and how much samples of one cloth differ.

    Makes some 3500 drapes. The numbers that `bdp-field` uses are in `cusick_bench.problem.cloth_prior`. OUT gets
    levels.csv and levels.png, simulated samples beside real ones, and population.json, all that --json prints.
    """
    from cusick_bench.problem.population.derivation import (
        PopulationPlan,
        derive_population,
        population_problem,
        population_samples,
    )
    from cusick_bench.problem.population.levels import compare_levels, level_drapes

    plan = PopulationPlan(law.value, vertices, cloths)
    groups = population_samples(data)
    drapes = plan.drapes + level_drapes(groups, specimens)
    with interruptible("nothing was written"), folder_made(out), progress_bar("draping", drapes) as bar:
        found = derive_population(groups, plan, done=bar.advance)
        levels = compare_levels(population_problem(plan), found, groups, specimens, done=bar.advance)
    document = {name: value for name, value in asdict(found).items() if name not in ("expected", "places")}
    places = {name: place.tolist() for name, place in found.places.items()}
    document = {"law": law.value, "vertices": vertices, **document, "places": places, "levels": levels}
    if out is not None:
        write_atomically(out / "expected_statistics.npz", found.expected.npz())
        _write(document, out)
    if as_json:
        print_json(document)
        return
    table = Table("number", "mean", "sd", title=f"population by law {law.value}, {vertices} vertices")
    for name, (mean, spread) in found.traits.items():
        table.add_row(name, f"{mean:.3g}", f"{spread:.3g}")
    for name, size in found.discrepancy.items():
        table.add_row(f"discrepancy of {name}", "", f"{size:.3g}")
    table.add_row("log stiffness between samples of one cloth", "", f"{found.level:.3g}")
    output.print(table)
    output.print(_levels_table(levels))


def _write(document: dict[str, Any], out: Path) -> None:
    """Writes the report of a population."""
    import pandas as pd

    from cusick_bench.files.csv_text import csv_text
    from cusick_bench.report.figures.population_levels import save_population_levels

    levels = document["levels"]
    for file, text in {"population.json": json_text(document), "levels.csv": csv_text(pd.DataFrame(levels))}.items():
        write_atomically(out / file, text.encode())
    save_population_levels(out / "levels.png", f"law {document['law']}, {document['vertices']} vertices", levels)
    tell(f"wrote {out / 'levels.png'}, levels.csv, population.json and expected_statistics.npz beside it")


def _levels_table(levels: list[dict[str, Any]]) -> Table:
    table = Table(*levels[0], title="samples of a fabric, and specimens of the cloth it was placed at")
    for row in levels:
        table.add_row(*(value if isinstance(value, str) else f"{value:.3g}" for value in row.values()))
    return table
