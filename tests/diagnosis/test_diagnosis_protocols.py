"""The same drapes under another laboratory's protocol are diagnosed alike, or it is said why not."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from atlas_fabrics import only
from other_laboratory import LARGE_IMAGES, NEAR_CAMERA, SMALL_CLOTH, write_laboratory
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.diagnosis.atlas.store import Calibration, load_uncalibrated
from cusick_bench.diagnosis.diagnose import diagnose
from cusick_bench.diagnosis.document.build import _measured, document
from cusick_bench.diagnosis.document.model import BaseParameters, DataCounts
from cusick_bench.diagnosis.document.with_effect import turning_notes
from cusick_bench.diagnosis.errors import DiagnosisError, Refused
from cusick_bench.diagnosis.inference.fabric_evidence import FabricEvidence, fabric_evidence
from cusick_bench.diagnosis.inference.residuals.refusal import doubts
from cusick_bench.diagnosis.inference.residuals.samples import sample_statistics, to_atlas
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.diagnosis.measure.captures import Captures, read_captures
from cusick_bench.diagnosis.measure.statistics import FREE, RESOLUTION, capture_statistics
from cusick_bench.diagnosis.options import Options
from cusick_bench.problem.scene import parse_causes
from cusick_bench.report.diagnosis.wording.words import cloth_in_words

CLOTH = "fabric_3"


@pytest.fixture(scope="module")
def laboratories(tmp_path_factory) -> dict[str, Path]:
    cases = {"release": RELEASE, "large images": LARGE_IMAGES, "small cloth": SMALL_CLOTH, "near camera": NEAR_CAMERA}
    return {
        name: write_laboratory(tmp_path_factory.mktemp("lab"), protocol, samples=6) for name, protocol in cases.items()
    }


def captures(laboratories: dict[str, Path], name: str) -> Captures:
    return read_captures(load(laboratories[name]), CLOTH)


def evidence(of: Captures) -> FabricEvidence:
    return fabric_evidence(of, load_uncalibrated()[0], Calibration(), np.random.default_rng(0))


def rows(of: Captures) -> np.ndarray:
    """Statistics in the atlas' lengths."""
    scaled, _ = to_atlas(of)
    return capture_statistics(scaled.cloth_frame(), scaled.protocol)


@pytest.mark.parametrize("name", [pytest.param("large images", marks=pytest.mark.slow), "small cloth"])
def test_statistics_and_evidence_agree_with_the_releases_protocol(laboratories, name):
    ours, nominal = captures(laboratories, name), captures(laboratories, "release")
    assert (ours.sample.tolist(), ours.side.tolist()) == (nominal.sample.tolist(), nominal.side.tolist())
    scale = ours.protocol.cloth_scale
    error = np.abs(ours.radii / scale - nominal.radii)  # a pixel of the release is 1.4 mm
    assert error.max() < 5e-4
    assert error.mean() < 1e-4
    assert to_atlas(ours)[0].area == pytest.approx(nominal.area, rel=1e-3)
    apart = np.abs(rows(ours) - rows(nominal))[:, list(FREE)] / RESOLUTION[list(FREE)]
    assert np.median(apart) < 0.2
    assert np.quantile(apart, 0.95) < 1.2
    found, expected = evidence(ours), evidence(nominal)
    assert found.p == pytest.approx(expected.p, abs=0.05)
    acting, other = expected.sets.posterior.effects, found.sets.posterior.effects
    for effect, probability in acting.items():
        assert other.get(effect, 0.0) == pytest.approx(probability, abs=0.15), effect


def test_lengths_of_another_cloth_are_said_to_be_scaled(laboratories):
    _, notes = to_atlas(captures(laboratories, "small cloth"))
    assert notes == [
        "lengths are those of the atlas' cloth of 150 mm radius; for this one, of 120 mm, multiply them by 0.8"
    ]
    assert to_atlas(captures(laboratories, "large images"))[1] == []


def test_causes_to_simulate_are_in_the_laboratorys_lengths(laboratories):
    emulator, _ = load_uncalibrated()
    known = {one.name: one for one in hypotheses(emulator)}
    values = {
        "local-mass-patch": {"mass": 1.0, "direction": 30.0, "radius": 0.12, "size": 0.02},
        "perspective": {"inverse_height": 1.0},
        "camera-scale": {"error": 0.02},
        "rest-curvature": {"curvature": 190.0, "direction": 45.0},
    }
    causes = tuple(Candidate(known[name], value, 0.0, 0.0, 0.0) for name, value in values.items())
    nominal = captures(laboratories, "release")
    found = replace(diagnose(nominal, emulator, options=only("creep")), causes=causes)
    made = [
        document(found, captures(laboratories, name), emulator, command="", version="")
        for name in ("release", "small cloth")
    ]
    listed = [one.with_effect for one in made]
    assert listed[0] == (
        "local-mass-patch:mass=1,direction=30,radius=0.12,size=0.02",
        "perspective:inverse_height=1",
        "camera-scale:error=0.02",
        "rest-curvature:curvature=190,direction=45",
    )
    assert listed[1] == (
        "local-mass-patch:mass=1,direction=30,radius=0.096,size=0.016",
        "perspective:inverse_height=1.25",
        "camera-scale:error=0.02",
        "rest-curvature:curvature=200,direction=45",  # its bound
    )
    assert len(parse_causes(listed[1])) == len(causes)
    told = [[note for note in one.notes if "--with-effect" in note] for one in made]
    assert told[0] == []
    assert told[1] == [
        "rest-curvature: curvature is 238 1/m on this cloth, but --with-effect takes -200 to 200 only and is given "
        "200, so what it simulates differs"
    ]


