"""Makes an atlas: drapes of fabrics all over the base model's parameters, with and without every effect, once.

A point of the atlas is a fabric theta (scrambled Sobol points over the base model's range) with a few samples, each
draped on both sides. Every effect is then added, with a random severity, direction and place, to *the same* samples:
under common random numbers the difference is the effect's alone. What is kept of each drape is its silhouette, so a
point weighs kilobytes; each file is written when its drapes are done, and a build that was stopped goes on where it
was. `cusick_bench.diagnosis.atlas.emulator` turns the points into smooth functions of theta and severity.
"""

import json
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import SETTINGS, BaseModel
from cusick_bench.diagnosis.atlas.design import (
    BASE,
    FINE,
    FINEST,
    FINEST_SAMPLES,
    FINEST_VERTICES,
    LAWS,
    ONE_MESH,
    SEED,
    Design,
    at_fine,
)
from cusick_bench.diagnosis.atlas.observation import drape_and_observe, observe
from cusick_bench.diagnosis.atlas.points import DESIGN_FILE, is_made, point_file, read_design, write_point
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.runner.processes import process_pool
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import Effect, Parameter, registered
from cusick_bench.sim.effects.effect_timing import acts_later
from cusick_bench.sim.setup import Setup, Simulators, drape_setups

CHEAP_SETTINGS = replace(SETTINGS, law="paper")
_SHORT_STEPS = replace(CHEAP_SETTINGS, steps=150, step_seconds=0.03)
LEAST, MOST = 0.7, 6.0  # range of severities, in typical ones
_PATCH_RADIUS = (0.097, 0.147)  # [m]
_PATCH_SIZE = (0.012, 0.032)  # [m]
_MOST_SIMULATORS = 40


