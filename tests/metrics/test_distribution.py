"""Scores of distributions: minimised by the true one, fair to any number of draws, intervals that hold what they say.

Distributions are simulated, so their truth is known; expectations are compared within four standard errors.
"""

from collections.abc import Callable
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
import torch
from jaxtyping import TypeCheckError
from scipy.stats import norm

from cusick_bench.datasets import DrapeSample
from cusick_bench.datasets.profile import profile_from_image
from cusick_bench.metrics import (
    DISTRIBUTION_METRICS,
    MetricError,
    Shape,
    coverage,
    crps,
    distribution_scores,
    energy_distance_of_draws,
    energy_score,
    expected_best,
    fold_test,
    hausdorff,
    ranks,
    score,
    variogram_score,
)
from cusick_bench.solvers.base import Prediction
from cusick_bench.solvers.reference.silhouettes import silhouette

ANGLES = 2 * np.pi * np.arange(720) / 720
COARSE = 2 * np.pi * np.arange(72) / 72


def wave(folds: int = 7, phase: float = 0.0, depth: float = 0.012, mean: float = 0.12) -> np.ndarray:
    return mean + depth * np.cos(folds * ANGLES - phase)


def assert_mean(values: list[float] | np.ndarray, expected: float) -> None:
    """The mean of independent values is the expected one, as far as they can tell."""
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    assert abs(np.mean(values) - expected) < 4 * error, (np.mean(values), expected, error)


def assert_greater(one: list[float], other: list[float]) -> None:
    """The expectation of the one exceeds that of the other, beyond chance."""
    difference = np.array(one) - np.array(other)
    assert difference.mean() > 4 * difference.std(ddof=1) / np.sqrt(len(difference))


def test_energy_distance_of_equal_distributions_is_zero_on_average_and_of_shifted_ones_is_known():
    generator = np.random.default_rng(1)
    equal = [
        energy_distance_of_draws(generator.normal(size=(7, 3)), generator.normal(size=(11, 3))) for _ in range(1500)
    ]
    assert_mean(equal, 0.0)
    shift, draws = 1.5, [
        energy_distance_of_draws(generator.normal(1.5, 1, (8, 1)), generator.normal(0, 1, (6, 1))) for _ in range(1500)
    ]  # fmt: skip
    apart = shift * (2 * norm.cdf(shift / np.sqrt(2)) - 1) + 2 * np.sqrt(2) * norm.pdf(shift / np.sqrt(2))
    assert_mean(draws, 2 * apart - 2 * 2 / np.sqrt(np.pi))


def test_crps_is_the_closed_form_for_normal_forecasts():
    generator = np.random.default_rng(2)
    draws = generator.normal(size=4000)
    for y in (-0.3, 0.0, 1.7):
        exact = y * (2 * norm.cdf(y) - 1) + 2 * norm.pdf(y) - 1 / np.sqrt(np.pi)
        assert crps(draws, np.array([y])) == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize("scored", [energy_score, variogram_score])
def test_scores_do_not_depend_on_the_number_of_draws(scored):
    generator = np.random.default_rng(3)

    def expectation(count: int) -> list[float]:
        return [scored(generator.normal(size=(count, 8)), generator.normal(size=(2, 8))) for _ in range(1200)]

    few, more, many = expectation(2), expectation(5), expectation(60)
    for values in (few, more):
        error = np.hypot(*(np.std(part) / np.sqrt(len(part)) for part in (values, many)))
        assert abs(np.mean(values) - np.mean(many)) < 4 * error


def test_a_single_draw_is_scored_by_its_distance():
    draw, samples = np.full((1, 4), 0.2), np.array([[0.2, 0.2, 0.2, 0.2], [0.5, 0.5, 0.5, 0.5]])
    assert energy_score(draw, samples) == pytest.approx(0.15)
    assert crps(np.array([0.2]), np.array([0.1, 0.5])) == pytest.approx(0.2)
    assert variogram_score(draw, samples) == pytest.approx(0)
    assert energy_distance_of_draws(draw, samples) == pytest.approx(2 * 0.15 - 0.3)
    assert np.isnan(energy_distance_of_draws(draw, samples[:1]))


Drawer = Callable[[np.random.Generator, int], np.ndarray]


def folded(mean: float = 0.12, spread: float = 0.005, depth: float = 0.01, turned: bool = True, folds=(7, 8)) -> Drawer:
    """Profiles of a cloth: random mean and number of folds, and a phase that is random, or always 0."""

    def draw(generator: np.random.Generator, count: int) -> np.ndarray:
        level = generator.normal(mean, spread, (count, 1))
        phase = generator.uniform(0, 2 * np.pi, (count, 1)) if turned else np.zeros((count, 1))
        return level + depth * np.cos(generator.choice(folds, (count, 1)) * COARSE - phase)

    return draw


