"""A grid of one cloth at a small mesh."""

import json
from pathlib import Path

from cusick_bench.datasets import load
from cusick_bench.problem import Budget
from cusick_bench.runner import Cell, ProblemSettings, Source, plan, run
from cusick_bench.runner.executors.pool import _worker
from cusick_bench.sim.engine.settings import DrapeSettings

DENSITY = 0.2  # [kg/m2], of every cloth that make_lab makes
SMALL = ProblemSettings(vertices=100, drape=DrapeSettings(steps=20), budget=Budget(8))


def run_small(data: Path, out: Path, solvers: list[str], **options) -> tuple[list[Cell], list[dict]]:
    """Cells of a grid, of `fabric_1` unless `cloths` says otherwise, and their results."""
    planned = {"cloths": ["fabric_1"], "settings": SMALL} | {
        key: options.pop(key) for key in ("cloths", "seeds", "settings") if key in options
    }
    cells = plan(load(data), solvers=solvers, **planned)
    return cells, list(run(Source(str(data)), cells, out, **options))  # read now, before they change


def numbers(folder: Path) -> dict:
    """What must not depend on how often a run was killed: all but times."""
    result = json.loads((folder / "result.json").read_text())
    spent = {name: value for name, value in result["spent"].items() if name != "wall_seconds"}
    losses = [json.loads(line)["loss"] for line in (folder / "trace.jsonl").read_text().splitlines()]
    return {"metrics": result["metrics"], "spent": spent, "losses": losses}


def small_run_arguments(data: Path, out: Path, *solvers: str) -> list[str]:
    """Arguments of `cusick-bench` that run the same grid."""
    options = [
        "run",
        "--data",
        str(data),
        "--out",
        str(out),
        "--cloth",
        "fabric_1",
        "--vertices",
        "100",
        "--law",
        "paper",
    ]
    for solver in solvers:
        options += ["--solver", solver]
    return [*options, "--budget", "8", "--steps", "20"]


def say_much(messages: int) -> None:
    """Tells so many steps of a cell from a worker of a pool, which finds this function by its name."""
    for number in range(messages):
        _worker.messages.put((None, 0.0, 0.0, f"choosing drape {number}"))
