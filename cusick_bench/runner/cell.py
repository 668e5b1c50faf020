"""One cell: build the problem, solve, score, write. Any error inside becomes the cell's result."""

import logging
import os
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from cusick_bench.datasets import DrapeDataset, DrapeSample
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.datasets.synthetic_set import recipe as synthetic_recipe
from cusick_bench.datasets.truth import true_tables
from cusick_bench.files import read_json_object, read_npz
from cusick_bench.files.plain_names import part_of
from cusick_bench.metrics.found_stiffness import find_stiffness, stiffness_document
from cusick_bench.metrics.prediction_score import score, to_levels
from cusick_bench.metrics.stiffness import ClothStiffness, cloth_stiffness
from cusick_bench.problem import (
    SPACES,
    Checkpoint,
    DrapeProblem,
    Journal,
    Meter,
    Scene,
    StaleJournal,
    StiffnessPrior,
    TrainMesh,
    laid_like,
    parse_causes,
    profile_in_cloth_frame,
)
from cusick_bench.problem.metering.journal import forget
from cusick_bench.problem.train_mesh import with_reference
from cusick_bench.runner.environment import code_state
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.samples import (
    place_in_order,
    read_image,
    read_repeats,
    read_sample,
    readable_rows,
    training_rows,
)
from cusick_bench.runner.store import (
    CELL_FILE,
    MOST_PREDICTION_BYTES,
    PREDICTION_FILE,
    RESULT_FILE,
    Store,
    disk_errors,
    ends_grid,
    write_json,
)
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.errors import CusickError, failure_text, raise_stop
from cusick_bench.sim.memory import memory_returned
from cusick_bench.sim.render.camera import Camera, PinholeCamera
from cusick_bench.sim.setup import Simulators
from cusick_bench.solvers.base import HeldOut, Oracle, Prediction
from cusick_bench.solvers.registry import make_solver

_log = logging.getLogger(__name__)

# Told the share of the work done, in [0, 1] or NaN, the smallest loss so far, and what goes on.
Report = Callable[[float, float, str], None]


Silhouettes = Float[np.ndarray, "images size size"]

_POSTERIOR = "posterior_"  # before names of a posterior's arrays in `prediction.npz`
SIMULATORS_KEPT = 8  # simulators that a process reuses; meshing and the linear solver's analysis take a second each


def _scene(dataset: DrapeDataset, cell: Cell, simulator: DrapeSimulator) -> Scene | None:
    """Scene with the effects that act in the picture that is fitted."""
    if not cell.settings.causes:
        return None
    row = cell.train[0]
    capture, later = place_in_order(dataset, row)
    return Scene(
        parse_causes(cell.settings.causes),
        simulator.mesh,
        simulator.settings,
        side="down" if dataset.index.at[row, "side"] == "down" else "up",
        capture=capture,
        later=later,
        seed=cell.seed,
    )


def _camera(name: str, protocol: Protocol) -> Camera:
    """The camera of the data, or one of the other projection: the published scripts', at the data's scale."""
    if name in ("protocol", protocol.projection):
        return camera_of(protocol)
    if name == "parallel":
        return camera_of(replace(protocol, projection="parallel"))
    image_y: Any = protocol.image_y
    size = RELEASE.image_size_px * protocol.px_per_m / RELEASE.px_per_m  # whose field of view is the scripts'
    return PinholeCamera(size_px=size, centre_px=protocol.centre_px, image_y=image_y)


