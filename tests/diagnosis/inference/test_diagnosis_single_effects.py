"""One effect at a time: its direction, its place, how strong it is, and by which method it is named."""

import numpy as np
import pytest
from atlas_fabrics import THETA, drawn_fabric, fabric_of, residual_of

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.detectability import power
from cusick_bench.diagnosis.inference.detectability.power import detectable_at
from cusick_bench.diagnosis.inference.findings.detection import detection_p_value
from cusick_bench.diagnosis.inference.findings.unusual import unusual
from cusick_bench.diagnosis.inference.residuals.feature_rows import faces_of
from cusick_bench.diagnosis.inference.sets.fabric_sets import fabric_sets
from cusick_bench.diagnosis.inference.single_effects.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.inference.single_effects.evidence import (
    Candidate,
    candidates,
    detectable_grids,
)
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.inference.single_effects.localise import place
from cusick_bench.diagnosis.measure.statistics import NAMES, rotated
from cusick_bench.sim.effects import registered
from cusick_bench.sim.effects.effect_timing import acts_later


@pytest.mark.parametrize(
    "name",
    [
        "camera-offset",
        pytest.param("face-asymmetry", marks=pytest.mark.slow),
        pytest.param("rest-curvature", marks=pytest.mark.slow),
        pytest.param("perspective", marks=pytest.mark.slow),
        pytest.param("local-mass-patch", marks=pytest.mark.slow),
    ],
)
def test_planted_shift_is_named(emulator: Emulator, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shift of twice what is detectable, as the atlas makes it, is given to its own effect or an equivalent one."""
    generator = np.random.default_rng(5)
    hypothesis = next(one for one in hypotheses(emulator) if one.name == name)
    monkeypatch.setattr(power, "hypotheses", lambda emulator: [hypothesis])  # to save time
    strength = 2 * detectable_at(emulator, float(THETA[0]), {}, fabrics=1)[name]
    value = {p.name: np.array([p.default]) for p in hypothesis.effect.parameters}
    value[hypothesis.effect.severity.name] = np.array([min(strength, hypothesis.effect.severity.high)])
    moved = shifts(emulator, hypothesis, THETA, emulator.sd(THETA), 0.5, value).features[0]
    fabric = fabric_of(emulator, *drawn_fabric(emulator, generator, shift=moved))
    plain = fabric.against()
    assert detection_p_value(fabric.model(plain), generator) < 0.05
    found = fabric_sets(fabric, plain, generator, steps=40).posterior.effects
    alike = {
        "local-mass-patch": {"local-mass-patch", "local-stiff-patch"},
        "camera-offset": {"camera-offset", "camera-tilt", "plate-tilt", "off-centre"},
        "perspective": {"perspective", "camera-scale", "threshold", "cut-size"},
    }.get(name, {name})
    assert sum(found.get(one, 0.0) for one in alike) > 0.5


def test_direction_turns_the_shift(emulator: Emulator) -> None:
    """In the cloth's frame the two faces agree, in the laboratory's they mirror each other."""
    found = {(one.name, one.frame): one for one in hypotheses(emulator)}
    value = {"shift": np.array([3e-3]), "direction": np.array([40.0])}
    sd = np.ones(len(NAMES))
    lab, fixed = (
        faces_of(shifts(emulator, found["camera-offset", frame], THETA, sd, 0.5, value).features[0])
        for frame in ("lab", "cloth")
    )
    up, down = fixed
    np.testing.assert_allclose(up, down)
    np.testing.assert_allclose(lab[0], up)
    np.testing.assert_allclose(lab[1], rotated(up, np.deg2rad(140 - 40)), atol=1e-12)
    first = NAMES.index("harmonic_1_real")
    assert up[first] > 0.5 * 3e-3 * np.cos(np.deg2rad(40))  # the outline moves with the camera


def test_only_creep_acts_later() -> None:
    assert [name for name, one in registered().items() if acts_later(one)] == ["creep"]


def test_patch_is_found_where_it_is(emulator: Emulator) -> None:
    generator = np.random.default_rng(8)
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "local-mass-patch")
    value = {
        "mass": np.array([8.0]),
        "direction": np.array([200.0]),
        "radius": np.array([0.13]),
        "size": np.array([0.02]),
    }
    moved = shifts(emulator, hypothesis, THETA, emulator.sd(THETA), 0.5, value).features[0]
    residual = residual_of(emulator, *drawn_fabric(emulator, generator, shift=moved))
    made = detectable_grids(emulator, residual)
    best = next(one for one in candidates(residual.white, made) if one.hypothesis.name == "local-mass-patch")
    own = next(one for one in made if one.hypothesis is best.hypothesis)
    shift = own.shift[own.best(own.log_likelihood(residual.white))]
    spot = place(best, residual.white, made, shift)
    assert spot.map.shape == (4, 16)
    assert spot.map.sum() == pytest.approx(1)
    assert spot.localisable
    assert spot.angle is not None
    first, last = spot.angle
    assert (200.0 - first) % 360 <= last - first
    assert spot.null_map is not None
    assert spot.null_map.max() < 2 / 64 < spot.map.max(), "noise prefers no place"
    assert spot.null_p == 0.01
    weaker = place(best, residual.white, made, shift / 10)
    assert spot.resolution is not None
    assert weaker.resolution is not None
    assert last - first <= spot.resolution[0] < weaker.resolution[0] <= 360
    assert 0 < spot.resolution[1] <= weaker.resolution[1] <= 0.06
    assert place(None, residual.white, made).localisable is False


def test_noise_is_often_as_narrow_a_map_as_noise(emulator: Emulator) -> None:
    residual = residual_of(emulator, *drawn_fabric(emulator, np.random.default_rng(8)))
    made = detectable_grids(emulator, residual)
    generator = np.random.default_rng(3)
    found = [place(None, generator.standard_normal(len(residual.white)), made) for _ in range(3)]
    assert np.median([one.null_p for one in found]) > 0.1
    assert all(one.resolution is None for one in found)


def test_a_patch_whose_place_is_not_told_says_why(emulator: Emulator) -> None:
    residual = residual_of(emulator, *drawn_fabric(emulator, np.random.default_rng(8)))
    patch = next(one for one in hypotheses(emulator) if one.name == "local-mass-patch")
    cause = Candidate(patch, {"mass": 2.0, "direction": 200.0, "radius": 0.13, "size": 0.02})
    nothing = np.zeros_like(residual.white)  # nothing is left that a patch at any place could explain
    spot = place(cause, nothing, detectable_grids(emulator, residual))
    assert (spot.kind, spot.localisable) == ("patch", False)
    assert "the map is nearly as wide as under noise" in spot.why_not


def test_an_effect_many_times_as_strong_as_usual_is_to_be_measured(emulator: Emulator) -> None:
    offset = next(one for one in hypotheses(emulator) if one.name == "camera-offset")
    assert not unusual([Candidate(offset, {"shift": 6e-3, "direction": 0.0})])
    (note,) = unusual([Candidate(offset, {"shift": 23e-3, "direction": 0.0})])
    assert "camera-offset: shift 0.023 m is 16 times what is usual" in note
    pure = next(one for one in hypotheses(emulator) if one.effect.severity.unit == "1")
    severity = pure.effect.severity
    (note,) = unusual([Candidate(pure, {severity.name: 8 * severity.typical})])
    assert f"{severity.name} {8 * severity.typical:.3g} is 8 times what is usual" in note  # without a unit "1"


def test_simpler_methods_name_what_is_plain(emulator: Emulator) -> None:
    generator = np.random.default_rng(16)
    residual = residual_of(emulator, *drawn_fabric(emulator, generator))
    made = detectable_grids(emulator, residual)
    grid = next(one for one in made if one.hypothesis.name == "face-asymmetry")
    shift = grid.shift[int(np.argmax(np.linalg.norm(grid.shift, axis=1)))]
    moved = [one.shift for one in made]
    for method in (largest_marginal_score, lasso_without_projection):
        found = method(shift, made, moved)
        assert next(iter(found)) == "face-asymmetry"
        assert sum(found.values()) == pytest.approx(1, abs=0.02)
        assert method(np.zeros(len(shift)), made, moved) == {}
