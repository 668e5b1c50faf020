"""One cell: build the problem, solve, score, write. Any error inside becomes the cell's result."""

import logging
import traceback
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.truth import true_tables
from cusick_bench.metrics.found_stiffness import find_stiffness, stiffness_document
from cusick_bench.metrics.prediction_score import score
from cusick_bench.metrics.stiffness import ClothStiffness, cloth_stiffness
from cusick_bench.problem import DrapeProblem, Meter, StaleJournal
from cusick_bench.problem.metering.journal import forget
from cusick_bench.runner.cell_files import write_prediction
from cusick_bench.runner.cell_problem import build_problem
from cusick_bench.runner.environment import code_state
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.samples import read_image, read_repeats, read_sample, readable_rows
from cusick_bench.runner.store import CELL_FILE, RESULT_FILE, Store, disk_errors, ends_grid, write_json
from cusick_bench.sim.errors import CusickError, failure_text, raise_stop
from cusick_bench.sim.memory import memory_returned
from cusick_bench.sim.setup import Simulators
from cusick_bench.solvers.base import HeldOut, Oracle, Prediction
from cusick_bench.solvers.registry import make_solver

_log = logging.getLogger(__name__)

# Told the share of the work done, in [0, 1] or NaN, the smallest loss so far, and what goes on.
Report = Callable[[float, float, str], None]


Silhouettes = Float[np.ndarray, "images size size"]

SIMULATORS_KEPT = 8  # simulators that a process reuses; meshing and the linear solver's analysis take a second each


@memory_returned()
def run_cell(
    dataset: DrapeDataset, cell: Cell, store: Store, report: Report, simulators: Simulators | None = None
) -> dict[str, Any]:
    """Runs a cell, or goes on with it where an earlier run was killed.

    Args:
        dataset: The data set.
        cell: What to run.
        store: Where results lie.
        report: Called with the cell's progress.
        simulators: Simulators that are reused from cell to cell; by default new ones.

    Returns:
        The cell's result; `status` is "done" or "failed".

    Raises:
        RunnerError: The disk cannot be written, or another process runs this cell.
    """
    if store.is_done(cell.key):
        return store.result(cell.key)
    with disk_errors(store.out), store.claimed(cell.key) as folder:
        if store.is_done(cell.key):  # by another process, after the first look and before the claim
            return store.result(cell.key)
        record = cell.record()
        write_json(folder / CELL_FILE, record)
        try:
            result = record | _attempt(dataset, cell, folder, report, simulators) | {"code": code_state()}
        except StaleJournal as error:
            _log.warning("%s; the cell is run again from its start", error)
            forget(folder)
            result = record | _attempt(dataset, cell, folder, report, simulators) | {"code": code_state()}
        write_json(folder / RESULT_FILE, result)
        if result["status"] == "done":
            store.mark_done(cell.key)
        return result


def _attempt(
    dataset: DrapeDataset, cell: Cell, folder: Path, report: Report, simulators: Simulators | None
) -> dict[str, Any]:
    """Result of a cell that is solved and scored, using what an earlier run has kept.

    Raises:
        StaleJournal: What it has kept is of another run.
        OSError: The disk cannot be written.
    """
    meter: Meter | None = None
    problem: DrapeProblem | None = None
    spent: dict[str, float] | None = None
    try:
        true = true_stiffness(dataset, cell.cloth)  # before the work, since a damaged file ends it
        problem = build_problem(dataset, cell, folder, simulators)
        meter = problem.meter
        prediction = solve_cell(problem, dataset, cell, report)
        spent = _spent(meter)  # before scoring, which is not the solver's time
        report(1.0, meter.best_loss, "scoring")
        metrics = score_cell(dataset, cell, prediction)
        found, drawn = find_stiffness(make_solver(cell.solver), problem, prediction, true)
        write_prediction(folder, prediction, problem, drawn)
        outcome = {"status": "done", "failure": "", "finished": prediction.finished, "metrics": metrics}
        outcome |= stiffness_document(found)
        outcome |= {"notes": prediction.notes} if prediction.notes else {}
    except StaleJournal:
        raise
    except OSError as error:
        if ends_grid(error, folder):
            raise
        outcome = _failed(error)
    except (Exception, SystemExit) as error:  # a solver or an effect of another package may call sys.exit
        raise_stop(error)
        outcome = _failed(error)
    finally:
        if problem is not None:
            problem.journal.close()
    return outcome | {"spent": spent or _spent(meter)}