@pytest.mark.parametrize("frame", ["lab", "cloth"])
def test_a_direction_that_turns_over_with_the_cloth_is_told(laboratories, frame):
    emulator, _ = load_uncalibrated()
    known = next(one for one in hypotheses(emulator) if (one.name, one.frame) == ("off-centre", frame))
    cause = Candidate(known, {"shift": 0.004, "direction": 30.0}, 0.0, 0.0, 0.0)
    nominal = captures(laboratories, "release")
    found = diagnose(nominal, emulator, options=only("off-centre"))
    acting, probability = {**found.acting, "off-centre": 1.0}, {**found.probability, "off-centre": 0.5}
    found = replace(
        found, causes=(cause,), best={**found.best, "off-centre": cause}, acting=acting, probability=probability
    )
    made = document(found, nominal, emulator, command="", version="")
    assert made.with_effect == ("off-centre:shift=0.004,direction=30",)
    assert any("turns over with the cloth" in note for note in made.notes) == (frame == "cloth")
    (listed,) = (one for one in made.causes if one.effect == "off-centre")
    assert listed.turns_with_cloth == (frame == "cloth")


@pytest.mark.parametrize("turned", ["about y", "about x"])
def test_what_simulates_cloth_face_down_is_seen_where_the_camera_sees_it(laboratories, turned):
    """Simulated cloth is turned over about y: `run` sees its warp at 180 degrees."""
    known = {(one.name, one.frame): one for one in hypotheses(load_uncalibrated()[0])}
    places = {"direction": 30.0, "radius": 0.12, "size": 0.02}
    leaning = Candidate(known["plate-tilt", "cloth"], {"angle": 2.0, "direction": 30.0}, 0.0, 0.0, 0.0)
    heavy = Candidate(known["local-mass-patch", "cloth"], {"mass": 1.0, **places}, 0.0, 0.0, 0.0)
    nominal = captures(laboratories, "release")
    ours = replace(nominal, protocol=replace(nominal.protocol, turn_over=turned))
    seen = ours.seen_at()[ours.side == "down"][0, 30]
    notes = list(turning_notes((leaning, heavy), ours.warp_seen_down))
    assert (int(re.findall(r"give (\d+) minus the direction", notes[0])[0]) - 30) % 360 == seen
    on_cloth = 30 + (180 if "give the direction plus 180" in notes[-1] else 0)
    assert (180 - on_cloth) % 360 == seen


@pytest.mark.parametrize(("face", "direction"), [("up", 30), ("down", 150)])
def test_one_face_does_not_tell_whether_a_direction_turns_over_with_the_cloth(laboratories, face, direction):
    """It is stated on the bench: a cloth that was turned over about y is seen there as a mirror image."""
    emulator, _ = load_uncalibrated()
    known = next(one for one in hypotheses(emulator) if (one.name, one.frame) == ("off-centre", "cloth"))
    shared = SharedCauses((Candidate(known, {"shift": 0.004, "direction": 30.0}, 0.0, 0.0, 0.0),))
    nominal = captures(laboratories, "release")
    shown = nominal.select(nominal.side == face)
    found = diagnose(shown, emulator, options=only("off-centre", "creep"), shared=shared)
    made = document(found, shown, emulator, command="", version="")
    assert f"off-centre:shift=0.004,direction={direction}" in made.with_effect
    assert any("one face only" in note for note in made.notes)
    assert not any("turns over with the cloth" in note for note in made.notes)
    (listed,) = (one for one in made.causes if one.effect == "off-centre")
    assert not listed.turns_with_cloth
    assert listed.parameters["direction"].value == pytest.approx(direction)


def test_perspective_is_taken_out_and_said(laboratories):
    ours, nominal = captures(laboratories, "near camera"), captures(laboratories, "release")
    assert np.abs(ours.radii - nominal.radii).mean() < 1.5e-3
    (note,) = to_atlas(ours)[1]
    assert "radii are corrected for the pinhole camera" in note
    assert "hangs and bulges" in note, "as `hanging_line` does, no longer as straight lines"


