"""The study of brisk drops: it compares what it says, cloth by cloth."""

import pytest

from cusick_bench.benchmark.pace import NAMES, pace_study


def test_brisk_drops_are_as_near_to_steady_ones_as_a_few_more_steps_bring_them():
    made: list[int] = []
    study = pace_study(97, 4, done=made.append)
    assert sum(made) == 12
    assert 2 <= study.cloths <= 4
    assert [one.name for one in study.changes] == list(NAMES)
    assert 0 < study.brisk_pairs < 0.3 * study.other_pairs
    assert 0 < study.longer_pairs < 0.3 * study.other_pairs
    assert study.ratio == pytest.approx(study.single_seconds / study.brisk_seconds)
