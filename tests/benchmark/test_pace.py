"""The study of brisk drops: it compares what it says, cloth by cloth."""

import numpy as np
import pytest

from cusick_bench.benchmark.pace import NAMES, _study, pace_study
from cusick_bench.benchmark.timing import Timing, paired_ratio
from cusick_bench.solvers.reference.silhouettes import silhouette


def test_brisk_drops_are_as_near_to_steady_ones_as_a_few_more_steps_bring_them():
    made: list[int] = []
    study = pace_study(97, 4, done=made.append)
    assert sum(made) == 12
    assert 2 <= study.cloths <= 4
    assert [one.name for one in study.changes] == list(NAMES)
    assert 0 < study.brisk_pairs < 0.3 * study.other_pairs
    assert 0 < study.longer_pairs < 0.3 * study.other_pairs
    assert study.ratio == pytest.approx(study.single_seconds / study.brisk_seconds)


def test_changes_and_pairs_are_those_of_their_own_drops():
    """Discs: brisk ones are smaller than steady ones, longer drops sink by half as much."""

    def discs(less: float) -> np.ndarray:
        return np.stack([silhouette(np.full(4, radius - less)) for radius in (0.115, 0.12, 0.13)])

    steady, brisk, longer = (discs(less) for less in (0.0, 4e-3, 2e-3))
    study = _study(97, (6.0, 4.0, 2.0), steady, brisk, longer)
    change = study.changes[NAMES.index("drape_coefficient")]
    radii = np.array([0.115, 0.12, 0.13])
    for found, error, less in (
        (change.brisk, change.brisk_error, 4e-3), (change.longer, change.longer_error, 2e-3)
    ):  # fmt: skip
        sunk = 100 * ((radii - less) ** 2 - radii**2) / (0.15**2 - 0.09**2)
        assert found == pytest.approx(sunk.mean(), abs=0.1)
        assert error == pytest.approx(sunk.std(ddof=1) / np.sqrt(3), abs=0.1)
    assert study.brisk_pairs == pytest.approx(np.square(brisk - steady).mean())
    assert study.longer_pairs == pytest.approx(np.square(longer - steady).mean())
    assert study.ratio == 3.0


def test_a_ratio_is_of_the_first_to_the_second():
    assert paired_ratio(Timing((2.0, 6.0, 4.0)), Timing((1.0, 2.0, 2.0))) == {"median": 2.0, "low": 2.0, "high": 3.0}
