"""Kills a grid with SIGKILL at random moments, resumes it each time, and compares the tables bit by bit.

    python tests/faults/kills.py --moments 100 --way process

A grid of tiny cells is run once undisturbed, in one process. Then it is run again and again, each time into a folder
that goes on until the grid is finished in it; at a random moment of every run one process dies:

    process   the one that runs all cells
    workers   any of: the parent, its two workers, what belongs to them
    local     any of: the parent that schedules (`--executor local`), its tasks, what belongs to them

and the next run starts at once, whatever is left of the last. Every folder that is finished must hold the numbers of
the undisturbed run: traces, answers and results of all cells, and the table of cells, all but the times.
"""

import argparse
import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

PRELOADED = ["cusick_bench.runner.cell", "cusick_bench.runner.execute", "cusick_bench.solvers.registry"]
"""Imported once, by the process from which runs are forked: a run starts within a second."""

WAYS = ("process", "workers", "local")
SOLVERS = ("null:disc", "null:copy", "nlopt:LN_BOBYQA", "null:random-phase,draws=3")
CLOTHS = ("fabric_1", "fabric_2")
LONGEST = 900.0  # [s] that a run may take on busy cores
PROCESSES = Path("/proc")


@dataclass(frozen=True)
class Grid:
    """A grid and where it is run: `way` of `WAYS`, `out` the results folder, `data` the name of a data set."""

    way: str
    out: Path
    data: str = "synthetic"

    def run(self) -> None:
        """Runs what is not finished yet, in this process or its children."""
        from cusick_bench.problem import Budget
        from cusick_bench.runner import ProblemSettings, Source, Submitted, load_once, plan, run
        from cusick_bench.sim.engine.settings import DrapeSettings

        settings = ProblemSettings(vertices=97, drape=DrapeSettings(steps=5), budget=Budget(16))
        source = Source(self.data)
        planned = plan(load_once(source), solvers=list(SOLVERS), cloths=list(CLOTHS), settings=settings)
        cells = [replace(cell, test=cell.test[:2]) for cell in planned]  # so that kills meet more than scores
        options: dict[str, Any] = {"workers": {"workers": 2}, "local": {"executor": Submitted("local", workers=2)}}
        results = run(source, cells, self.out, **options.get(self.way, {}))
        if any(result["status"] != "done" for result in results):
            sys.exit(1)

    def finished(self) -> bool:
        """Whether every cell has its marker."""
        return len(list(self.out.glob("cells/*/done"))) == len(SOLVERS) * len(CLOTHS)


@dataclass
class Tally:
    """What was done: moments by the process that died, folders that were finished and compared, runs without a kill."""

    moments: Counter[str] = field(default_factory=Counter)
    compared: int = 0
    undisturbed: int = 0

    @property
    def total(self) -> int:
        """Number of kills."""
        return sum(self.moments.values())


def numbers(out: Path) -> dict[str, Any]:
    """Whatever must come out alike of a finished folder: all but times.

    Args:
        out: Results folder.

    Returns:
        By cell what was asked, its trace, answer and result; and the table of cells.
    """
    from cusick_bench.leaderboard import cell_table, load_cells

    found: dict[str, Any] = {}
    for folder in sorted((out / "cells").iterdir()):
        result = json.loads((folder / "result.json").read_text())
        lines = [json.loads(line) for line in (folder / "trace.jsonl").read_text().splitlines()]
        kept = ("kind", "digest", "loss", "best_loss", "forward_equivalents", "failure")
        found[folder.name] = {
            "cell": (folder / "cell.json").read_bytes(),
            "trace": [[line[name] for name in kept] for line in lines],
            "answer": (folder / "prediction.npz").read_bytes(),
            "result": {name: result[name] for name in result if name not in ("spent", "code")},
            "spent": {name: value for name, value in result["spent"].items() if name != "wall_seconds"},
        }
    table = cell_table(load_cells(out))
    return found | {
        "table": table.drop(columns=["spent_wall_seconds", "commit"])
        .sort_values(["solver", "cloth"])
        .to_csv(index=False)
    }


