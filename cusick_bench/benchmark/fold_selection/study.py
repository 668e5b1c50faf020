"""Drapes a cloth under each condition, several times, and measures the folds.

Draw i of every condition has the same random numbers: the same shape is laid down longer, higher, or on another mesh.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from cusick_bench.benchmark.convergence.plate_cloth import plate_cloth
from cusick_bench.benchmark.fold_selection.conditions import Condition, Level
from cusick_bench.benchmark.fold_selection.responses import FoldResponses, fold_responses
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.cloth.shape import SmoothField, smooth_field
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects.boundary.plate_slip import PlateSlip
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.sim.setup import Field, Setup, Simulators, drape_setups

_POISSON = 0.15  # middle of what cloths have; laws with a fixed one take no notice
_SHEAR = 3  # column of the stretch table that holds shear stiffness
_REST_LENGTH = 0.03  # [m] correlation length of the rest shape
_TOLERANCE = 1e-6  # of the weight, to which a cloth comes to rest under a part of it


@dataclass(frozen=True)
class FoldRow:
    """Folds under one condition.

    Attributes:
        factor: Name of the factor.
        label: Level of the factor.
        condition: How the drapes were made.
        failed: Drapes that did not come to rest or flew apart.
        responses: What was measured on the others.
    """

    factor: str
    label: str
    condition: Condition
    failed: int
    responses: FoldResponses


def fold_rows(
    levels: Sequence[Level], draws: int, *, seed: int = 0, done: Callable[[Level], None] = lambda level: None
) -> list[FoldRow]:
    """Drapes every level; a condition that stands in several factors is draped once.

    Args:
        levels: What to compare.
        draws: Drapes a condition.
        seed: Seed of the laid shapes, rest shapes and slides.
        done: Called after every level.

    Returns:
        A row a level.
    """
    measured: dict[Condition, tuple[int, FoldResponses]] = {}
    rows = []
    for level in levels:
        condition = level.condition
        if condition not in measured:
            images = drape_images(condition, draws, seed=seed)
            measured[condition] = (draws - len(images), fold_responses(images))
        rows.append(FoldRow(level.factor, level.label, condition, *measured[condition]))
        done(level)
    return rows


def drape_images(condition: Condition, draws: int, *, seed: int = 0) -> list[Float[ndarray, "height width"]]:
    """Silhouettes of drapes made in one way.

    Args:
        condition: The way.
        draws: Number of drapes.
        seed: Seed of what is random about them.

    Returns:
        Silhouettes of those that come to rest.
    """
    setups = [_setup(condition, seed, draw) for draw in range(draws)]
    with torch.no_grad():
        shapes = _slowly_released(setups, condition.stages) if condition.stages else drape_setups(setups)
        return [
            render(shape, setup.faces, ParallelCamera()).numpy()
            for shape, setup in zip(shapes, setups, strict=True)
            if shape is not None
        ]


def _setup(condition: Condition, seed: int, draw: int) -> Setup:
    generator = np.random.default_rng([seed, draw])
    laying = smooth_field(condition.laying_height, condition.laying_length, generator)
    rest = smooth_field(condition.rest_height, _REST_LENGTH, generator)
    alone = condition.slide > 0 or condition.stages > 0  # a mesh of its own, or one by one: no batch for lockstep
    settings = DrapeSettings(
        law=condition.law, steps=condition.steps, step_seconds=condition.step_seconds,
        backend="auto" if alone else "lockstep",
    )  # fmt: skip
    setup = Setup(
        _mesh(condition, seed), settings, _cloth(condition),
        laying=_as_field(laying), rest=_as_field(rest) if condition.rest_height > 0 else None,
        laying_seed=(seed, draw),
    )  # fmt: skip
    return PlateSlip().apply(setup, {"slide": condition.slide})


def _cloth(condition: Condition) -> Material:
    material = plate_cloth(condition.ln_bending, _POISSON, condition.law)
    stretch = material.stretch.clone()
    stretch[..., _SHEAR] = condition.shear
    return replace(material, stretch=stretch)


def _mesh(condition: Condition, seed: int) -> Mesh:
    """Rings for the law that converges on them, the irregular mesh of atlas and table 1 for the others."""
    return ring_mesh(condition.vertices) if condition.law == "plate" else disc_mesh(condition.vertices, seed=seed)


def _as_field(smooth: SmoothField) -> Field:
    return lambda points: torch.from_numpy(smooth(points.numpy()))


def _slowly_released(setups: Sequence[Setup], stages: int) -> list[Tensor | None]:
    """Rests under a weight that grows part by part, each from the one before: a cloth let down without swinging."""
    simulators, found = Simulators(), []
    for setup in setups:
        settings = replace(setup.settings, mode="equilibrium", tolerance=_TOLERANCE)
        simulator = simulators.get(setup.mesh, settings)
        found.append(_rest(simulator, setup, stages))
    return found


def _rest(simulator: DrapeSimulator, setup: Setup, stages: int) -> Tensor | None:
    initial, cloth = setup.initial()[None], setup.cloth()
    rest_angle, shape = setup.rest_angle()[None], initial
    for stage in range(1, stages + 1):
        part = replace(cloth, density=cloth.density * (stage / stages))
        batch = simulator.drape_batch([part], initial=initial, rest_angle=rest_angle, warm=shape)
        if batch.failures[0] is not None:
            return None
        shape = batch.vertices
    return setup.to_camera(shape[0])
