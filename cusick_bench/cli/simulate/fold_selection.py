"""`cusick-bench fold-selection`: what decides number and depth of folds, beside the same numbers of real cloths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from cusick_bench.benchmark.fold_selection.conditions import FACTORS, Condition, levels
from cusick_bench.cli.common import output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_data
from cusick_bench.cli.options import (
    LAW,
    MOST_DRAWS,
    Json,
    Law,
    LawName,
    Seed,
    Vertices,
    data_option,
    output_option,
    simulation_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import room_for_picture
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.benchmark.fold_selection.real_cloth import ClothRow
    from cusick_bench.benchmark.fold_selection.responses import FoldResponses
    from cusick_bench.benchmark.fold_selection.study import FoldRow

app = typer.Typer()

_DRAWS = 8


class FactorName(StrEnum):
    """Factors that can be asked for, those of `FACTORS`."""

    stiffness = "stiffness"
    mesh = "mesh"
    laying_length = "laying-length"
    laying_height = "laying-height"
    release = "release"
    step = "step"
    slide = "slide"
    rest_shape = "rest-shape"
    shear = "shear"


@app.command("fold-selection")
@user_errors
def fold_selection(
    factor: Annotated[
        list[FactorName] | None,
        simulation_option("--factor", help="Factor whose levels are compared; repeatable; by default all."),
    ] = None,
    law: Law = LAW,
    vertices: Vertices = Condition.vertices,
    draws: Annotated[int, simulation_option(min=2, max=MOST_DRAWS, help="Drapes of each condition.")] = _DRAWS,
    data: Annotated[
        str | None,
        data_option(help="Real drapes to measure beside: a data set's name or folder.", autocompletion=complete_data),
    ] = None,
    picture: Annotated[Path | None, output_option(help="PNG to write: folds of all conditions.")] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Drape one cloth while one factor at a time changes, and measure its folds.

    Factors are stiffness, mesh, length and height of the shape in which the cloth is laid down, its release, the time
    step, how far off the plate's axis it lies, its rest shape, and its shear stiffness. All together take some minutes
    on two cores.
    """
    from cusick_bench.benchmark.fold_selection.study import fold_rows

    room = room_for_picture(picture)
    if law is LawName.published and (factor is None or FactorName.release in factor):
        raise CusickError(
            "law 'published' has no rests, which factor 'release' needs; name other factors, or law paper"
        )
    names = [one.value for one in factor] if factor else list(FACTORS)
    asked = levels(Condition(law=law.value, vertices=vertices), list(dict.fromkeys(names)))
    cloths = _real(data) if data is not None else []
    with room, progress_bar("draping", len(asked)) as bar:
        rows = fold_rows(asked, draws, seed=seed, done=lambda level: bar.advance(1))
    if picture is not None:
        from cusick_bench.report.figures.fold_selection import save_fold_selection

        save_fold_selection(picture, f"law {law.value}, {vertices} vertices, {draws} drapes each", rows, cloths)
        tell(f"wrote {picture}")
    if as_json:
        document = {"law": law.value, "vertices": vertices, "draws": draws, "seed": seed}
        print_json({**document, "rows": [asdict(row) for row in rows], "cloths": [asdict(row) for row in cloths]})
    else:
        _print(rows, cloths)


def _real(data: str) -> list[ClothRow]:
    from cusick_bench.benchmark.fold_selection.real_cloth import cloth_rows
    from cusick_bench.datasets import load

    rows = cloth_rows(load(data))
    if not rows:
        raise CusickError(
            f"{data} has no fabric of which one face is shown by three samples or more, from which folds are told; "
            "name another data set, or leave --data out"
        )
    return rows


def _print(rows: Sequence[FoldRow], cloths: Sequence[ClothRow]) -> None:
    for factor in dict.fromkeys(row.factor for row in rows):
        table = _table(f"{factor}: {FACTORS[factor]} (mean ± standard error; sd between drapes)", "level")
        for row in rows:
            if row.factor == factor:
                table.add_row(row.label, *_cells(row.responses, row.failed))
        output.print(table)
    if cloths:
        table = _table("real cloths, first captures", "cloth")
        for cloth in cloths:
            table.add_row(f"{cloth.cloth} {cloth.side}".strip(), *_cells(cloth.responses))
        output.print(table)


def _table(title: str, first: str) -> Table:
    table = Table(title=title)
    table.add_column(first)
    for name in (
        "drapes",
        "folds",
        "sd",
        "depth mm",
        "drape coefficient",
        "sd",
        "skewness",
        "crest number",
        "pair MSE",
    ):
        table.add_column(name, justify="right")
    return table


def _cells(found: FoldResponses, failed: int = 0) -> list[str]:
    return [
        str(found.drapes) + (f" ({failed} failed)" if failed else ""),
        f"{found.folds:.2f} ± {found.error('folds'):.2f}", f"{found.folds_sd:.2f}",
        f"{found.fold_depth_mm:.2f} ± {found.error('fold_depth_mm'):.2f}",
        f"{found.drape_coefficient:.3f} ± {found.error('drape_coefficient'):.3f}", f"{found.drape_coefficient_sd:.3f}",
        f"{found.fold_skewness:+.2f} ± {found.error('fold_skewness'):.2f}", f"{found.crest_number:.1f}",
        f"{found.pair_mse:.3f}",
    ]  # fmt: skip
