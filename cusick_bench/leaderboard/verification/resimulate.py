"""One finished cell repeated from what it stored: the drape from the parameters, the metrics from the data.

A cell without physics, or of an oracle, is repeated as a whole. For a simulation the stored parameters are draped again
with the present code: a drop from the start, an equilibrium from the stored shape, which Newton's method must not
change; the stiffness of these parameters is computed again. Draws that are the fit itself are repeated with it. Of the
draws from a stored posterior, a few random ones are drawn and draped again; the pictures of all are rendered again from
the stored shapes, and scored again. Numbers of draws that are left out must be of drapes that fail: a few are tried.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from cusick_bench.datasets import DrapeDataset
from cusick_bench.files import BadFile
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.verification.comparison import (
    REDRAWN,
    ROUNDED,
    Check,
    largest,
    moved,
    pixel_tolerance,
    relative,
)
from cusick_bench.metrics.found_stiffness import FoundStiffness, find_stiffness
from cusick_bench.metrics.prediction_score import from_levels
from cusick_bench.problem import Budget, DrapeProblem
from cusick_bench.runner import Cell, Store, build_problem, load_prediction, run_cell
from cusick_bench.runner.cell import score_cell, true_stiffness
from cusick_bench.runner.cell_files import stored_posterior
from cusick_bench.runner.store import CELL_FILE, PREDICTION_FILE, read_json
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.setup import Simulators
from cusick_bench.solvers.base import Prediction
from cusick_bench.solvers.registry import make_solver
from cusick_bench.solvers.variational.predictive import MOST

_RANGE = 10  # numbers of draws that are looked through for those left out, for each stored draw

_NAMES = {"train_target": "training image", "train_image": "fit", "draws": "draws"}


@dataclass(frozen=True)
class Repetition:
    """A cell done again.

    Attributes:
        prediction: What is scored.
        checks: Comparisons of shapes, parameters and pictures.
        notes: What was not done again, and why.
        simulated: Whether what the cell claims could be made again at all.
        same_draws: Whether the draws scored are, picture by picture, those that are stored.
        metrics: Its metrics where they were made with it; None where `rescore` has to.
        stiffness: The stiffness of the stored parameters and posterior; None where none are stored.
    """

    prediction: Prediction
    checks: tuple[Check, ...] = ()
    notes: tuple[str, ...] = field(default=())
    simulated: bool = True
    same_draws: bool = False
    metrics: dict[str, float] | None = None
    stiffness: FoundStiffness | None = None


def read_record(folder: Path) -> dict[str, Any]:
    """A cell's `cell.json`.

    Args:
        folder: The cell's.

    Returns:
        What was asked.

    Raises:
        RunnerError: It is damaged.
        LeaderboardError: It is missing.
    """
    path = folder / CELL_FILE
    if not path.is_file():
        raise LeaderboardError(f"{folder} has no cell.json; give a cell's folder or that of `cusick-bench run --out`")
    return read_json(path)


def repeat(
    folder: Path,
    cell: Cell,
    kind: str,
    dataset: DrapeDataset,
    *,
    redrawn: int = REDRAWN,
    seed: int = 0,
    simulators: Simulators | None = None,
) -> Repetition:
    """Does a cell again.

    Args:
        folder: The cell's.
        cell: From `Cell.from_record`.
        kind: "solver", "null" or "oracle".
        dataset: Data to do it on.
        redrawn: Draws of a posterior to drape again.
        seed: Seed of their choice.
        simulators: Simulators that are reused from cell to cell; by default new ones.

    Returns:
        What was made again, with what it was compared with.

    Raises:
        LeaderboardError: The stored prediction is damaged, or cannot be made again.
    """
    stored = _stored(folder)
    if kind != "solver":
        return _made_again(stored, cell, dataset)
    unlimited = replace(cell, settings=replace(cell.settings, budget=Budget()))
    problem = build_problem(dataset, unlimited, simulators=simulators)
    target = largest("training image", stored["train_target"], problem.train_image, 1e-6)
    if "tau" not in stored or "vertices" not in stored:
        note = "not simulated again: no parameters are stored; the stored pictures were scored again"
        return Repetition(_as_stored(stored), (target,), (note,), simulated=False, same_draws=True)
    repetition = _with_stiffness(_simulated(stored, problem, (target,)), stored, problem, cell, dataset)
    if _is_the_fit(stored):
        return repetition
    generator = np.random.default_rng([seed, int(folder.name[:8], 16)])
    chosen = _chosen(stored, redrawn, generator)
    return _with_draws(repetition, stored, problem, cell, chosen, _left_out(stored, redrawn, generator))


def rescore(repetition: Repetition, cell: Cell, dataset: DrapeDataset) -> dict[str, float]:
    """Metrics of a repetition against the data.

    Args:
        repetition: From `repeat`.
        cell: The cell.
        dataset: Data to score against.

    Returns:
        Metrics by name.
    """
    if repetition.metrics is not None:
        return repetition.metrics
    return score_cell(dataset, cell, repetition.prediction)


def _stored(folder: Path) -> dict[str, ndarray]:
    try:
        stored = load_prediction(folder)
    except BadFile as error:
        raise LeaderboardError(f"{folder / PREDICTION_FILE} cannot be read ({error}); run the cell again") from error
    missing = [name for name in ("train_image", "train_target", "draws") if name not in stored]
    if missing:
        raise LeaderboardError(f"{folder / PREDICTION_FILE} lacks {missing[0]!r}; run the cell again")
    return stored


def _made_again(stored: dict[str, ndarray], cell: Cell, dataset: DrapeDataset) -> Repetition:
    """A row without physics, solved and scored anew in a folder of its own."""
    with tempfile.TemporaryDirectory() as scratch:
        store = Store(Path(scratch))
        result = run_cell(dataset, cell, store, lambda fraction, loss, message: None)
        if result["status"] != "done":
            raise LeaderboardError(f"{cell.solver} cannot be made again: {result['failure']}")
        again = load_prediction(store.folder(cell.key))
    checks = tuple(largest(_NAMES[name], stored[name], again[name], 1e-6) for name in _NAMES)
    return Repetition(_as_stored(again), checks, same_draws=True, metrics=result["metrics"])


def _as_stored(stored: dict[str, ndarray]) -> Prediction:
    """The stored pictures as a prediction."""
    return Prediction(
        train_image=np.asarray(stored["train_image"], dtype=np.float64),
        draws=from_levels(stored["draws"]),
        vertices=stored.get("vertices"),
        faces=stored.get("faces"),
        draw_vertices=stored.get("draw_vertices"),
        draw_turned=stored.get("draw_turned"),
    )


def _simulated(stored: dict[str, ndarray], problem: DrapeProblem, checks: tuple[Check, ...]) -> Repetition:
    faces = problem.simulator.mesh.faces
    if stored["tau"].shape != (problem.dimension,) or not np.array_equal(stored.get("faces", faces), faces):
        raise LeaderboardError(
            f"the stored prediction must have {problem.dimension} parameters on {problem.simulator.mesh.vertices} "
            f"vertices, got {stored['tau'].size}; it belongs to another problem"
        )
    material, vertices, image = _draped(problem, stored["tau"], stored["vertices"])
    pixel = pixel_tolerance(problem.protocol)
    checks += tuple(
        relative(name, stored[name], getattr(material, name).numpy())
        for name in ("stretch", "bending", "density")
        if name in stored
    )
    checks += (moved("shape [m]", stored["vertices"], vertices), largest("fit", stored["train_image"], image, pixel))
    if _is_the_fit(stored):
        checks += (largest("draws", stored["draws"][0] / 255, image, pixel + ROUNDED),)
    return Repetition(Prediction(image, image[None], stored["tau"], vertices, faces, vertices[None]), checks)


def _with_stiffness(
    fit: Repetition, stored: dict[str, ndarray], problem: DrapeProblem, cell: Cell, dataset: DrapeDataset
) -> Repetition:
    """A repeated fit with the stiffness of its parameters, or of draws from its posterior."""
    prediction = replace(fit.prediction, posterior=stored_posterior(stored) or None)
    true = true_stiffness(dataset, cell.cloth)
    found, drawn = find_stiffness(make_solver(cell.solver), problem, prediction, true)
    again = replace(fit, stiffness=found)
    if drawn is None or "bending_draws" not in stored:
        return again
    return replace(again, checks=(*fit.checks, relative("stiffness of draws", stored["bending_draws"], drawn)))


def _draped(problem: DrapeProblem, tau: ndarray, start: ndarray) -> tuple[Material, ndarray, ndarray]:
    """Material, shape [m] and silhouette of the drape at tau; `start` is where an equilibrium is said to be.

    Raises:
        DrapeDiverged: The drape fails.
    """
    with torch.no_grad():
        vector, warm = torch.as_tensor(tau, dtype=torch.float64), _start(start, problem)
        vertices = problem.simulate(vector[None], warm).member(0).vertices
        return problem.space.specimen(vector).material, vertices.numpy(), problem.render(vertices).numpy()


def _with_draws(
    fit: Repetition,
    stored: dict[str, ndarray],
    problem: DrapeProblem,
    cell: Cell,
    chosen: list[int],
    left_out: list[int],
) -> Repetition:
    """A repeated fit with the stored draws: the chosen ones are drawn and draped again, and those left out tried."""
    again, shapes, pixel = fit.prediction, stored.get("draw_vertices"), pixel_tolerance(problem.protocol)
    drawn = replace(
        _as_stored(stored), train_image=again.train_image, tau=again.tau, vertices=again.vertices, faces=again.faces
    )
    checks, told = list(_rendered(stored, problem)), "none of them was simulated again"
    redone = False
    if shapes is not None and chosen and all(check.holds for check in checks):
        redone = True
        solver, numbers = make_solver(cell.solver), stored["posterior_draws"]
        posterior = stored_posterior(stored)
        draping, pairs = problem.at_pace(solver.pace_of_draws), []
        for place in chosen:
            tau = solver.redraw(problem, posterior, int(numbers[place]))
            _, vertices, image = _draped(draping, tau, shapes[place])
            shift = moved("shapes of redraws [m]", shapes[place], vertices)
            pairs.append((shift, largest("redraws", stored["draws"][place] / 255, image, pixel + ROUNDED)))
        checks += [max(group, key=lambda check: check.difference) for group in zip(*pairs, strict=True)]
        doubled = len(numbers) - len(np.unique(numbers))
        checks.append(Check("numbers of draws", doubled, 0.0, f"{doubled} are there twice"))

        def at_rest(tried: list[int]) -> list[int]:
            drawn = ((number, solver.redraw(problem, posterior, number)) for number in tried)
            return [number for number, tau in drawn if draping.draw_batch(tau[None])[0] is not None]

        following = _following(stored, solver.draws_asked_for, len(chosen))
        resting = at_rest(left_out) + min(map(at_rest, following), key=len, default=[])
        checks.append(Check("draws left out", len(resting), 0.0, f"come to rest: {', '.join(map(str, resting))}"))
        told = f"{len(chosen)} of them, chosen at random, were drawn and simulated again"
    note = f"{len(stored['draws'])} draws were scored again; {told}"
    checks = (*fit.checks, *checks)
    return replace(fit, prediction=drawn, checks=checks, notes=(note,), simulated=redone, same_draws=True)


def _chosen(stored: dict[str, ndarray], count: int, generator: np.random.Generator) -> list[int]:
    """Places of draws to make again; none where no posterior is stored, or it does not number the draws."""
    numbers = stored.get("posterior_draws", np.zeros(0))
    if len(numbers) != len(stored["draws"]):
        return []
    return sorted(generator.choice(len(numbers), min(count, len(numbers)), replace=False).tolist())


def _left_out(stored: dict[str, ndarray], count: int, generator: np.random.Generator) -> list[int]:
    """Some numbers that no stored draw has and a later one of the same face is above."""
    numbers = stored.get("posterior_draws", np.zeros(0))
    if len(numbers) != len(stored["draws"]):
        return []
    turned = stored.get("draw_turned", np.zeros(len(numbers), dtype=bool))
    last = min(int(numbers[turned == face].max()) for face in np.unique(turned))
    missing = np.setdiff1d(np.arange(min(last, _RANGE * len(numbers))), numbers)
    return sorted(generator.choice(missing, min(count, len(missing)), replace=False).tolist())


def _following(stored: dict[str, ndarray], asked: int, count: int) -> list[list[int]]:
    """Of each face the numbers after its last draw that the solver has tried, where draws are fewer than asked for."""
    numbers = stored["posterior_draws"]
    turned = stored.get("draw_turned", np.zeros(len(numbers), dtype=bool))
    faces = np.unique(turned)
    if len(numbers) >= asked * len(faces):
        return []
    step, end = len(faces), MOST * asked * len(faces)
    return [list(range(int(numbers[turned == face].max()) + step, end, step))[:count] for face in faces]


def _start(vertices: ndarray, problem: DrapeProblem) -> Tensor | None:
    """An equilibrium is one of many, so it is sought from where it is said to be."""
    if problem.simulator.settings.mode != "equilibrium":
        return None
    return torch.as_tensor(vertices)[None]


def _is_the_fit(stored: dict[str, ndarray]) -> bool:
    """Whether the only draw is the fit, as for solvers that answer with one drape."""
    shapes = stored.get("draw_vertices")
    return len(stored["draws"]) == 1 and shapes is not None and np.array_equal(shapes[0], stored["vertices"])


def _rendered(stored: dict[str, ndarray], problem: DrapeProblem) -> Iterator[Check]:
    """Pictures of all draws, made again from their stored shapes."""
    shapes = stored.get("draw_vertices")
    if shapes is None:
        return
    if len(shapes) != len(stored["draws"]):
        yield Check("draws", inf, 0.0, f"{len(shapes)} shapes for {len(stored['draws'])} pictures")
        return
    worst = 0.0
    for shape, picture in zip(shapes, stored["draws"], strict=True):
        with torch.no_grad():
            image = problem.render(torch.as_tensor(shape, dtype=torch.float64)).numpy()
        worst = max(worst, float(np.abs(picture / 255 - image).max()))
    tolerance = ROUNDED if shapes.dtype == np.float64 else pixel_tolerance(problem.protocol)
    yield Check("pictures of draws", worst, tolerance, f"a pixel differs by {worst:.2g}")
