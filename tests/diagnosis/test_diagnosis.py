"""The diagnosis against known answers: fabrics made by the atlas' own statistics, by simulation, and by a liar."""

from dataclasses import replace

import numpy as np
import pytest

from cusick_bench.datasets import load
from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, PRIOR_MEAN, PRIOR_SD, BaseModel
from cusick_bench.diagnosis.atlas.effect_timing import acts_later
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.observation import silhouette
from cusick_bench.diagnosis.atlas.store import Calibration, load_uncalibrated
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.diagnose import Options, _exchanges, diagnose
from cusick_bench.diagnosis.document.build import answer, document
from cusick_bench.diagnosis.document.headline import headline
from cusick_bench.diagnosis.document.model import DataCounts
from cusick_bench.diagnosis.errors import DiagnosisError, Refused
from cusick_bench.diagnosis.inference.detectability.power import detectable_at, expected_features
from cusick_bench.diagnosis.inference.findings.budget import Budget, Share
from cusick_bench.diagnosis.inference.findings.detection import detection_p_value, detection_statistic
from cusick_bench.diagnosis.inference.findings.unusual import unusual
from cusick_bench.diagnosis.inference.residuals.feature_rows import SPREAD, faces_of
from cusick_bench.diagnosis.inference.residuals.refusal import domain_doubts
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import fabric_sets
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.inference.single_effects.evidence import (
    NONE,
    UNKNOWN,
    Candidate,
    candidates,
    detectable_grids,
)
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.inference.single_effects.localise import place
from cusick_bench.diagnosis.inference.single_effects.next_measurement import TURN_OVER, advise
from cusick_bench.diagnosis.measure.captures import Captures, captures_from_profiles, read_captures
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.statistics import GROUPS, NAMES, rotated
from cusick_bench.diagnosis.simulation.samples import simulate
from cusick_bench.sim.effects import effect, registered
from cusick_bench.sim.setup import Simulators, drape_setups

THETA = PRIOR_MEAN + PRIOR_SD * np.array([0.9, 0.2, 0.0, 0.0, 0.2, 0.1, 0.1, 0.0, 0.0])


@pytest.fixture(scope="module")
def emulator() -> Emulator:
    return load_uncalibrated()[0]


@pytest.fixture(scope="module")
def detectable(emulator: Emulator) -> dict[str, float]:
    return detectable_at(emulator, float(THETA[0]), {}, fabrics=1)


