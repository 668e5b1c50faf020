"""What a laboratory shares, and what may act in its place: exchanges of one shared effect for another."""

from dataclasses import replace

import numpy as np
import pytest

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.detectability.power import expected_features
from cusick_bench.diagnosis.inference.findings.novelty import Novelty
from cusick_bench.diagnosis.inference.findings.verdict import finding
from cusick_bench.diagnosis.inference.laboratory.look_alikes import AdaptedSet, Exchanges
from cusick_bench.diagnosis.inference.laboratory.shared_effects import (
    Laboratory,
    LaboratoryFabric,
    SharedEffect,
    least_lead,
    shared_points,
    shares,
)
from cusick_bench.diagnosis.inference.laboratory.shared_walk import SharedWalk, pooled
from cusick_bench.diagnosis.inference.residuals.feature_rows import FACE_EVEN, FACE_ODD, faces_of
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import fabric_sets
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN, Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts

FITS = Novelty(0.5, 0.9)
NAMES = ("camera-offset", "camera-scale")


@pytest.fixture(scope="module")
def fabrics(emulator: Emulator) -> list[LaboratoryFabric]:
    """Three fabrics under a camera 3 mm beside its place, whose picture is 2 % too large."""
    plain = FabricData(emulator, Calibration(), expected_features(emulator, PRIOR_MEAN, 12), None, 0.5)
    sd, features = emulator.sd(PRIOR_MEAN), plain.features
    for name, value in (("camera-offset", {"shift": 3e-3, "direction": 120.0}), ("camera-scale", {"error": 0.02})):
        one = next(h for h in hypotheses(emulator) if h.name == name)
        point = {key: np.array([number]) for key, number in value.items()}
        shift = shifts(emulator, one, PRIOR_MEAN, sd, 0.5, point).features[0]
        features = replace(
            features,
            mean=features.mean + faces_of(shift) * sd,
            contrast=features.contrast + np.stack([shift[FACE_EVEN] * sd, shift[FACE_ODD] * sd]),
        )
    data = replace(plain, features=features)
    sets = fabric_sets(data, data.against(), np.random.default_rng(0), steps=20)
    return [LaboratoryFabric(name, data, sets) for name in "abc"]


def started_from(fabrics: list[LaboratoryFabric], *names: str) -> SharedWalk:
    """A walk that begins at the strongest points of effects."""
    points = [shared_points(one) for one in fabrics]
    first = points[0]
    start = [int(np.argmax(np.where(first.effect == first.names.index(name), first.size(), 0))) for name in names]
    return SharedWalk(fabrics, points, np.random.default_rng(0), start)


@pytest.fixture(scope="module")
def found(fabrics: list[LaboratoryFabric]) -> Exchanges:
    """After a search that begins at a look-alike of each of the two effects that act."""
    exchanges = Exchanges(fabrics, np.random.default_rng(0))
    exchanges.search(started_from(fabrics, "off-centre", "cut-size"))
    return exchanges


@pytest.mark.slow
def test_intervals_of_what_is_shared_hold_the_stated_value(fabrics: list[LaboratoryFabric]) -> None:
    """Which is refined after the walk, and may leave its densest point."""
    walk = started_from(fabrics, "camera-offset")
    walk.step(counts=True)
    hypothesis = next(one for one in hypotheses(fabrics[0].data.emulator) if one.name == "camera-offset")
    stated = Candidate(hypothesis, {"shift": 3e-3, "direction": 170.0})
    found = {one.name: one for one in pooled([walk], np.ones(1), [stated]).effects}["camera-offset"]
    assert found.cause == stated
    low, high = found.intervals["direction"]
    assert (170 - low + 1e-6) % 360 <= high - low + 2e-6
    low, high = {one.name: one for one in pooled([walk], np.ones(1)).effects}["camera-offset"].intervals["direction"]
    assert (170 - low) % 360 > high - low


@pytest.mark.slow
class TestExchanges:
    def test_from_a_look_alike_what_acts_is_found(self, found: Exchanges) -> None:
        assert found.likeliest == frozenset(NAMES)
        walk = found.sets[found.likeliest].walk
        points = walk.points[0]
        values = {points.name(point): points.value(point) for point in walk.shared}
        assert values["camera-offset"]["shift"] == pytest.approx(3e-3, rel=0.5)  # a grid's points differ by half
        assert values["camera-scale"]["error"] == pytest.approx(0.02, rel=0.5)

    def test_without_it_less_is_explained_than_with_any_other_in_its_place(self, found: Exchanges) -> None:
        for name in NAMES:
            others = found.look_alikes(name)
            assert all(0 < nats < found.without(name) for nats in others.values())
            assert list(others.values()) == sorted(others.values())
        assert found.without("camera-offset") > least_lead(3)

    def test_a_look_alike_has_the_parameters_that_all_fabrics_would_share(self, found: Exchanges) -> None:
        one = found.in_place_of("camera-offset", "off-centre")
        assert one.hypothesis.name == "off-centre"
        assert one.value["shift"] > 1e-3
        assert one.value["direction"] == pytest.approx(120, abs=30)

    def test_walks_of_a_set_never_lose_an_effect(self, found: Exchanges) -> None:
        for names, one in found.sets.items():
            points = one.walk.points[0]
            assert {points.name(point) for point in one.walk.shared} == names


