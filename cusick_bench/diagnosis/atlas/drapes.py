"""The atlas: drapes of fabrics all over the base model's parameters, with and without every effect, made once.

A point of the atlas is a fabric theta (scrambled Sobol points over the base model's range) with a few samples, each
draped on both sides. Every effect is then added, with a random severity, direction and place, to *the same* samples:
under common random numbers the difference is the effect's alone. What is kept of each drape is its statistics, so a
point weighs kilobytes; each file is written when its drapes are done, and a build that was stopped goes on where it
was. `cusick_bench.diagnosis.atlas.emulator` turns the points into smooth functions of theta and severity.
"""

import json
import os
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.stats import qmc

from cusick_bench.datasets.profile import profile_from_mesh
from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, NAMES, BaseModel
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.statistics import NAMES as STATISTICS
from cusick_bench.diagnosis.measure.statistics import capture_statistics, mirrored
from cusick_bench.runner.processes import one_thread_each
from cusick_bench.sim.effects import Effect, registered
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.setup import Setup, Simulators, drape_setups

ANGLES = 360
BASE = "base"
FINE = "fine-mesh"
"""The base model again, on a finer mesh with shorter steps: what a simulator's own errors do to the statistics."""
LAWS = "other-laws"
"""The base model again, with membrane, bending curve and lengths that theta leaves open drawn at random."""
ONE_MESH = "one-mesh"
"""The base model again, all samples of a fabric on one mesh: what an asymmetry that they share does, be it a mesh's."""
FINE_VERTICES, _FINE_SETTINGS = 1205, DrapeSettings(steps=150, step_seconds=0.03)
NOT_SIMULATED = ("grain-skew", "density-bias", "self-contact")
"""Turned statistics, another weight, and drapes too costly for an atlas: see `emulator`."""
LEAST, MOST = 0.7, 6.0  # range of severities, in typical ones
_SEED = 71
_STIFF_IN_SHEAR = 5.8  # of theta's shear
_PATCH_RADIUS = (0.097, 0.147)  # [m]
_PATCH_SIZE = (0.012, 0.032)  # [m]


@dataclass(frozen=True)
class Design:
    """What an atlas is made of.

    Attributes:
        points: Fabrics.
        stiff_points: More of them that are stiff in shear, where little changes; of these the same shares as of the
            others have what follows.
        effect_points: How many of them, the first ones, have every effect too.
        fine_points: How many of them have drapes on a finer mesh.
        law_points: How many of them have drapes under other laws.
        one_mesh_points: How many of them have all samples on one mesh.
        samples: Samples of each, draped on both sides.
        vertices: Mesh size.
    """

    points: int = 320
    stiff_points: int = 80
    effect_points: int = 160
    fine_points: int = 100
    law_points: int = 80
    one_mesh_points: int = 80
    samples: int = 4
    vertices: int = 480

    def theta(self) -> Float[ndarray, "points parameters"]:
        """The fabrics."""
        shear = NAMES.index("shear")
        middle_low, middle_high = LOW.copy(), HIGH.copy()
        middle_low[shear] = middle_high[shear] = _STIFF_IN_SHEAR
        return np.concatenate(
            [_spread(LOW, middle_high, self.points, _SEED), _spread(middle_low, HIGH, self.stiff_points, _SEED + 1)]
        )

    def has(self, point: int, count: int) -> bool:
        """Whether a point is among the first `count`, or as large a share of the stiff ones."""
        if point < self.points:
            return point < count
        return (point - self.points) * self.points < count * self.stiff_points

    def tasks(self) -> list[tuple[int, str]]:
        """(point, effect) to simulate, in an order of which any beginning is a smaller atlas."""
        effects = [name for name in registered() if name not in NOT_SIMULATED]
        return [
            (point, name)
            for point in range(self.points + self.stiff_points)
            for name in (
                BASE,
                *([FINE] if self.has(point, self.fine_points) else ()),
                *([LAWS] if self.has(point, self.law_points) else ()),
                *([ONE_MESH] if self.has(point, self.one_mesh_points) else ()),
                *(effects if self.has(point, self.effect_points) else ()),
            )
        ]


