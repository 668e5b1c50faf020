"""`cusick-bench garment`: skirts from a digitised cloth."""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, tell, tell_damaged, user_errors
from cusick_bench.cli.options import (
    BENDING,
    DENSITY,
    Json,
    LawName,
    Seed,
    bending_stiffnesses,
    checked_density,
    cloth_option,
    output_option,
    simulation_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.simulate.garment_options import (
    Amplitude,
    Draws,
    Duration,
    HemRadius,
    Heterogeneity,
    HipRadius,
    Kind,
    KindName,
    LayingHeight,
    Length,
    Motion,
    Period,
    Shear,
    SkirtVertices,
    Stretch,
    WaistRadius,
    motion_option,
    skirt_size,
    waist_motion,
    wearing_of,
)
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.garment import GarmentError
from cusick_bench.runner.store import disk_errors, write_json

if TYPE_CHECKING:
    import pandas as pd

    from cusick_bench.garment import Cloth
    from cusick_bench.leaderboard import Cells


app = typer.Typer(help="Skirts from a digitised cloth.", no_args_is_help=True)


@app.callback()
def _root() -> None:
    """Skirts from a digitised cloth."""


@app.command()
@user_errors
def skirt(
    result: Annotated[
        Path | None,
        cloth_option(
            "--from", help="Cell of a run (RUN/cells/KEY) whose cloth to wear, instead of --density and --bending."
        ),
    ] = None,
    density: Annotated[float | None, DENSITY] = None,
    bending: Annotated[str | None, BENDING] = None,
    stretch: Stretch = None,
    shear: Shear = None,
    heterogeneity: Heterogeneity = 0.1,
    name: Annotated[str | None, cloth_option(help="Name of the cloth; a colour in it is used.")] = None,
    kind: Kind = KindName.circular,
    dynamic: Annotated[bool, motion_option("--dynamic/--static", help="Move the waist once the skirt hangs.")] = False,
    motion: Motion = None,
    amplitude: Amplitude = None,
    period: Period = None,
    duration: Duration = None,
    draws: Draws = 4,
    laying_height: LayingHeight = 0.01,
    vertices: SkirtVertices = 2500,
    law: Annotated[
        LawName | None,
        simulation_option(
            help="Material law; that of the result by default, and paper for tables of law plate.", show_default=False
        ),
    ] = None,
    waist: WaistRadius = 0.11,
    length: Length = 0.35,
    hem: HemRadius = None,
    hip: HipRadius = 0.13,
    seed: Seed = 0,
    out: Annotated[Path | None, output_option(help="Folder for meshes, silhouettes, pictures and summary.")] = None,
    as_json: Json = False,
) -> None:
    """Simulate skirts of a digitised cloth, at rest and optionally in motion, and measure how they hang and differ."""
    from cusick_bench.garment.output import forget_skirts, write_motion, write_rest
    from cusick_bench.garment.wearing import wear

    clock = time.perf_counter()
    moving = waist_motion(dynamic, motion, amplitude, period, duration)
    cloth = _cloth(result, density, bending, stretch, shear, heterogeneity, name)
    _check_law(law, cloth)
    wearing = wearing_of(
        kind, skirt_size(kind, waist, length, hem), hip, moving,
        vertices=vertices, draws=draws, laying_height=laying_height, seed=seed,
    )  # fmt: skip
    with (
        nullcontext() if out is None else disk_errors(out),
        folder_made(out),
        progress_bar("hanging the skirts (at most so many steps)") as bar,
    ):
        worn = wear(cloth, wearing, bar.tell)
    document = worn.document() | {"seconds": time.perf_counter() - clock}
    if out is not None:
        with disk_errors(out), progress_bar("drawing"), interruptible(f"what was ready is in {out}"):
            forget_skirts(out)
            write_rest(out, worn.pattern, worn.positions, cloth.name, wearing.body)
            if moving is not None:
                write_motion(out, worn.pattern, worn.times, worn.frames, moving, cloth.name, wearing.body)
            write_json(out / "summary.json", document)
        document["out"] = out
    if as_json:
        print_json(document)
    else:
        _print(document)


@app.command()
@user_errors
def compare(
    run: Annotated[Path, typer.Argument(help="Results folder of a run.", metavar="RUN")],
    solver: Annotated[
        list[str] | None,
        cloth_option(help="Solver whose cloths to wear, repeatable; needed where several of the run have found one."),
    ] = None,
    heterogeneity: Heterogeneity = 0.1,
    kind: Kind = KindName.circular,
    static: Annotated[bool, motion_option("--static/--dynamic", help="Leave out the motion.")] = False,
    motion: Motion = None,
    amplitude: Amplitude = None,
    period: Period = None,
    duration: Duration = None,
    draws: Draws = 4,
    laying_height: LayingHeight = 0.01,
    vertices: SkirtVertices = 2500,
    waist: WaistRadius = 0.11,
    length: Length = 0.35,
    hem: HemRadius = None,
    hip: HipRadius = 0.13,
    seed: Seed = 0,
    out: Annotated[
        Path | None, output_option(help="Folder for the picture, the page and the numbers; by default RUN/garments.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Simulate the same skirt, with the same motion, of every cloth of a run, and show them side by side.

    Writes side_by_side.png (at rest, and at three moments of the motion), garments.html (skirts that can be turned in
    3D) and garments.json. If there are several seeds, or splits of a cloth's samples, the first is used.
    """
    from cusick_bench.garment import cloth_of_cell
    from cusick_bench.garment.output import forget_comparison
    from cusick_bench.garment.page import write_page
    from cusick_bench.garment.side_by_side import compared, save_side_by_side
    from cusick_bench.garment.wearing import wear

    clock = time.perf_counter()
    moving = waist_motion(not static, motion, amplitude, period, duration)
    cells = _cells_of(run, solver or [])
    wearing = wearing_of(
        kind, skirt_size(kind, waist, length, hem), hip, moving,
        vertices=vertices, draws=draws, laying_height=laying_height, seed=seed,
    )  # fmt: skip
    cloths = [replace(cloth_of_cell(folder, spread=heterogeneity), name=name) for name, folder in cells.items()]
    folder = out or run / "garments"
    worn, documents = [], []
    with (
        disk_errors(folder),
        interruptible("nothing was written"),
        folder_made(folder),
        progress_bar("cloths", len(cloths)) as bar,
    ):
        for number, cloth in enumerate(cloths):
            bar.say(cloth.name)
            bar.show(number)
            one = wear(cloth, wearing)
            documents.append(one.document())
            worn.append(replace(one, frames=one.frames[:, :1].copy()))  # of a hundred draws the others take gigabytes
    rows = compared(worn)
    document: dict[str, Any] = {
        "run": str(run), "kind": kind.value, "vertices": worn[0].pattern.mesh.vertices, "seed": seed, "cloths": rows,
        "motion": None if moving is None else asdict(moving), "skirts": documents,
        "seconds": time.perf_counter() - clock,
    }  # fmt: skip
    with (
        disk_errors(folder),
        progress_bar("drawing", len(worn)) as bar,
        interruptible(f"what was ready is in {folder}"),
    ):
        forget_comparison(folder)
        write_json(folder / "garments.json", document)
        save_side_by_side(worn, folder / "side_by_side.png", bar.show)
        write_page(worn, folder / "garments.html")
    document["out"] = folder
    if as_json:
        print_json(document)
    else:
        _print_compared(rows, folder)


def _cells_of(run: Path, solvers: list[str]) -> dict[str, Path]:
    """Folder of every cloth's cell of the first split and seed, by cloth, and by solver where there are several."""
    from cusick_bench.leaderboard import load_cells
    from cusick_bench.leaderboard.cells.variants import BOARD, method_label, variants

    cells = load_cells(run)
    tell_damaged(cells)
    table = cells.table.sort_values(["cloth", "solver", "repeat"])
    fitted, stated = _stated_fits(run, table.loc[table["stiffness"].notna()], solvers)
    names = sorted(set(fitted["solver"]))
    if not names:
        raise GarmentError(f"no cell of {run} has found any stiffness; run a solver with physics, such as homo")
    if not solvers and len(names) > 1:
        raise GarmentError(f"{run} has cloths of several solvers; choose one with --solver: {', '.join(names)}")
    chosen = solvers or names
    if missing := [name for name in chosen if name not in names]:
        raise GarmentError(f"{run} has no cloth of {missing[0]!r}; use --solver with one of {', '.join(names)}")
    own = fitted.loc[fitted["solver"].isin(chosen)]
    rows = [method_label(*names) for names, _ in variants(own)]
    unlike = rows if len(rows) > len(chosen) else []
    boards = [" ".join(map(str, board)) for board in own[BOARD].drop_duplicates().itertuples(index=False, name=None)]
    if unlike or (len(boards) > 1 and not stated):
        raise GarmentError(
            f"{run} has fits that cannot be compared: {'; '.join(unlike or boards)}; fit all cloths with one setting "
            "into a results folder of their own (`run --out`)"
        )
    own = own.drop_duplicates(["cloth", "solver"])
    _tell_missing(cells, own, chosen)
    labels = own["cloth"] if len(chosen) == 1 else own["cloth"] + " of " + own["solver"]
    return {str(label): Path(folder) for label, folder in zip(labels, own["folder"], strict=True)}


def _stated_fits(run: Path, fitted: pd.DataFrame, solvers: list[str]) -> tuple[pd.DataFrame, bool]:
    """Of the run of an identification the fits that its document states, and whether these are all that is asked for.

    Its folder keeps those of earlier weights and options, and fits of fabrics that did not change when others did.
    Solvers that the document states no fit of, as an earlier identification has used them, are there if they are named.
    """
    from cusick_bench.identify.document import IdentifyDocument
    from cusick_bench.identify.workspace import Workspace

    workspace = Workspace(run.absolute().parent)
    if run.absolute() != workspace.run or not workspace.document.is_file():
        return fitted, False
    document = IdentifyDocument.read(workspace.document)
    keys = {Path(one.fit.path).name for one in document.fabrics if one.fit is not None}
    is_stated = [Path(folder).name in keys for folder in fitted["folder"]]
    if not any(is_stated):
        return fitted, False
    earlier = set(solvers) - {name for name, one in zip(fitted["solver"], is_stated, strict=True) if one}
    is_earlier = [name in earlier for name in fitted["solver"]]
    shown = [one or other for one, other in zip(is_stated, is_earlier, strict=True)]
    return fitted.loc[shown], not any(is_earlier)


def _tell_missing(cells: Cells, own: pd.DataFrame, chosen: list[str]) -> None:
    """Tells which cloths are not shown since their fits failed or have not finished."""
    shown = set(zip(own["cloth"], own["solver"], strict=True))
    for cell in cells.skipped:
        if cell.status != "damaged" and cell.solver in chosen and (cell.cloth, cell.solver) not in shown:
            tell(cell.note)


def _cloth(
    result: Path | None, density: float | None, bending: str | None, stretch: float | None, shear: float | None,
    deviation: float, name: str | None,
) -> Cloth:  # fmt: skip
    """The cloth of a result, or of numbers."""
    from cusick_bench.garment import cloth_of_cell, cloth_of_numbers

    if (result is None) == (density is None and bending is None):
        raise GarmentError("give either --from RESULT, or --density and --bending")
    membrane = {name: value for name, value in (("stretch", stretch), ("shear", shear)) if value is not None}
    if result is not None:
        if membrane:
            raise GarmentError(f"--{next(iter(membrane))} is about a cloth given by numbers; leave it out with --from")
        cloth = cloth_of_cell(result, spread=deviation)
    elif density is None or bending is None:
        raise GarmentError("a cloth given by numbers needs both --density and --bending")
    else:
        cloth = cloth_of_numbers(
            density=checked_density(density),
            bending=bending_stiffnesses(bending),
            spread=deviation,
            **membrane,
        )
    return cloth if name is None else replace(cloth, name=name)


def _check_law(law: LawName | None, cloth: Cloth) -> None:
    if law is LawName.plate:
        raise GarmentError(
            "law plate needs cloth of one piece, clamped in a circle, and a skirt has seams and hangs on a waist; "
            "leave out --law: skirts hang by law paper, which reads the same tables"
        )
    if law is not None and law.value != cloth.law:
        raise GarmentError(f"the cloth's tables are for law {cloth.law}, got --law {law.value}; leave it out")


def _print(document: dict[str, Any]) -> None:
    table = Table(title=f"{document['kind']} skirt of {document['cloth']}, {document['vertices']} vertices")
    columns = {
        "hem_radius_m": "hem radius [m]", "hem_depth_m": "hem depth [m]", "folds": "folds",
        "projected_area_m2": "area [m2]", "drape_coefficient": "drape coefficient",
    }  # fmt: skip
    for title in ("draw", *columns.values(), "at rest"):
        table.add_column(title, justify="right")
    for draw in document["draws"]:
        cells = [f"{draw[key]:.4g}" for key in columns]
        table.add_row(str(draw["draw"]), *cells, "yes" if draw["at_rest"] else "no")
    if len(document["draws"]) > 1:
        table.add_section()
        for title in ("mean", "sd"):
            table.add_row(title, *(f"{document['spread'][title][key]:.3g}" for key in columns), "")
    output.print(table)
    if len(document["draws"]) > 1:
        output.print(f"vertices differ by {1e3 * document['spread']['vertex_sd_rms_m']:.1f} mm (rms sd between draws)")
    if "motion" in document:
        motion = document["motion"]
        output.print(
            f"in motion the hem spreads from {motion['hem_radius_rest_m']:.3f} to {motion['hem_radius_max_m']:.3f} m "
            f"and trails the waist by up to {motion['hem_trail_max_m']:.3f} m"
        )


def _print_compared(rows: list[dict[str, Any]], folder: Path) -> None:
    from cusick_bench.garment.side_by_side import mean_and_deviation

    table = Table(title="skirts side by side: mean and standard deviation over draws")
    for title in ("cloth", "folds", "hem radius [mm]", "drape coefficient", "draws differ by [mm]", "at rest"):
        table.add_column(title, justify="left" if title == "cloth" else "right")
    for row in rows:
        between = 1e3 * row["vertex_sd_m"]  # NaN of a single draw
        table.add_row(
            row["cloth"],
            mean_and_deviation(row, "folds", 1, 1),
            mean_and_deviation(row, "hem_radius_m", 1e3),
            mean_and_deviation(row, "drape_coefficient", 1, 3),
            f"{between:.0f}" if between == between else "-",
            "yes" if row["at_rest"] else "no",
        )
    output.print(table)
    tell(f"wrote {folder / 'side_by_side.png'}, garments.html and garments.json")
