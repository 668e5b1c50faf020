"""Drops a polar plate: implicit Euler with steps that grow as the cloth comes to rest, air drag, loads.

Per step, (M (1 + h c) + h^2 K) v' = M v + h F with the consistent mass matrix M, c the drag of the air.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.withheld.world.fabric import BEND, growth_share
from cusick_bench.withheld.world.polar import band, kernels
from cusick_bench.withheld.world.polar.grid import PolarGrid
from cusick_bench.withheld.world.polar.history import PointVariables
from cusick_bench.withheld.world.polar.material import PlateMaterial
from cusick_bench.withheld.world.scene import Scene, gravity_vector

_FIRST, _LONGEST, _LONGER = 0.02, 0.12, 1.03  # [s] the first step, the longest one, and the factor between two
_DRAG = 0.8  # [1/s]
_FAR = 1.0  # [m]
_REST = 2e-5  # [m/s] below which a cloth without internal variables is at rest

Displacements = Float[ndarray, "unknowns 3"]


@dataclass(frozen=True, eq=False)
class PolarPlate:
    """A plate under its loads.

    Attributes:
        grid: Where it is integrated.
        material: What it is made of.
        mass: Mass of each point [kg].
        scene: Its loads.
    """

    grid: PolarGrid
    material: PlateMaterial
    mass: Float[ndarray, "intervals points"]
    scene: Scene


def zero_band(grid: PolarGrid) -> Float[ndarray, "size width"]:
    """A band matrix of all displacements, as `band` and `kernels` want it.

    Args:
        grid: Where the plate is integrated.

    Returns:
        Zeros.
    """
    return np.zeros((3 * grid.rows * grid.angular, 21 * grid.rows))  # 6 rings apart at most, and 3 axes each


def projected(grid: PolarGrid, height: Float[ndarray, "intervals points"]) -> Displacements:
    """The displacement whose height is nearest to a given one.

    Args:
        grid: Where the plate is integrated.
        height: Heights of the points [m].

    Returns:
        The displacement, in least squares over the area.
    """
    matrix, right = zero_band(grid), np.zeros((grid.rows * grid.angular, 3))
    kernels.add_mass(grid.unknowns, grid.value, grid.weight, matrix)
    load = (grid.weight * height)[..., None] * np.array([0.0, 0.0, 1.0])
    kernels.spread(grid.unknowns, grid.value, load, right)
    band.factorise(matrix)
    flat = right.ravel()
    band.solve(matrix, flat)
    return flat.reshape(-1, 3)


def drop(plate: PolarPlate, u: Displacements, steps: int) -> tuple[Displacements, dict[str, ndarray]]:
    """Drops one cloth.

    Args:
        plate: The cloth and its loads.
        u: Displacements in which it is laid down [m].
        steps: Most steps; a cloth at rest needs no more.

    Returns:
        Displacements [m], and what each law keeps for the sample's next picture, by name of the law.

    Raises:
        DrapeDiverged: The cloth flies apart.
    """
    grid, material = plate.grid, plate.material
    variables = [start(material, plate.scene) for start in plate.scene.internal_variables]
    inertia = zero_band(grid)
    kernels.add_mass(grid.unknowns, grid.value, plate.mass, inertia)
    matrix, v, h = np.empty_like(inertia), np.zeros_like(u), _FIRST
    state = _State(grid)
    for step in range(steps):
        state.update(u)
        now = _advanced(variables, state, material, h)
        force = _load(plate, state)
        np.multiply(inertia, 1 + h * _DRAG, out=matrix)
        _elastic(grid, now, u, h * h, force, matrix)
        right = kernels.times(inertia, v.ravel()) + h * force.ravel()
        if not band.factorise(matrix):
            raise DrapeDiverged(f"step {step + 1} of {steps}: the matrix is not positive definite; use weaker loads")
        band.solve(matrix, right)
        v = right.reshape(-1, 3)
        u = u + h * v
        if not np.abs(u).max() < _FAR:
            raise DrapeDiverged(f"step {step + 1} of {steps}: the cloth flies apart; use weaker loads")
        if np.abs(v).max() < _REST and not variables:
            break
        h = min(_LONGER * h, _LONGEST)
    state.update(u)
    kept = {type(law).__name__: law.carried_over(state.curvature) for law in variables}
    return u, {name: value for name, value in kept.items() if value is not None}


class _State:
    """Positions, strains and curvatures at the points."""

    def __init__(self, grid: PolarGrid) -> None:
        self.grid = grid
        self.moved, self.area, self.strain, self.curvature = (np.zeros((*grid.weight.shape, 3)) for _ in range(4))

    def update(self, u: Displacements) -> None:
        """Evaluates all points at some displacements."""
        grid = self.grid
        kernels.strains(
            grid.unknowns, u, grid.value, grid.slopes, self.moved, self.area, self.strain, self.curvature
        )  # fmt: skip


def _advanced(variables: list[PointVariables], state: _State, material: PlateMaterial, h: float) -> PlateMaterial:
    """The material of this step, with all internal variables advanced one after the other."""
    for law in variables:
        material = law.advance(state.strain, state.curvature, material, h)
    return material


def _load(plate: PolarPlate, state: _State) -> Displacements:
    """Forces from outside on the splines [N]."""
    grid, scene = plate.grid, plate.scene
    acceleration = np.broadcast_to(gravity_vector(scene), state.moved.shape)
    if scene.accelerations:
        x = (state.moved + np.append(grid.points, np.zeros((*grid.weight.shape, 1)), -1)).reshape(-1, 3)
        more = np.sum([law(x) for law in scene.accelerations], axis=0)
        acceleration = acceleration + more.reshape(state.moved.shape)
    load = plate.mass[..., None] * acceleration
    for pressure in scene.pressures:
        normal = state.area / np.linalg.norm(state.area, axis=-1)[..., None]
        push = pressure(normal.reshape(-1, 3)).reshape(grid.weight.shape)
        load = load + (push * grid.weight)[..., None] * state.area
    force = np.zeros((grid.rows * grid.angular, 3))
    kernels.spread(grid.unknowns, grid.value, load, force)
    return force


def _elastic(
    grid: PolarGrid, material: PlateMaterial, u: Displacements, factor: float, force: Displacements, matrix: ndarray
) -> float:
    """Adds elastic forces, and their stiffness times a factor; returns the energy [J]."""
    growth = material.growth * float(growth_share(np.array(np.inf)))
    return kernels.elasticity(
        grid.unknowns, u, grid.stretch_weight, grid.weight, grid.slopes, material.stretch, material.rest_strain,
        material.bending, material.rest_curvature, growth, BEND, factor, force, matrix,
    )  # fmt: skip
