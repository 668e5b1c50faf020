"""`cusick-bench convergence`: how drape coefficient and fold number depend on the mesh."""

from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import (
    DENSITY,
    MOST_DRAWS,
    Json,
    VerticesList,
    checked_bending,
    checked_density,
    cloth_option,
)
from cusick_bench.cli.progress import progress_bar

app = typer.Typer()


def _one(vertices: int, draw: int, density: float, bending: float) -> tuple[float, int]:
    from cusick_bench.datasets.profile import drape_coefficient, fold_count, profile_from_image
    from cusick_bench.sim.cloth.material import uniform_material
    from cusick_bench.sim.cloth.mesh import disc_mesh
    from cusick_bench.sim.drape import DrapeSimulator
    from cusick_bench.sim.engine.settings import DrapeSettings
    from cusick_bench.sim.render.camera import ParallelCamera
    from cusick_bench.sim.render.silhouette import render

    simulator = DrapeSimulator(disc_mesh(vertices, seed=draw), DrapeSettings(seed=draw))
    drape = simulator.drape(uniform_material(density=density, bending=bending))
    image = render(drape.vertices.detach(), simulator.mesh.faces, ParallelCamera())
    return drape_coefficient(image), fold_count(profile_from_image(image))


@app.command()
@user_errors
def convergence(
    vertices: VerticesList = None,
    density: Annotated[float, DENSITY] = 0.192,
    bending: Annotated[float, cloth_option(help="Bending stiffness [N m].")] = 1.4e-5,
    draws: Annotated[
        int, typer.Option(min=2, max=MOST_DRAWS, help="Drapes per size, each with its own mesh and laying.")
    ] = 8,
    as_json: Json = False,
) -> None:
    """Drapes one cloth on meshes of several sizes: how much drape coefficient and folds depend on the mesh.

    Without --vertices the meshes have 297, 1205, 2699 and 7496.
    """
    sizes = vertices or [297, 1205, 2699, 7496]
    checked_density(density)
    checked_bending(bending)
    rows: list[dict[str, Any]] = []
    with progress_bar("draping", len(sizes) * draws) as bar:
        for size in sizes:
            found = []
            for draw in range(draws):
                found.append(_one(size, draw, density, bending))
                bar.advance()
            coefficient, folds = np.array(found, dtype=float).T
            rows.append(
                {
                    "vertices": size,
                    "drape_coefficient": coefficient.mean(),
                    "drape_coefficient_se": coefficient.std(ddof=1) / np.sqrt(draws),
                    "folds": folds.mean(),
                    "folds_se": folds.std(ddof=1) / np.sqrt(draws),
                }
            )
    if as_json:
        print_json({"density": density, "bending": bending, "draws": draws, "meshes": rows})
        return
    table = Table(title=f"{draws} drapes each, {density:g} kg/m2, {bending:g} N m (mean ± standard error)")
    for name in ("vertices", "drape coefficient", "folds"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            str(row["vertices"]),
            f"{row['drape_coefficient']:.4f} ± {row['drape_coefficient_se']:.4f}",
            f"{row['folds']:.2f} ± {row['folds_se']:.2f}",
        )
    output.print(table)
