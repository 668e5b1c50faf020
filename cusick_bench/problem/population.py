"""In what cloths differ, and by how much samples of one cloth do: where the field space has its priors from.

`derive_population` (`cusick-bench population`) repeats it on the public release, with fabrics that no table of results
predicts, for one material law:

1. Cloths with traits and correlation length of the laid shape spread over a box are draped, one specimen each, and the
   statistics of their silhouettes are regressed on the five numbers (to the fourth degree in the level of bending, the
   second else).
2. Every fabric and face gets the five numbers whose expected statistics are nearest to the mean of its samples, in
   units of the scatter between specimens. Traits and length have their mean and standard deviation over fabrics; so
   has what even the nearest cloth misses.
3. Simulated specimens of these cloths, all of one level, differ less in area than samples do. The rest is
   put down to a level of stiffness of each sample: in log stiffness the root of the median, over fabrics and
   faces, of (variance of samples - variance of specimens) / slope^2.

The weight of these fabrics is not published. What matters is stiffness over weight, and the level is free, so all are
draped with one assumed weight.

References:
    Robbins. An empirical Bayes approach to statistics. Third Berkeley Symposium, 1956.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import minimize

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.problem.drape_problem import DrapeProblem
from cusick_bench.problem.errors import ProblemError
from cusick_bench.problem.field_space import FIELDS, TRAITS, FieldSpace
from cusick_bench.problem.priors import STRETCH_LEVEL_SD, StiffnessPrior
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.constants import VERTICES_OF_POPULATION
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.triangles.system import Law

FABRICS = ("fabric_1", "fabric_9", "fabric_12", "fabric_14", "fabric_20", "fabric_21")
AREAL_DENSITY = 0.15  # [kg/m2] assumed
# traits in their order, log of the laid shape's correlation length [m]
LOW = np.array([-4.0, -2.5, -0.4, -0.5, math.log(0.008)])
HIGH = np.array([2.5, 1.0, 0.8, 1.5, math.log(0.045)])
AREA = STATISTICS.index("area_log_odds")
MATCHED = tuple(name for name in STATISTICS if not name.startswith("grain_2"))  # which is of the warp against the weft
SHRINKAGE = 0.3  # weight of a cloth's squared distance from the middle of the box, in half sides
DISCREPANCY = 0.02  # of the scatter's variance: what the mean over however many samples may still miss


@dataclass(frozen=True)
class Samples:
    """Statistics of samples of one fabric and face, first captures."""

    fabric: str
    statistics: Float[ndarray, "samples statistics"]


@dataclass(frozen=True)
class Emulator:
    """Expected statistics of a cloth and the scatter of one specimen about them.

    Attributes:
        coefficients: Regression on the features of a cloth.
        scatter: Covariance of the statistics of specimens of one cloth.
    """

    coefficients: Float[ndarray, "features statistics"]
    scatter: Float[ndarray, "statistics statistics"]

    def __call__(self, cloths: Float[ndarray, "*cloths numbers"]) -> Float[ndarray, "rows statistics"]:
        """Expected statistics of cloths (traits, log length), one row a cloth; a single cloth makes one row."""
        return _features(np.atleast_2d(cloths)) @ self.coefficients


@dataclass(frozen=True)
class PopulationPlan:
    """How much a population is derived from.

    Attributes:
        law: Material law.
        vertices: Number of vertices of the mesh.
        cloths: Number of cloths that are draped for the regression.
        specimens: Number that are draped of every fabric and face, for the spread between specimens.

    Raises:
        ProblemError: Fewer cloths than the regression has features, or no two specimens.
    """

    law: Law = "paper"
    vertices: int = VERTICES_OF_POPULATION
    cloths: int = 1300
    specimens: int = 16

    def __post_init__(self) -> None:
        least = _features(LOW[None]).shape[1] + 1
        if self.cloths < least:
            raise ProblemError(f"the regression needs at least {least} cloths, got {self.cloths}")
        if self.specimens < 2:
            raise ProblemError(f"a spread needs at least 2 specimens, got {self.specimens}")


def derive_population(
    folder: Path | str, plan: PopulationPlan | None = None, *, done: Callable[[int], None] = lambda drapes: None
) -> dict[str, Any]:
    """Derives `TRAITS`, the length of `FIELDS["laying"]`, the level of `FIELDS["stiffness"]`, and `DISCREPANCY` anew.

    Args:
        folder: Folder of the public release.
        plan: How much to drape, by which law.
        done: Called with the number of drapes made, `cloths` and `specimens` of every fabric and face in all.

    Returns:
        `traits`: name -> (mean, sd beside that of the tables' prior); `length`: (median [m], sd of its logarithm) of
        the laid shape; `level`: standard deviation of log stiffness between samples; `discrepancy`: name of a statistic
        -> (mean, sd) of fabrics less nearest cloths; `fabrics`: for each fabric and face its five numbers, and the sd
        of the statistic `area_log_odds` over samples and over specimens.

    Raises:
        ProblemError: The folder has none of the fabrics in two samples.
    """
    plan = plan or PopulationPlan()
    groups = _samples(load(str(folder)))
    if not groups:
        raise ProblemError(f"{folder} has none of the fabrics {', '.join(FABRICS)} in two samples; give the release")
    problem = population_problem(plan)
    emulator = fit_emulator(*_drape_box(problem, plan.cloths, done))
    placed = [nearest_cloth(emulator, group) for group in groups]
    spreads = [_spread(problem, cloth, plan.specimens, done) for cloth in placed]
    excess = [
        max(group.statistics[:, AREA].var(ddof=1) - spread**2, 0) / _slope(emulator, cloth) ** 2
        for group, cloth, spread in zip(groups, placed, spreads, strict=True)
    ]
    missed = [group.statistics.mean(0) - emulator(cloth)[0] for group, cloth in zip(groups, placed, strict=True)]
    means, apart = _by_fabric(groups, placed), _by_fabric(groups, missed)
    rows = [
        {"fabric": group.fabric, "samples": len(group.statistics), "cloth": cloth.round(2).tolist()}
        | {"sd_samples": round(float(group.statistics[:, AREA].std(ddof=1)), 4), "sd_specimens": round(spread, 4)}
        for group, cloth, spread in zip(groups, placed, spreads, strict=True)
    ]
    middle, spread = means.mean(0), means.std(0, ddof=1)
    return {
        "traits": {name: (float(middle[i]), _beside(name, float(spread[i]))) for i, name in enumerate(TRAITS)},
        "length": (math.exp(middle[-1]), float(spread[-1])),
        "discrepancy": {
            name: (float(apart[:, i].mean()), float(apart[:, i].std(ddof=1))) for i, name in enumerate(STATISTICS)
        },
        "level": float(np.sqrt(np.median(excess))),
        "fabrics": rows,
    }


def _by_fabric(groups: list[Samples], values: list[ndarray]) -> Float[ndarray, "fabrics numbers"]:
    """Means over the faces of each fabric."""
    names = sorted({group.fabric for group in groups})
    pairs = list(zip(groups, values, strict=True))
    return np.stack([np.mean([value for group, value in pairs if group.fabric == name], axis=0) for name in names])


def _beside(trait: str, spread: float) -> float:
    """Standard deviation of a trait between cloths, beside what the tables' own prior has of it already."""
    table = {"bending": _prior().bending_level_sd, "stretch": STRETCH_LEVEL_SD}
    return math.sqrt(max(spread**2 - table.get(trait, 0.0) ** 2, 0.0))


def fit_emulator(cloths: Float[ndarray, "cloths numbers"], statistics: Float[ndarray, "cloths statistics"]) -> Emulator:
    """Regresses statistics of one specimen a cloth on the five numbers that describe the cloths.

    Args:
        cloths: Traits and log of the laid shape's correlation length, one cloth a row.
        statistics: Statistics of its specimen, in the order of `STATISTICS`.

    Returns:
        Expected statistics and the scatter of specimens about them.
    """
    design = _features(cloths)
    coefficients, *_ = np.linalg.lstsq(design, statistics, rcond=None)
    residual = statistics - design @ coefficients
    return Emulator(coefficients, residual.T @ residual / (len(cloths) - design.shape[1]))


def nearest_cloth(emulator: Emulator, samples: Samples) -> Float[ndarray, " numbers"]:
    """Finds the cloth whose expected statistics are nearest to the mean of a fabric's samples.

    Args:
        emulator: Result of `fit_emulator`.
        samples: Samples of one fabric.

    Returns:
        The five numbers of the cloth, within the box `LOW` to `HIGH`.
    """
    chosen = [STATISTICS.index(name) for name in MATCHED]
    scatter = emulator.scatter[np.ix_(chosen, chosen)] * (1 / len(samples.statistics) + DISCREPANCY)
    target = samples.statistics.mean(0)[chosen]

    def cost(place: ndarray) -> float:
        gap = emulator(LOW + (place + 1) / 2 * (HIGH - LOW))[0, chosen] - target
        return float(gap @ np.linalg.solve(scatter, gap) + SHRINKAGE * (place[1:] ** 2).sum())

    starts = [np.array([level, *np.zeros(len(LOW) - 1)]) for level in (-0.8, -0.4, 0.0, 0.4, 0.8)]
    fits = [minimize(cost, start, method="L-BFGS-B", bounds=[(-1, 1)] * len(LOW)) for start in starts]
    return LOW + (min(fits, key=lambda fit: fit.fun).x + 1) / 2 * (HIGH - LOW)


def _features(cloths: Float[ndarray, "cloths numbers"]) -> Float[ndarray, "cloths features"]:
    """Powers and products: all to the second degree, with the level to the fourth."""
    place = 2 * (cloths - LOW) / (HIGH - LOW) - 1
    level = place[:, :1]
    products = [place[:, i : i + 1] * place[:, i:] for i in range(len(LOW))]
    return np.hstack([np.ones_like(level), place, *products, level**2 * place, place[:, 1:3] ** 3, level**4])


def _slope(emulator: Emulator, cloth: Float[ndarray, " numbers"], step: float = 0.3) -> float:
    """Derivative of the statistic `area` by the log level."""
    along = np.zeros(len(LOW))
    along[0] = step
    return float((emulator(cloth + along) - emulator(cloth - along))[0, AREA]) / (2 * step)


def _prior(law: Law = "paper") -> StiffnessPrior:
    return StiffnessPrior(law, AREAL_DENSITY)


def population_problem(plan: PopulationPlan) -> DrapeProblem:
    """The problem whose draws are the cloths of a population; there is nothing to fit.

    Args:
        plan: Law and mesh size.

    Returns:
        The problem, in the space `field`.
    """
    settings = DrapeSettings(law=plan.law, clamp="whole" if plan.law == "paper" else None)  # as for field_space
    simulator = DrapeSimulator(cloth_mesh(plan.law, plan.vertices), settings)
    space = FieldSpace(simulator.mesh, _prior(plan.law))
    nothing = np.zeros((RELEASE.image_size_px, RELEASE.image_size_px))
    return DrapeProblem(train_image=nothing, simulator=simulator, space=space)


def _tau(problem: DrapeProblem, cloth: Float[ndarray, " numbers"], generator: np.random.Generator) -> ndarray:
    """A specimen of the cloth, its fields with median amplitudes, its level of stiffness that of the cloth."""
    tau = generator.standard_normal(problem.dimension)
    tau[: problem.space.specimen_level.start] = 0
    for number, (name, trait) in zip(cloth, TRAITS.items(), strict=False):  # the last number is the length
        tau[FieldSpace.trait_entry(name)] = (number - trait.mean) / trait.sd
    laying = FIELDS["laying"]
    tau[FieldSpace.length("laying")] = (cloth[-1] - math.log(laying.length)) / laying.length_sd
    tau[problem.space.specimen_level.start] = 0  # the constant mode of stiffness
    return tau


def _drape(
    problem: DrapeProblem, taus: list[ndarray], done: Callable[[int], None]
) -> tuple[list[int], Float[ndarray, "rest statistics"]]:
    """Statistics of the drapes that come to rest, and which these are."""
    seen = []
    for tau in taus:
        seen += problem.draw_batch(tau[None])
        done(1)
    rest = [index for index, one in enumerate(seen) if one is not None]
    images = (torch.as_tensor(one.image) for one in seen if one is not None)
    return rest, np.stack([drape_statistics(image, problem.protocol).numpy() for image in images])


def _drape_box(problem: DrapeProblem, count: int, done: Callable[[int], None]) -> tuple[ndarray, ndarray]:
    generator = np.random.default_rng(0)
    cloths = LOW + (HIGH - LOW) * generator.random((count, len(LOW)))
    rest, statistics = _drape(problem, [_tau(problem, cloth, generator) for cloth in cloths], done)
    return cloths[rest], statistics


def _spread(
    problem: DrapeProblem, cloth: Float[ndarray, " numbers"], specimens: int, done: Callable[[int], None]
) -> float:
    """Standard deviation of the statistic `area` between specimens of one cloth."""
    draw = partial(_tau, problem, cloth, np.random.default_rng(1))
    return float(_drape(problem, [draw() for _ in range(specimens)], done)[1][:, AREA].std(ddof=1))


def _samples(dataset: DrapeDataset) -> list[Samples]:
    """Fabrics and faces of which there are two samples or more."""
    index = dataset.index
    index = index[index["cloth"].isin(FABRICS)]
    found = []
    for _, rows in index.groupby(["cloth", index["side"].astype(str)], sort=True):
        first = rows.groupby("sample").head(1).index
        images = (torch.as_tensor(np.asarray(dataset.image(int(row)), dtype=np.float64)) for row in first)
        statistics = np.stack([drape_statistics(image, dataset.protocol).numpy() for image in images])
        if len(statistics) > 1:
            found.append(Samples(str(np.asarray(rows["cloth"])[0]), statistics))
    return found