def unrelated(generator: np.random.Generator, count: int) -> np.ndarray:
    """Radii with the marginal distribution of `folded()` at every angle, but independent of each other."""
    return np.stack([folded()(generator, count)[:, column] for column in range(len(COARSE))], axis=1)


@pytest.mark.parametrize(
    "wrong",
    [folded(mean=0.123), folded(spread=0.0005), folded(spread=0.012), folded(depth=0.006), folded(turned=False)],
    ids=["shifted", "narrow", "wide", "shallow", "phase"],
)
def test_the_true_distribution_has_the_smallest_energy_score(wrong):
    assert_greater(*_scores(energy_score, wrong, 900))


@pytest.mark.parametrize(
    "wrong", [folded(depth=0.007), folded(folds=(10, 11)), unrelated], ids=["shallow", "folds", "unrelated"]
)
def test_the_true_distribution_has_the_smallest_variogram_score(wrong):
    assert_greater(*_scores(variogram_score, wrong, 60))


def test_variogram_score_is_that_of_its_definition():
    """Roots of differences at every pair of angles of the circle, a pair weighing as the inverse of its separation."""
    generator = np.random.default_rng(9)
    draws, samples = generator.normal(size=(4, 5)), generator.normal(size=(3, 5))
    total = weights = 0.0
    for a in range(5):
        for b in range(a):
            weight = 1 / min(a - b, 5 - (a - b))
            drawn, seen = (np.sqrt(np.abs(values[:, a] - values[:, b])) for values in (draws, samples))
            total += weight * (np.mean((seen - drawn.mean()) ** 2) - drawn.var(ddof=1) / 4)
            weights += weight
    assert variogram_score(draws, samples) == pytest.approx(total / weights)


def _scores(scored, wrong: Drawer, trials: int) -> tuple[list[float], list[float]]:
    """Scores of wrong and of right draws against the same samples of the truth."""
    generator, right = np.random.default_rng(4), folded()
    wrongs, rights = [], []
    for _ in range(trials):
        samples = right(generator, 11)
        wrongs.append(scored(wrong(generator, 30), samples))
        rights.append(scored(right(generator, 30), samples))
    return wrongs, rights


def test_scores_refuse_what_cannot_be_compared():
    for scored in (energy_score, energy_distance_of_draws, variogram_score):
        with pytest.raises(
            (MetricError, TypeCheckError), match=r"one length|parameter 'samples'"
        ):  # whichever looks first
            scored(np.zeros((3, 4)), np.zeros((3, 5)))
        with pytest.raises(MetricError, match="at least one draw"):
            scored(np.zeros((0, 4)), np.zeros((3, 4)))
        with pytest.raises(MetricError, match="finite"):
            scored(np.full((2, 4), np.nan), np.zeros((3, 4)))


@pytest.mark.parametrize("level", [0.5, 0.9])
@pytest.mark.parametrize("count", [2, 6, 19, 200])
def test_intervals_cover_a_further_draw_as_often_as_they_say(level, count):
    generator = np.random.default_rng(5)
    rates = [coverage(generator.normal(size=count), generator.normal(size=20), level) for _ in range(1500)]
    assert np.mean(rates) == pytest.approx(level, abs=0.02)
    if count >= 19:  # whatever the distribution
        rates = [
            coverage(generator.exponential(size=count), generator.exponential(size=20), level) for _ in range(1500)
        ]
        assert np.mean(rates) == pytest.approx(level, abs=0.02)


@pytest.mark.parametrize("count", [2, 4, 5, 8])
def test_an_interval_narrower_than_the_two_middle_draws_covers_as_little_as_it_says(count):
    generator = np.random.default_rng(8)
    rates = [coverage(generator.normal(size=count), generator.normal(size=20), 0.1) for _ in range(3000)]
    assert np.mean(rates) == pytest.approx(0.1, abs=0.015)


@pytest.mark.parametrize(
    "calibrated",
    [lambda draws, samples: coverage(draws, samples, 0.9), ranks,
     lambda draws, samples: fold_test(draws, samples, np.random.default_rng(0))],
)  # fmt: skip
def test_calibration_without_numbers_or_with_ones_that_are_not_finite_is_refused(calibrated):
    some = np.array([7.0, 8.0, 9.0])
    for draws, samples in ((some[:0], some), (some, some[:0])):
        with pytest.raises(MetricError, match="at least one draw and one sample"):
            calibrated(draws, samples)
    for draws, samples in ((np.array([7.0, np.nan, 9.0]), some), (some, np.array([np.inf]))):
        with pytest.raises(MetricError, match="finite"):
            calibrated(draws, samples)


