"""Stiffness tables of cloths drawn again from a stored posterior, by the solver that has learned it.

`Solver.redraw` gives the parameters of any draw; what the arrays of a posterior mean, its solver alone knows. A draw in
the space `homo` or `field` is a whole cloth, of which a garment can be made. A draw in the space `heter` has a table
for each element of its disc, and nothing says how elements of a garment go together, which has other elements.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy import ndarray

from cusick_bench.garment.errors import GarmentError
from cusick_bench.leaderboard.cells.loading import load_cells
from cusick_bench.leaderboard.cells.source import load_data_of
from cusick_bench.metrics.found_stiffness import DRAWS
from cusick_bench.problem import DrapeProblem
from cusick_bench.problem.cloth_prior import CLOTH
from cusick_bench.problem.cloth_tables import cloth_tables
from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE
from cusick_bench.runner import Cell, build_problem
from cusick_bench.sim.errors import CusickError
from cusick_bench.solvers.base import Solver
from cusick_bench.solvers.registry import make_solver


def redrawn_tables(folder: Path, record: dict[str, Any], posterior: dict[str, ndarray]) -> dict[str, ndarray]:
    """Tables of the draws 0, 1, ... of a cell's posterior.

    Args:
        folder: The cell's folder, in its run's.
        record: Contents of its `cell.json`.
        posterior: Arrays of the posterior, by the solver's own names.

    Returns:
        `stretch` [N/m] and `bending` [N m], a table of each draw.

    Raises:
        GarmentError: The solver, its `redraw` or the data of the run are missing, or draws are no whole cloths.
    """
    name = str(record.get("solver"))
    space = str((record.get("settings") or {}).get("space"))
    if space not in ("homo", "field"):
        raise GarmentError(
            f"{folder}: draws of {name} are of the space {space}, with a table for each element of its disc, and "
            "nothing says how those of a garment go together; run the solver with --space homo or field"
        )
    try:
        solver = make_solver(name)
        problem = _problem(folder, record, solver)
    except CusickError as error:
        raise GarmentError(
            f"{folder}: to draw cloths from the posterior of {name}, its solver must be installed and the run's data "
            f"must be here: {error}"
        ) from error
    draws = torch.as_tensor(np.stack([_draw(solver, problem, posterior, index, folder) for index in range(DRAWS)]))
    prior = problem.space.prior
    if space == "field":
        stretch, bending = cloth_tables(prior, draws[:, :CLOTH])
    else:
        parts = draws.split([STRETCH_SIZE, BENDING_SIZE], -1)
        stretch, bending = prior.stretch(parts[0]), prior.bending(parts[1])
    return {"stretch": stretch.numpy(), "bending": bending.numpy()}


def _problem(folder: Path, record: dict[str, Any], solver: Solver) -> DrapeProblem:
    """The problem that was answered, if solver and data are those of then."""
    cell = Cell.from_record(record)
    version = dict(cell.numerics).get(f"solver {solver.name}")
    if version not in (None, solver.version):
        raise GarmentError(f"the cell is of its version {version}, and {solver.version} is here; run the cell again")
    dataset = load_data_of(load_cells(folder.resolve().parents[1], changed=True))
    if dataset.content_hash != cell.dataset_hash:
        raise GarmentError(f"{dataset.name} has changed since the run; run the cell again")
    return build_problem(dataset, cell)


def _draw(solver: Solver, problem: DrapeProblem, posterior: dict[str, ndarray], index: int, folder: Path) -> ndarray:
    """Parameters of a draw."""
    if type(solver).redraw is Solver.redraw:
        raise GarmentError(
            f"{folder}: {solver.name} keeps a posterior, but defines no `redraw`, which draws cloths from it; add it "
            "to the solver (see docs/add-solver.md)"
        )
    tau = np.asarray(solver.redraw(problem, posterior, index), dtype=np.float64)
    if tau.shape != (problem.dimension,) or not np.isfinite(tau).all():
        raise GarmentError(
            f"{folder}: `redraw` of {solver.name} must give {problem.dimension} finite numbers, got shape {tau.shape} "
            f"for draw {index}; mend the solver"
        )
    return tau
