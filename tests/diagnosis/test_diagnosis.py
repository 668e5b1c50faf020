"""Whole diagnoses against known answers: fabrics simulated on another mesh than that of the atlas, and little data."""

from dataclasses import replace

import numpy as np
import pytest
from atlas_fabrics import only, simulated_captures

from cusick_bench.datasets import load
from cusick_bench.diagnosis import data_set
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.data_set import DataSetDiagnosis
from cusick_bench.diagnosis.diagnose import Options, _exchanges, diagnose
from cusick_bench.diagnosis.document.build import answer, document
from cusick_bench.diagnosis.document.model import DataCounts
from cusick_bench.diagnosis.errors import DiagnosisError, Refused
from cusick_bench.diagnosis.inference.laboratory.shared_effects import Laboratory, SharedEffect
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.evidence import (
    NONE,
    UNKNOWN,
    Candidate,
)
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.diagnosis.inference.single_effects.next_measurement import TURN_OVER
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.sim.effects import registered
from cusick_bench.sim.setup import Simulators


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


@pytest.mark.slow
def test_fabric_without_effect_is_left_in_peace(emulator: Emulator, one_thread: None) -> None:
    found = diagnose(simulated_captures(), emulator, options=Options(samples=0))
    assert found.verdict == NONE
    assert found.gap is None
    assert NONE in found.set90


def test_little_data_gets_what_is_possible(emulator: Emulator, one_thread: None) -> None:
    whole = simulated_captures(samples=3)
    options = only("creep", "bending-friction", "camera-offset")
    found = diagnose(whole.select((whole.side == "up") & (whole.capture == 1)), emulator, options=options)
    assert found.verdict in (NONE, "ambiguous", UNKNOWN)
    assert any("natural variability is mostly the model's" in note for note in found.notes)
    assert any("one face" in note for note in found.notes)
    assert any("creep cannot be told from bending-friction" in note for note in found.notes)
    with pytest.raises(Refused, match="at least 2 samples, simulated has 1"):
        diagnose(whole.select(whole.sample == 1), emulator)
    missing = whole.select((whole.sample > 1) | (whole.capture == 1))
    unequal = diagnose(missing, emulator, options=options)
    assert any("captures are unequal, 1 to 2" in note for note in unequal.notes)


@pytest.mark.slow
def test_one_picture_of_each_drape_shows_creep_as_little_as_friction(one_thread: None) -> None:
    captures = read_captures(load("synthetic"), "fabric_2")
    first = captures.select(np.isin(captures.capture, (1, 3)))
    found = diagnose(first, *load_atlas(), Options(samples=0))
    assert found.acting["creep"] == found.acting["bending-friction"] > 0
    assert found.probability["creep"] == found.probability["bending-friction"]
    assert any("creep cannot be told from bending-friction" in note for note in found.notes)


def test_one_simulated_sample_is_refused(emulator: Emulator) -> None:
    with pytest.raises(DiagnosisError, match="2 or more, or 0"):
        diagnose(read_captures(load("synthetic"), "fabric_2"), emulator, options=Options(samples=1))


def test_another_plate_is_refused(emulator: Emulator, one_thread: None) -> None:
    captures = simulated_captures(samples=3)
    other = replace(captures, protocol=replace(captures.protocol, plate_radius_m=0.06))
    with pytest.raises(Refused, match="plate over cloth"):
        diagnose(other, emulator)


def test_a_set_of_effects_holds_those_of_the_laboratory(emulator: Emulator) -> None:
    captures = simulated_captures("camera-offset", 4e-3, samples=3)
    offset = next(one for one in hypotheses(emulator) if one.name == "camera-offset" and one.frame == "lab")
    shared = SharedCauses((Candidate(offset, {"shift": 4e-3, "direction": 0.0}),))
    found = diagnose(captures, emulator, options=only("camera-offset", "plate-slip"), shared=shared)
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
    options = only("camera-offset", "off-centre")
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


@pytest.mark.parametrize("probability", [0.9, 0.3])
def test_every_fabric_is_diagnosed_with_what_all_of_them_show(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, probability: float
) -> None:
    """Where it is likely enough to be named, so that no fabric has its answer without the others."""
    given: list[SharedCauses] = []

    def refuse(*data: object, shared: SharedCauses, **named: object) -> None:
        given.append(shared)
        raise Refused("not today")

    monkeypatch.setattr(data_set, "diagnose", refuse)
    scale = Candidate(next(one for one in hypotheses(emulator) if one.name == "camera-scale"), {"error": 0.02})
    found = Laboratory(("a", "b"), (SharedEffect("camera-scale", probability, scale, {}, {}),), {})
    captures = read_captures(load("synthetic"), "fabric_2")
    made = DataSetDiagnosis(
        {"a": captures, "b": captures}, emulator, Calibration(), Options(samples=0), found, Simulators()
    )
    one = made.document("b", command="")
    assert (one.fabric, one.verdict, one.refused) == ("b", "refused", "not today")
    assert [shared.causes for shared in given] == [(scale,) if probability > 0.5 else ()]
    assert list(made.together("b")) == (["a", "b"] if probability > 0.5 else ["b"])
    assert list(replace(made, laboratory=None).together("b")) == ["b"]
