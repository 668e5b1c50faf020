"""Priors of the field space: how cloths differ from each other, and how much samples of one cloth differ.

`derive_population` (`cusick-bench population`) repeats the derivation for one material law, from fabrics of the public
release that are not used in any table of results. The differences are estimated level by level:

1. Simulation. Random cloths of the prior, with all levels of bending, are draped, one specimen each and two of every
   second cloth, and the statistics of their silhouettes are fitted (`expected_statistics`).
2. Fabrics. Each fabric gets the cloth of highest posterior density, given the means of its samples and their scatter,
   from both faces at once: face down a cloth's curl has the other sign. The prior of traits and of the length of the
   laid shape has their mean and standard deviation over fabrics. The distance of fabrics from their best cloths, as a
   root mean square, is the discrepancy.
3. Samples. If the samples of a fabric and face differ more in area than specimens of its cloth with one level, the rest
   is attributed to the level of stiffness of each sample: its variance is the median over fabrics and faces of
   (variance of samples - variance of specimens) / slope^2.
4. Faces and repeats are compared, but not fitted (`compare_levels`).

The weight of these fabrics is not published. Only stiffness over weight matters, and the level is free, so all are
draped with one assumed weight.

References:
    Robbins. An empirical Bayes approach to statistics. Third Berkeley Symposium, 1956.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.optimize import minimize

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.problem.cloth_prior import CLOTH, TRAITS, trait_entry
from cusick_bench.problem.drape_problem import DrapeProblem
from cusick_bench.problem.errors import ProblemError
from cusick_bench.problem.field_space import FieldSpace
from cusick_bench.problem.leading import LEADING
from cusick_bench.problem.population.expected_statistics import ExpectedStatistics, learn, least_cloths
from cusick_bench.problem.priors import DENSITY_REFERENCE, StiffnessPrior
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.constants import VERTICES_OF_POPULATION, Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings, Membrane

FABRICS = ("fabric_9", "fabric_12", "fabric_14", "fabric_20", "fabric_21")
LEVELS = (-4.0, 2.5)  # range of log bending stiffness over that of the median fabric, from limp silk to canvas
AREA = STATISTICS.index("area_log_odds")
BENDING, CURL = LEADING.index("bending"), LEADING.index("curl")
MATCHED = tuple(name for name in STATISTICS if name != "grain_2_imaginary")  # which no orthotropic cloth has
MISSED = 0.05  # least standard deviation of a fabric's mean statistics in step 2, however many samples there are
WIDER = 1.2  # width of the prior in step 2 over the present one, so that the result does not just reproduce it
FIRST_FACES = ("1", "2", "up")  # captures 1 and 2 show one face, 3 and 4 the other, where a side is not named
TOGETHER = 8  # draped at once


@dataclass(frozen=True)
class Samples:
    """First captures of the samples of one fabric and face.

    Attributes:
        fabric: Its name.
        turned: Whether the cloth lies on its other face.
        images: Silhouettes.
        statistics: Their statistics.
        repeats: Silhouettes of the second captures, where every sample has one.
        protocol: How all these silhouettes were taken.
        numbers: Which samples of the fabric these are, in the same order.
    """

    fabric: str
    turned: bool
    images: Float[ndarray, "samples size size"]
    statistics: Float[ndarray, "samples statistics"]
    repeats: Float[ndarray, "samples size size"] | None = None
    protocol: Protocol = RELEASE
    numbers: tuple[int, ...] = ()


@dataclass(frozen=True)
class PopulationPlan:
    """How much a population is derived from.

    Attributes:
        law: Material law.
        vertices: Number of vertices of the mesh.
        cloths: Number of cloths that are draped for the regression, every second one twice.
        membrane: Whether it is softened (see `DrapeSettings`).

    Raises:
        ProblemError: Fewer cloths than the regression needs.
    """

    law: Law = "plate"
    vertices: int = VERTICES_OF_POPULATION
    cloths: int = 2048
    membrane: Membrane | None = None

    def __post_init__(self) -> None:
        least = least_cloths()
        if self.cloths < least:
            raise ProblemError(f"the regression needs at least {least} cloths, got {self.cloths}")

    @property
    def drapes(self) -> int:
        """Number of drapes for the regression."""
        return self.cloths + math.ceil(self.cloths / 2)


@dataclass(frozen=True)
class Population:
    """The derived population.

    Attributes:
        expected: Expected statistics of cloths.
        places: Leading directions of each fabric's cloth.
        traits: Mean and standard deviation between fabrics of each leading direction.
        discrepancy: Root mean square, over fabrics, of what their cloths miss of the mean statistics.
        level: Standard deviation of log stiffness between samples.
        area_spreads: Fabric, whether turned, standard deviation of `area_log_odds` of its samples, and of specimens of
            one level.
    """

    expected: ExpectedStatistics
    places: dict[str, Float[ndarray, " leading"]]
    traits: dict[str, tuple[float, float]]
    discrepancy: dict[str, float]
    level: float
    area_spreads: list[tuple[str, bool, float, float]]


def derive_population(
    groups: list[Samples], plan: PopulationPlan, *, done: Callable[[int], None] = lambda drapes: None
) -> Population:
    """Derives `TRAITS`, length of `FIELDS["laying"]`, level of `FIELDS["stiffness"]`, `DISCREPANCY`, and expectations.

    Args:
        groups: Samples of fabrics, see `population_samples`.
        plan: How much to drape, by which law.
        done: Called with the number of drapes made, `plan.drapes` in all.

    Returns:
        The population.
    """
    problem = population_problem(plan)
    draped = drape_population(problem, plan.cloths, done)
    expected = learn(field_space_of(problem).leading, draped.cloths, draped.levels, draped.statistics, draped.pairs)
    names = sorted({group.fabric for group in groups})
    own = {name: [group for group in groups if group.fabric == name] for name in names}
    places = {name: nearest_cloth(problem, expected, own[name]) for name in names}
    missed = np.stack([np.mean([_missed(expected, places[name], one) for one in own[name]], axis=0) for name in names])
    spreads, excess = [], []
    for group in groups:
        cloth = _turned(places[group.fabric], group.turned)
        specimens = math.sqrt(float(expected.scatter(cloth[None])[0, AREA, AREA]))
        samples = float(group.statistics[:, AREA].std(ddof=1))
        spreads.append((group.fabric, group.turned, samples, specimens))
        excess.append((samples**2 - specimens**2) / float(expected.slope(cloth[None])[0, AREA]) ** 2)
    found = np.stack(list(places.values()))
    spread = found.std(0, ddof=1)
    spread[CURL] = math.sqrt(float((found[:, CURL] ** 2).mean()))  # which face is the first is nobody's choice
    return Population(
        expected,
        places,
        {name: (float(found[:, i].mean()), float(spread[i])) for i, name in enumerate(LEADING)},
        {name: float(one) for name, one in zip(STATISTICS, np.sqrt((missed**2).mean(0)), strict=True)},
        math.sqrt(max(float(np.median(excess)), 0.0)),
        spreads,
    )


def population_samples(folder: Path | str) -> list[Samples]:
    """Reads the fabrics and faces of which there are two samples or more.

    Args:
        folder: Folder of the public release.

    Returns:
        First captures, of two fabrics at least: how cloths differ cannot be seen in one.

    Raises:
        ProblemError: The folder has fewer than two of the fabrics in two samples.
    """
    dataset = load(str(folder))
    index = dataset.index
    found = []
    for name in FABRICS:
        rows = index[index["cloth"] == name]
        for turned in (False, True):
            ours = [int(row) for row in rows.index if _is_turned(dataset, int(row)) == turned]
            first = rows.loc[ours].groupby("sample").head(1).index
            if len(first) < 2:
                continue
            images = _images(dataset, first)
            statistics = drape_statistics(torch.as_tensor(images), dataset.protocol).numpy()
            second = rows.loc[ours].groupby("sample").nth(1).index
            repeats = _images(dataset, second) if len(second) == len(first) else None
            numbers = tuple(int(one) for one in rows.loc[first, "sample"])
            found.append(Samples(name, turned, images, statistics, repeats, dataset.protocol, numbers))
    known = sorted({group.fabric for group in found})
    if len(known) < 2:
        raise ProblemError(
            f"how cloths differ is seen in two of the fabrics {', '.join(FABRICS)} at least, with two samples each; "
            f"{folder} has {' and '.join(known) or 'none'}: give the release"
        )
    return found


def _images(dataset: DrapeDataset, rows: Iterable[int]) -> Float[ndarray, "rows size size"]:
    return np.stack([np.asarray(dataset.image(int(row)), dtype=np.float64) for row in rows])


def _is_turned(dataset: DrapeDataset, row: int) -> bool:
    side = str(dataset.index.at[row, "side"])
    known = side if side in ("up", "down") else str(dataset.index.at[row, "capture"])
    return known not in FIRST_FACES


def nearest_cloth(
    problem: DrapeProblem, expected: ExpectedStatistics, groups: list[Samples]
) -> Float[ndarray, " leading"]:
    """Finds the cloth of highest posterior density, given samples of both faces of one fabric.

    Args:
        problem: Its space has the prior, which counts wider than it is, and not for the level of bending.
        expected: Expected statistics and their scatter.
        groups: Samples of each face.

    Returns:
        Leading directions of the cloth.
    """
    space, chosen = field_space_of(problem), [STATISTICS.index(name) for name in MATCHED]
    leading, level = space.leading, space.level_sd(np.zeros(CLOTH))
    origin, spread = leading.origin, WIDER * np.linalg.norm(leading.rows, axis=1)
    weight = np.where(np.arange(len(LEADING)) == BENDING, 0.0, 1 / spread**2)

    def cost(place: ndarray) -> float:
        total = float(weight @ (place - origin) ** 2)
        for group in groups:
            cloth = _turned(place, group.turned)[None]
            slope, count = level * expected.slope(cloth)[0, chosen], len(group.statistics)
            scatter = expected.scatter(cloth)[0][np.ix_(chosen, chosen)] + np.outer(slope, slope)
            gap = group.statistics[:, chosen].mean(0) - expected(cloth)[0, chosen]
            between = scatter / count + MISSED**2 * np.eye(len(chosen))
            total += float(gap @ np.linalg.solve(between, gap) + np.linalg.slogdet(between)[1])
        return total

    fits = []
    for bending in np.linspace(*LEVELS, 5):
        for curl in (-0.5, 0.5):
            start = origin.copy()
            start[BENDING], start[CURL] = bending, origin[CURL] + curl * spread[CURL]
            fits.append(
                minimize(cost, start, method="L-BFGS-B", bounds=list(zip(expected.low, expected.high, strict=True)))
            )
    return min(fits, key=lambda fit: fit.fun).x


def _turned(place: Float[ndarray, " leading"], turned: bool) -> Float[ndarray, " leading"]:
    """A cloth face up, or turned over: its curl has the other sign."""
    sign = np.ones(len(place))
    sign[CURL] = -1 if turned else 1
    return place * sign


def _missed(expected: ExpectedStatistics, place: ndarray, group: Samples) -> Float[ndarray, " statistics"]:
    return group.statistics.mean(0) - expected(_turned(place, group.turned)[None])[0]


def population_problem(plan: PopulationPlan) -> DrapeProblem:
    """The problem whose draws are the cloths of a population; there is nothing to fit.

    Args:
        plan: Law and mesh size.

    Returns:
        The problem, in the space `field`.
    """
    settings = DrapeSettings(law=plan.law, membrane=plan.membrane, backend="lockstep")
    simulator = DrapeSimulator(cloth_mesh(plan.law, plan.vertices), settings)
    space = FieldSpace(simulator.mesh, StiffnessPrior(plan.law, DENSITY_REFERENCE))
    nothing = np.zeros((RELEASE.image_size_px, RELEASE.image_size_px))
    return DrapeProblem(train_image=nothing, simulator=simulator, space=space)


def field_space_of(problem: DrapeProblem) -> FieldSpace:
    """The space of a problem whose cloths have fields.

    Args:
        problem: The problem.

    Returns:
        Its space.

    Raises:
        ProblemError: It is another one.
    """
    if not isinstance(problem.space, FieldSpace):
        raise ProblemError(f"a population is drawn from the space 'field', got {problem.space.name!r}")
    return problem.space


def placed_at(
    problem: DrapeProblem, place: Float[ndarray, " leading"], generator: np.random.Generator
) -> Float[ndarray, " dimension"]:
    """A specimen of the most probable cloth of given leading directions.

    Args:
        problem: Its space has the prior.
        place: Leading directions.
        generator: Draws the fields.

    Returns:
        Its parameter vector.
    """
    leading, tau = field_space_of(problem).leading, generator.standard_normal(problem.dimension)
    tau[: leading.rows.shape[1]] = np.linalg.pinv(leading.rows) @ (place - leading.origin)
    return tau


def random_cloths(problem: DrapeProblem, count: int, seed: int) -> Float[ndarray, "members dimension"]:
    """Specimens of random cloths of all levels of bending.

    Args:
        problem: Its space has the prior.
        count: Number of cloths.
        seed: Seed of what is random about them.

    Returns:
        Parameter vectors.
    """
    generator, leading = np.random.default_rng(seed), field_space_of(problem).leading
    taus = generator.standard_normal((count, problem.dimension))
    numbers = leading.rows.shape[1]
    wanted = np.linspace(*LEVELS, count)[generator.permutation(count)]
    short = wanted - leading(taus[:, :numbers])[:, BENDING]
    trait = trait_entry("bending")
    taus[:, trait] += short / TRAITS["bending"].sd
    return taus


@dataclass(frozen=True)
class Draped:
    """Specimens of random cloths that came to rest.

    Attributes:
        cloths: theta of their cloths.
        levels: Their levels of stiffness.
        statistics: Their statistics.
        pairs: Rows of which two are specimens of one cloth.
    """

    cloths: Float[ndarray, "rest numbers"]
    levels: Float[ndarray, " rest"]
    statistics: Float[ndarray, "rest statistics"]
    pairs: Int[ndarray, "pairs 2"]


def drape_population(problem: DrapeProblem, count: int, done: Callable[[int], None] = lambda drapes: None) -> Draped:
    """Drapes specimens of random cloths of all levels of bending, two of every second cloth.

    Args:
        problem: See `population_problem`.
        count: Number of cloths.
        done: Called with the number of drapes made.

    Returns:
        What comes to rest.
    """
    taus, twice = random_cloths(problem, count, 0), np.arange(0, count, 2)
    seconds = taus[twice]
    specimen = problem.space.specimen_level
    seconds[:, specimen] = np.random.default_rng(1).standard_normal(seconds[:, specimen].shape)
    taus, cloth = np.vstack([taus, seconds]), np.concatenate([np.arange(count), twice])
    rest, statistics = drape_statistics_of(problem, taus, done)
    rows = {(int(cloth[index]), index >= count): row for row, index in enumerate(rest)}
    pairs = [(rows[one, False], rows[one, True]) for one in twice.tolist() if {(one, False), (one, True)} <= set(rows)]
    levels = field_space_of(problem).levels(taus[rest])
    return Draped(taus[rest, :CLOTH], levels, statistics, np.array(pairs).reshape(-1, 2))


def drape_statistics_of(
    problem: DrapeProblem, taus: Float[ndarray, "members dimension"], done: Callable[[int], None]
) -> tuple[list[int], Float[ndarray, "rest statistics"]]:
    """Drapes cloths.

    Args:
        problem: Who drapes.
        taus: Parameter vectors.
        done: Called with the number of drapes made.

    Returns:
        Which come to rest, and their statistics.
    """
    rest, images = [], []
    for first in range(0, len(taus), TOGETHER):
        for index, seen in enumerate(problem.draw_batch(taus[first : first + TOGETHER]), first):
            if seen is not None:
                rest.append(index)
                images.append(drape_statistics(torch.as_tensor(seen.image), problem.protocol).numpy())
        done(min(TOGETHER, len(taus) - first))
    return rest, np.stack(images)
