"""Energy distance, floors and resampling of the diagnosis, against answers that are known."""

from math import erf, exp, pi, sqrt

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import ANGLES
from cusick_bench.diagnosis.measure.energy import Standardisation, energy_by_group
from cusick_bench.diagnosis.measure.floors import repeat_floor, split_half_floor, spread_by_level
from cusick_bench.diagnosis.measure.resampling import (
    bootstrap_distance,
    bootstrap_rows,
    bootstrap_weights,
    halves_by_cluster,
    sign_flip_test,
    two_sample_test,
)
from cusick_bench.diagnosis.measure.statistics import (
    GROUPS,
    NAMES,
    RESOLUTION,
    capture_statistics,
)
from cusick_bench.metrics.energy import cluster_distances, energy_distance
from cusick_bench.metrics.errors import MetricError

THETA = np.arange(ANGLES) * (2 * pi / ANGLES)


def rings(generator, count, *, roughness=1.0):
    """Random closed profiles with folds and with everything that has an angle."""
    orders = np.arange(1, 15)
    size = 0.004 * roughness * np.exp(-(((orders - 7) / 4) ** 2)) + 0.0005
    harmonics = (generator.normal(size=(count, 14)) + 1j * generator.normal(size=(count, 14))) * size
    return 0.12 + np.real(harmonics @ np.exp(-1j * np.outer(orders, THETA)))


def clusters(generator, count, repeats, *, shift=0.0, numbers=3, correlation=0.95):
    """Vectors of samples whose captures follow each other as a first-order autoregression; and their labels."""
    values = np.zeros((count, repeats, numbers))
    values[:, 0] = generator.normal(size=(count, numbers))
    for i in range(1, repeats):
        fresh = generator.normal(size=(count, numbers))
        values[:, i] = correlation * values[:, i - 1] + sqrt(1 - correlation**2) * fresh
    return values.reshape(-1, numbers) + shift, np.repeat(np.arange(count), repeats)


@pytest.mark.parametrize("shared", [False, True])
def test_energy_distance_is_what_its_definition_says(shared):
    generator = np.random.default_rng(3)
    first, second = generator.normal(size=(9, 2)), generator.normal(size=(7, 2))
    own, other = np.array([0, 0, 1, 1, 1, 2, 3, 3, 4]), np.array([2, 2, 5, 0, 0, 6, 6])

    def mean(a, b, a_label, b_label, alone):
        terms = [
            np.linalg.norm(x - y)
            for x, p in zip(a, a_label, strict=True)
            for y, q in zip(b, b_label, strict=True)
            if alone or p != q
        ]
        return np.mean(terms)

    expected = 2 * mean(first, second, own, other, not shared)
    expected -= mean(first, first, own, own, False) + mean(second, second, other, other, False)
    assert energy_distance(first, second, own, other, shared=shared) == pytest.approx(expected, rel=1e-12)


def test_energy_distance_of_shifted_normals():
    generator = np.random.default_rng(4)
    first, second = generator.normal(size=(1500, 1)), generator.normal(size=(1500, 1)) + 1.0
    across = 2 / sqrt(pi) * exp(-0.25) + erf(0.5)  # mean |N(1, 2)|
    assert energy_distance(first, second) == pytest.approx(2 * across - 4 / sqrt(pi), rel=0.1)


def test_pairs_within_a_cluster_would_bias_it():
    generator = np.random.default_rng(5)
    kept, naive = [], []
    for _ in range(400):
        (first, own), (second, other) = (clusters(generator, 6, 3) for _ in range(2))
        kept.append(energy_distance(first, second, own, other))
        naive.append(energy_distance(first, second))
    error = np.std(kept) / sqrt(len(kept))
    assert abs(np.mean(kept)) < 3 * error
    assert np.mean(naive) > 10 * error