def build(
    folder: Path, design: Design, *, workers: int = 1, progress: Callable[[int, int], None] = lambda done, total: None
) -> None:
    """Makes all points that are not there yet, or that other versions of the code have made.

    Args:
        folder: Where the atlas is made; created.
        design: What it is made of; must be that of the points that are there.
        workers: Number of processes.
        progress: Called with the number of tasks that are done and the number of all tasks.

    Raises:
        DiagnosisError: The folder holds an atlas of another design.
        BadFile: A point's file is damaged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _check_design(folder, design)
    tasks = design.tasks()
    open_tasks = [task for task in tasks if not is_made(point_file(folder, *task))]
    done = len(tasks) - len(open_tasks)
    progress(done, len(tasks))
    fabrics = [(point, [name for _, name in group]) for point, group in groupby(open_tasks, key=lambda task: task[0])]
    for finished in _make_all(folder, design, fabrics, workers):
        done += finished
        progress(done, len(tasks))


def make_points(
    folder: Path, design: Design, point: int, names: Sequence[str], simulators: Simulators | None = None
) -> int:
    """Makes points of one fabric and writes their files.

    Args:
        folder: Folder of the atlas.
        design: What it is made of.
        point: Number of the fabric.
        names: Effects, or `BASE` and the like.
        simulators: Simulators that are reused from fabric to fabric.

    Returns:
        Number of points that were made.
    """
    kept = simulators or Simulators(most=_MOST_SIMULATORS)
    theta = design.theta()[point]
    effects = registered()
    for model, base, named in (
        (BaseModel(design.vertices, CHEAP_SETTINGS), BASE, {name: name for name in effects}),
        (BaseModel(meshes=1, first_mesh=point), FINE, {at_fine(name): name for name in effects}),
    ):
        wanted = [name for name in names if name == base or name in named]
        if not wanted:
            continue
        setups = model.samples(theta, design.samples, (SEED, point))
        positions: list[torch.Tensor | None] = []  # of the base drapes: imaging effects only change the picture
        if any(name == base or effects[named[name]].kind == "imaging" for name in wanted):
            with torch.no_grad():
                positions = drape_setups(setups, kept)
        for name in wanted:
            if name == base:
                value, radii = np.zeros(0), observe(setups, positions)
            else:
                value, radii = _with_effect(effects[named[name]], point, setups, positions, kept)
            write_point(point_file(folder, point, name), value, radii.reshape(design.samples, 2, -1))
    for name in names:
        if name in (FINEST, LAWS, ONE_MESH):
            changed = _other_model(design, point, name)
            setups = changed.samples(theta, FINEST_SAMPLES if name == FINEST else design.samples, (SEED, point))
            radii = drape_and_observe(setups, Simulators() if name == FINEST else kept)
            write_point(point_file(folder, point, name), np.zeros(0), radii.reshape(-1, 2, radii.shape[-1]))
    return len(names)


def random_value(effect: Effect, generator: np.random.Generator) -> dict[str, float]:
    """Random parameters: severity (log-uniform, either sign where that means something), direction and place.

    Args:
        effect: The effect.
        generator: Random generator of the draw.

    Returns:
        Its parameters by name.
    """
    value = {}
    for p in effect.parameters:
        if p.role == "severity":
            size = p.typical * float(np.exp(generator.uniform(np.log(LEAST), np.log(MOST))))
            sign = -1.0 if effect.signed and generator.random() < 0.5 else 1.0
            value[p.name] = _within(p, sign * size)
        elif p.role == "direction":
            value[p.name] = _within(p, generator.uniform(0, 360))
        elif p.role == "radius":
            value[p.name] = _within(p, generator.uniform(*_PATCH_RADIUS))
        else:
            low, high = _PATCH_SIZE if effect.located == "patch" else (0.5 * p.default, 2 * p.default)
            value[p.name] = _within(p, generator.uniform(low, high))
    return value


def _within(parameter: Parameter, value: float) -> float:
    return float(np.clip(value, parameter.low, parameter.high))


def _check_design(folder: Path, design: Design) -> None:
    path = folder / DESIGN_FILE
    if not path.exists():
        write_atomically(path, json.dumps(asdict(design)).encode())
    elif (known := read_design(path)) != design:
        raise DiagnosisError(
            f"{folder} holds an atlas of another design, {known}; give another --out, or the same options"
        )


def _make_all(folder: Path, design: Design, fabrics: list[tuple[int, list[str]]], workers: int) -> Iterator[int]:
    """Makes points of several fabrics; gives the number of those that are finished, fabric by fabric."""
    if workers <= 1:
        simulators = Simulators(most=_MOST_SIMULATORS)
        for point, names in fabrics:
            yield make_points(folder, design, point, names, simulators)
        return
    with process_pool(workers) as pool:
        for future in [pool.submit(make_points, folder, design, point, names) for point, names in fabrics]:
            yield future.result()


def _other_model(design: Design, point: int, name: str) -> BaseModel:
    """Another model of the same samples, whose random fields, as functions of place, do not depend on the mesh."""
    if name == FINEST:
        return BaseModel(FINEST_VERTICES, meshes=1, first_mesh=point)
    if name == LAWS:
        return BaseModel(design.vertices, _SHORT_STEPS, other_laws=True)
    return BaseModel(design.vertices, CHEAP_SETTINGS, meshes=1, first_mesh=100 + point)  # a mesh of the fabric's own


def _with_effect(
    effect: Effect, point: int, setups: list[Setup], positions: list[torch.Tensor | None], simulators: Simulators
) -> tuple[ndarray, ndarray]:
    """Random parameters of an effect, and the silhouettes of the drapes with it."""
    generator = np.random.default_rng([SEED, point, zlib.crc32(effect.name.encode())])
    chosen = random_value(effect, generator)
    value = np.array([chosen[p.name] for p in effect.parameters])
    changed = [effect.apply(setup, chosen) for setup in _as_later(effect, setups)]
    if effect.kind != "imaging":
        return value, drape_and_observe(changed, simulators)
    pictures = [None if where is None else one.seen[-1](where) for one, where in zip(changed, positions, strict=True)]
    return value, observe(changed, pictures)


def _as_later(effect: Effect, setups: list[Setup]) -> list[Setup]:
    """Setups of the captures that show an effect: the next ones of each face if it acts with time."""
    if not acts_later(effect):
        return setups
    return [replace(setup, later=True, capture=setup.capture + 1) for setup in setups]
