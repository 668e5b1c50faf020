"""`cusick-bench plate-elements`: discretisations of a plate side by side."""

from dataclasses import asdict
from typing import Annotated

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import Json, Seed, VerticesList, simulation_option
from cusick_bench.cli.progress import progress_bar

app = typer.Typer()

_SIZES = (297, 480, 1205, 2699)
_POISSON = (-1 / 3, 0.0, 0.3)


@app.command("plate-elements")
@user_errors
def plate_elements(
    vertices: VerticesList = None,
    rings: Annotated[
        bool, simulation_option("--rings", help="Meshes in rings, on which law plate is simulated, not irregular ones.")
    ] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compare several discretisations of a linear plate, law plate among them, with the exact deflection.

    Without --vertices the meshes have 297, 480, 1205 and 2699.
    """
    from cusick_bench.benchmark.convergence.plate_elements import ELEMENTS, compare_plate_elements
    from cusick_bench.sim.cloth.mesh import disc_mesh
    from cusick_bench.sim.cloth.ring_mesh import ring_mesh

    make = ring_mesh if rings else disc_mesh
    meshes = [make(size, seed=seed) for size in sorted(set(vertices or _SIZES))]
    rows = []
    with progress_bar("solving", len(ELEMENTS) * len(meshes)) as bar:
        for name in ELEMENTS:
            for mesh in meshes:
                rows += compare_plate_elements([mesh], _POISSON, elements=[name])
                bar.advance()
    if as_json:
        print_json({"meshes": "rings" if rings else "irregular", "plates": [asdict(row) for row in rows]})
        return
    table = Table(
        "discretisation", "vertices", "Poisson", "deflection / exact", "uneven %", "unknowns", "couplings", "solve ms",
        title="linear plate",
    )  # fmt: skip
    for row in rows:
        table.add_row(
            row.element, str(row.vertices), f"{row.poisson:.3g}", f"{row.ratio:.4f}", f"{100 * row.uneven:.2g}",
            str(row.unknowns), f"{row.couplings:.0f}", f"{1e3 * row.solve_seconds:.3g}",
        )  # fmt: skip
    output.print(table)
