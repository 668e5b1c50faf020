"""`cusick-bench pace`: what a brisk drop changes of silhouettes, and how much time it saves."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import MOST_DRAWS, Json, Seed, Vertices, simulation_option
from cusick_bench.cli.progress import progress_bar

if TYPE_CHECKING:
    from cusick_bench.benchmark.pace import PaceStudy

app = typer.Typer()


@app.command()
@user_errors
def pace(
    vertices: Vertices = 1205,
    draws: Annotated[int, simulation_option(min=2, max=MOST_DRAWS, help="Random cloths.")] = 64,
    seed: Seed = 1,
    as_json: Json = False,
) -> None:
    """Compare drops of random cloths, stiff to limp, at the paces brisk and steady, in silhouettes and time.

    Steady drops with a tenth more steps show which differences do not matter. Takes some minutes on two cores.
    """
    from cusick_bench.benchmark.pace import pace_study

    with progress_bar("draping", 3 * draws) as bar:
        study = pace_study(vertices, draws, seed=seed, done=bar.advance)
    if as_json:
        print_json({**asdict(study), "ratio": study.ratio, "seed": seed})
    else:
        _print(study)


def _print(study: PaceStudy) -> None:
    title = f"{study.vertices} vertices, {study.cloths} cloths: change of a steady drop's silhouette, mean ± se"
    table = Table("quantity", "brisk", "a tenth more steps", title=title)
    for one in study.changes:
        brisk, longer = f"{one.brisk:.3f} ± {one.brisk_error:.3f}", f"{one.longer:.3f} ± {one.longer_error:.3f}"
        table.add_row(one.name, brisk, longer)
    table.add_row("MSE of pairs", f"{study.brisk_pairs:.4f}", f"{study.longer_pairs:.4f}")
    output.print(table)
    output.print(
        f"Core seconds: a steady drop by itself {study.single_seconds:.3f}, in lockstep {study.steady_seconds:.3f}, a "
        f"brisk one {study.brisk_seconds:.3f}, {study.ratio:.2f} times faster. Two cloths of about one drape "
        f"coefficient differ by an MSE of {study.other_pairs:.4f}."
    )
