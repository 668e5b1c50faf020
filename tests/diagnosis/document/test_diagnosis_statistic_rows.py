"""Statistics of data and models side by side: differences in standard errors, shifts by the fabric's own outlines."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cusick_bench.datasets import load
from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.diagnose import Diagnosis, diagnose
from cusick_bench.diagnosis.document.build import answer, document, with_effect
from cusick_bench.diagnosis.document.statistic_rows import statistic_rows
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.measure.captures import Captures, read_captures
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.gap import Gap
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.diagnosis.options import Options
from cusick_bench.diagnosis.simulation.closure import Closure
from cusick_bench.diagnosis.simulation.samples import Simulated


def scores(emulator: Emulator, specimens: np.ndarray, simulated: np.ndarray | None) -> np.ndarray:
    """z of a fabric whose base model is at the prior means."""
    drapes = None if simulated is None else SimpleNamespace(base=SimpleNamespace(specimens=simulated), effect=None)
    diagnosis = SimpleNamespace(
        residual=SimpleNamespace(theta=PRIOR_MEAN, sd=emulator.sd(PRIOR_MEAN)),
        features=features(specimens), emulator=emulator, causes=(), simulated=drapes,
    )  # fmt: skip
    return np.array([row.z for row in statistic_rows(diagnosis)], dtype=np.float64)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("faces", ["both", "up", "unequal"])
@pytest.mark.parametrize("simulated", [0, 6])
def test_differences_by_chance_are_one_standard_error(emulator: Emulator, faces: str, simulated: int) -> None:
    """Of two faces the one that differs more counts: the larger of two such numbers has the mean square 1 + 2 / pi."""
    generator, made = np.random.default_rng(3), []
    for _ in range(60):
        noise = generator.standard_normal((12 + simulated, 2, len(NAMES)))
        drawn = emulator.mean(PRIOR_MEAN) + noise * emulator.sd(PRIOR_MEAN)
        data = drawn[:12].copy()
        data[0 if faces == "up" else 3 if faces == "unequal" else 12 :, 1] = np.nan
        made.append(scores(emulator, data, drawn[12:] if simulated else None))
    expected = 1.0 if faces == "up" else np.sqrt(1 + 2 / np.pi)
    assert np.sqrt(np.mean(np.square(made))) == pytest.approx(expected, rel=0.05)


def test_effects_of_the_camera_move_the_fabrics_own_outlines(
    emulator: Emulator, diagnosed: tuple[Captures, Diagnosis]
) -> None:
    _, found = diagnosed
    (scale,) = (one for one in hypotheses(emulator) if one.name == "camera-scale")
    found = replace(found, causes=(Candidate(scale, {"error": 0.02}, 0.0, 0.0, 0.0),))
    (row,) = (row for row in statistic_rows(found) if row.name == "mean_radius")
    assert row.up is not None
    assert row.base is not None
    assert row.effect is not None
    assert row.effect - row.base == pytest.approx(row.up * (1 - 1 / 1.02), rel=1e-3)


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize(("face", "sign"), [(0, -1), (1, 1)])
def test_of_one_face_an_effect_is_shown_as_it_acts_on_that_face(
    emulator: Emulator, face: int, sign: int, simulated: bool
) -> None:
    """Cloth that curls drapes more on one face and less on the other; on both together little is seen of it."""
    curl = next(one for one in hypotheses(emulator) if one.name == "rest-curvature")
    value, sd = {"curvature": 40.0, "direction": 0.0}, emulator.sd(PRIOR_MEAN)
    given = {name: np.array([number]) for name, number in value.items()}
    even, odd = shifts(emulator, curl, PRIOR_MEAN, sd, 0.5, given).features[0][: 2 * len(NAMES)].reshape(2, -1)
    drawn = emulator.mean(PRIOR_MEAN) + np.random.default_rng(3).standard_normal((12, 2, len(NAMES))) * sd
    curled = drawn + np.stack([even - odd, even + odd]) * sd
    data = curled.copy()
    data[:, 1 - face] = np.nan
    drapes = SimpleNamespace(base=SimpleNamespace(specimens=drawn), effect=SimpleNamespace(specimens=curled))
    diagnosis = SimpleNamespace(
        residual=SimpleNamespace(theta=PRIOR_MEAN, sd=sd, drift=0.5, kept=np.ones(1)), features=features(data),
        emulator=emulator, causes=(Candidate(curl, value),), simulated=drapes if simulated else None,
    )  # fmt: skip
    place = NAMES.index("harmonic_2_real")
    row = statistic_rows(diagnosis)[place]  # pyright: ignore[reportArgumentType]
    assert row.base is not None
    assert row.effect is not None
    assert abs(odd[place]) > 2 * abs(even[place])
    assert row.effect - row.base == pytest.approx((even + sign * odd)[place] * sd[place], rel=1e-6)


def test_where_nothing_is_said_to_act_the_base_model_is_fitted_alone() -> None:
    """Of two drapes a camera off its place is likeliest, and no verdict: the base model is not fitted beside it."""
    captures = read_captures(load("synthetic"), "fabric_1")
    two = captures.select((captures.side == "down") & np.isin(captures.sample, (2, 3)) & (captures.capture == 3))
    emulator, calibration = load_atlas()
    found = diagnose(two, emulator, calibration, Options(samples=0))
    assert (found.verdict, found.causes) == ("none", ())
    assert next(iter(found.sets))  # something is likelier than nothing
    made = document(found, two, emulator, command="", version="")
    assert made.base.bending == found.plain.theta[0]
    (coverage,) = (row.z for row in made.statistics if row.name == "area_dc")
    assert coverage is not None
    assert abs(coverage) < 1.5  # any cloth can have it


@pytest.fixture(scope="module")
def diagnosed(emulator: Emulator) -> tuple[Captures, Diagnosis]:
    """Pictures of a fabric, and what was found from three samples of it, without simulations."""
    captures = read_captures(load("synthetic"), "fabric_1")
    return captures, diagnose(captures.select(captures.sample <= 3), emulator, options=Options(samples=0))


@pytest.mark.parametrize(("name", "stated"), [("rest-curvature", 176.0), ("plate-tilt", 356.0)])
def test_a_direction_is_stated_within_the_turn_of_its_interval(
    emulator: Emulator, diagnosed: tuple[Captures, Diagnosis], name: str, stated: float
) -> None:
    """A curvature has an axis but no sense; a fit of it may pass 0 deg."""
    captures, found = diagnosed
    hypothesis = next(one for one in hypotheses(emulator) if one.name == name)
    cause = Candidate(hypothesis, {hypothesis.effect.severity.name: 4.0, "direction": 356.0})
    turned = replace(found, best={name: cause}, acting={name: 1.0}, intervals={name: {"direction": (170.0, 185.0)}})
    made = document(turned, captures, emulator, command="", version="")
    (parameters,) = (one.parameters for one in made.causes if one.effect == name)
    assert parameters["direction"].value == stated


def test_a_document_states_every_number_of_its_diagnosis_in_its_place(
    emulator: Emulator, diagnosed: tuple[Captures, Diagnosis]
) -> None:
    captures, found = diagnosed
    captures = captures.select((captures.side == "up") | (captures.sample == 1))
    captures = captures.select((captures.sample != 2) | (captures.capture == 1))  # of which one picture is left
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "camera-scale")
    cause, interval = Candidate(hypothesis, {"error": 0.03}), {"camera-scale": {"error": (0.01, 0.05)}}
    gap = Gap(0.5, 0.1, {"size": 0.4}, {"size": 0.2}, 0.6, (0.3, 0.8), 0.25)
    base, effect = (Simulated(np.zeros((1, 2, len(NAMES))), np.full((1, 2, 360), radius)) for radius in (0.1, 0.12))
    full = replace(
        found, causes=(cause,), best={"camera-scale": cause}, acting={"camera-scale": 0.9}, intervals=interval,
        shared=("camera-scale",), simulated=Closure(gap, base, effect), p=0.03, verdict="effect",
        effects=("camera-scale",), groups=(),
        place=replace(found.place, localisable=True, angle=(10.0, 40.0), radius=(0.12, 0.15)),
    )  # fmt: skip
    made, answered = document(full, captures, emulator, command="", version=""), answer(full)
    for one in (made.gap, answered.gap):
        assert (one.base, one.floor, one.p) == (0.5, 0.1, 0.03)
    assert made.gap.effect == 0.25
    assert (made.gap.groups["size"].gap, made.gap.groups["size"].floor) == (0.4, 0.2)
    assert (made.closure.effect, made.closure.fraction, made.closure.ci90) == (("camera-scale",), 0.6, (0.3, 0.8))
    for profiles, radius in ((made.profiles.base, 0.1), (made.profiles.effect, 0.12)):
        assert [(one.sample, one.side) for one in profiles] == [(1, "up"), (1, "down")]
        assert {one for profile in profiles for one in profile.radii_m} == {radius}
    (stated,) = (one for one in made.causes if one.effect == "camera-scale")
    assert (stated.acting, stated.shared, stated.stage) == (0.9, True, "imaging")
    assert (stated.parameters["error"].value, stated.parameters["error"].ci90) == (0.03, (0.01, 0.05))
    assert (made.where.angle_deg, made.where.radius_m) == ((10.0, 40.0), (0.12, 0.15))
    faces = [int((captures.side == side).sum()) for side in ("up", "down")]
    assert faces[0] > faces[1] > 0
    assert (made.data.up, made.data.down, made.data.captures) == (*faces, sum(faces))
    assert made.data.samples == len(set(captures.sample.tolist()))
    assert made.data.later == made.data.samples, "the second of each face: two of sample 1, one of each other but 2"
    assert made.fit.base == pytest.approx(np.mean(found.plain.white**2))


def test_what_was_found_of_captures_numbered_backwards_is_simulated_forwards(emulator: Emulator) -> None:
    """A loss of the other sign stands for the other order; a camera's scale may be too small by itself."""
    known = {one.name: one for one in hypotheses(emulator)}
    assert with_effect(Candidate(known["creep"], {"loss": -0.2}), 0.8) == "creep:loss=0.2"
    assert with_effect(Candidate(known["camera-scale"], {"error": -0.02}), 0.8) == "camera-scale:error=-0.02"
