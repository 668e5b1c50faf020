"""The release of the base model: settings that can be simulated."""

import pytest

from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.release import STEP_SECONDS, STEPS


def test_the_release_can_be_simulated():
    settings = DrapeSettings(law="plate", steps=STEPS, step_seconds=STEP_SECONDS)
    assert settings.steps * settings.step_seconds == pytest.approx(4.5)
