"""Stiffness from the drapes of each fabric, fitted by a solver with a posterior.

A sample that differs from the fabric's others would give the stiffness of that sample only, so the sample with the
median drape coefficient is fitted; a solver that can do so learns from the other samples and the other face as well.
Nothing is held out, since this is a measurement and not a comparison of methods, and a fabric with one sample can be
measured, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np
import pandas as pd

from cusick_bench.datasets import DrapeDataset, Split
from cusick_bench.datasets.errors import BadImage, DataError
from cusick_bench.datasets.files.silhouette import drape_coefficient_of
from cusick_bench.datasets.impossible import impossible, require_possible
from cusick_bench.datasets.index import OTHER_FACE
from cusick_bench.identify.document import FAILED, NO_PHYSICS, UNUSABLE, UNWEIGHED, Fit, Stiffness
from cusick_bench.identify.earlier_fits import keys_of_fits
from cusick_bench.identify.options import Options
from cusick_bench.identify.workspace import Workspace
from cusick_bench.metrics.found_stiffness import Quantity, read_stiffness
from cusick_bench.problem import Budget
from cusick_bench.runner import Cell, ProblemSettings, RunnerError, Source, Store, Watcher, plan, run
from cusick_bench.runner.samples import training_rows
from cusick_bench.sim.constants import DEFAULT_LAW
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.solvers.base import Solver
from cusick_bench.solvers.registry import make_solver

SPLIT = "typical"
"""Name of the split in which the most typical drape trains, and other ones of the cloth, and nothing is held out."""
FORCED_SPLIT = "typical-forced"
"""Name of the split in which silhouettes train that no cloth on its plate can show."""


@dataclass(frozen=True)
class FitPlan:
    """Plan of a fit.

    Attributes:
        cells: A cell for each fabric that can be fitted, by its name.
        missing: Why there is none, for each of the others.
    """

    cells: Mapping[str, Cell] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)


def typical_rows(dataset: DrapeDataset, cloth: str, *, force: bool = False) -> tuple[int, ...]:
    """The drapes of a cloth that its stiffness may be learned from, one a sample.

    Args:
        dataset: The data set.
        cloth: One of its cloths.
        force: Whether silhouettes that no cloth on its plate can show are usable, too.

    Returns:
        Rows of the index of usable silhouettes, face up where there are such, the first picture of each: first the one
        with the median drape coefficient (the lower of two), then the others in the order of the index. Empty where no
        picture can be used.
    """
    own = dataset.table.loc[dataset.table["cloth"] == cloth]
    up = own.loc[own["side"] == "up"]
    ordered = sorted((_measured(dataset, up, force) or _measured(dataset, own, force)).values())
    if not ordered:
        return ()
    typical = ordered[(len(ordered) - 1) // 2][1]
    return typical, *sorted(row for _, row in ordered if row != typical)


def turned_rows(dataset: DrapeDataset, rows: Sequence[int], *, force: bool = False) -> tuple[int, ...]:
    """Drapes of the same samples with the other face up, where drapes with the face up are given.

    Args:
        dataset: The data set.
        rows: Rows of the index of drapes of one cloth, one a sample.
        force: As in `typical_rows`.

    Returns:
        Rows of usable silhouettes, the first picture of each; fewer where a sample lacks one, or the face is unknown.
    """
    table = dataset.table
    shown = table.loc[list(rows)]
    if set(shown["side"]) != {"up"}:
        return ()
    own = (table["cloth"] == shown["cloth"].iloc[0]) & table["sample"].isin(shown["sample"])
    turned = _measured(dataset, table.loc[own & (table["side"] == OTHER_FACE["up"])], force)
    return tuple(turned[sample][1] for sample in shown["sample"] if sample in turned)


def _measured(dataset: DrapeDataset, table: pd.DataFrame, force: bool) -> dict[Any, tuple[float, int]]:
    """Drape coefficient and row of the first usable picture of each sample in a part of the table, by its number."""
    measured: dict[Any, tuple[float, int]] = {}
    for row, sample in zip(table.index.tolist(), table["sample"], strict=True):
        if sample in measured or (share := _drape_coefficient(dataset, row)) is None:
            continue
        if force or not impossible(dataset, [row]):
            measured[sample] = share, row
    return measured


def _drape_coefficient(dataset: DrapeDataset, row: int) -> float | None:
    try:
        share = drape_coefficient_of(dataset.image(row).numpy(), dataset.protocol)
    except BadImage:
        return None
    return share if isfinite(share) else None


def plan_fits(dataset: DrapeDataset, cloths: Sequence[str], options: Options) -> FitPlan:
    """Chooses what to fit, and says why where nothing can be.

    Args:
        dataset: The data set.
        cloths: Cloths to fit.
        options: How to fit.

    Returns:
        The plan.

    Raises:
        CusickError: An unknown solver, or one that cannot fit by the law in use.
    """
    settings = ProblemSettings(
        vertices=options.vertices,
        drape=DrapeSettings(law=DEFAULT_LAW, steps=options.steps),
        budget=Budget(options.budget),
    )
    solver = make_solver(options.solver)
    cells: dict[str, Cell] = {}
    missing: dict[str, str] = {}
    for cloth in cloths:
        rows = typical_rows(dataset, cloth, force=options.force)
        if not rows:
            missing[cloth] = _why_none(dataset, cloth)
            continue
        if not _weighed(dataset, rows[0]):
            missing[cloth] = f"{UNWEIGHED}, and a drape shows stiffness over weight only"
            continue
        train = _training(dataset, rows, solver, force=options.force)
        forced = options.force and train != _training(dataset, typical_rows(dataset, cloth), solver)
        (cells[cloth],) = plan(
            dataset,
            solvers=[options.solver],
            seeds=[options.seed],
            settings=settings,
            protocol=FORCED_SPLIT if forced else SPLIT,
            splits=[Split(cloth, train, ())],
        )
    return FitPlan(cells, missing)


def _training(dataset: DrapeDataset, rows: Sequence[int], solver: Solver, *, force: bool = False) -> tuple[int, ...]:
    """Rows of the index that a solver learns from, of those that it may learn from and of the samples' other face."""
    used = tuple(rows[: solver.samples_used(len(rows))])
    return (*used, *turned_rows(dataset, used, force=force)) if used and solver.learns_both_faces else used