def kill_and_resume(way: str, moments: int, seed: int, root: Path, *, tell: bool = False) -> Tally:
    """Kills a grid so many times, and compares every folder in which it was finished all the same.

    Args:
        way: One of `WAYS`.
        moments: Number of kills.
        seed: Of the moments.
        root: Folder for the results folders.
        tell: Whether each kill is told on standard error.

    Returns:
        What was done.

    Raises:
        AssertionError: A finished folder holds other numbers, or leftovers of a kill.
    """
    generator, tally, context = np.random.default_rng(seed), Tally(), multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    whole = Grid("process", root / "undisturbed")
    _finish(context, whole)
    begin = time.monotonic()
    _finish(context, Grid(way, root / "timed"))
    duration = time.monotonic() - begin
    expected = numbers(whole.out)
    grid = Grid(way, root / "killed-0")
    while tally.total < moments:
        killed = _killed_once(context, grid, generator, duration)
        if killed:
            tally.moments[killed] += 1
            if tell:
                sys.stderr.write(f"{tally.total}: {killed} killed, {len(list(grid.out.glob('cells/*/done')))} done\n")
        else:
            tally.undisturbed += 1
        if grid.finished():
            grid = _compared(context, grid, expected, tally, root)
    _compared(context, grid, expected, tally, root)
    return tally


def _compared(context: Any, grid: Grid, expected: dict[str, Any], tally: Tally, root: Path) -> Grid:
    """Finishes a folder, compares it, and gives the next one."""
    _finish(context, grid)
    found = numbers(grid.out)
    unlike = [key for key in expected | found if expected.get(key) != found.get(key)]
    assert not unlike, f"{grid.out}: {unlike} are not those of the undisturbed run"
    leftovers = list(grid.out.glob("cells/*/*.part"))
    assert not leftovers, f"left half written: {leftovers}"
    tally.compared += 1
    shutil.rmtree(grid.out, ignore_errors=True)  # a task whose parent was killed may still write into it
    return Grid(grid.way, root / f"killed-{tally.compared}")


def _finish(context: Any, grid: Grid) -> None:
    """Runs a grid to its end; a second time where a cell was held by what was left of the run before."""
    for _ in range(3):
        process = context.Process(target=grid.run)
        process.start()
        process.join(LONGEST)
        if process.exitcode == 0:
            return
        _end(process.pid)
    raise AssertionError(f"{grid} did not finish: exit status {process.exitcode}")


def _killed_once(context: Any, grid: Grid, generator: np.random.Generator, duration: float) -> str:
    """Runs a grid and kills one process of it; "" where it was finished before."""
    process = context.Process(target=grid.run)
    process.start()
    process.join(generator.uniform(0.0, duration))
    if not process.is_alive():
        return ""
    others = [] if grid.way == "process" else _descendants(process.pid)
    victim = int(generator.choice([process.pid, *others]))
    name = "parent" if victim == process.pid else _role(victim)
    with suppress(ProcessLookupError):
        os.kill(victim, signal.SIGKILL)
    process.join(LONGEST)
    assert not process.is_alive(), f"{grid} hangs after its {name} was killed"
    return name


def _descendants(parent: int) -> list[int]:
    """Processes that a process has started, and those that these have."""
    children: dict[int, list[int]] = {}
    for folder in PROCESSES.iterdir():
        if folder.name.isdigit():
            with suppress(OSError, IndexError):
                words = (folder / "stat").read_text().rpartition(")")[2].split()
                if words[0] not in "ZX":
                    children.setdefault(int(words[1]), []).append(int(folder.name))
    found, new = [], [parent]
    while new:
        new = [child for one in new for child in children.get(one, [])]
        found += new
    return found


def _role(process: int) -> str:
    """What a process is, by its command."""
    with suppress(OSError):
        command = (PROCESSES / str(process) / "cmdline").read_bytes()
        for word, role in ((b"resource_tracker", "tracker"), (b"submitit", "task"), (b"spawn_main", "worker")):
            if word in command:
                return role
    return "other"


def _end(process: int) -> None:
    for one in [process, *_descendants(process)]:
        with suppress(ProcessLookupError):
            os.kill(one, signal.SIGKILL)


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=100)
    parser.add_argument("--way", choices=WAYS, default="process")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        tally = kill_and_resume(arguments.way, arguments.moments, arguments.seed, Path(folder), tell=True)
    sys.stdout.write(
        f"{tally.total} kills ({dict(tally.moments)}), {tally.compared} finished folders like the undisturbed one, "
        f"{tally.undisturbed} runs finished before their kill\n"
    )


if __name__ == "__main__":
    _main()