def drawn_fabric(
    emulator: Emulator, generator: np.random.Generator, samples: int = 12, shift: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Statistics of samples as the atlas says they scatter, and drifts without creep."""
    sd = emulator.sd(THETA)
    root = np.linalg.cholesky(emulator.correlation)
    noise = (generator.standard_normal((samples, len(root))) @ root.T).reshape(samples, 2, -1) * sd
    moved = 0.0 if shift is None else faces_of(shift) * sd
    drift = 0.2 * generator.standard_normal((samples, len(NAMES))) * sd
    return emulator.mean(THETA) + noise + moved, drift


def fabric_of(emulator: Emulator, specimens: np.ndarray, drift: np.ndarray) -> FabricData:
    """A drawn fabric; its spreads are the atlas' own, as what is drawn lacks their uncertainty."""
    found = replace(features(specimens, drift), spread=emulator.spread(THETA))
    return FabricData(emulator, Calibration(), found, None, 0.5)


def residual_of(emulator: Emulator, specimens: np.ndarray, drift: np.ndarray) -> Residual:
    return fabric_of(emulator, specimens, drift).against()


def simulated_captures(cause: str = "", severity: float = 0.0, *, samples: int = 8, seed: int = 3) -> Captures:
    """Two captures of each face of samples of a simulated fabric on another mesh than the atlas'."""
    setups = BaseModel(600, meshes=40).samples(THETA, samples, (900, seed))
    simulators, rows = Simulators(), []
    labels = [(sample, side) for sample in range(1, samples + 1) for side in ("up", "down")]
    for later in (False, True):
        changed = [
            effect(cause).apply(replace(setup, later=later), {effect(cause).severity.name: severity})
            if cause
            else setup
            for setup in setups
        ]
        rows.append([silhouette(s, x) for s, x in zip(changed, drape_setups(changed, simulators), strict=True)])
    generator = np.random.default_rng(seed)
    radii = np.array([*rows[0], *rows[1]])
    radii += generator.normal(0, 1e-4, (len(radii), 1))
    return captures_from_profiles(
        radii,
        sample=np.array([sample for sample, _ in labels] * 2),
        side=[side for _, side in labels] * 2,
        capture=np.repeat([1, 2], len(labels)),
    )


def test_base_model_recovers_its_parameters(emulator: Emulator) -> None:
    generator = np.random.default_rng(3)
    errors = []
    for _ in range(6):
        residual = residual_of(emulator, *drawn_fabric(emulator, generator))
        errors.append((residual.theta - THETA) / np.sqrt(np.diag(residual.theta_covariance)))
    assert np.abs(np.array(errors)[:, 0]).mean() < 2.5
    assert abs(float(np.mean([e[0] for e in errors]))) < 2


@pytest.mark.slow
def test_detection_holds_its_level(emulator: Emulator) -> None:
    """Over all causes together, on fabrics whose scatter is the atlas' own."""
    generator = np.random.default_rng(4)
    fabric = fabric_of(emulator, *drawn_fabric(emulator, generator))
    model = fabric.model(fabric.against())
    limit = np.quantile(detection_statistic(model, generator.standard_normal((400, len(model.white)))), 0.95)
    alarms = 0
    for _ in range(40):
        one = fabric_of(emulator, *drawn_fabric(emulator, generator))
        model = one.model(one.against())
        alarms += detection_statistic(model, model.white[None])[0] > limit
    assert alarms <= 6  # of 40; twice the level and more would show


@pytest.mark.parametrize(
    "name", ["camera-offset", "face-asymmetry", "rest-curvature", "perspective", "local-mass-patch"]
)
def test_planted_shift_is_named(emulator: Emulator, detectable: dict[str, float], name: str) -> None:
    """A shift of twice what is detectable, as the atlas makes it, is given to its own effect or an equivalent one."""
    generator = np.random.default_rng(5)
    strength = 2 * detectable[name]
    hypothesis = next(one for one in hypotheses(emulator) if one.name == name)
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


def test_what_a_stiffer_cloth_explains_is_not_detectable(emulator: Emulator, detectable: dict[str, float]) -> None:
    """Friction that moves the drape far beyond the noise, but nearly as stiffness does, needs more than that."""
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "bending-friction")
    seen = against_base(emulator, expected_features(emulator, THETA, 12), start=THETA, fixed=True)
    value = {"ratio": np.array([detectable["bending-friction"]])}
    moved = shifts(emulator, hypothesis, THETA, seen.sd, seen.drift, value).features
    means = np.linalg.norm(faces_of(moved[0]) * np.sqrt(12))
    assert means > 8 * np.linalg.norm(seen.whiten(moved))  # most of the shift is the base parameters' own


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


def test_an_effect_that_explains_a_cloth_at_the_end_of_the_atlas_is_no_reason_to_refuse_it(emulator: Emulator) -> None:
    """The limpest cloth, seen 4 % too large, misses its drape coefficient by 12 standard deviations between samples."""
    generator, theta = np.random.default_rng(0), PRIOR_MEAN.copy()
    theta[0] = LOW[0]
    scale = Candidate(next(one for one in hypotheses(emulator) if one.name == "camera-scale"), {"error": 0.04})
    sd, given = emulator.sd(theta), {"error": np.array([0.04])}
    shift = shifts(emulator, scale.hypothesis, theta, sd, 0.5, given).features[0]
    specimens, drift = drawn_fabric(emulator, generator)
    seen = specimens - emulator.mean(THETA) + emulator.mean(theta) + faces_of(shift) * sd
    fabric = fabric_of(emulator, seen, drift)
    at = fabric.against(start=theta, shift=shift, fixed=True)
    (note,) = domain_doubts(emulator, fabric.features, at, fabric.shift([scale], at))
    assert "bending stiffness lies at the lower end" in note
    with pytest.raises(Refused, match="limper than any"):
        domain_doubts(emulator, fabric.features, at, np.zeros_like(shift))


@pytest.mark.parametrize(
    ("bending", "coverage", "said"),
    [
        (LOW[0], -0.05, "this cloth is limper than any of the atlas"),
        (LOW[0], 0.2, "its drape coefficient is that of a stiffer one"),
        (HIGH[0], 0.2, "this cloth is stiffer than any of the atlas"),
        (HIGH[0], -0.2, "its drape coefficient is that of a limper one"),
    ],
)
def test_a_cloth_is_called_limper_than_the_atlas_only_where_it_drapes_so(
    emulator: Emulator, bending: float, coverage: float, said: str
) -> None:
    """An outline without folds may be nearest to the limpest cloth, though a middling one covers as much."""
    theta = PRIOR_MEAN.copy()
    theta[0] = bending
    specimens, drift = drawn_fabric(emulator, np.random.default_rng(0))
    seen = specimens - emulator.mean(THETA) + emulator.mean(theta)
    seen[..., NAMES.index("area_dc")] += coverage
    fabric = fabric_of(emulator, seen, drift)
    at = fabric.against(start=theta, fixed=True)
    with pytest.raises(Refused, match=said):
        domain_doubts(emulator, fabric.features, at, np.zeros(len(at.kept)))


