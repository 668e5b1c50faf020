"""What an effect does in a simulation, against what the atlas says of it."""

import numpy as np
import pytest
from atlas_fabrics import THETA

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN, BaseModel
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.feature_rows import faces_of
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.measure.statistics import GROUPS, NAMES
from cusick_bench.diagnosis.simulation.samples import simulate


@pytest.mark.slow
def test_limp_cloth_answers_as_its_simulation_does(emulator: Emulator) -> None:
    """Fitted over stiff and limp cloth alike, responses of limp cloth came out several times too large, or reversed."""
    theta = PRIOR_MEAN.copy()
    theta[0] = -7.5
    for name, severity in (("creep", 0.19), ("rim-stiffening", 2.0)):
        hypothesis = next(one for one in hypotheses(emulator) if one.name == name)
        value = {p.name: p.default for p in hypothesis.effect.parameters} | {hypothesis.effect.severity.name: severity}
        cause = Candidate(hypothesis, value, 0.0, 0.0, 0.0)
        model = BaseModel()
        acts, base = (simulate(theta, causes, 8, (3,), drift=1.0, model=model) for causes in ((cause,), ()))
        made = np.nanmean(acts.specimens - base.specimens, axis=0) / emulator.sd(theta)
        given = {key: np.array([number]) for key, number in value.items()}
        moved = faces_of(shifts(emulator, hypothesis, theta, emulator.sd(theta), 1.0, given).features[0])
        size = list(GROUPS["size"])
        # The fault was a factor of several, or the sign. Rim-stiffening is still understated, by half.
        ratio = moved[:, size] / made[:, size]
        assert (ratio > 0.4).all(), name
        assert (ratio < 1.6).all(), name


def test_simulated_cause_moves_what_the_atlas_says(emulator: Emulator, one_thread: None) -> None:
    """Statistics of a real simulation against the atlas: camera scale, whose answer is known."""
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "camera-scale")
    cause = Candidate(hypothesis, {"error": 0.05}, 0.0, 0.0, 0.0)
    model = BaseModel(200)
    plain = simulate(THETA, (), 2, (1,), model=model).specimens
    scaled = simulate(THETA, (cause,), 2, (1,), model=model).specimens
    radius = NAMES.index("mean_radius")
    np.testing.assert_allclose(scaled[..., radius], 1.05 * plain[..., radius], rtol=1e-6)
    moved = shifts(emulator, hypothesis, THETA, np.ones(len(NAMES)), 0.5, {"error": np.array([0.05])}).features[0]
    assert moved[radius] == pytest.approx(0.05 * plain[..., radius].mean(), rel=0.15)
