"""How far a drop is from the rest that it tends to, and what a shorter time step changes.

A drop ends after a number of steps, an equilibrium where the net force vanishes: where both have the same folds they
are on one branch of rests, and more steps bring the drop nearer to it. A shorter step changes more than accuracy:
implicit Euler damps motion by its step, so which folds a cloth falls into depends on it. What counts is the change of
the statistics against their spread between draws.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from cusick_bench.benchmark.convergence.mesh_dependence import (
    NAMES,
    StatisticChange,
    silhouette_statistics,
    statistic_changes,
)
from cusick_bench.sim.cloth.irregular import jittered_mesh
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.branch import follow
from cusick_bench.sim.errors import DrapeDiverged

FOLD_STATISTICS = ("area_dc", "folds", "fold_centroid", "fold_depth")
"""Statistics whose change by the time step is shown."""


@dataclass(frozen=True)
class RestRow:
    """Drops of some number of steps against the rests that they tend to.

    Attributes:
        steps: Number of steps.
        step_seconds: Time step [s].
        draws: Draws that have both.
        at_rest: Share of the drops whose net force is small (5 % of the weight).
        same_branch: Share of the drops with as many folds as their rest.
        distance_mm: Of these, the largest distance of a vertex from its place at rest, mean over the draws [mm].
        drape_coefficient_points: Of these, the mean size of the difference of the drape coefficients [points].
    """

    steps: int
    step_seconds: float
    draws: int
    at_rest: float
    same_branch: float
    distance_mm: float
    drape_coefficient_points: float


@dataclass(frozen=True)
class StepChange:
    """Change by halving the time step, over the same time of fall.

    Attributes:
        step_seconds: Step [s].
        halved_seconds: Half of it [s].
        draws: Draws that diverge at neither.
        statistics: Changes of `FOLD_STATISTICS`, halved minus whole, in standard deviations between draws.
    """

    step_seconds: float
    halved_seconds: float
    draws: int
    statistics: tuple[StatisticChange, ...]


@dataclass(frozen=True)
class TimeStep:
    """Convergence in time on meshes of one size.

    Attributes:
        vertices: Mesh size.
        rests: Drops against rests, by number of steps.
        halvings: Changes by halving the step, again and again.
    """

    vertices: int
    rests: tuple[RestRow, ...]
    halvings: tuple[StepChange, ...]


def time_step(
    size: int,
    draws: int,
    material: Material,
    settings: DrapeSettings,
    *,
    steps: Sequence[int],
    halvings: int,
    jitter: float = 0.0,
    seed: int = 0,
    done: Callable[[int], None] = lambda drapes: None,
) -> TimeStep:
    """Compares drops with rests, and with drops at shorter time steps.

    Args:
        size: Number of vertices.
        draws: Drapes, each on a mesh and from a laid-down shape of its own.
        material: The cloth, homogeneous.
        settings: Law and time step; the number of steps is that of `steps`, and the last of these is the time of
            fall at which the step is halved.
        steps: Numbers of steps after which drops are compared with rests, at least one.
        halvings: How often the step is halved.
        jitter: Share of the spacing by which interior vertices are moved.
        seed: Seed of the first mesh and shape.
        done: Called with the number of drapes made, `drapes_of_time_step` in all.

    Returns:
        The comparisons.

    Raises:
        SimulationError: The law has no rests, or a size or jitter is out of range.
    """
    numbers = range(seed, seed + draws)
    meshes = [jittered_mesh(cloth_mesh(settings.law, size, seed=number), jitter, seed=number) for number in numbers]
    rests = tuple(_rest_row(meshes, numbers, material, replace(settings, steps=n), done) for n in steps)
    whole, time = (
        _statistics(meshes, numbers, material, replace(settings, steps=steps[-1]), done),
        settings.step_seconds,
    )
    changes = []
    for halving in range(1, halvings + 1):
        shorter = replace(settings, steps=steps[-1] * 2**halving, step_seconds=time / 2)
        halved = _statistics(meshes, numbers, material, shorter, done)
        both, found = statistic_changes(halved, whole)
        shown = tuple(one for one in found if one.name in FOLD_STATISTICS)
        changes.append(StepChange(time, time / 2, both, shown))
        whole, time = halved, time / 2
    return TimeStep(size, rests, tuple(changes))


def drapes_of_time_step(draws: int, steps: Sequence[int], halvings: int) -> int:
    """How many drapes `time_step` makes.

    Args:
        draws: Draws.
        steps: Numbers of steps.
        halvings: How often the step is halved.

    Returns:
        The number.
    """
    return draws * (2 * len(steps) + 1 + halvings)


def _rest_row(
    meshes: Sequence[Mesh],
    numbers: Sequence[int],
    material: Material,
    settings: DrapeSettings,
    done: Callable[[int], None],
) -> RestRow:
    at_rest, same, distances, differences = [], [], [], []
    for mesh, number in zip(meshes, numbers, strict=True):
        own = replace(settings, seed=number)
        try:
            with torch.no_grad():
                fallen = DrapeSimulator(mesh, own).drape(material)
                rest = DrapeSimulator(mesh, replace(own, mode="equilibrium")).drape(material)
        except DrapeDiverged:
            continue
        finally:
            done(2)
        before, after = fallen.vertices.numpy(), rest.vertices.numpy()
        branch = follow(mesh, before, after)
        at_rest.append(fallen.converged)
        same.append(not branch.changed)
        if not branch.changed:
            distances.append(1e3 * branch.moved)
            two = [silhouette_statistics(x, mesh.faces)[NAMES.index("area_dc")] for x in (before, after)]
            differences.append(100 * abs(two[0] - two[1]))
    return RestRow(
        settings.steps, settings.step_seconds, len(same), _mean(at_rest), _mean(same), _mean(distances),
        _mean(differences),
    )  # fmt: skip


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _statistics(
    meshes: Sequence[Mesh],
    numbers: Sequence[int],
    material: Material,
    settings: DrapeSettings,
    done: Callable[[int], None],
) -> np.ndarray:
    found = np.full((len(meshes), len(NAMES)), np.nan)
    for place, (mesh, number) in enumerate(zip(meshes, numbers, strict=True)):
        try:
            with torch.no_grad():
                drape = DrapeSimulator(mesh, replace(settings, seed=number)).drape(material)
            found[place] = silhouette_statistics(drape.vertices.numpy(), mesh.faces)
        except DrapeDiverged:
            pass
        done(1)
    return found