def _spread(low: ndarray, high: ndarray, count: int, seed: int) -> Float[ndarray, "points parameters"]:
    """Scrambled Sobol points in a box."""
    whole = 1 << max(0, (count - 1).bit_length())
    unit = qmc.Sobol(len(low), rng=np.random.default_rng(seed)).random(whole)[:count]
    return low + unit * (high - low)


@dataclass(frozen=True, eq=False)
class Point:
    """Statistics of one fabric's drapes, with one effect or none.

    Attributes:
        value: Parameters of the effect in its order; empty for the base.
        statistics: Of every sample and side, in the cloth's frame; NaN where a drape failed.
    """

    value: Float[ndarray, "effect_parameters"]
    statistics: Float[ndarray, "samples sides statistics"]


def build(
    folder: Path, design: Design, *, workers: int = 1, progress: Callable[[int, int], None] = lambda done, total: None
) -> None:
    """Makes all points that are not there yet.

    Args:
        folder: Where the atlas is made; created.
        design: What it is made of; must be that of the points that are there.
        workers: Processes.
        progress: Told how many of how many tasks are done.

    Raises:
        DiagnosisError: The folder holds an atlas of another design.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _check_design(folder, design)
    tasks = design.tasks()
    open_tasks = [task for task in tasks if not _file(folder, *task).exists()]
    done = len(tasks) - len(open_tasks)
    progress(done, len(tasks))
    chunks = [list(group) for _, group in groupby(open_tasks, key=lambda task: task[0])]
    for finished in _each(folder, design, chunks, workers):
        done += finished
        progress(done, len(tasks))


def read(folder: Path) -> tuple[Design, dict[str, dict[int, Point]]]:
    """Points of an atlas by effect and number, as far as it is made.

    Raises:
        DiagnosisError: No atlas there.
    """
    path = folder / "design.json"
    if not path.exists():
        raise DiagnosisError(f"no atlas in {folder}; make one with `cusick-bench atlas build --out {folder}`")
    design = Design(**json.loads(path.read_text()))
    found: dict[str, dict[int, Point]] = {}
    for point, name in design.tasks():
        file = _file(folder, point, name)
        if file.exists():
            with np.load(file, allow_pickle=False) as arrays:
                found.setdefault(name, {})[point] = Point(arrays["value"], arrays["statistics"])
    return design, found


def statistics_of(setups: list[Setup], simulators: Simulators | None = None) -> Float[ndarray, "setups statistics"]:
    """Statistics of drapes in the cloth's frame; NaN where a drape failed."""
    with torch.no_grad():
        return observe(setups, drape_setups(setups, simulators))


def observe(setups: list[Setup], positions: list[torch.Tensor | None]) -> Float[ndarray, "setups statistics"]:
    """Statistics of drapes whose positions are known, as the camera sees them."""
    found = np.full((len(setups), len(STATISTICS)), np.nan)
    seen = [index for index, where in enumerate(positions) if where is not None]
    if not seen:
        return found
    radii = np.stack([silhouette(setups[index], positions[index]) for index in seen])
    good = np.isfinite(radii).all(1) & (radii > 0).all(1)
    values = capture_statistics(radii[good])
    down = np.array([setups[index].side == "down" for index in seen])[good]
    found[np.array(seen)[good]] = np.where(down[:, None], mirrored(values), values)
    return found


def silhouette(setup: Setup, positions: torch.Tensor | None) -> Float[ndarray, "angles"]:
    """Radius profile as the camera sees it [m]."""
    assert positions is not None
    return profile_from_mesh(positions.detach().numpy(), setup.faces, angles=ANGLES).radii


def random_value(effect: Effect, generator: np.random.Generator) -> dict[str, float]:
    """Severity (log-uniform, either sign where that means something), direction and place."""
    value = {}
    for p in effect.parameters:
        if p.role == "severity":
            size = p.typical * float(np.exp(generator.uniform(np.log(LEAST), np.log(MOST))))
            sign = -1.0 if effect.signed and generator.random() < 0.5 else 1.0
            value[p.name] = float(np.clip(sign * size, p.low, p.high))
        elif p.role == "direction":
            value[p.name] = float(generator.uniform(0, 360))
        elif p.role == "radius":
            value[p.name] = float(generator.uniform(*_PATCH_RADIUS))
        else:
            low, high = _PATCH_SIZE if effect.located == "patch" else (0.5 * p.default, 2 * p.default)
            value[p.name] = float(generator.uniform(low, high))
    return value