def test_an_effect_many_times_as_strong_as_usual_is_to_be_measured(emulator: Emulator) -> None:
    offset = next(one for one in hypotheses(emulator) if one.name == "camera-offset")
    assert not unusual([Candidate(offset, {"shift": 6e-3, "direction": 0.0})])
    (note,) = unusual([Candidate(offset, {"shift": 23e-3, "direction": 0.0})])
    assert "camera-offset: shift 0.023 m is 16 times what is usual" in note
    pure = next(one for one in hypotheses(emulator) if one.effect.severity.unit == "1")
    severity = pure.effect.severity
    (note,) = unusual([Candidate(pure, {severity.name: 8 * severity.typical})])
    assert f"{severity.name} {8 * severity.typical:.3g} is 8 times what is usual" in note  # without a unit "1"


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
    spot = place(best, residual.white, made)
    assert spot.map.shape == (4, 16)
    assert spot.map.sum() == pytest.approx(1)
    assert spot.localisable
    assert spot.angle is not None
    first, last = spot.angle
    assert (200.0 - first) % 360 <= last - first
    assert place(None, residual.white, made).localisable is False


def test_a_patch_whose_place_is_not_told_says_why(emulator: Emulator) -> None:
    residual = residual_of(emulator, *drawn_fabric(emulator, np.random.default_rng(8)))
    patch = next(one for one in hypotheses(emulator) if one.name == "local-mass-patch")
    cause = Candidate(patch, {"mass": 2.0, "direction": 200.0, "radius": 0.13, "size": 0.02})
    nothing = np.zeros_like(residual.white)  # nothing is left that a patch at any place could explain
    spot = place(cause, nothing, detectable_grids(emulator, residual))
    assert (spot.kind, spot.localisable) == ("patch", False)
    assert "the map is nearly as wide as under noise" in spot.why_not


def test_advice_is_the_entropy_of_its_partition() -> None:
    found = advise({"density-bias": 0.5, NONE: 0.5})
    assert found[0].bits == pytest.approx(1.0)
    assert any(one.measurement.name == "weigh" for one in found)
    assert advise({"creep": 1.0}) == []
    shared = {"plate-tilt": {"plate-tilt": 0.75, "off-centre": 0.25}}
    in_doubt = advise({"plate-tilt": 1.0, NONE: 0.0}, shared=shared)
    assert {one.measurement.name for one in in_doubt} == {"measure the plate", "side view"}
    assert [one.bits for one in in_doubt] == pytest.approx([0.811] * 2, abs=1e-3)
    assert advise({"plate-tilt": 1.0}, shared={"plate-tilt": {"plate-tilt": 1.0}}) == []


def test_what_has_been_measured_already_is_not_advised() -> None:
    either = {"rest-curvature": 0.5, NONE: 0.5}
    assert TURN_OVER in [one.measurement.name for one in advise(either, most=9)]
    assert TURN_OVER not in [one.measurement.name for one in advise(either, made=(TURN_OVER,), most=9)]


def test_a_density_does_not_hang_on_the_units_of_the_rows(emulator: Emulator) -> None:
    """They are those of the best base parameters, and densities of several are compared."""
    residual = residual_of(emulator, *drawn_fabric(emulator, np.random.default_rng(7)))
    rows = np.ones(len(residual.kept))
    rows[SPREAD] = 2.0  # entries of `SPREADS` are in no unit of theirs
    coarser = replace(residual, sd=2 * residual.sd, root=residual.root * (rows / 2)[residual.kept, None])
    assert coarser.log_likelihood == pytest.approx(residual.log_likelihood)


def test_one_simulated_sample_is_refused(emulator: Emulator) -> None:
    with pytest.raises(DiagnosisError, match="2 or more, or 0"):
        diagnose(read_captures(load("synthetic"), "fabric_2"), emulator, options=Options(samples=1))


def test_one_picture_of_each_drape_shows_creep_as_little_as_friction(one_thread: None) -> None:
    captures = read_captures(load("synthetic"), "fabric_2")
    first = captures.select(np.isin(captures.capture, (1, 3)))
    found = diagnose(first, *load_atlas(), Options(samples=0))
    assert found.acting["creep"] == found.acting["bending-friction"] > 0
    assert found.probability["creep"] == found.probability["bending-friction"]
    assert any("creep cannot be told from bending-friction" in note for note in found.notes)


