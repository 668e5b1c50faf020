"""Statistics of drapes, what they tell cloths apart by, and how they vary."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.metrics import (
    LOCKED,
    PHASE_FREE,
    SCALES,
    STATISTICS,
    Confusion,
    MetricError,
    Shape,
    drape_statistics,
    image_statistics,
    learn,
    profile_statistics,
    standardised,
    variability,
    variability_rows,
)
from cusick_bench.solvers.reference.silhouettes import silhouette

ANGLES = 2 * np.pi * np.arange(720) / 720


def wave(folds: int = 7, phase: float = 0.0, depth: float = 0.012, mean: float = 0.12) -> np.ndarray:
    return mean + depth * np.cos(folds * ANGLES - phase)


def statistic(radii: np.ndarray, name: str) -> float:
    return float(profile_statistics(radii[None], np.zeros(1))[0, STATISTICS.index(name)])


def test_statistics_of_a_wave_are_its_own():
    radii = wave(8, phase=0.9, depth=0.01) + 0.003 * np.cos(2 * ANGLES - 0.5)
    expected = {
        "mean_radius": 0.12,
        "amplitude_8": 0.01,
        "amplitude_2": 0.003,
        "amplitude_5": 0,
        "harmonic_2_real": 0.003 * np.cos(0.5),
        "harmonic_2_imaginary": 0.003 * np.sin(0.5),
        "harmonic_1_real": 0,
        "radius_quantile_50": np.median(radii),
        "radius_quantile_05": np.percentile(radii, 5),
        "folds": 8,
    }
    for name, value in expected.items():
        assert statistic(radii, name) == pytest.approx(value, abs=1e-9), name


def test_turning_a_drape_changes_locked_statistics_only():
    generator = np.random.default_rng(0)
    radii = 0.12 + sum(0.002 * np.cos(m * ANGLES - generator.uniform(0, 6)) for m in range(1, 14))
    still, turned = profile_statistics(np.stack([radii, np.roll(radii, 90)]), np.array([0.4, 0.4]))
    free = [STATISTICS.index(name) for name in PHASE_FREE]
    np.testing.assert_allclose(turned[free], still[free], rtol=1e-9, atol=1e-12)
    locked = dict(zip(LOCKED, turned[[STATISTICS.index(name) for name in LOCKED]], strict=True))
    assert locked["harmonic_2_real"] == pytest.approx(
        -statistic(radii, "harmonic_2_imaginary")
    )  # 45 deg are 90 in m = 2
    assert locked["harmonic_2_imaginary"] == pytest.approx(statistic(radii, "harmonic_2_real"))


def test_skewness_tells_narrow_valleys_from_narrow_ridges_and_is_silent_on_discs():
    ridges = 0.11 + 0.02 * np.exp(5 * (np.cos(8 * ANGLES) - 1))
    assert statistic(ridges, "skewness") > 0.5
    assert statistic(0.24 - ridges, "skewness") == pytest.approx(-statistic(ridges, "skewness"))
    noise = np.random.default_rng(0).exponential(2e-5, 720)
    assert abs(statistic(0.12 + noise, "skewness")) < 1e-3


def test_statistics_of_images_are_those_of_their_profiles_in_any_number_format():
    images = np.stack([silhouette(wave(7)), silhouette(wave(9, mean=0.115))])
    measured = image_statistics(images)
    assert measured.shape == (2, len(STATISTICS))
    np.testing.assert_array_equal(measured[:, STATISTICS.index("folds")], [7, 9])
    true = profile_statistics(np.stack([wave(7), wave(9, mean=0.115)]), measured[:, 0])
    assert np.abs(standardised(measured - true)).max() < 0.15  # pixels, a tenth of the spread between samples
    in_bytes = image_statistics(np.round(255 * images).astype(np.uint8))
    assert np.abs(standardised(in_bytes - measured)).max() < 0.02


def test_every_statistic_has_a_scale_and_standardising_chooses_columns():
    assert list(SCALES) == list(STATISTICS)
    values = np.arange(len(STATISTICS), dtype=float)[None]
    np.testing.assert_allclose(standardised(values, ("folds",)), STATISTICS.index("folds") / SCALES["folds"])
    assert standardised(values).shape == values.shape


def test_drapes_of_one_shape_are_the_same_in_units_of_the_spread_whatever_their_size():
    """Lengths count in proportion to the cloth; shares, skewness and numbers of folds as they are."""
    double = replace(RELEASE, cloth_radius_m=0.3, plate_radius_m=0.18, px_per_m=RELEASE.px_per_m / 2)
    radii, coefficients = np.stack([wave(7), wave(8, depth=0.009)]), np.array([0.4, 0.5])
    small = standardised(profile_statistics(radii, coefficients))
    large = standardised(profile_statistics(2 * radii, coefficients, double), protocol=double)
    np.testing.assert_allclose(large, small, rtol=1e-9, atol=1e-9)


def test_statistics_refuse_what_is_no_profile():
    with pytest.raises(
        (MetricError, TypeCheckError), match=r"drape coefficients|parameter 'coefficients'"
    ):  # whichever looks first
        profile_statistics(np.zeros((2, 720)), np.zeros(3))
    with pytest.raises(MetricError, match="finite"):
        profile_statistics(np.full((1, 720), np.nan), np.zeros(1))


def test_scales_are_what_the_release_shows(real_data: Path):
    dataset = load(str(real_data))
    variances = []
    for fabric in (1, 2, 3, 4, 5, 9):
        own = (dataset.table["cloth"] == f"fabric_{fabric}") & (dataset.table["capture"] == 1)
        drapes = [Shape(dataset.image(row)) for row in np.flatnonzero(own)]
        variances.append(drape_statistics(drapes).var(0, ddof=1))
    np.testing.assert_allclose(np.sqrt(np.mean(variances, axis=0)), list(SCALES.values()), rtol=0.055)


def test_cloths_that_lie_apart_are_told_apart_and_equal_ones_are_not():
    generator = np.random.default_rng(10)
    names, samples = ["a"] * 12 + ["b"] * 12 + ["c"] * 12, list(range(12)) * 3

    def share(offset: float) -> float:
        cloths = generator.normal(size=(36, 6)) + offset * np.repeat([0, 1, 2], 12)[:, None]
        return learn(cloths, names, samples)[1].accuracy

    assert share(6.0) == pytest.approx(35 / 36)  # the one that lies furthest out is taken for none
    # Guessing, less the drapes taken for none; a mean that leaves a drape out leans away from it. Chance makes 0.013.
    assert 1 / 3 - 0.08 < np.mean([share(0.0) for _ in range(40)]) < 1 / 3 + 0.03


def test_captures_of_a_sample_are_left_out_together():
    """With three of the four captures at 10 still in, the fourth would be recognised."""
    values = np.array([[0.0], [10.0], [10.0], [10.0], [10.0], [6.0], [6.1]])
    confusion = learn(values, ["a"] * 5 + ["b"] * 2, [1, 2, 2, 2, 2, 1, 2])[1]
    np.testing.assert_array_equal(confusion.counts.sum(1), [5, 2])
    np.testing.assert_allclose(confusion.accuracies, [0, 1])
    assert confusion.accuracy == 0.5


def test_each_statistic_counts_in_units_of_its_spread_within_cloths():
    values = np.array([[0.0, -100.0], [0.1, 100.0], [1.0, -100.0], [1.1, 140.0]])
    judge, _ = learn(values, list("aabb"), [1, 2, 1, 2])
    np.testing.assert_array_equal(judge.assign(np.array([[0.1, 60.0], [1.0, -60.0]])), [0, 1])
    assert np.isnan(judge.confusion(np.zeros((0, 2)), []).accuracy)
    assert judge.confusion(values, list("aabb")).accuracy == 1


def test_what_is_like_no_cloth_is_taken_for_none():
    generator = np.random.default_rng(11)
    values = generator.normal(size=(200, 8)) + np.repeat([0.0, 9.0], 100)[:, None]
    judge, confusion = learn(values, ["a"] * 100 + ["b"] * 100, list(range(200)))
    assert confusion.strangers == pytest.approx(0.045)
    fresh = judge.confusion(generator.normal(size=(2000, 8)), ["a"] * 2000)
    assert fresh.strangers == pytest.approx(0.05, abs=0.025)
    between = judge.confusion(np.full((3, 8), 4.0), ["a"] * 3)
    np.testing.assert_array_equal(between.counts, [[0, 0, 3], [0, 0, 0]])
    assert between.strangers == 1


def test_shares_count_each_cloth_alike_however_many_drapes_it_has():
    found = Confusion(("a", "b"), np.array([[1, 0, 3], [0, 12, 4]]))
    np.testing.assert_allclose(found.accuracies, [0.25, 0.75])
    assert (found.accuracy, found.strangers) == (0.5, 0.5)


def test_the_pooled_spread_is_unbiased():
    """Two cloths with two drapes each, 1 from their means: four squares with two degrees of freedom."""
    judge, _ = learn(np.array([[0.0], [2.0], [10.0], [12.0]]), list("aabb"), [1, 2, 1, 2])
    assert judge.spread[0] == pytest.approx(np.sqrt(2))
    np.testing.assert_allclose(judge.distances(np.array([[3.0]])), [[np.sqrt(2), 4 * np.sqrt(2)]])


def test_classification_refuses_what_cannot_be_told_apart():
    with pytest.raises(MetricError, match="2 cloths"):
        learn(np.zeros((5, 2)), ["a"] * 5, list(range(5)))
    with pytest.raises(MetricError, match="at least 2 samples"):
        learn(np.arange(4.0)[:, None], list("aabb"), [1, 1, 1, 2])
    judge, _ = learn(np.arange(4.0)[:, None], list("aabb"), [1, 2, 1, 2])
    with pytest.raises(MetricError, match="unknown cloth c"):
        judge.confusion(np.zeros((1, 1)), ["c"])


def test_variability_of_drapes_is_theirs():
    """Discs of three sizes: no folds, and areas that are known."""
    radii = np.array([0.110, 0.115, 0.120, 0.125])
    images = np.stack([silhouette(np.full(4, radius)) for radius in radii])
    found = variability(images)
    assert found.drapes == 4
    coefficients = (radii**2 - 0.09**2) / (0.15**2 - 0.09**2)
    assert found.dc_sd.value == pytest.approx(coefficients.std(ddof=1), rel=0.02)
    assert found.folds_sd.value == found.folds.value == 0
    areas = np.pi * (723 * radii) ** 2 / 256**2
    gaps = np.abs(areas[:, None] - areas)[np.triu_indices(4, 1)]
    assert found.pair_mse.value == pytest.approx(gaps.mean(), rel=0.08)  # pixels at the rims are half covered


def test_variability_sees_folds_elsewhere_and_knows_its_error():
    generator = np.random.default_rng(3)

    def drapes(count):
        waves = [(int(generator.integers(6, 10)), generator.uniform(0, 6)) for _ in range(count)]
        return np.stack([silhouette(wave(*of, mean=generator.normal(0.12, 0.004))) for of in waves])

    sets = [variability(drapes(8)) for _ in range(24)]
    for name in ("pair_mse", "dc_sd", "folds_sd"):
        values = [getattr(one, name).value for one in sets]
        claimed = np.mean([getattr(one, name).error for one in sets])
        # The jackknife claims up to a third too much (Efron and Stein); 24 sets tell the spread to 15 %.
        assert 0.55 < np.std(values, ddof=1) / claimed < 1.3, name
    still = variability(np.stack([silhouette(wave(7, 0.01 * i)) for i in range(4)]))
    assert still.pair_mse.value < 0.1 * sets[0].pair_mse.value


def test_the_error_of_variability_is_that_of_leaving_each_drape_out():
    generator = np.random.default_rng(4)
    means, folds = generator.normal(0.12, 0.004, 6), (6, 7, 7, 8, 9, 9)
    images = np.stack([silhouette(wave(n, phase=n, mean=mean)) for n, mean in zip(folds, means, strict=True)])
    found = variability(images)
    without = [variability(np.delete(images, i, axis=0)) for i in range(6)]
    for name in ("pair_mse", "dc_sd", "folds_sd"):
        values = np.array([getattr(one, name).value for one in without])
        expected = np.sqrt(5 / 6 * ((values - values.mean()) ** 2).sum())
        assert getattr(found, name).error == pytest.approx(expected, rel=1e-9), name
    assert found.folds.value == pytest.approx(np.mean(folds))
    assert found.folds.error == pytest.approx(np.std(folds, ddof=1) / np.sqrt(6)), "of a mean it is the usual one"


def test_variability_rows_are_read_side_by_side():
    images = np.stack([silhouette(wave(7, phase)) for phase in (0.0, 1.0, 2.0)])
    one, other = variability_rows({"samples": images, "bytes": np.round(255 * images).astype(np.uint8)})
    assert (one["drapes_of"], one["drapes"]) == ("samples", 3)
    assert one["pair_mse"] == pytest.approx(other["pair_mse"], rel=0.01)
    with pytest.raises(MetricError, match="3 drapes or more, got 2"):
        variability(images[:2])


def test_statistics_that_are_not_finite_are_no_ones_drapes():
    """All drapes of the second cloth were taken for the first one's."""
    values = np.array([[0.0, 0.1], [0.2, 0.0], [5.0, 5.1], [5.2, 5.0]])
    damaged = values.copy()
    damaged[2, 1] = np.nan
    judge, _ = learn(values, list("aabb"), [1, 2, 1, 2])
    for call in (lambda: learn(damaged, list("aabb"), [1, 2, 1, 2]), lambda: judge.assign(damaged)):
        with pytest.raises(MetricError, match="must be finite, got nan in row 2, column 1"):
            call()