def test_a_variogram_of_one_angle_is_refused():
    with pytest.raises(MetricError, match="at least 2, got 1"):
        variogram_score(np.zeros((2, 1)), np.zeros((2, 1)))


def test_draws_that_vary_too_little_cover_too_little_and_a_single_one_nothing():
    generator = np.random.default_rng(6)
    samples = generator.normal(size=2000)
    assert coverage(generator.normal(0, 0.3, 500), samples, 0.9) < 0.5
    assert coverage(np.array([0.1]), samples, 0.9) == 0
    with pytest.raises(MetricError, match="between 0 and 1"):
        coverage(samples, samples, 90.0)


def test_ranks_are_uniform_among_equals_and_lean_where_draws_are_shifted():
    generator = np.random.default_rng(7)
    found = ranks(generator.normal(size=99), generator.normal(size=4000))
    assert 0 < found.min() < found.max() < 1
    uniform = np.concatenate([ranks(generator.normal(size=9), generator.normal(size=1)) for _ in range(3000)])
    assert np.bincount((10 * uniform).astype(int)).min() > 230
    assert ranks(generator.normal(2, 1, 99), generator.normal(size=400)).mean() < 0.2
    np.testing.assert_allclose(ranks(np.array([1.0, 2.0]), np.array([1.0])), [1 / 3])


def test_fold_test_rejects_equal_distributions_one_time_in_twenty_and_others_often():
    generator = np.random.default_rng(8)

    def rejections(low: int, high: int) -> float:
        outcomes = []
        for _ in range(250):
            drawn = generator.integers(6, 10, 200).astype(float)
            seen = generator.integers(low, high, 11).astype(float)
            outcomes.append(fold_test(drawn, seen, generator, permutations=199) < 0.05)
        return float(np.mean(outcomes))

    assert rejections(6, 10) < 0.09
    assert rejections(7, 11) > 0.5  # shifted by one fold
    assert rejections(7, 8) > 0.7  # right on average, without spread


def test_fold_test_never_says_that_a_difference_is_impossible():
    p = fold_test(np.full(200, 7.0), np.full(11, 12.0), np.random.default_rng(0), permutations=99)
    assert p == pytest.approx(0.01)  # the samples as they are count as one of the permutations


def test_fold_test_of_a_single_draw_asks_whether_all_have_its_number():
    generator = np.random.default_rng(0)
    assert fold_test(np.array([7.0]), np.full(11, 7.0), generator) == 1
    assert fold_test(np.array([7.0]), np.array([7.0, 8.0]), generator) == 0


def shapes(count: int, seed: int, mean: float = 0.12, turned: bool = True) -> list[Shape]:
    generator = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        phase = generator.uniform(0, 6) if turned else 0.0
        made.append(Shape(silhouette(wave(int(generator.integers(6, 9)), phase, 0.01, generator.normal(mean, 0.002)))))
    return made


def test_draws_from_the_samples_own_distribution_pass_every_score():
    tests = shapes(12, 1)
    right, shifted = (distribution_scores(shapes(60, 2, mean), tests) for mean in (0.12, 0.127))
    assert tuple(right) == DISTRIBUTION_METRICS
    assert abs(right["test_energy_distance"]) < 0.3 < shifted["test_energy_distance"]
    for name in ("test_energy_score", "test_dc_crps", "test_dc_rank_bias"):
        assert right[name] < shifted[name], name
    assert right["test_dc_cover_90"] > 0.6 > shifted["test_dc_cover_90"]
    assert right["test_fold_p"] > 0.05
    assert right == distribution_scores(shapes(60, 2), tests)


def test_captures_of_one_sample_are_no_further_samples():
    draws, tests = shapes(40, 2), shapes(4, 1)
    alone, thrice = distribution_scores(draws, tests), np.repeat(np.arange(4), 3)
    again = distribution_scores(draws, [tests[i] for i in thrice], of=thrice)
    assert again == pytest.approx(alone)
    one = distribution_scores(draws, tests[:1] * 4, of=np.zeros(4, dtype=int))
    assert [name for name, value in one.items() if np.isnan(value)] == [
        "test_energy_distance", "test_energy_distance_phase_free", "test_energy_distance_locked",
    ]  # fmt: skip


def test_phase_is_seen_by_locked_statistics_alone():
    """A cloth whose second harmonic lies along the warp in every sample, drawn at random angles."""

    def elongated(count: int, turned: bool) -> list[Shape]:
        generator = np.random.default_rng(9)
        phases = generator.uniform(0, 6, (count, 2)) * (1, turned)
        return [Shape(silhouette(wave(8, a, 0.008) + 0.004 * np.cos(2 * ANGLES - b))) for a, b in phases]

    tests, draws = elongated(12, False), elongated(40, True)
    scores = distribution_scores(draws, tests)
    assert scores["test_energy_distance_locked"] > 1
    assert scores["test_energy_distance_phase_free"] < 0.3