def test_shared_samples_are_not_compared_between_the_sets():
    generator = np.random.default_rng(6)
    found = []
    for _ in range(400):
        both = generator.normal(size=(8, 2))
        noisy = both + 0.3 * generator.normal(size=both.shape)
        again, labels = both + 0.3 * generator.normal(size=both.shape), np.arange(8)
        found.append(energy_distance(again, noisy, labels, labels, shared=True))
    assert abs(np.mean(found)) < 3 * np.std(found) / sqrt(len(found))


def test_distances_do_not_depend_on_units():
    generator = np.random.default_rng(7)
    first, second = generator.normal(size=(10, 4)), generator.normal(size=(12, 4)) + 0.5
    unit = np.array([1.0, 1e-3, 50.0, 2.0])
    plain, scaled = Standardisation.of_scales(np.ones(4)), Standardisation.of_scales(unit)
    expected = energy_distance(plain.apply(first), plain.apply(second))
    assert energy_distance(scaled.apply(first * unit), scaled.apply(second * unit)) == pytest.approx(expected)


def test_whitening_takes_correlations_off_and_is_safe_with_few_samples():
    generator = np.random.default_rng(8)
    mixing = np.array([[1.0, 0, 0], [0.6, 0.8, 0], [0, 0, 0.01]])
    many = generator.normal(size=(4000, 3)) @ mixing.T
    standard = Standardisation.of_spread(many, np.arange(4000), np.full(3, 1e-6), correlated=True)
    assert np.cov(standard.apply(many).T) * 3 == pytest.approx(np.eye(3), abs=0.15)
    assert np.linalg.eigvalsh(standard.covariance).min() > 0
    few = generator.normal(size=(6, 20)) @ generator.normal(size=(20, 20))
    small = Standardisation.of_spread(few, np.arange(6), np.full(20, 1e-6), correlated=True)
    assert np.linalg.cond(small.covariance) < 1e4
    assert np.isfinite(small.apply(few)).all()


def test_scales_are_of_samples_and_not_below_the_resolution():
    values = np.array([[0.0, 5.0], [2.0, 5.0], [10.0, 5.0], [12.0, 5.0]])
    standard = Standardisation.of_spread(values, np.array([1, 1, 2, 2]), np.array([0.1, 0.1]))
    assert np.sqrt(np.diag(standard.covariance)) == pytest.approx([sqrt(50), 0.1])
    with pytest.raises(DiagnosisError, match="at least 2 samples"):
        Standardisation.of_spread(values, np.ones(4, dtype=int), np.array([0.1, 0.1]))


def test_a_change_of_one_group_shows_in_that_group_alone():
    generator = np.random.default_rng(9)
    first, second = (capture_statistics(rings(generator, 300)) for _ in range(2))
    standard = Standardisation.of_spread(first, np.arange(300), RESOLUTION)
    second[:, NAMES.index("folds")] += 2
    found = energy_by_group(first, second, standard, GROUPS)
    assert found["number"] > 0.1
    assert max(abs(value) for name, value in found.items() if name != "number") < 0.02


def test_sets_without_an_energy_distance():
    with pytest.raises(MetricError, match="finite"):
        energy_distance(np.full((3, 2), np.nan), np.zeros((3, 2)))
    with pytest.raises((MetricError, TypeCheckError), match=r"same statistics|second"):  # whichever looks first
        energy_distance(np.zeros((3, 2)), np.zeros((3, 1)))
    with pytest.raises(MetricError, match="vectors"):
        energy_distance(np.zeros((0, 2)), np.zeros((3, 2)))
    assert np.isnan(energy_distance(np.zeros((3, 2)), np.ones((2, 2)), np.zeros(3, dtype=int)))


def rejections(generator, *, clustered, repeats=3, shift=0.0, runs=300):
    count = 0
    for _ in range(runs):
        (first, own), (second, other) = (clusters(generator, 6, repeats, shift=s) for s in (0.0, shift))
        labels = (own, other) if clustered else (None, None)
        count += two_sample_test(cluster_distances(first, second, *labels), generator, 199) <= 0.05
    return count / runs


