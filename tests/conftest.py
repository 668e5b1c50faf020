"""Shared fixtures. The repository root leaves sys.path, or `datasets/` would shadow other packages."""

import one_thread_a_worker  # noqa: F401, before numba, numpy and torch

# isort: split
import itertools
import os
import sys
from dataclasses import replace
from pathlib import Path

import array_checks  # before the package, whose annotations it checks
import jaxtyping
import numba
import numpy as np
import pytest
import torch
from PIL import Image
from toy_cloths import write_toy
from toy_problem import toy_image

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.threads import thread_pool

ROOT = Path(__file__).resolve().parents[1]
sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != ROOT]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Tests of what users are told, and long ones, run as users run the package: without `array_checks`."""
    unchecked = map(item.get_closest_marker, ("unchecked_arrays", "slow", "nightly"))
    jaxtyping.config.jaxtyping_disable = any(unchecked)
    array_checks.calls_left.clear()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the public release; skips where it is absent, since it has no licence and is never shipped."""
    folder = Path(os.environ.get("CUSICK_DATA", ROOT.parent / "shared" / "cusick"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no Cusick release at {folder}; set CUSICK_DATA to its folder to run this test")
    return folder


@pytest.fixture(scope="session")
def make_lab(tmp_path_factory):
    """Makes small data sets in the public layout: make_lab(bendings) has a fabric for each of them.

    `samples` are hung of every fabric; all weigh 0.2 kg/m2, which fabrics.csv says of the first `weighed` ones only.
    """

    def make(bendings, samples: int = 3, weighed: int | None = None) -> Path:
        root = tmp_path_factory.mktemp("lab")
        weights = ["fabric,areal_density_kg_m2,thickness_m"]
        for fabric, bending in enumerate(bendings, start=1):
            folder = root / "data" / f"Fabric {fabric}" / "silhouettes"
            folder.mkdir(parents=True)
            if weighed is None or fabric <= weighed:
                weights.append(f"fabric_{fabric},0.2,0.0004")
            for sample in range(1, samples + 1):
                grey = np.round(255 * (1 - toy_image(sample, bending=bending))).astype(np.uint8)
                Image.fromarray(grey).save(folder / f"Fabric_{fabric}_Sample_{sample}_Capture_1.jpg", quality=95)
        (root / "fabrics.csv").write_text("\n".join(weights) + "\n")
        return root

    return make


@pytest.fixture(scope="session")
def toy_data(tmp_path_factory) -> Path:
    """Two cloths of five drapes each, of 7 and of 10 folds, with meshes, in the public layout."""
    return write_toy(tmp_path_factory.mktemp("toy"), fabrics=(1, 4), samples=5, captures=1)


@pytest.fixture(scope="session")
def toy_dataset(toy_data: Path) -> DrapeDataset:
    """The same, loaded."""
    return load(toy_data)


def _numpys_global_generator() -> tuple:
    """Its state with the place in it: a draw takes the next of 624 words, and only every 624th makes new ones."""
    name, words, *place = np.random.get_state()  # noqa: NPY002
    return name, words.tobytes(), *place


@pytest.fixture(autouse=True)
def _no_global_seeds():
    """Global generators must stay untouched: every random choice takes its generator as an argument."""
    before_numpy = _numpys_global_generator()
    before_torch = torch.random.get_rng_state()
    yield
    assert _numpys_global_generator() == before_numpy, "a test or the code drew from numpy's global generator"
    assert torch.equal(torch.random.get_rng_state(), before_torch), (
        "a test or the code drew from torch's global generator"
    )


@pytest.fixture(scope="module")
def one_thread():
    """One thread for compiled kernels: small meshes are done before a second thread has woken up."""
    thread_pool()
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
