"""Grids that are killed at random moments end with the undisturbed table; how many is said by CUSICK_MOMENTS."""

import os
from pathlib import Path

import pytest
from kills import PROCESSES, WAYS, kill_and_resume

MOMENTS = int(os.environ.get("CUSICK_MOMENTS", "100"))

pytestmark = pytest.mark.skipif(not (PROCESSES / "self" / "stat").exists(), reason="looks for processes in /proc")


def _way(name: str):
    """A way to run the grid; what it needs is looked for when it is tried."""
    if name == "local":
        pytest.importorskip("submitit")
    return name


@pytest.mark.slow
def test_a_few_kills_and_resumptions_are_bit_identical(tmp_path: Path):
    tally = kill_and_resume("process", 4, seed=1, root=tmp_path)
    assert tally.total >= 4
    assert tally.compared >= 1


@pytest.mark.nightly
@pytest.mark.parametrize("way", WAYS)
def test_kills_at_random_moments_and_resumptions_are_bit_identical(tmp_path: Path, way: str):
    tally = kill_and_resume(_way(way), MOMENTS, seed=0, root=tmp_path)
    assert tally.total >= MOMENTS
    assert tally.compared >= 1