def build_problem(
    dataset: DrapeDataset, cell: Cell, folder: Path | None = None, simulators: Simulators | None = None
) -> DrapeProblem:
    """Poses a cell's problem.

    Args:
        dataset: The data set.
        cell: What to pose.
        folder: Where the problem keeps what a resumed solver needs; nowhere by default.
        simulators: Simulators that are reused from cell to cell; by default new ones.

    Returns:
        The problem, its budget not touched.
    """
    kept = Simulators() if simulators is None else simulators
    settings, protocol, sample = cell.settings, dataset.protocol, read_sample(dataset, cell.train[0])
    known: dict[str, Any] = sample.row.to_dict()
    drape = replace(settings.drape, seed=cell.seed, plate_radius=protocol.plate_radius_m, gravity=protocol.gravity_m_s2)
    mesh = cloth_mesh(drape.law, settings.vertices, radius=protocol.cloth_radius_m, plate_radius=drape.plate_radius)
    simulator = kept.get(mesh, drape)
    scene = _scene(dataset, cell, simulator)
    if scene is not None:
        simulator = kept.get(scene.warped, scene.simulated)
    prior, plate_radius = StiffnessPrior(drape.law, float(known["areal_density"])), simulator.settings.plate_radius
    radii = profile_in_cloth_frame(sample.profile.radii, scene)
    laid = laid_like(radii, simulator.mesh, plate_radius=plate_radius)
    own, other = training_rows(dataset, cell.train)
    return DrapeProblem(
        train_image=read_image(dataset, cell.train[0]),
        further_images=tuple(read_image(dataset, row) for row in own[1:]),
        other_face_images=tuple(read_image(dataset, row) for row in other),
        simulator=simulator,
        space=SPACES[settings.space](simulator.mesh, prior, plate_radius, protocol.cloth_radius_m),
        thickness=float(known["thickness"]),
        protocol=protocol,
        camera=_camera(settings.camera, protocol),
        renderer=settings.renderer,  # pyright: ignore[reportArgumentType]
        loss=settings.loss,
        initial=laid if settings.laying == "image" else None,
        meter=Meter(settings.budget),
        journal=Journal(folder, cell.key),
        checkpoint=Checkpoint(folder, cell.key),
        train_mesh=_train_mesh(sample, simulator.mesh, protocol) if make_solver(cell.solver).needs_mesh else None,
        scene=scene,
    )


def _train_mesh(sample: DrapeSample, model: Mesh, protocol: Protocol) -> TrainMesh | None:
    """The training sample's mesh; its flat shape is known where it is a mesh of the synthetic set or the model's."""
    if sample.mesh is None:
        return None
    synthetic = synthetic_recipe.true_mesh(protocol.cloth_radius_m, protocol.plate_radius_m)
    return with_reference(sample.mesh.vertices, sample.mesh.faces, (synthetic, model))


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
        _write_prediction(folder / PREDICTION_FILE, prediction, problem, drawn)
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


def _write_prediction(
    path: Path, prediction: Prediction, problem: DrapeProblem, bending_draws: np.ndarray | None
) -> None:
    arrays: dict[str, np.ndarray] = {
        "train_image": np.asarray(prediction.train_image, dtype=np.float32),
        "train_target": np.asarray(problem.train_image, dtype=np.float32),
        "draws": to_levels(prediction.draws),
    }
    for name in ("tau", "vertices", "faces", "draw_vertices", "draw_turned"):
        value = getattr(prediction, name)
        if value is not None:
            arrays[name] = np.asarray(value)
    if prediction.posterior is not None:
        arrays |= {f"{_POSTERIOR}{name}": value for name, value in prediction.posterior.items()}
    if prediction.tau is not None:
        with torch.no_grad():
            material = problem.space.specimen(torch.as_tensor(prediction.tau)).material
        arrays |= {name: getattr(material, name).numpy() for name in ("stretch", "bending", "density")}
    if bending_draws is not None:
        arrays["bending_draws"] = bending_draws  # [N m], in the order of `metrics.stiffness.BENDING`
    part = part_of(path)
    with part.open("wb") as file:
        np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def load_prediction(folder: Path) -> dict[str, np.ndarray]:
    """The arrays of a cell's `prediction.npz`.

    Args:
        folder: The cell's.

    Returns:
        Arrays by name: `train_image`, `train_target`, `draws`, and what else the solver answered.
    """
    remedy = "delete the cell's folder and run it again"
    return read_npz(folder / PREDICTION_FILE, remedy=remedy, most_bytes=MOST_PREDICTION_BYTES)


def stored_posterior(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The posterior among the arrays of a cell's `prediction.npz`, as the solver gave it.

    Args:
        arrays: From `load_prediction`.

    Returns:
        Arrays by the solver's own names; none where it gave no posterior.
    """
    return {name.removeprefix(_POSTERIOR): one for name, one in arrays.items() if name.startswith(_POSTERIOR)}


def load_cell(folder: Path) -> dict[str, Any]:
    """A cell's `cell.json`.

    Args:
        folder: The cell's.

    Returns:
        What was asked.
    """
    return read_json_object(folder / CELL_FILE, remedy="delete the cell's folder and run it again")