def exchanges_with(log_joint: dict[tuple[str, ...], float]) -> Exchanges:
    """Thirteen fabrics, with sets that have been tried."""
    walk: SharedWalk = object()  # pyright: ignore[reportAssignmentType]
    one: LaboratoryFabric = object()  # pyright: ignore[reportAssignmentType]
    found = Exchanges([one] * 13, np.random.default_rng(0))
    found.sets = {frozenset(names): AdaptedSet(walk, value) for names, value in log_joint.items()}
    found.likeliest = max(found.sets, key=lambda names: found.sets[names].log_joint)
    return found


def test_a_look_alike_explains_more_than_half_and_is_not_too_far_behind() -> None:
    found = exchanges_with(
        {
            ("plate-tilt", "camera-scale"): -1000.0,
            ("camera-scale",): -1100.0,
            ("camera-tilt", "camera-scale"): -1010.0,
            ("camera-offset", "camera-scale"): -1035.0,
            ("off-centre", "camera-scale"): -1040.0,  # beyond 36 nat, ten times the square root of thirteen
            ("plate-tilt",): -1010.0,
            ("plate-tilt", "cut-size"): -1004.0,
            ("plate-tilt", "threshold"): -1006.0,  # explains less than half of what the scale explains
        }
    )
    assert found.look_alikes("plate-tilt") == {"camera-tilt": 10.0, "camera-offset": 35.0}
    assert found.look_alikes("camera-scale") == {"cut-size": 4.0}
    assert found.without("camera-scale") == 10.0
    assert found.look_alikes("perspective") == {}
    assert found.without("perspective") == np.inf


def test_a_lead_that_errors_of_the_base_model_can_cause_is_nineteen_to_one() -> None:
    for fabrics in (2, 13):
        share = shares({"first": 0.0, "second": least_lead(fabrics)}, fabrics)
        assert share["first"] == pytest.approx(0.95)
    assert shares({"first": 0.0, "second": 0.0}, 5) == {"first": 0.5, "second": 0.5}


def test_probability_is_divided_among_look_alikes() -> None:
    tilt = Candidate(None, {"angle": 2.0})  # pyright: ignore[reportArgumentType]
    effects = (
        SharedEffect("plate-tilt", 0.9, tilt, {}, {}, {"camera-tilt": 0.0}),
        SharedEffect("camera-scale", 1.0, tilt, {}, {}),
        SharedEffect("threshold", 0.1, tilt, {}, {}),
    )
    acting = Laboratory(("a", "b"), effects, {}).acting
    assert acting["plate-tilt"] == pytest.approx({"plate-tilt": 0.45, "camera-tilt": 0.45})
    assert acting["camera-scale"] == {"camera-scale": 1.0}
    assert "threshold" not in acting


class TestFabricsOfALaboratoryInDoubt:
    own = SetPosterior({"creep": 0.9}, {"creep": 0.9, NONE: 0.08, UNKNOWN: 0.02}, {("creep",): 1.0}, (), np.zeros(0), 0)
    group = ("plate-tilt", "camera-tilt")

    def test_the_group_is_said_instead_of_its_first(self) -> None:
        found = finding(0.01, self.own, FITS, ("camera-scale", "plate-tilt"), [self.group])
        assert set(found.effects) == {"camera-scale", "creep"}
        assert found.groups == (self.group,)
        assert found.verdict == "several"
        assert {"camera-scale", "creep", *self.group} <= set(found.set90)

    def test_where_nothing_acts_beside_it(self) -> None:
        quiet = finding(0.5, self.own, FITS, ("camera-scale", "plate-tilt"), [self.group])
        assert (quiet.verdict, quiet.effects, quiet.groups) == ("several", ("camera-scale",), (self.group,))
        alone = finding(0.5, self.own, FITS, ("plate-tilt",), [self.group])
        assert (alone.verdict, alone.effects, alone.groups) == ("ambiguous", (), (self.group,))
        assert set(self.group) <= set(alone.set90)


def test_what_acts_for_all_fabrics_beside_what_one_alone_shows(emulator: Emulator) -> None:
    """A look-alike of two shared effects counts by the larger probability, whichever comes last."""
    known = {one.name: Candidate(one, {}) for one in hypotheses(emulator)}
    causes, alike = (
        (known["plate-tilt"], known["off-centre"], known["camera-scale"]),
        {"camera-tilt": known["camera-tilt"]},
    )
    probability = {
        "plate-tilt": {"plate-tilt": 0.5, "camera-tilt": 0.4},
        "off-centre": {"off-centre": 0.8, "camera-tilt": 0.1},
    }
    shared = SharedCauses(causes, probability, alike)
    assert shared.groups == [("plate-tilt", "camera-tilt"), ("off-centre", "camera-tilt")]
    acting = shared.acting_beside({"camera-tilt": 0.2, "creep": 0.7})
    assert acting == {"plate-tilt": 0.5, "off-centre": 0.8, "camera-scale": 1.0, "camera-tilt": 0.4, "creep": 0.7}
    assert shared.likelier_than({"camera-tilt": 0.2}) == alike
    assert shared.likelier_than({"camera-tilt": 0.5}) == {}