def test_repeats_taken_for_independent_are_rejected_and_clusters_hold_their_level():
    generator = np.random.default_rng(10)
    assert rejections(generator, clustered=False) > 0.3
    assert 0.015 < rejections(generator, clustered=True) < 0.09
    assert rejections(generator, clustered=True, shift=2.0, runs=60) > 0.8


def test_a_sample_in_both_sets_is_no_two_sample_test():
    generator, values = np.random.default_rng(11), np.random.default_rng(0).normal(size=(4, 2))
    shared = cluster_distances(values, values, np.arange(4), np.arange(4), shared=True)
    with pytest.raises(DiagnosisError, match="one set only"):
        two_sample_test(shared, generator)
    with pytest.raises(DiagnosisError, match="at least 2 samples"):
        two_sample_test(cluster_distances(values, values, np.zeros(4, dtype=int)), generator)


def test_sign_flips_hold_the_family_wise_level():
    generator = np.random.default_rng(12)
    mixing = generator.normal(size=(15, 15)) / 4
    rejected = 0
    for _ in range(400):
        spread = generator.gamma(1.0, size=(10, 1))  # samples need not be alike
        rejected += sign_flip_test(spread * (generator.normal(size=(10, 15)) @ mixing), generator, 400).p <= 0.05
    assert 0.015 < rejected / 400 < 0.085


def test_sign_flips_find_the_contrast_that_is_there():
    generator = np.random.default_rng(13)
    contrasts = generator.normal(size=(12, 20))
    contrasts[:, 4] += 3
    contrasts[3] = np.nan
    found = sign_flip_test(contrasts, generator)
    assert found.samples == 11
    assert found.p == pytest.approx(2 / 2**11)  # all flips tried: the data and their negative
    assert found.each[4] == found.p
    assert (np.delete(found.each, 4) > 0.05).all()
    known = np.delete(contrasts, 3, axis=0)
    assert found.t == pytest.approx(known.mean(0) / known.std(0, ddof=1) * sqrt(11))


def test_sign_flips_of_many_samples_are_drawn_and_never_certain():
    contrasts = np.random.default_rng(14).normal(size=(40, 2)) + 5
    assert sign_flip_test(contrasts, np.random.default_rng(0), 99).p == pytest.approx(0.01)
    constant = sign_flip_test(np.zeros((6, 2)), np.random.default_rng(0))
    assert (constant.p, constant.t.tolist()) == (1.0, [0.0, 0.0])
    with pytest.raises(DiagnosisError, match="at least 2 samples"):
        sign_flip_test(np.array([[1.0], [np.nan]]), np.random.default_rng(0))


def test_bootstrap_by_cluster_has_the_spread_of_new_samples():
    generator = np.random.default_rng(15)
    fresh, drawn = [], []
    for i in range(200):
        (first, own), (second, other) = (clusters(generator, 15, 2, shift=s) for s in (0.0, 1.5))
        pooled = cluster_distances(first, second, own, other)
        fresh.append(pooled.observed)
        if i < 20:
            drawn.append(bootstrap_distance(pooled, generator, 300).std())
    assert np.mean(drawn) == pytest.approx(np.std(fresh), rel=0.2)


def test_bootstrap_of_one_set_leaves_the_other_as_it_is():
    generator = np.random.default_rng(22)
    pooled = cluster_distances(np.ones((8, 2)), generator.normal(size=(20, 2)))
    assert bootstrap_distance(pooled, generator, 50, both=False) == pytest.approx(np.full(50, pooled.observed))
    assert bootstrap_distance(pooled, generator, 50).std() > 0.05 * pooled.observed


def test_permutations_keep_the_sizes_of_the_sets():
    """With sets of 2 and 3 samples, well apart, 1 of 10 ways to deal them is as extreme."""
    pooled = cluster_distances(np.array([[0.0], [0.1]]), np.array([[5.0], [5.1], [5.3]]))
    assert two_sample_test(pooled, np.random.default_rng(0), 4999) == pytest.approx(0.1, abs=0.02)