def samples_of(design: Design, point: int) -> list[Setup]:
    """Setups of a point's samples without effect."""
    return BaseModel(design.vertices).samples(_theta(design)[point], design.samples, (_SEED, point))


@lru_cache(maxsize=4)
def _theta(design: Design) -> ndarray:
    return design.theta()


def _file(folder: Path, point: int, name: str) -> Path:
    return folder / "points" / f"{point:04d}" / f"{name}.npz"


def _check_design(folder: Path, design: Design) -> None:
    path, text = folder / "design.json", json.dumps(asdict(design))
    if path.exists() and json.loads(path.read_text()) != json.loads(text):
        raise DiagnosisError(
            f"{folder} holds an atlas of another design, {path.read_text()}; give another --out, or the same options"
        )
    path.write_text(text)


def _each(folder: Path, design: Design, chunks: list[list[tuple[int, str]]], workers: int) -> Iterator[int]:
    if workers <= 1:
        for chunk in chunks:
            yield make(folder, design, chunk)
        return
    with one_thread_each(workers) as pool:
        for future in [pool.submit(make, folder, design, chunk) for chunk in chunks]:
            yield future.result()


_SIMULATORS = Simulators(most=40)


def make(folder: Path, design: Design, tasks: list[tuple[int, str]]) -> int:
    """Makes some points; returns their number."""
    for point, name in tasks:
        setups = samples_of(design, point)
        if name == BASE:
            value, statistics = np.zeros(0), observe(setups, _draped(folder, point, setups))
        elif name in (FINE, LAWS, ONE_MESH):
            model = _other_model(design, point, name)
            changed = model.samples(_theta(design)[point], design.samples, (_SEED, point))
            value, statistics = np.zeros(0), statistics_of(changed, _SIMULATORS)
        else:
            effect = registered()[name]
            generator = np.random.default_rng([_SEED, point, zlib.crc32(name.encode())])
            chosen = random_value(effect, generator)
            changed = [effect.apply(setup, chosen) for setup in _as_later(effect, setups)]
            statistics = _with_effect(folder, point, effect, setups, changed)
            value = np.array([chosen[p.name] for p in effect.parameters])
        _write(_file(folder, point, name), value, statistics.reshape(design.samples, 2, -1))
    return len(tasks)


def _other_model(design: Design, point: int, name: str) -> BaseModel:
    """The model that drapes the same samples otherwise: their fields are functions of the cloth's points."""
    if name == FINE:
        return BaseModel(FINE_VERTICES, _FINE_SETTINGS)
    if name == LAWS:
        return BaseModel(design.vertices, other_laws=True)
    return BaseModel(design.vertices, meshes=1, first_mesh=100 + point)  # a mesh of the fabric's own


def _as_later(effect: Effect, setups: list[Setup]) -> list[Setup]:
    """History is seen in the later captures."""
    return [replace(setup, later=True) for setup in setups] if effect.kind == "history" else setups


def _with_effect(
    folder: Path, point: int, effect: Effect, setups: list[Setup], changed: list[Setup]
) -> Float[ndarray, "setups statistics"]:
    if effect.kind != "imaging":
        return statistics_of(changed, _SIMULATORS)
    positions = _draped(folder, point, setups)  # the drape is the same, only seen otherwise
    seen = [None if where is None else one.seen[-1](where) for one, where in zip(changed, positions, strict=True)]
    return observe(changed, seen)


_LAST: dict[tuple[str, int], list[torch.Tensor | None]] = {}


def _draped(folder: Path, point: int, setups: list[Setup]) -> list[torch.Tensor | None]:
    """Positions of the base drapes of a point; those of the last point are kept."""
    key = (str(folder), point)
    if key not in _LAST:
        _LAST.clear()
        with torch.no_grad():
            _LAST[key] = drape_setups(setups, _SIMULATORS)
    return _LAST[key]


def _write(path: Path, value: ndarray, statistics: ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.tmp")
    with open(partial, "wb") as file:
        np.savez(file, value=value, statistics=statistics)
    partial.replace(path)
