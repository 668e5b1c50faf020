"""What tests of the diagnosis share."""

import pytest

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import load_uncalibrated


@pytest.fixture(scope="session")
def emulator() -> Emulator:
    """The shipped atlas as it was fitted, before its calibration."""
    return load_uncalibrated()[0]