def test_bootstrap_draws_whole_clusters():
    generator, labels = np.random.default_rng(16), np.array([7, 7, 3, 3, 3, 9])
    for _ in range(20):
        rows, draw_of = bootstrap_rows(labels, generator)
        assert len(np.unique(draw_of)) == 3
        for number in range(3):
            own = rows[draw_of == number]
            assert len(set(labels[own])) == 1
            assert len(own) == np.count_nonzero(labels == labels[own[0]])
    weights = bootstrap_weights(5, generator, 2000)
    assert (weights.sum(1) == 5).all()
    assert weights.mean(0) == pytest.approx(np.ones(5), abs=0.1)


def test_same_generator_same_answer():
    first, own = clusters(np.random.default_rng(17), 6, 2)
    pooled = cluster_distances(first, first + 0.3, own, own)
    answers = [two_sample_test(pooled, np.random.default_rng(1)) for _ in range(2)]
    assert answers[0] == answers[1]


def test_split_halves_lie_apart_by_nothing_on_average():
    generator = np.random.default_rng(18)
    floors, naive = [], []
    for _ in range(60):
        values, labels = clusters(generator, 12, 2)
        floors.append(split_half_floor(values, labels, generator, 200))
        naive.append(split_half_floor(values, np.arange(24), generator, 200).std())
    assert abs(np.mean(floors)) < 0.01
    assert np.mean([floor.std() for floor in floors]) > 1.3 * np.mean(naive)
    scaled = split_half_floor(values, labels, np.random.default_rng(0), 50, versus=12)
    assert scaled == pytest.approx(split_half_floor(values, labels, np.random.default_rng(0), 50) / 2)
    with pytest.raises(DiagnosisError, match="at least 4 samples"):
        split_half_floor(values[:6], labels[:6], generator)


def test_split_half_floor_scaled_to_a_simulation_is_the_floor_of_a_gap_that_is_none():
    generator = np.random.default_rng(19)
    gaps, floors = [], []
    for _ in range(150):
        (values, labels), (simulated, _) = clusters(generator, 12, 2), clusters(generator, 60, 1)
        gaps.append(energy_distance(values, simulated, labels))
        floors.append(split_half_floor(values, labels, generator, 100, versus=60).std())
    # 150 gaps tell their standard deviation to 6 % where they are normal, less well with a gap's long tail; halves that
    # are not scaled to 60 simulated samples would be wrong by a factor of 2 or so.
    assert np.mean(floors) == pytest.approx(np.std(gaps), rel=0.3)


def test_halves_are_halves():
    halves = halves_by_cluster(7, np.random.default_rng(20), 500)
    assert (halves.sum(1) == 3).all()
    assert halves.mean(0) == pytest.approx(np.full(7, 3 / 7), abs=0.08)


def test_floors_and_spreads_of_a_nested_design():
    generator = np.random.default_rng(21)
    samples, sides = np.repeat(np.arange(300), 4), np.tile(["up", "up", "down", "down"], 300)
    truth = (0.5, 0.3, 0.1)
    values = truth[0] * np.repeat(generator.normal(size=(300, 2)), 4, axis=0)
    values += truth[1] * np.repeat(generator.normal(size=(600, 2)), 2, axis=0)
    values += truth[2] * generator.normal(size=(1200, 2)) + (sides == "down")[:, None]
    spread = spread_by_level(values, samples, sides)
    for found, expected in zip((spread.sample, spread.face, spread.repeat), truth, strict=True):
        assert found == pytest.approx(np.full(2, expected), rel=0.15)
    floor = repeat_floor(values, samples, sides)
    assert floor.repeat == pytest.approx(truth[2] * sqrt(pi), rel=0.1)  # mean distance of two in the plane
    assert floor.repeat < floor.sample < floor.face  # the faces differ by 1 on average
    alone = spread_by_level(values[::4], samples[::4], sides[::4])
    assert np.isnan(alone.repeat).all()
    assert np.isnan(repeat_floor(values[::4], samples[::4], sides[::4]).repeat)
