"""What a brisk drop changes of the silhouettes of random cloths, and how much faster it is.

The cloths span all levels of bending of the population that `bdp-field` draws from, each with a laid shape of its own.
Both paces drop the same cloths, in lockstep, pack by pack in turn; times are those that cores were busy, so that
whatever else the machine does counts little. A few cloths are also dropped one by one, as without lockstep. Differences
are paired by cloth. A cloth's own drape is not the same after ten more steps either: it creeps, and its folds turn. So
a third drop, steady with a tenth more steps, says what difference is none.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.files.silhouette import drape_coefficient_of, fold_count_of, profile_of
from cusick_bench.problem import DrapeProblem
from cusick_bench.problem.population.derivation import PopulationPlan, population_problem, random_cloths
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.sim.drape import DrapeSimulator

NAMES = ("drape_coefficient", "folds", *STATISTICS)
"""What is compared: drape coefficient [points], number of folds, and the statistics of a fit [1]."""

TOGETHER = 16
"""Cloths dropped together: eight for each of two threads."""

_ALONE = 2  # of them are also dropped by themselves


@dataclass(frozen=True)
class PaceChange:
    """Mean change of a quantity, paired by cloth.

    Attributes:
        name: Of `NAMES`.
        brisk: Brisk less steady.
        brisk_error: Its standard error.
        longer: Steady with a tenth more steps less steady.
        longer_error: Its standard error.
    """

    name: str
    brisk: float
    brisk_error: float
    longer: float
    longer_error: float


@dataclass(frozen=True)
class PaceStudy:
    """Brisk drops beside steady ones.

    Attributes:
        vertices: Mesh size.
        cloths: Cloths that all three drops bring to an end.
        single_seconds: Time that cores are busy with a steady drop by itself, silhouette included [s].
        steady_seconds: The same of a steady drop in lockstep [s].
        brisk_seconds: The same of a brisk drop in lockstep [s].
        changes: Change of every quantity.
        brisk_pairs: Mean squared error of the silhouettes of one cloth, brisk against steady.
        longer_pairs: The same of a tenth more steps.
        other_pairs: The same of two different cloths that are neighbours in drape coefficient.
    """

    vertices: int
    cloths: int
    single_seconds: float
    steady_seconds: float
    brisk_seconds: float
    changes: tuple[PaceChange, ...]
    brisk_pairs: float
    longer_pairs: float
    other_pairs: float

    @property
    def ratio(self) -> float:
        """Time of a steady drop by itself over that of a brisk one in lockstep."""
        return self.single_seconds / self.brisk_seconds


def pace_study(
    vertices: int, cloths: int, *, seed: int = 1, done: Callable[[int], None] = lambda drops: None
) -> PaceStudy:
    """Drops random cloths at both paces.

    Args:
        vertices: Mesh size.
        cloths: Number of cloths.
        seed: Seed of the cloths.
        done: Called with the number of drops made, three for each cloth.

    Returns:
        What differs.
    """
    problem = population_problem(PopulationPlan(vertices=vertices))
    s = problem.simulator.settings
    taus = random_cloths(problem, cloths, seed)
    alone = replace(problem, simulator=DrapeSimulator(problem.simulator.mesh, replace(s, backend="auto")))
    drops = [
        problem,
        replace(problem, simulator=DrapeSimulator(problem.simulator.mesh, replace(s, pace="brisk"))),
        replace(problem, simulator=DrapeSimulator(problem.simulator.mesh, replace(s, steps=round(1.1 * s.steps)))),
    ]
    for one in (*drops, alone):  # compiles and analyses
        drawn_images(one, taus[:2])
    seconds, images, single = np.zeros(3), [[], [], []], list[float]()
    for first in range(0, cloths, TOGETHER):
        some = taus[first : first + TOGETHER]
        for place, one in enumerate(drops):
            start = time.process_time()
            images[place].append(drawn_images(one, some))
            seconds[place] += time.process_time() - start
            done(len(some))
        start = time.process_time()
        drawn_images(alone, some[:_ALONE])
        single.append((time.process_time() - start) / len(some[:_ALONE]))
    steady, brisk, longer = (np.concatenate(one) for one in images)
    good = np.isfinite(steady + brisk + longer).all((1, 2))
    return _study(
        vertices,
        (float(np.mean(single)), float(seconds[0] / cloths), float(seconds[1] / cloths)),
        steady[good],
        brisk[good],
        longer[good],
    )


def _study(
    vertices: int, seconds: tuple[float, float, float], steady: ndarray, brisk: ndarray, longer: ndarray
) -> PaceStudy:
    base = drape_measures(steady)
    by_pace, by_length = drape_measures(brisk) - base, drape_measures(longer) - base
    root = np.sqrt(len(base))
    changes = tuple(
        PaceChange(name, *(float(n) for n in (a.mean(), a.std(ddof=1) / root, b.mean(), b.std(ddof=1) / root)))
        for name, a, b in zip(NAMES, by_pace.T, by_length.T, strict=True)
    )
    sorted_by_area, (single, together, briskly) = steady[np.argsort(base[:, 0])], seconds
    return PaceStudy(
        vertices=vertices,
        cloths=len(base),
        single_seconds=single,
        steady_seconds=together,
        brisk_seconds=briskly,
        changes=changes,
        brisk_pairs=_pairs(brisk, steady),
        longer_pairs=_pairs(longer, steady),
        other_pairs=_pairs(sorted_by_area[1:], sorted_by_area[:-1]),
    )


def _pairs(one: ndarray, other: ndarray) -> float:
    return float(((one - other) ** 2).mean())


def drawn_images(
    problem: DrapeProblem, taus: Float[ndarray, "members dimension"]
) -> Float[ndarray, "members size size"]:
    """Silhouettes of drapes of specimens.

    Args:
        problem: Whose simulator drapes.
        taus: Parameter vectors, one a row.

    Returns:
        One a specimen; NaN where a drop fails.
    """
    nothing = np.full(problem.train_image.shape, np.nan)
    return np.stack([nothing if one is None else one.image for one in problem.draw_batch(taus)])


def drape_measures(images: Float[ndarray, "images size size"]) -> Float[ndarray, "images quantities"]:
    """`NAMES` of silhouettes.

    Args:
        images: Silhouettes of the release's protocol.

    Returns:
        One row a silhouette.
    """
    statistics = drape_statistics(torch.as_tensor(images)).numpy()
    folds = [fold_count_of(profile_of(one, RELEASE), RELEASE) for one in images]
    coefficients = [100 * drape_coefficient_of(one, RELEASE) for one in images]
    return np.column_stack([coefficients, np.array(folds, dtype=np.float64), statistics])