def test_a_large_cloth_under_a_near_camera_is_scaled(laboratories):
    """The scaled eye, at 0.1875 m, is nearer than a protocol allows."""
    protocol = Protocol(
        cloth_radius_m=0.24, plate_radius_m=0.144, px_per_m=450.0, projection="pinhole", camera_height_m=0.3
    )
    nominal = captures(laboratories, "release")
    ours = replace(nominal, radii=1.6 * nominal.radii, area=1.6**2 * nominal.area, protocol=protocol)
    scaled, _ = to_atlas(ours)
    assert scaled.radii == pytest.approx(nominal.radii)
    assert scaled.protocol.cloth_radius_m == RELEASE.cloth_radius_m


def test_another_ratio_of_plate_to_cloth_is_refused_with_the_reason(tmp_path):
    root = write_laboratory(tmp_path, RELEASE, samples=3, captures=(1,))
    (root / "protocol.json").write_text('{"plate_radius_m": 0.075}')
    with pytest.raises(DiagnosisError, match=r"atlas is for plate over cloth = 0\.6, this protocol has 0\.075 m over"):
        to_atlas(read_captures(load(root), CLOTH))
    command = CliRunner().invoke(app, ["diagnose", str(root), "--samples", "0", "--out", str(tmp_path / "out")])
    assert command.exit_code == 2


def test_stiffness_is_that_of_the_laboratorys_cloth_and_gravity():
    base = BaseParameters(bending=-6.5)
    data = DataCounts(areal_density_kg_m2=0.2)
    other = DataCounts(areal_density_kg_m2=0.2, cloth_radius_m=0.12, gravity_m_s2=9.81)
    (_, nominal, _), (_, scaled, _) = cloth_in_words(base, data)[1], cloth_in_words(base, other)[1]
    assert nominal == f"{1e6 * np.exp(-6.5) * 0.2 * 9.8 * 0.15**3:.2g} µN m"
    assert scaled == f"{1e6 * np.exp(-6.5) * 0.2 * 9.81 * 0.12**3:.2g} µN m"


def test_faces_that_no_sample_shows_both_of_are_not_called_one_face(laboratories):
    both = captures(laboratories, "release")
    chosen = (both.side == "up") == (both.sample % 2 == 0)
    cases = {"no sample shows both faces": chosen, "one face only": both.side == "up"}
    for words, rows in cases.items():
        ours = both.select(rows)
        (note,) = (
            one for one in doubts(ours, sample_statistics(ours).features()) if "in part" in one and "face" in one
        )
        assert words in note


def test_few_samples_of_each_face_are_not_called_few_samples(laboratories):
    both = captures(laboratories, "release")
    up = both.side == "up"
    for rows, words in (
        (up == (both.sample % 2 == 0), "only 3 samples of a face:"),  # of six
        (both.sample <= 3, "only 3 samples:"),
        ((both.sample <= 2) & (up == (both.sample == 1)), "only 1 sample of a face:"),
    ):
        ours = both.select(rows)
        assert doubts(ours, sample_statistics(ours).features())[0].startswith(words)


def test_pictures_of_unknown_face_that_do_not_count_are_said(laboratories):
    both = captures(laboratories, "release")
    for unknown, count in ((both.side == "down", 6), (both.side == "up", 0), (both.sample == 2, 0)):
        ours = replace(both, side=np.where(unknown, "", both.side))
        found = [one for one in doubts(ours, sample_statistics(ours).features()) if "unknown face" in one]
        assert [f"{count} of them count for nothing but drift" in note for note in found] == [True] * bool(count)


def test_outlines_of_cloth_turned_over_about_x_are_shown_as_if_about_y(laboratories):
    ours = captures(laboratories, "release")
    radii = np.where((ours.side == "down")[:, None], np.roll(ours.radii, 180, axis=1), ours.radii)
    other = replace(ours, radii=radii, protocol=replace(ours.protocol, turn_over="about x"))
    assert _measured(other) == _measured(ours)


def test_a_picture_under_several_names_is_said(laboratories):
    ours = captures(laboratories, "release")
    first, second = (np.flatnonzero(ours.sample == number) for number in (1, 2))
    radii = ours.radii.copy()
    radii[second] = radii[first]
    features = sample_statistics(ours).features()
    (note,) = (one for one in doubts(replace(ours, radii=radii), features) if "repeat" in one and "picture" in one)
    assert note.startswith(f"{len(second)} pictures of this fabric repeat others")
    assert not [one for one in doubts(ours, features) if one.endswith("`data audit`")]
    same = replace(ours, radii=np.tile(radii[:1], (len(radii), 1)))
    with pytest.raises(Refused, match=rf"all {len(radii)} pictures of {CLOTH} are the same one"):
        diagnose(same, load_uncalibrated()[0], options=Options(samples=0))
