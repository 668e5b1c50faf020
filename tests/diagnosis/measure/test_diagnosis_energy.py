"""Energy distance, floors and resampling of the diagnosis, against answers that are known."""

from math import erf, exp, pi, sqrt

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.floors import split_half_floor
from cusick_bench.diagnosis.measure.resampling import (
    bootstrap_weights,
    halves_by_cluster,
    sign_flip_test,
)
from cusick_bench.metrics.distributions.energy import energy_distance
from cusick_bench.metrics.errors import MetricError


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


def test_sets_without_an_energy_distance():
    with pytest.raises(MetricError, match="finite"):
        energy_distance(np.full((3, 2), np.nan), np.zeros((3, 2)))
    with pytest.raises((MetricError, TypeCheckError), match=r"same statistics|second"):  # whichever looks first
        energy_distance(np.zeros((3, 2)), np.zeros((3, 1)))
    with pytest.raises(MetricError, match="vectors"):
        energy_distance(np.zeros((0, 2)), np.zeros((3, 2)))
    assert np.isnan(energy_distance(np.zeros((3, 2)), np.ones((2, 2)), np.zeros(3, dtype=int)))


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


def test_split_halves_lie_apart_by_nothing_on_average():
    generator = np.random.default_rng(18)
    floors, naive = [], []
    for _ in range(60):
        values, labels = clusters(generator, 12, 2)
        floors.append(split_half_floor(values, labels, generator, 200))
        naive.append(split_half_floor(values, np.arange(24), generator, 200).std())
    assert abs(np.mean(floors)) < 0.01
    assert np.mean([floor.std() for floor in floors]) > 1.3 * np.mean(naive)
    scaled = split_half_floor(values, labels, np.random.default_rng(0), 50, folds=[(12, 12)])
    assert scaled == pytest.approx(split_half_floor(values, labels, np.random.default_rng(0), 50) / 2)
    twice = split_half_floor(values, labels, np.random.default_rng(0), 50, folds=[(12, 12), (12, 12)])
    assert twice == pytest.approx(scaled / np.sqrt(2))  # a mean of two scatters less
    with pytest.raises(DiagnosisError, match="at least 4 samples"):
        split_half_floor(values[:6], labels[:6], generator)


def test_split_half_floor_scaled_to_a_simulation_is_the_floor_of_a_gap_that_is_none():
    generator = np.random.default_rng(19)
    gaps, floors = [], []
    for _ in range(150):
        (values, labels), (simulated, _) = clusters(generator, 12, 2), clusters(generator, 60, 1)
        gaps.append(energy_distance(values, simulated, labels))
        floors.append(split_half_floor(values, labels, generator, 100, folds=[(12, 60)]).std())
    # 150 gaps tell their standard deviation to 6 % where they are normal, less well with a gap's long tail; halves that
    # are not scaled to 60 simulated samples would be wrong by a factor of 2 or so.
    assert np.mean(floors) == pytest.approx(np.std(gaps), rel=0.3)


def test_bootstrap_weights_draw_as_many_clusters_as_there_are():
    weights = bootstrap_weights(5, np.random.default_rng(16), 2000)
    assert (weights.sum(1) == 5).all()
    assert weights.mean(0) == pytest.approx(np.ones(5), abs=0.1)


def test_halves_are_halves():
    halves = halves_by_cluster(7, np.random.default_rng(20), 500)
    assert (halves.sum(1) == 3).all()
    assert halves.mean(0) == pytest.approx(np.full(7, 3 / 7), abs=0.08)
