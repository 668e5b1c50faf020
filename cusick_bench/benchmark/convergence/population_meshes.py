"""How far the drapes of random cloths, stiff to limp, are from those on finer meshes: the error of the mesh in use.

One cloth of middling stiffness says nothing of limp ones, whose folds are narrower, nor of cloths that hardly stretch:
a coarse surface cannot fold without being stretched, and resists that (membrane locking). So cloths are drawn from the
population of `bdp-field`, each laid down in a shape of its own, and the very same specimens are draped on every mesh.

References:
    Stolarski, Belytschko. Membrane locking and reduced integration for curved elements. Journal of Applied Mechanics
    49(1), 1982.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.benchmark.convergence.order import Limit, extrapolated_limit
from cusick_bench.benchmark.pace import NAMES, TOGETHER, drape_measures, drawn_images
from cusick_bench.problem.cloth_prior import CLOTH, TRAITS, trait_entry
from cusick_bench.problem.cloth_tables import cloth_tables, mean_bending
from cusick_bench.problem.population.derivation import PopulationPlan, population_problem, random_cloths
from cusick_bench.problem.priors import StiffnessPrior
from cusick_bench.sim.engine.settings import Membrane

GROUPS = ("limp", "middling", "stiff")
"""Thirds of the cloths, by their drape coefficient on the finest mesh."""

_COEFFICIENT, _FOLDS, _DEPTH = (NAMES.index(name) for name in ("drape_coefficient", "folds", "fold_depth_log"))


@dataclass(frozen=True)
class MeshError:
    """Drapes on one mesh beside those of the same specimens on the finest one.

    Attributes:
        vertices: Size of the mesh.
        points: Mean of the drape coefficient less that on the finest mesh [points].
        points_error: Its standard error.
        folds: The same of the number of folds.
        depth: The same of the logarithm of the folds' depth.
    """

    vertices: int
    points: float
    points_error: float
    folds: float
    depth: float


@dataclass(frozen=True)
class ClothGroup:
    """Cloths of like drape coefficient.

    Attributes:
        name: One of `GROUPS`, or "all".
        cloths: How many of them came to rest on every mesh.
        coefficients: Least and largest drape coefficient on the finest mesh [points].
        mean: Mean drape coefficient there [points].
        bending: Median of their bending stiffness, the mean of directions and curvatures [N m].
        errors: One a mesh, the finest last.
        limit: Drape coefficient to which the means tend [points]; None where no order is seen. Its interval is that of
            other such cloths, and as wide as these differ.
        limit_error: The same less the drape coefficient on the finest mesh, paired by cloth [points].
    """

    name: str
    cloths: int
    coefficients: tuple[float, float]
    mean: float
    bending: float
    errors: tuple[MeshError, ...]
    limit: Limit | None
    limit_error: Limit | None


def population_meshes(
    sizes: Sequence[int],
    cloths: int,
    *,
    stretch: float | None = None,
    membrane: Membrane | None = None,
    seed: int = 0,
    done: Callable[[int], None] = lambda drapes: None,
) -> tuple[ClothGroup, ...]:
    """Drapes random cloths by law `plate` on meshes of several sizes.

    Args:
        sizes: Numbers of vertices, two or more.
        cloths: Number of cloths; three or more.
        stretch: Membrane stiffness that all are given, the geometric mean of warp and weft at rest [N/m]; by default
            each has its own.
        membrane: Whether it is softened (see `DrapeSettings`).
        seed: Seed of the cloths, and of the resampling for limits.
        done: Called with the number of drapes made.

    Returns:
        All cloths, then those of each of `GROUPS`.
    """
    sizes = sorted(set(sizes))
    plans = [PopulationPlan(vertices=vertices, membrane=membrane) for vertices in sizes]
    problems = [population_problem(plan).at_pace("brisk") for plan in plans]
    prior, taus = problems[0].space.prior, random_cloths(problems[0], cloths, seed)  # parameters know no mesh
    if stretch is not None:
        taus = with_stretch(prior, taus, stretch)
    images: list[ndarray] = []
    for problem in problems:
        parts = []
        for first in range(0, cloths, TOGETHER):
            parts.append(drawn_images(problem, taus[first : first + TOGETHER]))
            done(len(parts[-1]))
        images.append(np.concatenate(parts))
    rested = np.all([np.isfinite(each).all((1, 2)) for each in images], axis=0)
    table = np.stack([drape_measures(each[rested]) for each in images], 1)
    bending = mean_bending(prior, taus[rested, :CLOTH])
    order = np.argsort(table[:, -1, _COEFFICIENT])
    groups = {"all": order} | dict(zip(GROUPS, np.array_split(order, len(GROUPS)), strict=True))
    return tuple(_group(name, sizes, table[rows], bending[rows], seed) for name, rows in groups.items() if len(rows))


def with_stretch(
    prior: StiffnessPrior, taus: Float[ndarray, "members dimension"], stretch: float
) -> Float[ndarray, "members dimension"]:
    """The same specimens with another level of membrane stiffness.

    Args:
        prior: Law and weight of the cloths.
        taus: Parameter vectors of `FieldSpace`.
        stretch: Geometric mean of warp and weft at rest that all get [N/m].

    Returns:
        Parameter vectors.
    """
    at_rest = cloth_tables(prior, torch.as_tensor(taus[:, :CLOTH]))[0][:, 0].numpy()
    level = np.log(2 * np.sqrt(at_rest[:, 0] * at_rest[:, 2]))  # of c11 and c22, which the law doubles
    changed = taus.copy()
    changed[:, trait_entry("stretch")] += (np.log(stretch) - level) / TRAITS["stretch"].sd
    return changed


def _group(
    name: str,
    sizes: Sequence[int],
    table: Float[ndarray, "cloths sizes quantities"],
    bending: Float[ndarray, " cloths"],
    seed: int,
) -> ClothGroup:
    change = table - table[:, -1:]
    mean, spread = change.mean(0), change.std(0, ddof=1) if len(table) > 1 else np.full(change.shape[1:], np.nan)
    errors = tuple(
        MeshError(
            size,
            float(mean[place, _COEFFICIENT]),
            float(spread[place, _COEFFICIENT] / np.sqrt(len(table))),
            float(mean[place, _FOLDS]),
            float(mean[place, _DEPTH]),
        )
        for place, size in enumerate(sizes)
    )
    finest = table[:, -1, _COEFFICIENT]
    limits = (extrapolated_limit(sizes, one[:, :, _COEFFICIENT], seed=seed) for one in (table, change))
    extent = float(finest.min()), float(finest.max())
    return ClothGroup(name, len(table), extent, float(finest.mean()), float(np.median(bending)), errors, *limits)
