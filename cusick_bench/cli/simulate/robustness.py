"""`cusick-bench robustness`: does every admissible cloth drape?"""

from typing import Annotated

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import LAW, MOST_DRAWS, DropMode, Json, Law, Mode, Seed, Vertices
from cusick_bench.cli.progress import progress_bar
from cusick_bench.sim.constants import VERTICES_OF_TRUTH

app = typer.Typer()


@app.command()
@user_errors
def robustness(
    draws: Annotated[int, typer.Option(min=1, max=MOST_DRAWS, help="Random cloths.")] = 1000,
    vertices: Vertices = VERTICES_OF_TRUTH,
    mode: DropMode = Mode.equilibrium,
    law: Law = LAW,
    least: Annotated[
        float,
        typer.Option(
            "--minimum-share",
            min=0,
            max=1,
            help="Least share of the cloths that come to rest; in mode drop, that fall without flying apart.",
        ),
    ] = 0.995,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Drape random cloths over the whole range of measured fabrics; exit status 1 if too few come to rest."""
    from cusick_bench.benchmark.robustness import robustness as run_robustness
    from cusick_bench.sim.cloth.resolution import cloth_mesh
    from cusick_bench.sim.drape import DrapeSimulator
    from cusick_bench.sim.engine.settings import DrapeSettings

    simulator = DrapeSimulator(cloth_mesh(law.value, vertices), DrapeSettings(law=law.value, mode=mode.value))
    with progress_bar("draping", draws) as bar:
        found = run_robustness(simulator, draws, seed=seed, done=bar.advance)
    if as_json:
        print_json({"vertices": vertices, "law": law.value, "mode": mode.value, **found})
    else:
        table = Table("seed", "density kg/m2", "bending N m", "anisotropy", "reason", title="not at rest")
        for row in found["failures"]:
            numbers = (f"{row[key]:.3g}" for key in ("density", "bending", "anisotropy"))
            table.add_row(str(row["seed"]), *numbers, row["reason"])
        if found["failures"]:
            output.print(table)
        output.print(f"{found['converged']} of {draws} cloths came to rest ({100 * found['fraction']:.2f} %)")
        if mode is Mode.drop:
            output.print(f"{found['diverged']} flew apart; {found['halved']} took shorter steps")
    share = 1 - found["diverged"] / draws if mode is Mode.drop else found["fraction"]
    if share < least:
        raise typer.Exit(1)
