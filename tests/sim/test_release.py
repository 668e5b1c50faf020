"""The release of the base model: settings that can be simulated, and lengths and heights spread as they say."""

import numpy as np
import pytest

from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.release import LAYING_HEIGHT, LAYING_LENGTH, STEP_SECONDS, STEPS, LogNormal


def test_the_release_can_be_simulated():
    settings = DrapeSettings(
        law="plate", steps=STEPS, step_seconds=STEP_SECONDS,
        laying_length=LAYING_LENGTH.median, laying_amplitude=LAYING_HEIGHT.median,
    )  # fmt: skip
    assert settings.steps * settings.step_seconds == pytest.approx(4.5)


@pytest.mark.parametrize("prior", [LAYING_LENGTH, LAYING_HEIGHT, LogNormal(3.0, 0.1)])
def test_draws_have_the_median_and_spread_that_they_say(prior):
    generator = np.random.default_rng(3)
    logs = np.log([prior.draw(generator) for _ in range(4000)])
    assert np.median(logs) == pytest.approx(np.log(prior.median), abs=0.05 * prior.log_sd)
    assert logs.std() == pytest.approx(prior.log_sd, rel=0.05)
