"""What tests of leaderboards share."""

import numpy as np
import pytest

from cusick_bench.leaderboard.gate import paired


@pytest.fixture
def noise() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def fewer_permutations():
    patch = pytest.MonkeyPatch()
    patch.setattr(paired, "PERMUTATIONS", 2000)
    yield
    patch.undo()