@pytest.mark.slow
def test_whole_diagnosis_of_simulated_fabrics(emulator: Emulator, one_thread: None) -> None:
    """Creep on another mesh than the atlas': named, most of the gap closed on samples that were not fitted."""
    captures = simulated_captures("creep", 0.4)
    found = diagnose(captures, emulator, options=Options(samples=5))
    assert "creep" in found.effects
    creep = next(one for one in found.causes if one.hypothesis.name == "creep")
    assert creep.value["loss"] == pytest.approx(0.4, abs=0.2)
    assert found.p < 0.05
    one = document(found, captures, emulator, command="", version="")
    assert one.causes[0].effect == "creep"
    assert one.where.stage["history"] > 0.6
    assert TURN_OVER not in [each.measurement.name for each in found.advice]  # both faces are there
    assert one.data == DataCounts(samples=8, captures=32, up=16, down=16, later=16, areal_density_kg_m2=None)
    assert abs(sum(cause.probability for cause in answer(found).causes) - 1) < 0.05
    profiles = [profile.radii_m for profile in one.profiles.base]
    table = {row.name: row.base for row in one.statistics}
    assert table["mean_radius"] == pytest.approx(np.mean(profiles), abs=1e-4)  # of the drapes that the page shows
    again = diagnose(captures, emulator, options=Options(samples=0, without=("creep",)))
    assert "creep" not in again.effects
    assert "creep" not in again.probability


@pytest.mark.slow
def test_a_pinhole_camera_is_an_imaging_cause(emulator: Emulator, one_thread: None) -> None:
    """The published programs look through a camera .7 m above, the silhouettes are parallel projections."""
    found = diagnose(simulated_captures("perspective", 1 / 0.7, samples=16), emulator, options=Options(samples=0))
    assert found.p < 0.05
    alike = {name for name, one in registered().items() if one.kind == "imaging"} | {"cut-size"}
    assert sum(value for name, value in found.probability.items() if name in alike) > 0.6


def test_fabric_without_effect_is_left_in_peace(emulator: Emulator, one_thread: None) -> None:
    found = diagnose(simulated_captures(), emulator, options=Options(samples=0))
    assert found.verdict == NONE
    assert found.gap is None
    assert NONE in found.set90


def test_little_data_gets_what_is_possible(emulator: Emulator, one_thread: None) -> None:
    whole = simulated_captures(samples=3)
    found = diagnose(whole.select((whole.side == "up") & (whole.capture == 1)), emulator, options=Options(samples=0))
    assert found.verdict in (NONE, "ambiguous", UNKNOWN)
    assert any("natural variability is mostly the model's" in note for note in found.notes)
    assert any("one face" in note for note in found.notes)
    assert any("creep cannot be told from bending-friction" in note for note in found.notes)
    with pytest.raises(Refused, match="at least 2 samples, simulated has 1"):
        diagnose(whole.select(whole.sample == 1), emulator)
    missing = whole.select((whole.sample > 1) | (whole.capture == 1))
    unequal = diagnose(missing, emulator, options=Options(samples=0))
    assert any("captures are unequal, 1 to 2" in note for note in unequal.notes)


def test_creep_is_weighed_where_no_capture_is_repeated(emulator: Emulator) -> None:
    """As what acts on every capture, as friction does, which is what the note says."""
    generator = np.random.default_rng(1)
    specimens, _ = drawn_fabric(emulator, generator)
    fabric = FabricData(emulator, Calibration(), features(specimens), None, 0.0)
    assert {"creep", "bending-friction"} <= set(fabric.model(fabric.against()).points.names)


def test_another_plate_is_refused(emulator: Emulator, one_thread: None) -> None:
    captures = simulated_captures(samples=3)
    other = replace(captures, protocol=replace(captures.protocol, plate_radius_m=0.06))
    with pytest.raises(Refused, match="plate over cloth"):
        diagnose(other, emulator)


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


