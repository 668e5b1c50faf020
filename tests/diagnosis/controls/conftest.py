"""A fabric under control."""

from dataclasses import replace

import pytest
from made_up_controls import CLOTH

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.diagnosis.controls.known_answers import FabricUnderControl
from cusick_bench.diagnosis.measure.captures import read_captures


@pytest.fixture(scope="module")
def fabric() -> DrapeDataset:
    return load("synthetic").select(cloth=CLOTH)


@pytest.fixture(scope="module")
def release(real_data) -> DrapeDataset:
    return replace(load(real_data), name="cusick")


@pytest.fixture(scope="module")
def under_control(fabric) -> FabricUnderControl:
    return FabricUnderControl(fabric, read_captures(fabric, CLOTH), halves=1)
