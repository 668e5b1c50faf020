"""A benchopt benchmark (Moreau et al., NeurIPS 2022) whose data, solvers and scores are this package's.

    DIR/objective.py        what is fitted and how it is scored
    DIR/datasets/*.py       cloths: of the shipped set, on which `benchopt test` runs, and of another one
    DIR/solvers/*.py        one solver a file; another one is one more file
    DIR/README.md           how to run it

The files are written from `templates/benchopt`, and call `drape_task`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from cusick_bench import __version__
from cusick_bench.datasets import REGISTRY, DrapeDataset
from cusick_bench.export.errors import ExportError
from cusick_bench.export.written import fill, literal, require_new, write_files
from cusick_bench.runner import ProblemSettings, Source, load_once
from cusick_bench.solvers.base import Solver
from cusick_bench.solvers.registry import entry_point_of, make_solver

SOLVERS = ("homo", "cmaes", "nlopt:LN_BOBYQA", "null:disc", "null:copy")
"""What is compared where nothing else is asked for: one of a kind."""

_SHIPPED = "synthetic"
_SIMULATED = "simulated"  # the name by which `benchopt test` finds the data set that it runs on


def write_benchmark(
    folder: Path,
    *,
    solvers: Sequence[str] = SOLVERS,
    data: str = _SHIPPED,
    settings: ProblemSettings | None = None,
    command: str = "cusick-bench export benchopt",
) -> list[Path]:
    """Writes a benchmark into a new folder.

    Args:
        folder: Where it is to be; made if it is not there.
        solvers: Registered names, with options.
        data: Data set beside the shipped one: name or folder.
        settings: Vertices, steps, law and parameter space of the problems.
        command: What the benchmark's README says it was written by.

    Returns:
        The files written.

    Raises:
        ExportError: The folder is not empty, or the same solver is given twice.
        CusickError: An unknown solver, or data that cannot be read.
    """
    require_new(folder, "a benchmark")
    return write_files(_texts(folder, solvers, data, settings or ProblemSettings(), command))


def _texts(folder: Path, solvers: Sequence[str], data: str, settings: ProblemSettings, command: str) -> dict[Path, str]:
    """Every file's text; all that can be wrong goes wrong here, before anything is written."""
    texts = {
        folder / "objective.py": fill(
            "benchopt/objective.py",
            vertices=settings.vertices,
            steps=settings.drape.steps,
            law=literal(settings.drape.law),
            space=literal(settings.space),
        ),
        folder / "datasets" / f"{_SIMULATED}.py": _dataset(_SIMULATED, _SHIPPED),
    }
    if data != _SHIPPED:
        texts[folder / "datasets" / "drapes.py"] = _dataset("drapes", data)
    packages: dict[str, str] = {}
    unknown: dict[str, str] = {}
    for text in solvers:
        solver = make_solver(text)
        entry = entry_point_of(solver.name)
        if entry is not None and entry.dist is not None:
            packages[solver.name] = entry.dist.name
        elif entry is not None:
            unknown[solver.name] = entry.value.partition(":")[0]
        path = folder / "solvers" / f"{re.sub(r'[^a-z0-9]+', '_', solver.name.lower())}.py"
        if path in texts:
            raise ExportError(f"a solver's file is {path.name}, and two are asked for; give each solver once")
        texts[path] = _solver(solver, text, packages.get(solver.name))
    texts[folder / "README.md"] = fill(
        "benchopt/README.md",
        command=command,
        version=__version__,
        packages=sorted(set(packages.values())),
        unknown=unknown,
    )
    return texts


def _dataset(name: str, data: str) -> str:
    dataset: DrapeDataset = load_once(Source(data))
    place = data if data in REGISTRY else str(Path(data).expanduser().resolve())
    of = "the shipped synthetic set" if data == _SHIPPED else f"`{_in_docstring(dataset.name)}`"
    return fill(
        "benchopt/dataset.py",
        summary=f"Drapes of {of}, a cloth at a time",
        of=of,
        name=literal(name),
        first=literal(dataset.cloths[0]),
        cloths=literal(list(dataset.cloths)),
        data=literal(place),
    )


def _solver(solver: Solver, text: str, package: str | None) -> str:
    given = [setting.partition("=")[0].strip() for setting in text.split(",")[1:]]
    return fill(
        "benchopt/solver.py",
        summary=_in_docstring(solver.summary[:1].upper() + solver.summary[1:] or solver.name),
        reference=literal(solver.reference) if solver.reference else "",
        name=literal(solver.name),
        parameters=repr({option: [solver.options[option]] for option in given}),
        requirements=literal(["pip::cusick-bench", *([] if package is None else [f"pip::{package}"])]),
        searches=solver.kind == "solver",
    )


def _in_docstring(text: str) -> str:
    """Text of others without what would end a docstring, or be an escape in it, as `\\xi` in a solver's summary."""
    return re.sub(r'["\\]', "'", text)
