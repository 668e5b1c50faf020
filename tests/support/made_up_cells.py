"""Finished cells of made-up numbers, without the run that would have made them."""

import json
from collections.abc import Callable
from pathlib import Path

import typer
from typer.testing import CliRunner, Result

from cusick_bench.cli.results.leaderboard import leaderboard
from cusick_bench.leaderboard import leaderboards, load_cells

CLOTHS = ("blue", "pink", "white", "viscose", "red")
DIFFICULTY = dict(zip(CLOTHS, (0.03, 0.04, 0.05, 0.06, 0.07), strict=True))


def write_cell(folder: Path, solver: str, cloth: str, seed: int = 0, **changes) -> Path:
    cell = folder / "cells" / f"{solver}-{cloth}-{seed}".replace(":", "_")
    cell.mkdir(parents=True)
    metrics = {"train_mse": 0.01, "test_mse": 0.05, "test_mse_best": 0.05, "draws": 1, "floor_mse": 0.0064}
    metrics |= {"test_hausdorff_m": 0.0316, "test_dc_error": 0.02, "test_folds_error": 0.5}
    record = {
        "solver": solver,
        "kind": solver.split(":")[0] if ":" in solver else "solver",
        "cloth": cloth,
        "seed": seed,
        "space": "homo",
        "vertices": 2699,
        "dataset": "cusick",
        "dataset_hash": "abc",
        "protocol": "paper",
        "code_version": "1",
        "settings": {"loss": "mse", "drape": {"steps": 100}},
    }
    record |= {key: value for key, value in changes.items() if key in (*record, "status", "failure")}
    metrics |= {key: value for key, value in changes.items() if key not in (*record, "status", "failure", "done")}
    (cell / "cell.json").write_text(json.dumps(record))
    spent = {"forward_equivalents": 240, "wall_seconds": 61.5}
    (cell / "result.json").write_text(json.dumps({"status": "done"} | record | {"spent": spent, "metrics": metrics}))
    if changes.get("done", True) and record.get("status") != "failed":
        (cell / "done").touch()
    return cell


def write_solver(folder: Path, solver: str, value: Callable[[str, int], float], seeds: int = 4, **changes) -> None:
    for cloth in CLOTHS:
        for seed in range(seeds):
            write_cell(folder, solver, cloth, seed, test_mse=value(cloth, seed), **changes)


def only(folder: Path, **options):
    (board,) = leaderboards(load_cells(folder), **options)
    return board


def ranks(board) -> dict[str, int | None]:
    return {row.label: row.rank for row in board.rows}


def shown_by_command(arguments: list[str]) -> Result:
    """What the command `leaderboard` prints, and its exit status."""
    app = typer.Typer()
    app.command()(leaderboard)
    return CliRunner().invoke(app, arguments)
