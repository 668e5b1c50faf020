"""Means over cells, their intervals and paired differences, of numbers whose truth is known."""

import numpy as np
import pytest
from made_up_cells import DIFFICULTY

from cusick_bench.leaderboard import (
    difference,
    estimate,
    interquartile_mean,
)
from cusick_bench.leaderboard.bootstrap import beside, geometric_mean, mean
from cusick_bench.leaderboard.cells.cell_number import SEEDS


def test_interquartile_mean_drops_the_outer_quarters():
    assert interquartile_mean(np.array([0.0, 1, 2, 3, 4, 5, 6, 1000])) == pytest.approx(3.5)
    assert interquartile_mean(np.array([1.0, 2, 6])) == pytest.approx(3)


def test_stratified_interval_holds_the_true_mean_as_often_as_it_says():
    """Cloths differ tenfold in level, seeds by 0.01: only seeds are resampled, so the interval is narrow, and right."""
    truth, hits, widths = 0.55, 0, []
    for trial in range(100):
        generator = np.random.default_rng(trial)
        values = {(c, s): level + generator.normal(0, 0.01) for c, level in (("a", 0.1), ("b", 1.0)) for s in range(20)}
        interval = estimate(values, mean, generator)
        hits += interval.low <= truth <= interval.high
        widths.append(interval.high - interval.low)
    assert 88 <= hits <= 100
    assert np.mean(widths) == pytest.approx(2 * 1.96 * 0.01 / np.sqrt(40), rel=0.1)


@pytest.mark.parametrize(("cloths", "seeds"), [(3, 1), (5, 1), (12, 1), (3, 3)])
def test_intervals_of_few_units_hold_the_true_mean_as_often_as_they_say(cloths, seeds):
    """Normal values; percentile intervals would hold it in 75, 84, 91 and 83 % of cases."""
    generator, hits, trials = np.random.default_rng(cloths + seeds), 0, 400
    for _ in range(trials):
        drawn = generator.normal(0, 1, (cloths, seeds))
        interval = estimate({(str(c), s): drawn[c, s] for c, s in np.ndindex(cloths, seeds)}, mean, generator)
        hits += interval.low <= 0 <= interval.high
    assert hits / trials == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("seeds", [(4, 4), (2, 6, 6, 6), (2, 12)])
def test_intervals_of_geometric_means_hold_the_truth_however_many_seeds_each_cloth_has(seeds):
    """Log-normal values; as of cells that all weigh alike, the last two would hold it in 90 and 79 % of cases."""
    generator, hits, trials = np.random.default_rng(sum(seeds)), 0, 400
    for _ in range(trials):
        cells = [(str(cloth), seed) for cloth, number in enumerate(seeds) for seed in range(number)]
        interval = geometric_mean({cell: generator.normal(3 * int(cell[0]), 1) for cell in cells}, generator)
        hits += interval.low <= np.exp(3 * (len(seeds) - 1) / 2) <= interval.high
    assert hits / trials >= 0.925  # 95 % less two standard errors; too wide is on the safe side


def test_a_mean_of_values_that_are_never_negative_is_not_negative(noise):
    errors = {("blue", 0): 0.001, ("red", 0): 0.001, ("white", 0): 0.1}
    assert estimate(errors, mean, noise).low == 0
    assert difference(errors, {cell: 0.0 for cell in errors}, mean, noise).low < 0


def test_a_mean_of_shares_is_no_more_than_all(noise):
    shares = {("blue", 0): 1.0, ("red", 0): 1.0, ("white", 0): 0.25}
    assert estimate(shares, mean, noise).high > 1
    assert estimate(shares, mean, noise, 1.0).high == 1


def test_the_interval_of_a_geometric_mean_knows_no_unit_and_no_direction():
    """Stretch stiffnesses in N/m and kN/m, and ratios to the one run or to the other."""

    def interval(numbers) -> np.ndarray:
        logarithms = {(str(place), 0): float(np.log(number)) for place, number in enumerate(numbers)}
        found = geometric_mean(logarithms, np.random.default_rng(0))
        return np.array([found.low, found.value, found.high])

    numbers = np.array([1.5, 20.0, 100.0])
    low, value, high = interval(numbers)
    assert value == pytest.approx(3000 ** (1 / 3))
    assert low < 1 < value < high
    assert 1000 * interval(numbers / 1000) == pytest.approx(np.array([low, value, high]))
    assert interval(1 / numbers)[1] == pytest.approx(1 / value)
    assert interval(1 / numbers)[2] > 1


def test_cloths_are_resampled_where_seeds_change_nothing(noise):
    single = {(cloth, 0): level for cloth, level in DIFFICULTY.items()}
    repeated = {(cloth, seed): level for cloth, level in DIFFICULTY.items() for seed in range(3)}
    for values in (single, repeated):
        interval = estimate(values, mean, np.random.default_rng(1))
        spread = np.std(list(DIFFICULTY.values()), ddof=1) / np.sqrt(5)
        assert interval.value == pytest.approx(0.05)
        assert interval.high - interval.low == pytest.approx(2 * 2.776 * spread, rel=0.1)  # Student's t of 4 degrees


def test_pairing_cancels_what_a_cloth_does_to_both(noise):
    first = {(cloth, 0): level + 0.002 + noise.normal(0, 1e-4) for cloth, level in DIFFICULTY.items()}
    second = {(cloth, 0): level for cloth, level in DIFFICULTY.items()}
    paired = difference(first, second, mean, noise)
    assert paired.value == pytest.approx(0.002, abs=2e-4)
    assert paired.high - paired.low < 5e-4 < estimate(first, mean, noise).high - estimate(first, mean, noise).low
    assert paired.decided


def test_difference_uses_shared_cells_and_stretches_a_single_seed(noise):
    first = {("blue", 0): 1.0, ("blue", 1): 3.0, ("red", 0): 9.0, ("white", 5): 1.0}
    second = {("blue", 0): 1.0, ("white", 5): 0.0, ("pink", 0): 7.0}
    assert difference(first, second, mean, noise).value == pytest.approx((1 + 1) / 2)


def test_too_few_cells_have_no_interval_and_decide_nothing(noise):
    lonely = estimate({("blue", 0): 0.1}, mean, noise)
    assert lonely.value == 0.1
    assert np.isnan(lonely.low)
    assert not lonely.decided


def test_one_seed_of_a_left_out_sample_stands_for_all_seeds_of_it(noise):
    first = {("red", split * SEEDS): 1.0 + split for split in range(3)}
    second = {("red", split * SEEDS + seed): 1.0 for split in range(3) for seed in range(4)}
    assert difference(first, second, mean, noise).value == pytest.approx(1.0)


def test_values_beside_a_solver_whose_seeds_change_nothing_count_by_cloth_as_its_own_do():
    """Cloths of 2, 5 and 3 seeds: the others differ from the solver's by .001 at most, and so do the means."""
    own = {(cloth, seed): value for cloth, value, seeds in (("a", 1.0, 2), ("b", 2.0, 5), ("c", 3.0, 3))
           for seed in range(seeds)}  # fmt: skip
    others = {(cloth, seed): value + 1e-3 * (seed % 2) for (cloth, seed), value in own.items()}
    assert estimate(own, mean, np.random.default_rng(0)).value == pytest.approx(2.0)
    assert beside(own, others, mean) == pytest.approx(2.0, abs=1e-3)
