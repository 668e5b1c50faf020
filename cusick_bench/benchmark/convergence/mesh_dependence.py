"""How drapes of one cloth, and the statistics of their silhouettes, change from mesh to mesh.

Every draw is laid down in a shape of its own, which is the same on meshes of all sizes, and has meshes of its own: what
changes from size to size is paired by draw, and no mesh's own asymmetry is taken for a property of the cloth. Changes
are told in standard deviations between draws, which stand for the samples of a cloth: a diagnosis sees what is not
small against these.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.profile import profile_from_mesh
from cusick_bench.datasets.silhouette_statistics.selections import DIAGNOSED
from cusick_bench.sim.cloth.irregular import jittered_mesh
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged

NAMES = DIAGNOSED.names
"""Names of the statistics, as a diagnosis has them."""
SHOWN = ("area_dc", "folds", "fold_depth")
"""Those that the table of meshes shows."""
_ANGLES = 360  # as a diagnosis has them

Statistics = Float[ndarray, "draws statistics"]


@dataclass(frozen=True)
class MeshRow:
    """Drapes of one cloth on meshes of one size.

    Attributes:
        vertices: Mesh size.
        drapes: Drapes that did not diverge.
        drape_coefficient, folds, fold_depth_mm: Means over the drapes; depth is the folds' root mean square.
        drape_coefficient_se, folds_se, fold_depth_mm_se: Standard errors of the means.
        drape_coefficient_sd: Standard deviation between drapes.
        mesh_sd_points: Standard deviation of the drape coefficient of the first laying over meshes [points]; None
            where it was not asked for.
    """

    vertices: int
    drapes: int
    drape_coefficient: float
    drape_coefficient_se: float
    drape_coefficient_sd: float
    folds: float
    folds_se: float
    fold_depth_mm: float
    fold_depth_mm_se: float
    mesh_sd_points: float | None = None


@dataclass(frozen=True)
class StatisticChange:
    """Change of one statistic between two ways to simulate the same draws.

    Attributes:
        name: The statistic.
        change: Mean over the draws, in the statistic's unit.
        change_sd: The same in standard deviations between draws; None where these do not differ.
        error_sd: Standard error of that mean, in the same unit.
    """

    name: str
    change: float
    change_sd: float | None
    error_sd: float | None


@dataclass(frozen=True)
class MeshChange:
    """Changes from meshes of one size to the finest.

    Attributes:
        vertices: Mesh size.
        against: Size of the finest.
        draws: Draws that did not diverge on either.
        statistics: Each statistic's change, this size minus the finest.
    """

    vertices: int
    against: int
    draws: int
    statistics: tuple[StatisticChange, ...]


def draw_statistics(
    size: int,
    draws: int,
    material: Material,
    settings: DrapeSettings,
    *,
    jitter: float = 0.0,
    seed: int = 0,
    done: Callable[[int], None] = lambda drapes: None,
) -> Statistics:
    """Drapes a cloth several times, each on a mesh and from a laid-down shape of its own.

    Args:
        size: Number of vertices.
        draws: Number of drapes.
        material: The cloth, homogeneous.
        settings: How it is draped; its seed is not used.
        jitter: Share of the spacing by which interior vertices are moved.
        seed: Seed of the first mesh and shape.
        done: Called with the number of drapes made.

    Returns:
        Statistics in the order of `NAMES`; NaN where a drape diverged.
    """
    found = np.full((draws, len(NAMES)), np.nan)
    for draw in range(draws):
        found[draw] = _one(size, seed + draw, material, replace(settings, seed=seed + draw), jitter)
        done(1)
    return found


def mesh_spread(
    size: int,
    meshes: int,
    material: Material,
    settings: DrapeSettings,
    *,
    jitter: float = 0.0,
    seed: int = 0,
    done: Callable[[int], None] = lambda drapes: None,
) -> float:
    """Spread of the drape coefficient over meshes of one size, all else equal.

    Args:
        size: Number of vertices.
        meshes: Number of meshes, at least 2.
        material: The cloth, homogeneous.
        settings: How it is draped; its seed is not used.
        jitter: Share of the spacing by which interior vertices are moved.
        seed: Seed of the first mesh, and of the laid-down shape.
        done: Called with the number of drapes made.

    Returns:
        Standard deviation [points].
    """
    found, laid = [], replace(settings, seed=seed)
    for number in range(seed, seed + meshes):
        found.append(_one(size, number, material, laid, jitter)[NAMES.index("area_dc")])
        done(1)
    known = np.array(found)[np.isfinite(found)]
    return 100 * float(known.std(ddof=1)) if len(known) > 1 else float("nan")


def mesh_row(size: int, statistics: Statistics) -> MeshRow:
    """Row of the table of meshes for one size.

    Args:
        size: Number of vertices.
        statistics: Statistics of the drapes on that mesh.

    Returns:
        Means and their errors.
    """
    known = statistics[np.isfinite(statistics).all(1)][:, [NAMES.index(name) for name in SHOWN]]
    known = known * [1.0, 1.0, 1e3]
    many = len(known) > 1
    mean = known.mean(0) if len(known) else np.full(len(SHOWN), np.nan)
    sd = known.std(0, ddof=1) if many else np.full(len(SHOWN), np.nan)
    error = sd / np.sqrt(max(len(known), 1))
    (dc, folds, depth), (dc_se, folds_se, depth_se) = mean.tolist(), error.tolist()
    return MeshRow(size, len(known), dc, dc_se, float(sd[0]), folds, folds_se, depth, depth_se)


def statistic_changes(one: Statistics, other: Statistics) -> tuple[int, tuple[StatisticChange, ...]]:
    """Changes of every statistic, paired by draw.

    Args:
        one: Statistics of the draws.
        other: Statistics of the same draws, simulated otherwise; their spread is the unit of the changes.

    Returns:
        Number of draws that have both, and the changes, `one` minus `other`; none from fewer than two.
    """
    both = np.isfinite(one).all(1) & np.isfinite(other).all(1)
    draws = int(both.sum())
    if draws < 2:
        return draws, ()
    difference, sd = one[both] - other[both], other[both].std(0, ddof=1)
    mean, error = difference.mean(0), difference.std(0, ddof=1) / np.sqrt(draws)
    return draws, tuple(
        StatisticChange(
            name,
            float(mean[place]),
            float(mean[place] / sd[place]) if sd[place] > 0 else None,
            float(error[place] / sd[place]) if sd[place] > 0 else None,
        )
        for place, name in enumerate(NAMES)
    )


def mesh_changes(by_size: Mapping[int, Statistics]) -> list[MeshChange]:
    """Changes of every coarser mesh against the finest.

    Args:
        by_size: Statistics of the same draws, by mesh size.

    Returns:
        An entry a coarser size, the coarsest first.
    """
    *coarser, finest = sorted(by_size)
    return [MeshChange(size, finest, *statistic_changes(by_size[size], by_size[finest])) for size in coarser]


def largest_change(changes: Sequence[StatisticChange], names: Sequence[str] = NAMES) -> StatisticChange | None:
    """The statistic that changes most.

    Args:
        changes: Changes of statistics.
        names: Statistics to choose from.

    Returns:
        The largest change in standard deviations; None where none of them differs between draws.
    """
    known = [one for one in changes if one.name in names and one.change_sd is not None]
    return max(known, key=lambda one: abs(one.change_sd or 0.0), default=None)


def silhouette_statistics(positions: Float[ndarray, "vertices 3"], faces: ndarray) -> Float[ndarray, "statistics"]:
    """Statistics of a drape's outline, seen in parallel from above.

    Args:
        positions: Vertices of the drape [m].
        faces: Vertex indices of each triangle.

    Returns:
        Values in the order of `NAMES`.
    """
    return DIAGNOSED.measure(profile_from_mesh(positions, faces, angles=_ANGLES).radii[None])[0]


def _one(size: int, number: int, material: Material, settings: DrapeSettings, jitter: float) -> ndarray:
    mesh = jittered_mesh(cloth_mesh(settings.law, size, seed=number), jitter, seed=number)
    try:
        with torch.no_grad():
            drape = DrapeSimulator(mesh, settings).drape(material)
    except DrapeDiverged:
        return np.full(len(NAMES), np.nan)
    return silhouette_statistics(drape.vertices.numpy(), mesh.faces)
