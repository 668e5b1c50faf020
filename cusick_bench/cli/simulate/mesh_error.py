"""`cusick-bench mesh-error`: how far drapes of random cloths on a mesh are from those on finer ones."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import MOST_DRAWS, Json, Membrane, Seed, membrane_asked, simulation_option
from cusick_bench.cli.progress import progress_bar

if TYPE_CHECKING:
    from cusick_bench.benchmark.convergence.population_meshes import ClothGroup

app = typer.Typer()

_SIZES = [480, 700, 1205, 2699]


@app.command("mesh-error")
@user_errors
def mesh_error(
    vertices: Annotated[
        list[int], simulation_option(min=60, max=100_000, help="Vertices of a mesh; repeatable, two or more.")
    ] = _SIZES,
    draws: Annotated[int, simulation_option(min=3, max=MOST_DRAWS, help="Random cloths.")] = 32,
    stretch: Annotated[
        float | None,
        simulation_option(
            help="Membrane stiffness of all cloths, the mean of warp and weft [N/m]; by default each has its own."
        ),
    ] = None,
    membrane: Membrane = None,
    seed: Seed = 3,
    as_json: Json = False,
) -> None:
    """Drape the same random cloths, stiff to limp, with law plate on meshes of several sizes.

    Prints how far the drape coefficient on each mesh is from that on the finest one, and its limit: the error of a fit
    on that mesh. Takes some minutes on two cores.
    """
    from cusick_bench.benchmark.convergence.population_meshes import population_meshes
    from cusick_bench.problem import ProblemError

    if len(set(vertices)) < 2:
        raise ProblemError(f"errors need a finer mesh to compare with, got one size, {vertices[0]}; add --vertices")
    if stretch is not None and not 1 <= stretch <= 1e5:
        raise ProblemError(f"--stretch must be from 1 to 100000 N/m, got {stretch:g}; woven cloth has some hundred")
    asked = membrane_asked(membrane)
    with progress_bar("draping", len(set(vertices)) * draws) as bar:
        groups = population_meshes(vertices, draws, stretch=stretch, membrane=asked, seed=seed, done=bar.advance)
    if as_json:
        asked_for = {"stretch_N_m": stretch, "membrane": asked or "softened", "seed": seed}
        print_json({"groups": [asdict(group) for group in groups], **asked_for})
    else:
        _print(groups)


def _print(groups: tuple[ClothGroup, ...]) -> None:
    sizes = [one.vertices for one in groups[0].errors]
    title = f"drape coefficient less that at {sizes[-1]} vertices [points], mean ± se over the same cloths"
    table = Table("cloths", "number", f"DC at {sizes[-1]} [%]", "bending [µN m]", *map(str, sizes[:-1]), title=title)
    table.add_column("limit less the finest [90 %]; order")
    for group in groups:
        low, high = group.coefficients
        errors = [f"{one.points:+.1f} ± {one.points_error:.1f}" for one in group.errors[:-1]]
        table.add_row(
            group.name, str(group.cloths), f"{low:.0f} to {high:.0f}", f"{1e6 * group.bending:.2g}", *errors,
            _limit(group),
        )  # fmt: skip
    output.print(table)


def _limit(group: ClothGroup) -> str:
    if (limit := group.limit_error) is None:
        return "-"
    low, high = limit.value_90
    return f"{limit.value:+.1f} [{low:+.1f}, {high:+.1f}]; {limit.order:.1f}"
