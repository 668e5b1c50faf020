"""Shared fixtures. The repository root leaves sys.path, or `datasets/` would shadow other packages."""

import itertools
import os
import sys
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
import torch

from cusick_bench.sim.drape import DrapeSimulator

ROOT = Path(__file__).resolve().parents[1]
sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != ROOT]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the public release; skips where it is absent, since it has no licence and is never shipped."""
    folder = Path(os.environ.get("CUSICK_DATA", ROOT.parent / "shared" / "cusick"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no Cusick release at {folder}; set CUSICK_DATA to its folder to run this test")
    return folder


@pytest.fixture(autouse=True)
def _no_global_seeds():
    """Global generators must stay untouched: every random choice takes its generator as an argument."""
    before_numpy = np.random.get_state()[1].copy()  # noqa: NPY002
    before_torch = torch.random.get_rng_state()
    yield
    assert (np.random.get_state()[1] == before_numpy).all(), "a test or the code drew from numpy's global generator"  # noqa: NPY002
    assert torch.equal(torch.random.get_rng_state(), before_torch), (
        "a test or the code drew from torch's global generator"
    )


@pytest.fixture(scope="module")
def one_thread():
    """One thread for compiled kernels: small meshes are done before a second thread has woken up."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture(scope="module")
def one_torch_thread():
    """One thread for torch: small tensors gain nothing from more, and on busy cores threads wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def fail_drapes(monkeypatch):
    """Plants failures: fail_drapes(which) fails every drape, counted from 1, for which `which(count)` holds."""
    drape_batch, counter = DrapeSimulator.drape_batch, itertools.count(1)

    def plant(which):
        def faulty(self, materials, **settings):
            batch = drape_batch(self, materials, **settings)
            return replace(batch, failures=["planted" if which(next(counter)) else old for old in batch.failures])

        monkeypatch.setattr(DrapeSimulator, "drape_batch", faulty)

    return plant
