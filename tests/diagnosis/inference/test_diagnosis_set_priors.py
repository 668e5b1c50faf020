"""Sets of effects of a made-up fabric of six rows: priors add up, samplers keep to the joint probability."""

from math import comb

import numpy as np
import pytest

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.inference.findings.novelty import novelty
from cusick_bench.diagnosis.inference.laboratory import look_alikes, shared_walk
from cusick_bench.diagnosis.inference.laboratory.laboratory import _starts
from cusick_bench.diagnosis.inference.laboratory.look_alikes import Exchanges
from cusick_bench.diagnosis.inference.laboratory.shared_effects import MOST_SHARED, LaboratoryFabric, log_count
from cusick_bench.diagnosis.inference.laboratory.shared_walk import SharedWalk
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.sets.misfit import Misfit
from cusick_bench.diagnosis.inference.sets.refined import NamedSet
from cusick_bench.diagnosis.inference.sets.set_model import MOST, SetModel
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior, conditional
from cusick_bench.diagnosis.inference.single_effects.evidence import Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis
from cusick_bench.sim.effects import effect

ROWS, FORBIDDEN = 6, 3
NAMES = ("camera-scale", "threshold", "cut-size")
MISFIT = Misfit(np.eye(ROWS), (1, 1, 1, ROWS - FORBIDDEN), np.array([0.5, 1.0, 1.5]))


def points_of(seed: int, names: tuple[str, ...] = NAMES) -> EffectPoints:
    """Two points of each effect, of some size each."""
    generator, grids = np.random.default_rng(seed), []
    shift = generator.standard_normal((2 * len(names), ROWS)) + 2
    log_prior = np.log(np.tile([0.7, 0.3], len(names)))
    for number, name in enumerate(names):
        own, one = slice(2 * number, 2 * number + 2), effect(name)
        values = {one.severity.name: one.severity.typical * np.array([0.5, 2.0])}
        hypothesis = Hypothesis(one, "", 1.0)
        grids.append(Grid(hypothesis, values, np.ones(2), shift[own], np.zeros(2), log_prior[own]))
    effects = np.repeat(np.arange(len(names)), 2)
    rows = np.tile([0, 1], len(names))
    return EffectPoints(names, tuple(grids), effects, effects, rows, shift, 0.1 * shift**2, log_prior)


def model_of(seed: int, **settings: float) -> SetModel:
    white = np.random.default_rng([seed, 1]).standard_normal(ROWS) + 2
    return SetModel(white, MISFIT, points_of(seed, ("creep", "shear-friction", "face-asymmetry")), 5, **settings)


def sets_of(model: SetModel) -> FabricSets:
    count = len(model.white)
    rows, unit = np.ones(count, dtype=bool), np.eye(count)
    residual = Residual(PRIOR_MEAN, np.diag(PRIOR_SD**2), rows, np.ones(count), model.white, unit, 0.5)
    posterior = SetPosterior({}, {}, {}, (), np.zeros(len(model.points)), 0.0)
    return FabricSets(residual, model, posterior)


def laboratory_fabric(seed: int) -> LaboratoryFabric:
    data: FabricData = None  # pyright: ignore[reportAssignmentType]  # a walk asks for nothing of it
    return LaboratoryFabric(str(seed), data, sets_of(model_of(seed)))


def test_prior_probabilities_of_sets_of_all_sizes_add_up() -> None:
    model = model_of(0)
    of_fabric = [comb(model.listed, count) * np.exp(model.log_prior(count)) for count in range(MOST + 1)]
    shared = [comb(9, count) * np.exp(log_count(count, 9)) for count in range(MOST_SHARED + 2)]
    assert sum(of_fabric) == pytest.approx(1)
    assert sum(shared) == pytest.approx(1)
    assert shared[0] > shared[1] > shared[2] > shared[3] > shared[4] == 0


