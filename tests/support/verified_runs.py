"""A small run of several solvers, and how somebody tampers with it who wants to deceive."""

import json
from pathlib import Path

import numpy as np

from cusick_bench.datasets import load
from cusick_bench.leaderboard import load_cells
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings, Source, plan, run
from cusick_bench.runner.store import Store, write_json
from cusick_bench.sim.engine.settings import DrapeSettings

SOLVERS = ("homo,search=2", "null:disc", "null:random-phase,draws=12", "oracle:best-other")
DROP = DrapeSettings(steps=20)


def grid(data: Path, out: Path, solvers=SOLVERS, drape: DrapeSettings = DROP) -> Path:
    settings = ProblemSettings(vertices=100, drape=drape, budget=Budget(6))
    run(Source(str(data)), plan(load(data), solvers=list(solvers), settings=settings), out, command=["run", str(data)])
    return out


def folder_of(run_folder: Path, solver: str) -> Path:
    table = load_cells(run_folder).table
    return table.loc[table["solver"].str.startswith(solver), "folder"].iloc[0]


def change_arrays(folder: Path, **changes) -> None:
    with np.load(folder / "prediction.npz") as archive:
        arrays = dict(archive)
    for name, change in changes.items():
        arrays[name] = change(arrays[name])
    np.savez_compressed(folder / "prediction.npz", **arrays)
    mark_again(folder)


def change_json(path: Path, change) -> None:
    document = json.loads(path.read_text())
    change(document)
    write_json(path, document)
    mark_again(path.parent)


def mark_again(folder: Path) -> None:
    """The hashes of a cell's marker are made to fit, as somebody does who wants to deceive."""
    if (folder / "done").exists():
        Store(folder.parent.parent).mark_done(folder.name)
