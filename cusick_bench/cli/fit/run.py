"""`cusick-bench run`: solvers on cloths; repeat the command to go on where it was stopped."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import command_with, interruptible, output, print_json, tell, tell_damaged, user_errors
from cusick_bench.cli.fit.grid_progress import GridProgress, cells_kept
from cusick_bench.cli.options import (
    LAW,
    Budget,
    CameraName,
    Clamp,
    Data,
    DropMode,
    FabricsCsv,
    FirstSeed,
    FittedCloths,
    Force,
    Json,
    Law,
    Membrane,
    Mode,
    Seeds,
    Solvers,
    Steps,
    VerticesByLaw,
    WithEffect,
    Workers,
    clamp_by_law,
    data_option,
    fit_option,
    membrane_asked,
    output_option,
    running_option,
    simulation_option,
    vertices_by_law,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.problem import Budget as Limits
from cusick_bench.problem.spaces import DEFAULT_SPACE, SPACES
from cusick_bench.runner import RunnerError
from cusick_bench.sim.constants import VERTICES_TO_FIT

if TYPE_CHECKING:
    from cusick_bench.datasets import DrapeDataset
    from cusick_bench.metrics.found_stiffness import FoundStiffness
    from cusick_bench.runner import Submitted

app = typer.Typer()

EXECUTORS = ("process", "slurm", "local")

STIFFNESS_FILE = "stiffness.csv"

DEFAULT_BUDGET = 120  # forward-equivalents: a fit of minutes


@app.command("run")
@user_errors
def run_command(
    out: Annotated[Path, output_option(help="Results folder; finished cells in it are kept.")],
    data: Data = "synthetic",
    fabrics_csv: FabricsCsv = None,
    cloth: FittedCloths = None,
    protocol: Annotated[
        str,
        data_option(
            help="Which silhouettes are fitted: paper (one of one sample; other samples are held out) or "
            "leave-one-sample-out (each sample in turn is held out, the others are fitted)."
        ),
    ] = "paper",
    force: Force = False,
    solver: Solvers = None,
    space: Annotated[
        str | None,
        fit_option(help=f"Parameter space: {', '.join(SPACES)}; by default the solver's own, or {DEFAULT_SPACE}."),
    ] = None,
    loss: Annotated[str, fit_option(help="Training loss: mse, profile or mse+profile.")] = "mse",
    budget: Budget = DEFAULT_BUDGET,
    seconds: Annotated[float | None, fit_option(max=1e9, help="Wall time that a cell may spend [s].")] = None,
    seeds: Seeds = 1,
    seed: FirstSeed = 0,
    vertices: VerticesByLaw = None,
    mode: DropMode = Mode.drop,
    steps: Steps = 100,
    law: Law = LAW,
    clamp: Clamp = None,
    membrane: Membrane = None,
    camera: Annotated[
        CameraName | None,
        simulation_option(
            help="Parallel, or pinhole as in the published scripts; by default as the data's protocol says."
        ),
    ] = None,
    renderer: Annotated[
        str,
        simulation_option(
            help="Silhouette: coverage (exact share of each pixel) or soft (mask of DIB-R, as in the paper)."
        ),
    ] = "coverage",
    laying: Annotated[
        str,
        simulation_option(
            help="How the cloth is laid down: image, with the training image's folds, or random; in the space field it "
            "is a parameter."
        ),
    ] = "image",
    with_effect: WithEffect = None,
    executor: Annotated[
        str,
        running_option(help="What runs the cells: process, slurm, or local (as slurm, but on this machine)."),
    ] = "process",
    workers: Workers = 1,
    job: Annotated[
        list[str] | None,
        running_option(help="What a Slurm task asks for: time=60 (minutes), mem=8G, ...; repeatable."),
    ] = None,
    only: Annotated[
        str | None,
        running_option("--shard", help="Run the i-th of n parts of the grid: i/n."),
    ] = None,
    json: Json = False,
) -> None:
    """Run solvers on cloths, score them on held-out samples, and keep all results with their settings.

    A cell is one solver on one cloth with one seed. Repeating the command goes on where it was stopped. The stiffness
    of each cloth is printed, and written to OUT/stiffness.csv. Exit status 1 if a cell failed.
    """
    from cusick_bench.runner import ProblemSettings, Source, load_once, plan, require_space, run, shard
    from cusick_bench.sim.engine.settings import DrapeSettings

    cell_executor = _executor(executor, workers, job or [])
    if space is not None:
        require_space(solver or [], space)
    settings = ProblemSettings(
        space=space or DEFAULT_SPACE,
        vertices=vertices_by_law(vertices, law, VERTICES_TO_FIT),
        drape=DrapeSettings(
            law=law.value,
            mode=mode.value,
            steps=steps,
            clamp=clamp_by_law(clamp, law),
            membrane=membrane_asked(membrane),
        ),
        camera="protocol" if camera is None else camera.value,
        renderer=renderer,
        loss=loss,
        laying=laying,
        budget=Limits(budget, seconds),
        causes=tuple(with_effect or ()),
    )
    source = Source(data, None if fabrics_csv is None else str(fabrics_csv))
    with progress_bar("reading data"):
        dataset = load_once(source)
    planned = plan(
        dataset,
        solvers=solver or [],
        cloths=cloth,
        seeds=list(range(seed, seed + seeds)),
        settings=settings,
        protocol=protocol,
    )
    cells = shard(planned, only) if only else planned
    found, rows, progress = [], [], GridProgress()
    with interruptible(partial(cells_kept, progress, out), go_on=True):
        with progress:
            results = run(
                source, cells, out, workers=workers, executor=cell_executor, watcher=progress, command=sys.argv,
                force=force, grid=planned,
            )  # fmt: skip
        for cell, result in zip(cells, results, strict=True):
            found.append(_stiffness(result))
            rows.append(_row(result, out / "cells" / cell.key))
        _write_stiffness(out, dataset)
    if json:
        print_json({"cells": rows})
    else:
        output.print(_table(rows))
        if any(found):
            from cusick_bench.cli.fit.stiffness_table import stiffness_table

            output.print(stiffness_table(rows, found))
        tell(f"next: {command_with('leaderboard', out)}")
    if any(row["status"] == "failed" for row in rows):
        raise typer.Exit(1)


def _executor(name: str, workers: int, job: list[str]) -> "Submitted | None":
    """Executor of the cells; None for this process and its own workers."""
    if name not in EXECUTORS:
        raise RunnerError(f"unknown executor {name!r}; use one of {', '.join(EXECUTORS)}, or --shard i/n")
    options: dict[str, str] = {}
    for text in job:
        key, equals, value = text.partition("=")
        if not (key.isidentifier() and equals and value):
            raise RunnerError(f"--job takes NAME=VALUE, such as time=60; got {text[:60]!r}")
        options[key] = value
    if name == "process":
        if options:
            raise RunnerError("--job is for --executor slurm or local; leave it out, or give an executor")
        return None
    from cusick_bench.runner import Submitted

    return Submitted(name, workers, options)


def _stiffness(result: dict[str, Any]) -> "FoundStiffness | None":
    from cusick_bench.metrics.found_stiffness import read_stiffness

    try:
        return read_stiffness(result)
    except ValueError as error:
        raise RunnerError(f"result.json of {result['solver']} on {result['cloth']} is damaged: {error}") from error


def _write_stiffness(out: Path, dataset: "DrapeDataset") -> None:
    """The stiffness of all finished cells of the folder, whoever ran them."""
    from cusick_bench.files.folder_lock import locked
    from cusick_bench.leaderboard import LeaderboardError, load_cells, stiffness_csv
    from cusick_bench.runner.store import CELL_FILE, RESULT_FILE, write_atomically

    with locked(out):  # or what was read before another command's cells had ended could be written after its own table
        try:
            cells = load_cells(out, looked_at=(CELL_FILE, RESULT_FILE))  # other commands wait, and it is all they need
        except LeaderboardError:  # no cell has finished
            return
        write_atomically(out / STIFFNESS_FILE, stiffness_csv(cells, dataset).encode())
    tell_damaged(cells)


def _row(result: dict[str, Any], path: Path) -> dict[str, Any]:
    from cusick_bench.metrics.found_stiffness import stiffness_document

    metrics, spent = result["metrics"], result["spent"]
    return {
        "solver": result["solver"],
        "causes": result["settings"].get("causes", []),
        "cloth": result["cloth"],
        "seed": result["seed"],
        **({"left_out": result["left_out"]} if "left_out" in result else {}),
        "status": result["status"],
        "failure": result["failure"],
        "train_mse": metrics.get("train_mse"),
        "test_mse": metrics.get("test_mse"),
        "hausdorff_m": metrics.get("test_hausdorff_m"),
        **{name: result.get(name, none) for name, none in stiffness_document(None).items()},
        "seconds": spent.get("wall_seconds"),
        "forward_equivalents": spent.get("forward_equivalents"),
        "path": str(path),
    }


def _table(rows: list[dict[str, Any]]) -> Table:
    from cusick_bench.runner import labelled

    in_turn = ["left out"] if any("left_out" in row for row in rows) else []
    numbers = ("train MSE", "test MSE", "Hausdorff [mm]", "drapes", "time [s]")
    table = Table("cloth", "solver", "seed", *in_turn, "status", *numbers)
    for row in rows:
        table.add_row(
            row["cloth"],
            labelled(row["solver"], row["causes"]),
            str(row["seed"]),
            *(str(row.get("left_out", "")) for _ in in_turn),
            row["status"],
            _number(row["train_mse"], ".4f"),
            _number(row["test_mse"], ".4f"),
            _number(row["hausdorff_m"], ".1f", 1e3),
            _number(row["forward_equivalents"], ".0f"),
            _number(row["seconds"], ".0f"),
        )
    return table


def _number(value: float | None, form: str, factor: float = 1.0) -> str:
    return "" if value is None else format(factor * value, form)