def test_one_draw_has_every_score():
    scores = distribution_scores(shapes(1, 3), shapes(5, 4))
    assert all(np.isfinite(value) for value in scores.values())
    assert scores["test_dc_cover_90"] == 0


def each(tests: list[Shape]) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.array([i]), np.array([i])) for i in range(len(tests))]


def test_paired_draws_are_scored_against_their_own_sample():
    tests = shapes(5, 5)
    scores = distribution_scores(tests, tests, groups=each(tests))
    assert scores["test_energy_score"] == scores["test_dc_crps"] == 0
    assert scores["test_fold_p"] > 0.05
    crossed = distribution_scores(tests[::-1], tests, groups=each(tests))
    assert crossed["test_energy_score"] > 1e-3


def test_groups_count_by_their_samples_and_sets_are_compared_as_a_whole():
    draws, tests = [*shapes(30, 6, 0.11), *shapes(30, 7, 0.13)], [*shapes(2, 8, 0.11), *shapes(6, 9, 0.13)]
    low, high = (np.arange(30), np.arange(2)), (np.arange(30, 60), np.arange(2, 8))
    scores = distribution_scores(draws, tests, groups=[low, high])
    alone = [distribution_scores([draws[i] for i in own], [tests[i] for i in at]) for own, at in (low, high)]
    for name in ("test_energy_score", "test_variogram_score", "test_dc_crps", "test_dc_cover_90"):
        assert scores[name] == pytest.approx(0.25 * alone[0][name] + 0.75 * alone[1][name])
    coefficients = np.array([shape.drape_coefficient for shape in (*draws, *tests)])
    own = [ranks(coefficients[:30], coefficients[60:62]), ranks(coefficients[30:60], coefficients[62:])]
    assert scores["test_dc_rank_bias"] == pytest.approx(abs(np.concatenate(own).mean() - 0.5))
    mixed = distribution_scores(draws, tests)
    assert scores["test_dc_rank_bias"] != pytest.approx(mixed["test_dc_rank_bias"])
    assert scores["test_dc_crps"] < 0.7 * mixed["test_dc_crps"]
    assert scores["test_energy_distance"] == mixed["test_energy_distance"]


def sample(shape: Shape) -> DrapeSample:
    return DrapeSample(torch.from_numpy(shape.pixels), profile_from_image(shape.pixels), pd.Series(dtype=object), None)


def test_best_hausdorff_of_n_is_that_of_n_draws(monkeypatch):
    draws = shapes(23, 6)
    tests = [*shapes(1, 7), draws[21]]  # the second is met by a draw that is in neither of two sets of ten
    table = np.array([[hausdorff(draw.surface, test.surface) for test in tests] for draw in draws])
    prediction = Prediction(draws[0].pixels, np.stack([draw.pixels for draw in draws]))

    def scores() -> dict[str, float]:
        return score(prediction, sample(tests[0]), [sample(test) for test in tests])

    whole = scores()
    assert whole["test_hausdorff_best_m"] == pytest.approx(table.min(0).mean(), abs=1e-4)
    twenty = table[np.linspace(0, 22, 20).astype(int)]
    assert whole["test_hausdorff_best_of_10_m"] == pytest.approx(expected_best(twenty, 10), abs=1e-4)
    assert "test_hausdorff_best_of_100_m" not in whole
    assert set(DISTRIBUTION_METRICS) <= set(whole)
    module = import_module("cusick_bench.metrics.prediction_score")
    monkeypatch.setattr(module, "_MEAN_DRAWS", 5)
    monkeypatch.setattr(module, "SUBSETS", (5, 10, 23))
    in_sets = scores()
    sets = np.stack([table[:20:2].min(0), table[1:21:2].min(0)])
    assert in_sets["test_hausdorff_best_of_10_m"] == pytest.approx(sets.mean(), abs=1e-4)
    assert in_sets["test_hausdorff_best_of_23_m"] == in_sets["test_hausdorff_best_m"]
    assert in_sets["test_hausdorff_best_m"] == pytest.approx(table.min(0).mean(), abs=1e-4)


def test_nothing_held_out_leaves_every_score_of_distributions_open():
    (only,) = shapes(1, 8)
    nothing = score(Prediction(only.pixels, only.pixels[None]), sample(only), [])
    assert np.isnan([nothing[name] for name in DISTRIBUTION_METRICS]).all()
