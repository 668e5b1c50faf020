"""Data of small grids."""

from pathlib import Path

import pytest

from cusick_bench.datasets import load


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    """Two cloths with three samples each; the second has no areal density."""
    return make_lab((2.0, 4.0), weighed=1)


@pytest.fixture(scope="module")
def dataset(data):
    return load(data)
