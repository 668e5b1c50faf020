"""Gap and closure of samples whose distances are known."""

import numpy as np
import pytest

from cusick_bench.diagnosis.measure.gap import Fold, Gap, fit_of, gap
from cusick_bench.diagnosis.measure.statistics import NAMES


def test_closure_of_known_gaps() -> None:
    """A cause that gives the data's distribution closes the gap, one that changes nothing closes none of it."""
    generator = np.random.default_rng(12)
    shape = (14, 2, len(NAMES))
    sd, shift = np.full(len(NAMES), 2.0), np.zeros(len(NAMES))
    shift[:6] = 4.0

    def drawn(move: float) -> np.ndarray:
        return 2.0 * generator.standard_normal(shape) + move * shift

    data = [drawn(1.0), drawn(1.0)]
    plain = [drawn(0.0), drawn(0.0)]
    right = gap([Fold(d, b, drawn(1.0)) for d, b in zip(data, plain, strict=True)], sd, generator)
    useless = gap([Fold(d, b, b) for d, b in zip(data, plain, strict=True)], sd, generator)
    half = gap([Fold(d, b, drawn(0.5)) for d, b in zip(data, plain, strict=True)], sd, generator)
    assert right is not None
    assert useless is not None
    assert half is not None
    assert right.base > 5 * right.floor > 0
    assert right.closure == pytest.approx(1.0, abs=0.15)
    assert right.closure_interval[0] < right.closure < right.closure_interval[1] + 0.1
    assert useless.closure == pytest.approx(0.0, abs=1e-9)
    assert useless.closure_interval == pytest.approx((0.0, 0.0), abs=1e-9)  # the same draws for both models
    for one in (right, half):
        assert one.closure == pytest.approx((one.base - one.effect) / one.base, rel=1e-9)
    assert 0.4 < half.closure < 0.95
    assert right.groups["size"] > 5 * right.groups["envelope"]  # the shift is in the first statistics


def test_interval_of_a_closure_knows_of_the_simulated_samples_too() -> None:
    """Few of them: an interval from the data's scatter alone holds the closure of many in 81 of 100 repeats."""
    generator = np.random.default_rng(5)
    sd, shift = np.full(len(NAMES), 2.0), np.zeros(len(NAMES))
    shift[:6] = 3.0

    def drawn(samples: int, move: float) -> np.ndarray:
        return 2.0 * generator.standard_normal((samples, 2, len(NAMES))) + move * shift

    def closed(samples: int, folds: int) -> Gap:
        found = gap([Fold(*(drawn(samples, move) for move in (1.0, 0.0, 0.5))) for _ in range(folds)], sd, generator)
        assert found is not None
        return found

    true, repeats = closed(400, 1).closure, [closed(6, 2).closure_interval for _ in range(100)]
    assert np.mean([low <= true <= high for low, high in repeats]) >= 0.9
    assert np.mean([high - low for low, high in repeats]) < 1.0


def test_gap_needs_samples_and_uses_the_faces_there_are() -> None:
    generator = np.random.default_rng(13)
    values = generator.standard_normal((6, 2, len(NAMES)))
    assert gap([Fold(values[:1], values)], np.ones(len(NAMES)), generator) is None
    values[:, 1] = np.nan
    found = gap([Fold(values, generator.standard_normal((8, 2, len(NAMES))))], np.ones(len(NAMES)), generator)
    assert found is not None
    assert np.isfinite(found.base)


def test_a_fold_whose_samples_all_show_the_other_face_has_no_gap() -> None:
    """As where faces alternate from sample to sample: every second sample lies face down."""
    generator = np.random.default_rng(15)
    up, down, simulated = (generator.standard_normal((count, 2, len(NAMES))) for count in (6, 6, 24))
    up[:, 1], down[:, 0] = np.nan, np.nan
    sd = np.ones(len(NAMES))
    assert gap([Fold(up, simulated), Fold(down, simulated)], sd, generator) is None
    assert fit_of(down, simulated, sd, (0,)) == np.inf


def test_a_right_model_exceeds_the_floor_in_one_of_twenty_cases() -> None:
    generator = np.random.default_rng(15)
    sd, above = np.ones(len(NAMES)), []
    for _ in range(300):
        folds = [Fold(*(generator.standard_normal((count, 2, len(NAMES))) for count in (6, 24))) for _ in range(2)]
        found = gap(folds, sd, generator)
        assert found is not None
        above.append(
            [found.base > found.floor, *(found.groups[name] > found.groups_floor[name] for name in found.groups)]
        )
    assert np.mean(above, axis=0) == pytest.approx(0.05, abs=0.04)


def test_a_gap_that_may_be_chance_has_no_closure() -> None:
    """Halves of one set of samples, of which a cause changes nothing or a little."""
    generator = np.random.default_rng(16)
    closures = []
    for _ in range(100):
        data, base, effect = generator.standard_normal((3, 12, 2, len(NAMES)))
        found = gap([Fold(data, base, effect)], np.ones(len(NAMES)), generator)
        assert found is not None
        closures.append(found.closure)
    assert np.isnan(closures).mean() > 0.88


def test_no_gap_has_no_closure() -> None:
    generator = np.random.default_rng(14)
    same = [generator.standard_normal((10, 2, len(NAMES))) for _ in range(3)]
    found = gap([Fold(same[0], same[0], same[1])], np.ones(len(NAMES)), generator)
    assert found is not None
    assert found.base < 0.02
    assert np.isnan(found.closure) or abs(found.closure_interval[1] - found.closure_interval[0]) > 0.5
