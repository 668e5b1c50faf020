"""`cusick-bench learning-curve`: how much better fits of more samples of a cloth are."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, tell, user_errors
from cusick_bench.cli.fit.planned_cells import run_planned
from cusick_bench.cli.options import (
    LAW,
    MOST_CASES,
    Budget,
    Data,
    FabricsCsv,
    FirstSeed,
    FittedCloths,
    Force,
    Json,
    Law,
    Seeds,
    Solvers,
    Vertices,
    Workers,
    data_option,
    output_option,
)
from cusick_bench.sim.constants import VERTICES_OF_TRUTH

if TYPE_CHECKING:
    from cusick_bench.leaderboard.bootstrap import Estimate
    from cusick_bench.leaderboard.learning_curve import LearningStep

app = typer.Typer()
_SOLVER = "bdp-field"


@app.command(name="learning-curve")
@user_errors
def learning_curve_command(
    out: Annotated[Path, output_option(help="Folder for cells and tables; finished cells in it are kept.")],
    data: Data = "synthetic",
    fabrics_csv: FabricsCsv = None,
    cloth: FittedCloths = None,
    force: Force = False,
    learn_from: Annotated[
        list[int] | None,
        data_option(min=1, max=MOST_CASES, help="Training samples of a fit; repeatable; by default 1, 2, 4, 8."),
    ] = None,
    unseen: Annotated[
        int,
        data_option(min=2, max=MOST_CASES, help="Samples of every cloth that no fit sees, spread over all samples."),
    ] = 4,  # USUAL_UNSEEN
    solver: Solvers = None,
    seeds: Seeds = 1,
    seed: FirstSeed = 0,
    budget: Budget = 400.0,
    law: Law = LAW,
    vertices: Vertices = VERTICES_OF_TRUTH,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Fit one, two, four, ... samples of each cloth, and score all fits on the same unseen samples.

    For solvers that learn from several samples, such as bdp-field. Repeating the command goes on where it was stopped.
    Exit status 1 if a cell failed.
    """
    import pandas as pd

    from cusick_bench.files.csv_text import csv_text
    from cusick_bench.leaderboard.learning_curve import (
        learning_curve,
        learning_splits,
        numbers_without_more,
        split_name,
    )
    from cusick_bench.problem import Budget as Limit
    from cusick_bench.runner import ProblemSettings, Source, load_once, plan
    from cusick_bench.runner.store import write_atomically
    from cusick_bench.sim.engine.settings import DrapeSettings
    from cusick_bench.solvers.registry import make_solver

    source = Source(data, None if fabrics_csv is None else str(fabrics_csv))
    dataset = load_once(source)
    settings = ProblemSettings(vertices=vertices, drape=DrapeSettings(law=law.value), budget=Limit(budget))
    counts, solvers = learn_from or [1, 2, 4, 8], solver or [_SOLVER]
    planned = [
        cell
        for count, splits in learning_splits(dataset, cloth, counts, unseen).items()
        for cell in plan(
            dataset,
            solvers=solvers,
            seeds=list(range(seed, seed + seeds)),
            settings=settings,
            protocol=split_name(count, unseen),
            splits=splits,
        )
    ]
    for text in solvers:
        if repeated := numbers_without_more(make_solver(text), counts):
            numbers = ", ".join(map(str, repeated))
            tell(f"{text} uses no more of {numbers} samples than of fewer: its fits of them are the same ones again")
    cells = run_planned(source, planned, out, workers=workers, force=force)
    steps = learning_curve(cells)
    path = out / "learning-curve.csv"
    write_atomically(path, csv_text(pd.DataFrame([_record(step) for step in steps])).encode())
    tell(f"wrote {path}")
    if as_json:
        print_json({"steps": [asdict(step) for step in steps]})
    else:
        output.print(_table(steps, f"{dataset.name}: {unseen} unseen samples of each cloth, {vertices} vertices"))
    if cells.skipped:
        raise typer.Exit(1)


def _record(step: LearningStep) -> dict[str, Any]:
    row: dict[str, Any] = {"solver": step.solver, "samples": step.samples, "cells": step.cells}
    for name, one in step.metrics.items():
        row |= one.columns(name)
    return row | {
        "interval_factor": step.interval_factor,
        "error_factor": step.error_factor,
        "coverage": step.coverage,
    }


def _table(steps: list[LearningStep], title: str) -> Table:
    table = Table(
        "solver", "samples", "fits", "test MSE", "energy distance", "CRPS of DC [points]", "50 %, 90 % hold",
        "stiffness ×/÷", "off by ×/÷", "90 % holds truth", title=title,
    )  # fmt: skip
    for step in steps:
        of = step.metrics
        held = [_text(of[f"test_dc_cover_{level}"].value, ".0%") for level in (50, 90)]
        table.add_row(
            step.solver,
            str(step.samples),
            str(step.cells),
            _with_interval(of["test_mse"]),
            _with_interval(of["test_energy_distance"]),
            _with_interval(of["test_dc_crps"], 100),
            ", ".join(held),
            _text(step.interval_factor, ".2f"),
            _text(step.error_factor, ".2f"),
            _text(step.coverage, ".0%"),
        )
    return table


def _with_interval(one: Estimate, factor: float = 1.0) -> str:
    value, low, high = (factor * each for each in (one.value, one.low, one.high))
    return f"{value:.3g} [{low:.3g}, {high:.3g}]" if isfinite(low) else _text(value, ".3g")


def _text(value: float, form: str) -> str:
    return format(value, form) if isfinite(value) else "-"
