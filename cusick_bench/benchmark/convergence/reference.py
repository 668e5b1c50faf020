"""Drapes of an ideal plate, simulated and compared with a table of reference drapes.

A disc of the standard's size is clamped along the plate's edge, laid down raised by 6 mm cos(m theta) s^2, where s runs
from 0 at the plate's edge to 1 at the rim, and comes to rest (mode `equilibrium`); m is the number of folds, and 0
stands for the flat cloth. Its rim is read as a smooth curve.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.benchmark.convergence.order import Order, observed_order
from cusick_bench.benchmark.convergence.plate_cloth import GRAVITY, plate_cloth, poisson_of
from cusick_bench.datasets.files.plate_drapes import PlateDrape
from cusick_bench.sim.cloth.irregular import jittered_mesh
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.cloth.rim import rim_curve
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS, Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import Clamp, DrapeSettings, Membrane
from cusick_bench.sim.engine.statics.branch import rim_folds
from cusick_bench.sim.errors import DrapeDiverged

_RAISED = 6e-3  # [m]
_POINTS = 100  # points of a drape coefficient of 1


@dataclass(frozen=True)
class PlateComparison:
    """One reference drape on the meshes of one size: means over those on which it came to rest, None where on none.

    Attributes:
        folds, ln_bending, poisson: The row of the reference.
        poisson_simulated: Poisson's ratio with which the law bends.
        vertices: Mesh size.
        meshes: Meshes on which the cloth came to rest.
        drape_coefficient: Drape coefficient of the smooth rim's projection.
        drape_coefficient_sd_points: Standard deviation over the meshes [points]; None of fewer than two.
        error_points: Drape coefficient minus the reference's [points].
        accuracy_points: The reference's own error [points].
        rim_min_mm, rim_max_mm: Least and largest radius of the projected rim [mm].
        rim_lowest_mm: Lowest height of the rim [mm].
        rim_min_error_mm, rim_max_error_mm, rim_lowest_error_mm: The same minus the reference's [mm].
        deflection_ratio: Mean way by which the rim sinks over the reference's; None for a drape with folds.
        folds_found: Folds that stand out on each mesh; others than `folds` tell of another branch of rests.
        seconds: Mean wall time of a drape [s].
        failures: Why the cloth did not come to rest, a line a mesh.
    """

    folds: int
    ln_bending: float
    poisson: float
    poisson_simulated: float
    vertices: int
    meshes: int
    drape_coefficient: float | None
    drape_coefficient_sd_points: float | None
    error_points: float | None
    accuracy_points: float
    rim_min_mm: float | None
    rim_max_mm: float | None
    rim_lowest_mm: float | None
    rim_min_error_mm: float | None
    rim_max_error_mm: float | None
    rim_lowest_error_mm: float | None
    deflection_ratio: float | None
    folds_found: tuple[int, ...]
    seconds: float | None
    failures: tuple[str, ...]


@dataclass(frozen=True)
class PlateOrder:
    """Observed orders of the errors for one reference drape; None where fewer than two sizes have an error to judge.

    Attributes:
        folds, ln_bending, poisson: The row of the reference.
        drape_coefficient: Order of the errors of the drape coefficient that are above the reference's own.
        deflection: Order of the errors of the deflection, for a drape without folds.
    """

    folds: int
    ln_bending: float
    poisson: float
    drape_coefficient: Order | None
    deflection: Order | None


def compare_with_reference(
    drapes: Sequence[PlateDrape],
    sizes: Sequence[int],
    law: Law,
    *,
    clamp: Clamp | None = None,
    membrane: Membrane | None = None,
    meshes: int = 1,
    jitter: float = 0.0,
    seed: int = 0,
    done: Callable[[int], None] = lambda drapes: None,
) -> list[PlateComparison]:
    """Simulates reference drapes on meshes of several sizes.

    Args:
        drapes: The reference.
        sizes: Numbers of vertices.
        law: Material law with an energy.
        clamp: How hinges on the plate's edge bend (see `DrapeSettings`).
        membrane: Whether it is softened (likewise).
        meshes: Meshes of each size.
        jitter: Share of the spacing by which interior vertices are moved.
        seed: Seed of the first mesh.
        done: Called with the number of drapes made.

    Returns:
        An entry for every drape and size, size by size; drapes that do not come to rest are told in it.

    Raises:
        SimulationError: The law has no rests, or a size or jitter is out of range.
    """
    settings = DrapeSettings(law=law, clamp=clamp, membrane=membrane, mode="equilibrium", gravity=GRAVITY)
    found = []
    for size in sizes:
        seeds = range(seed, seed + meshes)
        own = [jittered_mesh(cloth_mesh(law, size, seed=number), jitter, seed=number) for number in seeds]
        simulators = [DrapeSimulator(mesh, settings) for mesh in own]
        for drape in drapes:
            trials = []
            for simulator in simulators:
                trials.append(_trial(simulator, drape))
                done(1)
            found.append(_comparison(drape, size, law, trials))
    return found


def reference_orders(comparisons: Sequence[PlateComparison]) -> list[PlateOrder]:
    """Observed orders of the errors for every reference drape.

    Args:
        comparisons: Drapes on meshes of several sizes.

    Returns:
        An entry a drape, in their order.
    """
    rows: dict[tuple[int, float, float], list[PlateComparison]] = {}
    for one in comparisons:
        rows.setdefault((one.folds, one.ln_bending, one.poisson), []).append(one)
    orders = []
    for key, own in rows.items():
        sizes = [one.vertices for one in own]
        points = [np.nan if one.error_points is None else one.error_points for one in own]
        ratios = [np.nan if one.deflection_ratio is None else one.deflection_ratio - 1 for one in own]
        coefficient = observed_order(sizes, points, least=own[0].accuracy_points)
        orders.append(PlateOrder(*key, coefficient, observed_order(sizes, ratios)))
    return orders


def raised(mesh: Mesh, folds: int) -> Float[ndarray, "vertices 3"]:
    """The cloth as a reference drape is laid down.

    Args:
        mesh: The cloth, a disc of the standard's size.
        folds: Number of folds; 0 for the flat cloth.

    Returns:
        Positions [m].
    """
    shape = mesh.flat.copy()
    if folds > 0:
        radius, angle = np.hypot(*mesh.material.T), np.arctan2(mesh.material[:, 1], mesh.material[:, 0])
        outside = np.maximum(radius - PLATE_RADIUS, 0) / (CLOTH_RADIUS - PLATE_RADIUS)
        shape[:, 2] = _RAISED * np.cos(folds * angle) * outside**2
    return shape


@dataclass(frozen=True)
class _Trial:
    """A reference drape on one mesh."""

    drape_coefficient: float
    rim_min_mm: float
    rim_max_mm: float
    rim_lowest_mm: float
    rim_mean_mm: float
    folds: int
    seconds: float


def _trial(simulator: DrapeSimulator, drape: PlateDrape) -> "_Trial | str":
    """The drape, or why there is none."""
    mesh = simulator.mesh
    cloth = plate_cloth(drape.ln_bending, drape.poisson, simulator.settings.law)
    try:
        rest = simulator.drape(cloth, initial=torch.from_numpy(raised(mesh, drape.folds)))
    except DrapeDiverged as error:
        return str(error)
    positions = rest.vertices.numpy()
    rim = rim_curve(mesh, positions)
    radii, heights = 1e3 * rim.radii, 1e3 * rim.heights
    return _Trial(
        rim.drape_coefficient(), float(radii.min()), float(radii.max()), float(heights.min()), float(heights.mean()),
        rim_folds(mesh, positions), rest.seconds,
    )  # fmt: skip


def _comparison(drape: PlateDrape, size: int, law: Law, trials: Sequence["_Trial | str"]) -> PlateComparison:
    rests = [trial for trial in trials if isinstance(trial, _Trial)]
    failures = tuple(trial for trial in trials if isinstance(trial, str))

    def mean(name: str) -> float | None:
        return float(np.mean([getattr(rest, name) for rest in rests])) if rests else None

    def error(name: str) -> float | None:
        value = mean(name)
        return None if value is None else value - getattr(drape, name)

    coefficient, sunk = error("drape_coefficient"), mean("rim_mean_mm")
    spread = [rest.drape_coefficient for rest in rests]
    return PlateComparison(
        folds=drape.folds, ln_bending=drape.ln_bending, poisson=drape.poisson,
        poisson_simulated=poisson_of(law, drape.poisson), vertices=size, meshes=len(rests),
        drape_coefficient=mean("drape_coefficient"),
        drape_coefficient_sd_points=_POINTS * float(np.std(spread, ddof=1)) if len(rests) > 1 else None,
        error_points=None if coefficient is None else _POINTS * coefficient,
        accuracy_points=_POINTS * drape.accuracy,
        rim_min_mm=mean("rim_min_mm"), rim_max_mm=mean("rim_max_mm"), rim_lowest_mm=mean("rim_lowest_mm"),
        rim_min_error_mm=error("rim_min_mm"), rim_max_error_mm=error("rim_max_mm"),
        rim_lowest_error_mm=error("rim_lowest_mm"),
        deflection_ratio=_ratio(sunk, drape), folds_found=tuple(rest.folds for rest in rests),
        seconds=mean("seconds"), failures=failures,
    )  # fmt: skip


def _ratio(sunk_mm: float | None, drape: PlateDrape) -> float | None:
    """Mean deflection of an axisymmetric drape over the reference's."""
    if sunk_mm is None or drape.folds > 0 or drape.rim_lowest_mm == 0:
        return None
    return sunk_mm / drape.rim_lowest_mm