def test_a_headline_says_what_acts_and_what_is_left(emulator: Emulator) -> None:
    captures = simulated_captures("camera-offset", 4e-3, samples=4)
    found = diagnose(captures, emulator, options=Options(samples=0))
    doubtful = {UNKNOWN: 0.55, "camera-offset": 0.3, "plate-tilt": 0.1, NONE: 0.05}
    for kept in ((UNKNOWN, "camera-offset", "plate-tilt"), ("camera-offset", "plate-tilt")):
        said = headline(replace(found, verdict="ambiguous", probability=doubtful, set90=kept))
        assert "one of camera-offset, plate-tilt" in said
        assert ("something that is not on the list (55%)" in said) == (UNKNOWN in kept)
        assert "chance" not in said
    said = headline(replace(found, verdict="ambiguous", probability=doubtful | {NONE: 0.92}, set90=(NONE,)))
    assert said.startswith("Something shows, but no known effect stands out: it may be chance alone (92%).")
    acting, shared = {"camera-offset": 0.9, "creep": 0.7}, Budget({}, Share(0.25, (0.2, 0.3)))
    said = headline(
        replace(
            found, verdict="several", effects=("camera-offset", "creep"), groups=(("cut-size", "threshold"),),
            acting=acting, budget=shared, causes=found.causes or (Candidate(hypotheses(emulator)[0], {}),),
        )
    )  # fmt: skip
    assert "camera-offset (90%), creep (70%), and one of cut-size, threshold" in said
    assert said.endswith("Unexplained of the gap on unseen samples: 25%.")
    groups = (("camera-offset", "plate-tilt"), ("cut-size", "threshold"))
    said = headline(
        replace(found, verdict="ambiguous", effects=(), groups=groups, probability=doubtful, set90=sum(groups, ()))
    )
    assert said.startswith("Several effects act together")
    assert "one of camera-offset, plate-tilt, and one of cut-size, threshold." in said


def test_a_set_of_effects_holds_those_of_the_laboratory(emulator: Emulator) -> None:
    captures = simulated_captures("camera-offset", 4e-3, samples=3)
    offset = next(one for one in hypotheses(emulator) if one.name == "camera-offset" and one.frame == "lab")
    shared = SharedCauses((Candidate(offset, {"shift": 4e-3, "direction": 0.0}),))
    others = tuple({one.name for one in hypotheses(emulator)} - {"camera-offset", "plate-slip"})  # to save time
    found = diagnose(captures, emulator, options=Options(samples=0, without=others), shared=shared)
    assert found.shared == ("camera-offset",)
    assert sum(found.sets.values()) == pytest.approx(1)
    assert all("camera-offset" in names for names in found.sets)


@pytest.mark.parametrize("p", [0.4, 0.0])
def test_what_may_act_instead_for_all_fabrics_has_their_parameters(emulator: Emulator, p: float) -> None:
    """Unless it is likelier that this fabric alone shows it, at its own."""
    captures = simulated_captures("camera-offset", 4e-3, samples=3)
    known = {one.name: one for one in hypotheses(emulator) if one.frame == "lab"}
    shared = (Candidate(known["camera-offset"], {"shift": 4e-3, "direction": 0.0}),)
    instead = {"off-centre": Candidate(known["off-centre"], {"shift": 5e-3, "direction": 10.0})}
    acting = {"camera-offset": {"camera-offset": 1 - p, "off-centre": p}}
    others = tuple({one.name for one in hypotheses(emulator)} - {"camera-offset", "off-centre"})  # to save time
    options = Options(samples=0, without=others)
    found = diagnose(captures, emulator, options=options, shared=SharedCauses(shared, acting, instead))
    assert (found.best["off-centre"].value["shift"] == 5e-3) == (p > 0)


def test_the_likeliest_other_of_each_group_is_simulated_in_its_place(emulator: Emulator) -> None:
    known = {one.name: Candidate(one, {}) for one in hypotheses(emulator)}
    causes = [known[name] for name in ("plate-tilt", "camera-scale", "camera-offset", "creep")]
    groups = (("camera-scale", "threshold", "cut-size"), ("plate-tilt", "camera-tilt"), ("camera-offset", "off-centre"))
    acting = {"threshold": 0.1, "cut-size": 0.2, "camera-tilt": 0.3, "off-centre": 0.4}
    best = {name: known[name] for name in acting}
    found = _exchanges(groups, causes, best, acting)
    assert found == {"camera-offset": known["off-centre"], "plate-tilt": known["camera-tilt"]}, "no more than two"
    assert _exchanges(groups[:1], causes, best, acting) == {"camera-scale": known["cut-size"]}
    twice = (("camera-offset", "off-centre"), ("creep", "off-centre", "cut-size"))
    found = _exchanges(twice, causes, best, acting)
    assert found == {"camera-offset": known["off-centre"], "creep": known["cut-size"]}, "nothing acts twice"
    assert _exchanges((("rim-stiffening", "creep"),), causes, best, acting) == {}


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