def _unwatched(share: float, loss: float, message: str) -> None:
    """The report of a cell that nobody watches."""


def solve_cell(problem: DrapeProblem, dataset: DrapeDataset, cell: Cell, report: Report = _unwatched) -> Prediction:
    """Has a cell's solver answer its problem.

    Args:
        problem: The cell's problem, from `build_problem`.
        dataset: Data; only oracles are shown what is held out.
        cell: What is asked.
        report: Called with the solver's progress.

    Returns:
        The answer.

    Raises:
        CusickError: The solver cannot be used on this problem.
    """
    solver = make_solver(cell.solver)
    if isinstance(solver, Oracle):
        solver = solver.revealing(_heldout(dataset, cell))
    meter, said = problem.meter, ""

    def tell(message: str, fraction: float) -> None:
        nonlocal said
        said = message
        report(fraction, meter.best_loss, message)

    meter.observers.append(lambda evaluation: report(meter.share, evaluation.best_loss, said))
    return solver.solve(problem, np.random.default_rng([cell.seed, 2]), tell)


def score_cell(dataset: DrapeDataset, cell: Cell, prediction: Prediction) -> dict[str, float]:
    """Scores an answer on the cell's samples.

    Args:
        dataset: The data set.
        cell: Whose training and held-out samples are compared with.
        prediction: The answer.

    Returns:
        Metrics by name, as `cusick_bench.metrics.prediction_score.score` has them.

    Raises:
        MetricError: The prediction does not fit these samples.
    """
    train, test = read_sample(dataset, cell.train[0]), [read_sample(dataset, row) for row in cell.test]
    pairs = read_repeats(dataset, cell.cloth)
    return score(prediction, train, test, repeat_pairs=pairs, protocol=dataset.protocol)


def _heldout(dataset: DrapeDataset, cell: Cell) -> HeldOut:
    def images(rows: Sequence[int]) -> Silhouettes:
        size = dataset.protocol.image_size_px
        return np.stack([read_image(dataset, row) for row in rows]) if rows else np.zeros((0, size, size))

    sample, side = (dataset.table[name].astype(str).tolist() for name in ("sample", "side"))

    def others(row: int) -> list[int]:
        apart = [one for one in (*cell.train, *cell.test) if sample[one] != sample[row]]
        return [one for one in apart if side[one] == side[row]] or apart

    return HeldOut(
        images(cell.test),
        others=tuple(images(others(row)) for row in cell.test),
        repeats=tuple(images(readable_rows(dataset, dataset.repeats(row))) for row in cell.test),
    )


@lru_cache(maxsize=1)
def true_stiffness(dataset: DrapeDataset, cloth: str) -> ClothStiffness | None:
    """True stiffness of a cloth according to the data, which solvers never see.

    Args:
        dataset: Data.
        cloth: Whose stiffness.

    Returns:
        The true stiffness; None where the data do not know it.
    """
    true = true_tables(dataset, cloth)
    return None if true is None else cloth_stiffness(true.stretch, true.bending, true.law, poisson=true.poisson)


def _failed(error: BaseException) -> dict[str, Any]:
    """Record of a failure, with a traceback only if it is a bug."""
    trace = "" if isinstance(error, CusickError) else traceback.format_exc()
    return {"status": "failed", "failure": failure_text(error), "traceback": trace, "metrics": {}}


def _spent(meter: Meter | None) -> dict[str, float]:
    names = ("forward", "gradient", "failed", "jumped", "forward_equivalents", "simulated_seconds", "wall_seconds")
    return {name: float(getattr(meter, name)) if meter else 0.0 for name in names}