def _why_none(dataset: DrapeDataset, cloth: str) -> str:
    """Why no picture of a cloth is usable."""
    try:
        require_possible(dataset, typical_rows(dataset, cloth, force=True))
    except DataError as error:
        return str(error)
    return f"{UNUSABLE}; `cusick-bench data audit` says why"


def _weighed(dataset: DrapeDataset, row: int) -> bool:
    density = float(np.asarray(dataset.table["areal_density"])[row])
    return isfinite(density) and density > 0


def run_fits(
    source: Source,
    dataset: DrapeDataset,
    plan: FitPlan,
    workspace: Workspace,
    options: Options,
    *,
    watcher: Watcher | None = None,
    workers: int = 1,
    command: Sequence[str] = (),
) -> tuple[dict[str, Fit], dict[str, str]]:
    """Fits what is not fitted yet, or was with other pictures or another weight of its own.

    Args:
        source: Where the data come from.
        dataset: The data themselves.
        plan: What to fit.
        workspace: Where results lie.
        options: How to fit.
        watcher: Told of the fits' progress.
        workers: Number of processes.
        command: Command line, for the record.

    Returns:
        Fits by cloth, and for each cloth without one the reason.

    Raises:
        RunnerError: The workspace cannot be written, or a result is damaged; finished fits are kept.
    """
    fits, missing = {}, dict(plan.missing)
    if not plan.cells:
        return fits, missing
    keys = keys_of_fits(dataset, plan.cells, workspace)
    if waiting := [cell for cloth, cell in plan.cells.items() if keys[cloth] == cell.key]:
        run(source, waiting, workspace.run, workers=workers, watcher=watcher, command=command, force=options.force)
    for cloth, cell in plan.cells.items():
        result = Store(workspace.run).result(keys[cloth])
        if result["status"] != "done":
            missing[cloth] = f"{FAILED}: {result['failure']}"
            continue
        try:
            found = read_stiffness(result)
        except ValueError as error:
            raise RunnerError(f"result.json of {cloth} is damaged: {error}; remove {workspace.run}") from error
        if found is None:
            missing[cloth] = f"{options.solver} {NO_PHYSICS}; see `cusick-bench solvers`"
            continue
        row, (own, other) = dataset.index.loc[cell.train[0]], training_rows(dataset, cell.train)
        metrics = result["metrics"]
        fits[cloth] = Fit(
            image=str(row["image"]),
            sample=int(row["sample"]),
            samples=len(own),
            faces=2 if other else 1,
            turned=len(other),
            drape_coefficient=metrics.get("train_dc_target"),
            simulated_drape_coefficient=metrics.get("train_dc"),
            mse=metrics.get("train_mse"),
            finished=bool(result.get("finished", True)),
            stiffness={name: _stiffness(one) for name, one in found.bending.items()},
            stretch={name: _stiffness(one) for name, one in found.stretch.items()},
            solver=options.solver,
            drapes=float(result["spent"]["forward_equivalents"]),
            path=Store(workspace.run).folder(keys[cloth]).relative_to(workspace.out).as_posix(),
        )
    return fits, missing


def _stiffness(one: Quantity) -> Stiffness:
    return Stiffness(value=one.value, ci90=one.ci90)