@pytest.mark.parametrize("others", [[], [1], [1, 4]])
def test_a_place_is_filled_and_emptied_in_proportion_to_the_joint_probability(others: list[int]) -> None:
    """Detailed balance: any free place may take a further effect, only the one that it stands in can lose it."""
    model = model_of(1)
    given, free = conditional(model, others), MOST - len(others)
    taken = model.points.effect[others]
    for point in np.flatnonzero(~np.isin(model.points.effect, taken)):
        ratio = free * given.options[point] / given.options[-1]
        more = model.log_joint([*others, int(point)]) - model.log_joint(others)
        assert np.log(ratio) == pytest.approx(more)
        assert given.log_joint[point] - given.log_joint[-1] == pytest.approx(more)


class _Last:
    """Always draws the last place, which is empty."""

    def integers(self, count: int) -> int:
        return count - 1


@pytest.mark.parametrize("others", [[], [0], [0, 3]])
def test_a_shared_place_is_filled_and_emptied_in_proportion_to_the_joint_probability(
    others: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    fabrics, points = [laboratory_fabric(seed) for seed in (2, 3)], [points_of(seed) for seed in (4, 5)]
    walk, drawn = SharedWalk(fabrics, points, np.random.default_rng(0), others), []
    walk.own = [[2], []]

    def nothing(options: np.ndarray, generator: object) -> int:
        drawn.append(options)
        return len(options) - 1

    monkeypatch.setattr(shared_walk, "draw_option", nothing)
    walk.generator = _Last()  # pyright: ignore[reportAttributeAccessIssue]
    before = walk.log_joint()
    walk.step(counts=False)
    options, free = drawn[0], MOST_SHARED - len(others)
    for point in np.flatnonzero(~np.isin(points[0].effect, points[0].effect[others])):
        walk.shared, walk.own = [*others, int(point)], [[2], []]
        more = walk.log_joint() - before
        assert np.log(free * options[point] / options[-1]) == pytest.approx(more)


@pytest.mark.parametrize("seed", range(3))
def test_chains_of_a_laboratory_start_at_the_likeliest_point_of_each_effect(seed: int) -> None:
    fabrics, points = [laboratory_fabric(seed + n) for n in (0, 100)], [points_of(seed + n) for n in (200, 300)]
    walk, likeliest = SharedWalk(fabrics, points, np.random.default_rng(0), []), []
    for number in range(len(NAMES)):
        joint = {}
        for point in np.flatnonzero(points[0].effect == number).tolist():
            walk.shared = [point]
            joint[point] = walk.log_joint()
        likeliest.append([max(joint, key=joint.__getitem__)])
    assert _starts(fabrics, points) == likeliest


def some_of(points: EffectPoints, names: frozenset[str]) -> EffectPoints:
    chosen = [name for name in points.names if name in names]
    kept = np.flatnonzero([points.name(point) in names for point in range(len(points))])
    effects = np.array([chosen.index(points.name(int(point))) for point in kept], dtype=int)
    grids = tuple(grid for grid in points.grids if grid.hypothesis.name in names)
    own = (column[kept] for column in (points.row, points.shift, points.variance, points.log_prior))
    return EffectPoints(tuple(chosen), grids, effects, effects, *own)


def test_exchanged_shared_sets_of_any_size_have_the_prior_of_their_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the walk over all effects, though the walk of an exchange has points of its own effects only."""
    fabrics, points = [laboratory_fabric(seed) for seed in (2, 3)], [points_of(seed) for seed in (4, 5)]
    of_fabric = dict(zip(fabrics, points, strict=True))
    monkeypatch.setattr(look_alikes, "shared_points", lambda fabric, names: some_of(of_fabric[fabric], names))
    monkeypatch.setattr(look_alikes, "finer_shared_points", lambda fabric, points, chosen: points)
    found = Exchanges(fabrics, np.random.default_rng(0))
    found.search(SharedWalk(fabrics, points, np.random.default_rng(0), [0, 2]))
    assert {1, 2} <= {len(names) for names in found.sets}
    for one in found.sets.values():
        assert one.walk.log_joint() == pytest.approx(one.walk.on(points).log_joint())


def test_noise_of_few_samples_is_students_t_of_all_rows_together() -> None:
    """Variance f / (f - 2); and where one row is large, so are the others."""
    noise = model_of(0, freedom=10.0).null_noise(20_000, np.random.default_rng(1))
    assert noise.var() == pytest.approx(10 / 8, rel=0.05)
    squares = np.corrcoef((noise**2).T)[~np.eye(ROWS, dtype=bool)]
    assert squares.mean() > 0.1
    assert np.abs(np.corrcoef(noise.T)[~np.eye(ROWS, dtype=bool)]).max() < 0.05
    assert model_of(0).null_noise(20_000, np.random.default_rng(1)).var() == pytest.approx(1, rel=0.05)


def test_share_that_a_set_explains_leaves_out_noise_and_what_a_base_model_may_get_wrong() -> None:
    model = model_of(0)
    sets, nothing = sets_of(model), np.zeros(ROWS)

    def explained(left: np.ndarray) -> float:
        named = NamedSet((), nothing, left, np.zeros((0, ROWS)))
        return novelty(sets, named, np.random.default_rng(0)).explained

    assert explained(model.white) == 0
    noise = np.array([1.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    assert explained(noise) == pytest.approx(1)
    taken = model.white @ model.white - noise @ noise
    for allowed in (0.0, 0.5):
        left = noise + np.eye(ROWS)[FORBIDDEN] * allowed
        assert explained(left) == pytest.approx(1)
    beyond = np.sqrt((taken + 2) / 2)  # with it, what is left beyond noise is as much as what is taken
    assert explained(np.array([beyond, -1.0, 1.0, 0.0, 0.0, 0.0])) == pytest.approx(0.5)


def p_of(sets: FabricSets, left: np.ndarray, variance: np.ndarray, tangent: np.ndarray) -> float:
    """p-value of a set that leaves a residual."""
    return novelty(sets, NamedSet((), variance, left, tangent), np.random.default_rng(0)).p


def test_what_the_sets_own_parameters_could_change_is_nothing_new() -> None:
    """However far it lies along them, in units of what laws leave open; what lies across is as new as ever."""
    sets, none = sets_of(model_of(0)), np.zeros((0, ROWS))
    variance = np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    along, across = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    assert p_of(sets, 20 * along, variance, none) < 0.01
    assert p_of(sets, 20 * along, variance, along[None]) > 0.9
    assert p_of(sets, 20 * across, variance, along[None]) < 0.01


def test_what_lies_where_effects_move_the_rows_is_looked_at_by_itself() -> None:
    """Too much in ten of 40 rows and too little in the others is as much as chance leaves in all of them."""
    rows, moved = 40, 10
    points = points_of(0)
    spread_out = np.random.default_rng(2).standard_normal((5 * len(points), moved))
    every = np.arange(len(spread_out)) % len(points)
    shift = np.zeros((len(every), rows))
    shift[:, :moved] = spread_out
    many = EffectPoints(
        NAMES, points.grids, points.effect[every], points.grid[every], points.row[every], shift, 0 * shift,
        points.log_prior[every],
    )  # fmt: skip
    misfit = Misfit(np.eye(rows), (rows, 0, 0, 0), np.zeros(0))
    sets = sets_of(SetModel(np.zeros(rows), misfit, many, 5))
    among, beside = (np.where(np.isin(np.arange(rows), own), 2.0, 0.5) for own in (range(moved), range(moved, 20)))
    nothing = np.zeros(rows)
    assert p_of(sets, among, nothing, np.zeros((0, rows))) < 0.01
    assert p_of(sets, beside, nothing, np.zeros((0, rows))) > 0.1
