"""What tests of leaderboards share."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from verified_runs import grid

from cusick_bench.datasets import load
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


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    return make_lab((2.0,))


@pytest.fixture(scope="module")
def dataset(data):
    return load(data)


@pytest.fixture(scope="module")
def finished(data, tmp_path_factory) -> Path:
    return grid(data, tmp_path_factory.mktemp("run") / "out")


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    """A run to tamper with."""
    return Path(shutil.copytree(finished, tmp_path / "copy"))
