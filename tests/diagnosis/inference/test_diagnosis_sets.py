"""Sets of effects: what is planted together is named together, by the atlas' own statistics."""

import sys
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import (
    LAW_MISMATCH,
    OUTLINE_MISMATCH,
    PLATE_MISMATCH,
    Calibration,
)
from cusick_bench.diagnosis.inference.detectability.power import expected_features
from cusick_bench.diagnosis.inference.findings.budget import Budget, _parts, budget
from cusick_bench.diagnosis.inference.findings.evened import evened_out, evened_weights
from cusick_bench.diagnosis.inference.findings.intervals import parameter_intervals
from cusick_bench.diagnosis.inference.findings.novelty import Novelty, novelty
from cusick_bench.diagnosis.inference.findings.verdict import finding, look_alikes, set90
from cusick_bench.diagnosis.inference.laboratory.laboratory import laboratory
from cusick_bench.diagnosis.inference.laboratory.shared_effects import LaboratoryFabric
from cusick_bench.diagnosis.inference.residuals.feature_rows import DRIFT, FACE_EVEN, FACE_ODD, ROWS, SPREAD, faces_of
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import (
    FabricSets,
    fabric_sets,
    likeliest_candidates,
    named_causes,
)
from cusick_bench.diagnosis.inference.sets.misfit import misfit_of
from cusick_bench.diagnosis.inference.sets.refined import named_set, shared_set
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior, conditional
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN, Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.measure.features import ORDERS, Features
from cusick_bench.diagnosis.measure.statistics import NAMES

SIZES = {
    "camera-offset": (3e-3, 120.0),
    "face-asymmetry": (0.35, None),
    "creep": (0.15, None),
    "camera-scale": (-0.03, None),
}


def planted(emulator: Emulator, names: tuple[str, ...], bending: float = -6.0) -> tuple[FabricData, list[Candidate]]:
    """A fabric whose features are the base model's mean with effects added."""
    theta = PRIOR_MEAN.copy()
    theta[0] = bending
    sd, causes, total = emulator.sd(theta), [], np.zeros(ROWS)
    for name in names:
        hypothesis = next(one for one in hypotheses(emulator) if one.name == name and one.prior > 0.5)
        value = {p.name: p.default for p in hypothesis.effect.parameters}
        severity, direction = SIZES[name]
        value[hypothesis.effect.severity.name] = severity
        value |= {p.name: direction for p in hypothesis.effect.parameters if p.role == "direction"}
        causes.append(Candidate(hypothesis, value))
        point = {key: np.array([number]) for key, number in value.items()}
        total += shifts(emulator, hypothesis, theta, sd, 0.5, point).features[0]
    expected = expected_features(emulator, theta, 12)
    return FabricData(emulator, Calibration(), moved(expected, total, sd), None, 0.5), causes


def moved(features: Features, shift: np.ndarray, sd: np.ndarray) -> Features:
    """Features with a shift of the rows, in sd."""
    even, odd = shift[FACE_EVEN] * sd, shift[FACE_ODD] * sd
    return replace(
        features,
        mean=features.mean + faces_of(shift) * sd,
        contrast=features.contrast + np.stack([even, odd]),
        spread=features.spread + shift[SPREAD],
        order=features.order + shift[DRIFT] * sd[list(ORDERS)],
    )


def weighed(fabric: FabricData, seed: int = 0) -> FabricSets:
    return fabric_sets(fabric, fabric.against(), np.random.default_rng(seed), steps=40)


@pytest.fixture(scope="module")
def three(emulator: Emulator) -> tuple[FabricData, FabricSets]:
    fabric, _ = planted(emulator, ("camera-offset", "face-asymmetry", "creep"))
    return fabric, weighed(fabric)


def test_a_set_is_found_whole(three: tuple[FabricData, FabricSets]) -> None:
    fabric, sets = three
    acting = sets.posterior.effects
    assert acting["face-asymmetry"] > 0.9
    assert acting["creep"] > 0.9
    place = {"camera-offset", "camera-tilt", "plate-tilt", "off-centre"}
    assert sum(acting.get(name, 0.0) for name in place) > 0.9
    assert sum(value for name, value in acting.items() if name not in place) < 3.0
    causes = named_set(fabric, sets, named_causes(fabric, sets, ["creep", "face-asymmetry"])).causes
    values = {one.hypothesis.name: one.value for one in causes}
    assert values["creep"]["loss"] == pytest.approx(SIZES["creep"][0], rel=0.3)
    assert values["face-asymmetry"]["asymmetry"] == pytest.approx(SIZES["face-asymmetry"][0], rel=0.4)
    low, high = parameter_intervals(sets.model.points, sets.posterior, likeliest_candidates(sets))["creep"]["loss"]
    assert low < values["creep"]["loss"] < high, "a point of the grid stands for its surroundings"
    assert high / low < 2


@pytest.mark.slow
def test_the_same_seed_gives_the_same_posterior(three: tuple[FabricData, FabricSets]) -> None:
    fabric, sets = three
    assert weighed(fabric).posterior.effects == sets.posterior.effects


def test_a_fabric_without_effects_has_none(emulator: Emulator) -> None:
    fabric, _ = planted(emulator, ())
    posterior = weighed(fabric).posterior
    assert posterior.leading[NONE] > 0.8
    assert sum(posterior.leading.values()) == pytest.approx(1)
    assert max(posterior.effects.values()) < 0.1


def test_a_misfit_that_symmetry_allows_hides_no_effect_with_a_signature(emulator: Emulator) -> None:
    """Fold statistics of both faces are wrong by several standard deviations, and the outlines are shifted."""
    fabric, _ = planted(emulator, ("camera-offset",))
    sd, folds = emulator.sd(PRIOR_MEAN), NAMES.index("fold_depth")
    wrong = np.zeros(ROWS)
    wrong[folds] = 2.5  # of the even means, which come first
    spoilt = replace(fabric, features=moved(fabric.features, wrong, sd))
    sets = weighed(spoilt)
    place = {"camera-offset", "camera-tilt", "plate-tilt", "off-centre"}
    assert sum(sets.posterior.effects.get(name, 0.0) for name in place) > 0.9
    assert sets.posterior.misfit > 0.5
    named = named_set(spoilt, sets, named_causes(spoilt, sets, next(iter(sets.posterior.sets))))
    assert not novelty(sets, named, np.random.default_rng(0)).rejected


def test_captures_in_the_other_order_are_creep_of_the_other_sign(emulator: Emulator) -> None:
    fabric, _ = planted(emulator, ("creep",))
    features = fabric.features
    swapped = replace(fabric, features=replace(features, order=-features.order))
    for one, sign in ((fabric, 1), (swapped, -1)):
        sets = weighed(one)
        assert sets.posterior.effects["creep"] > 0.9
        (cause,) = named_causes(one, sets, ["creep"])
        assert np.sign(cause.value["loss"]) == sign


def test_pictures_that_are_numbered_backwards_show_as_much_creep(emulator: Emulator) -> None:
    """Two of three pictures are later ones, whichever way they are numbered: only the drift changes its sign."""
    creep, sd = next(one for one in hypotheses(emulator) if one.name == "creep"), emulator.sd(PRIOR_MEAN)
    forwards, backwards = shifts(emulator, creep, PRIOR_MEAN, sd, 2 / 3, {"loss": np.array([0.2, -0.2])}).features
    assert np.abs(forwards[FACE_EVEN]).max() > 0.1
    assert np.abs(forwards[DRIFT]).max() > 0.1
    for rows in (FACE_EVEN, FACE_ODD, SPREAD):
        assert backwards[rows] == pytest.approx(forwards[rows])
    assert backwards[DRIFT] == pytest.approx(-forwards[DRIFT])


def test_allowed_and_forbidden_rows_are_told_apart(emulator: Emulator) -> None:
    """A change of both faces alike lies in the allowed rows alone, a contrast between faces in the others."""
    fabric, _ = planted(emulator, ())
    residual = fabric.against()
    misfit = misfit_of(emulator, residual)
    np.testing.assert_allclose(misfit.rotation @ misfit.rotation.T, np.eye(len(residual.white)), atol=1e-9)
    alike, contrast = np.zeros((2, ROWS))
    depth = NAMES.index("fold_depth")
    alike[depth] = 1.0
    contrast[FACE_ODD.start + depth] = 1.0
    turned = misfit.turned(residual.whiten(np.stack([alike, contrast])))
    assert np.abs(turned[0, : misfit.forbidden]).max() < 1e-9
    assert np.linalg.norm(turned[1, : misfit.forbidden]) > 0.9 * np.linalg.norm(turned[1])


def test_another_law_moves_no_rows_that_symmetry_keeps_still(emulator: Emulator) -> None:
    fabric, _ = planted(emulator, ())
    model = fabric.model(fabric.against())
    sorts = np.repeat(np.arange(4), model.misfit.sorts)
    for name, still in (("bending-friction", {0, 1, 2}), ("creep", {0, 1}), ("face-asymmetry", {0, 2})):
        own = model.points.effect == model.points.names.index(name)
        variance = model.points.variance[own]
        assert variance[:, np.isin(sorts, list(still))].max() < 1e-9, name
        assert (variance[:, ~np.isin(sorts, list(still))].max(1) > 0).all(), name
    shift = np.random.default_rng(0).standard_normal((2, len(model.white)))
    within = [(shift[:, sorts == sort] ** 2).mean(1) for sort in range(4)]
    np.testing.assert_allclose(model.misfit.across(shift), np.stack(within, axis=1)[:, sorts])


def test_a_shift_outside_of_the_list_is_novel(three: tuple[FabricData, FabricSets]) -> None:
    _, sets = three
    model = sets.model
    nothing = named_set(three[0], sets, ())
    odd = np.random.default_rng(3).standard_normal(model.misfit.forbidden)
    for size, rejected in ((0.0, False), (12.0, True)):
        left = np.random.default_rng(4).standard_normal(len(model.white))
        left[: model.misfit.forbidden] += size * odd / np.linalg.norm(odd)
        test = novelty(sets, replace(nothing, left=left), np.random.default_rng(5))
        assert test.rejected == rejected


def test_one_place_of_a_set_keeps_its_others(three: tuple[FabricData, FabricSets]) -> None:
    _, sets = three
    point = sets.posterior.best[0]
    given = conditional(sets.model, [point], sets.more)
    assert given.options.sum() == pytest.approx(1)
    assert given.leading.sum() == pytest.approx(1)
    effect = sets.model.points.effect
    assert given.effects[effect[point]] == 1
    assert given.options[:-1][effect == effect[point]].sum() == 0


@pytest.mark.slow
def test_what_one_fabric_cannot_decide_several_may(emulator: Emulator) -> None:
    """One camera for three fabrics: its place is shared, their own effects are not."""
    fabrics = []
    for number, (names, bending) in enumerate(
        ((("camera-offset",), -6.0), (("camera-offset", "face-asymmetry"), -5.4), (("camera-offset",), -6.6))
    ):
        fabric, _ = planted(emulator, names, bending)
        fabrics.append(LaboratoryFabric(f"fabric {number}", fabric, weighed(fabric)))
    found = laboratory(fabrics, np.random.default_rng(0), steps=24)
    assert found is not None
    first = found.effects[0]
    assert first.name == "camera-offset"
    assert first.probability > 0.9
    assert first.cause.value["shift"] == pytest.approx(3e-3, rel=0.1)  # a grid's points differ by half
    assert first.cause.value["direction"] == pytest.approx(120, abs=5)
    away = replace(first.cause, value={"shift": 2.2e-3, "direction": 109.0})
    beside = [[p for p in f.sets.posterior.best if f.sets.model.points.name(p) != first.name] for f in fabrics]
    (refined,) = shared_set([(f.data, f.sets) for f in fabrics], beside, [away])
    assert refined.value == pytest.approx({"shift": 3e-3, "direction": 120}, rel=0.06), "found between the points"
    assert all(value > 3 for value in first.evidence.values())
    assert [one.hypothesis.name for one in found.named] == ["camera-offset"]
    assert laboratory(fabrics[:1], np.random.default_rng(0)) is None
    one = fabrics[1]
    known = fabric_sets(one.data, one.data.against(), np.random.default_rng(0), shared=found.named, steps=40)
    assert "camera-offset" not in known.posterior.effects
    assert known.posterior.effects["face-asymmetry"] > 0.9
    assert "camera-offset" in finding(0.01, known.posterior, Novelty(0.5, 0.9), ("camera-offset",)).effects


def test_all_that_a_laboratory_shares_is_named_and_stands_among_the_causes() -> None:
    own = posterior({"creep": 0.9}, {("creep",): 0.9, (): 0.1}, {"creep": 0.9, NONE: 0.08, UNKNOWN: 0.02})
    quiet = finding(0.5, own, FITS, ("camera-offset", "cut-size"))  # nothing beside what is shared
    assert (quiet.verdict, quiet.effects) == ("several", ("camera-offset", "cut-size"))
    assert quiet.leading["camera-offset"] == pytest.approx(0.75)
    found = finding(0.01, own, FITS, ("camera-offset", "cut-size"))
    assert set(found.effects) == {"camera-offset", "cut-size", "creep"}
    left = 1 - FITS.probability
    expected = {"creep": 0.9, "camera-offset": 0.08, "cut-size": 0.0, NONE: 0.0, UNKNOWN: 0.02}
    expected = {name: left * value for name, value in expected.items()} | {UNKNOWN: left * 0.02 + FITS.probability}
    assert found.leading == pytest.approx(expected)


def test_shares_of_the_budget_add_up(emulator: Emulator, three: tuple[FabricData, FabricSets]) -> None:
    fabric, sets = three
    root, sd = np.linalg.cholesky(emulator.correlation), emulator.sd(sets.residual.theta)
    scatter = (np.random.default_rng(0).standard_normal((12, len(root))) @ root.T).reshape(12, 2, -1) * sd
    drift = 0.2 * np.random.default_rng(1).standard_normal((12, len(NAMES))) * sd
    drift -= drift.mean(0)
    drift[:, list(ORDERS)] += fabric.features.order
    samples = SampleStatistics(fabric.features.mean + scatter - scatter.mean(0), drift, 0.5)
    causes = named_causes(fabric, sets, ["face-asymmetry", "creep"])
    found = budget(fabric, sets, samples, causes, np.random.default_rng(2))
    assert isinstance(found, Budget)
    assert set(found.effects) == {"face-asymmetry", "creep"}
    assert all(one.value > 0.1 for one in found.effects.values())
    total = sum(one.value for one in found.effects.values()) + found.unexplained.value
    assert total == pytest.approx(1)
    assert found.unexplained.interval[0] <= found.unexplained.value <= found.unexplained.interval[1]


@pytest.mark.parametrize("fitted", [1.8, 1.0, 0.5])
def test_shares_are_those_of_samples_that_severities_were_not_fitted_to(emulator: Emulator, fitted: float) -> None:
    """With m times the shift that unseen samples have, an effect explains 1 - (1 - m)^2 of theirs."""
    fabric, causes = planted(emulator, ("face-asymmetry",))
    theta = PRIOR_MEAN.copy()
    theta[0] = -6.0
    at, name = fabric.against(start=theta, fixed=True), causes[0].hypothesis.effect.severity.name
    root, sd = np.linalg.cholesky(emulator.correlation), emulator.sd(theta)
    scatter = (np.random.default_rng(0).standard_normal((8, len(root))) @ root.T).reshape(8, 2, -1) * sd
    scatter = np.concatenate([scatter - scatter.mean(0)] * 2)

    def moved_by(times: float) -> np.ndarray:
        stronger = replace(causes[0], value={name: times * causes[0].value[name]})
        return faces_of(fabric.shift([stronger], at)) * at.sd

    shown = np.repeat([moved_by(fitted), moved_by(1.0)], 8, axis=0)
    samples = SampleStatistics(emulator.mean(theta) + scatter + shown, np.full((16, len(NAMES)), np.nan), 0.5)
    parts = _parts(fabric, at, samples, causes, np.arange(8), np.arange(8, 16))
    assert parts is not None
    multiple = np.linalg.norm(moved_by(fitted) / at.sd) / np.linalg.norm(moved_by(1.0) / at.sd)
    assert parts[0] / parts.sum() == pytest.approx(1 - (1 - multiple) ** 2, abs=0.1)


@pytest.mark.parametrize("inflation", [1.0, 2.0])
def test_what_is_known_to_act_leaves_a_fabric_as_it_is_without(emulator: Emulator, inflation: float) -> None:
    """In units of a noise that is larger by the calibration's factor, as all that is compared with it."""
    plain, shown = (planted(emulator, names)[0] for names in ((), ("camera-offset",)))
    (offset,) = planted(emulator, ("camera-offset",))[1]
    theta, calibration = PRIOR_MEAN.copy(), Calibration(inflation=inflation)
    theta[0] = -6.0
    without = plain.against(start=theta, fixed=True)
    fabric = replace(shown, calibration=calibration)
    at = fabric.against(start=theta, fixed=True)
    model = fabric.model(at)
    more = fabric.shared_shift([offset], at, model.misfit)
    assert more is not None
    assert np.linalg.norm(more.shift) > 5 / inflation
    left = np.linalg.norm(model.white - more.shift)
    assert left == pytest.approx(np.linalg.norm(without.white) / inflation, abs=0.01 * np.linalg.norm(more.shift))
    assert fabric.shared_shift([], at, model.misfit) is None


def test_splits_with_hardly_any_gap_do_not_decide_the_shares(
    monkeypatch: pytest.MonkeyPatch, emulator: Emulator, three: tuple[FabricData, FabricSets]
) -> None:
    fabric, sets = three
    parts = cycle([np.array([6.0, 4.0])] * 9 + [np.array([-5.0, 5.01])])
    monkeypatch.setattr(sys.modules[budget.__module__], "_parts", lambda *_: next(parts))
    specimens = np.zeros((12, 2, len(NAMES)))
    samples = SampleStatistics(specimens, np.zeros((12, len(NAMES))), 0.5)
    causes = named_causes(fabric, sets, ["creep"])
    found = budget(fabric, sets, samples, causes, np.random.default_rng(2))
    assert found is not None
    assert found.effects["creep"].value == pytest.approx(49 / 90.01)
    assert found.unexplained.value == pytest.approx(41.01 / 90.01)


def posterior(effects: dict[str, float], sets: dict[tuple[str, ...], float], leading: dict[str, float]) -> SetPosterior:
    return SetPosterior(effects, leading, sets, (), np.zeros(0), 0.0)


FITS, FAILS = Novelty(0.5, 0.9), Novelty(0.01, 0.2)
NOTHING = {NONE: 0.02, UNKNOWN: 0.02}


def test_verdicts() -> None:
    sure = posterior({"creep": 0.95}, {("creep",): 0.95, (): 0.05}, {"creep": 0.96} | NOTHING)
    quiet = finding(0.2, sure, FITS)
    assert quiet.verdict == NONE
    assert NONE in quiet.set90
    assert quiet.leading[NONE] == pytest.approx(0.75)
    assert finding(0.01, sure, FITS).verdict == "effect"
    assert finding(0.01, sure, FITS).effects == ("creep",)
    both = posterior(
        {"creep": 0.95, "threshold": 0.9}, {("creep", "threshold"): 0.9, ("creep",): 0.1},
        {"creep": 0.6, "threshold": 0.36} | NOTHING,
    )  # fmt: skip
    assert finding(0.01, both, FITS).verdict == "several"
    novel = finding(0.01, both, FAILS)
    assert novel.verdict == UNKNOWN
    assert UNKNOWN in novel.set90
    assert novel.effects == ("creep", "threshold")
    assert novel.leading[UNKNOWN] >= 0.6
    assert sum(novel.leading.values()) == pytest.approx(1)
    carries = finding(0.01, both, Novelty(0.01, 0.9))
    assert carries.verdict == "several"
    assert UNKNOWN in carries.set90
    assert any("not on the list" in note for note in carries.notes)


def test_the_worse_a_set_fits_the_likelier_is_a_cause_outside_of_the_list() -> None:
    unknown = [Novelty(p, 0.0).probability for p in (0.8, 0.3, 0.1, 0.03, 0.001)]
    assert unknown == sorted(unknown)
    assert unknown[0] < 0.1
    assert unknown[-1] > 0.9
    assert Novelty(0.001, 0.9).probability == pytest.approx(0.1 * unknown[-1]), "it accounts for what the set leaves"
    sure = posterior({"creep": 0.95}, {("creep",): 0.95, (): 0.05}, {"creep": 0.96} | NOTHING)
    doubted = finding(0.01, sure, Novelty(0.03, 0.9))
    assert (doubted.verdict, doubted.effects) == ("effect", ("creep",)), "what has a signature of its own is named"
    assert 0.9 < doubted.leading["creep"] < 0.93
    assert UNKNOWN in doubted.set90


def test_what_silhouettes_hardly_tell_apart_is_not_told_apart() -> None:
    sure = posterior(
        {"camera-scale": 1.0, "cut-size": 0.0, "creep": 0.9, "plate-tilt": 0.1},
        {("camera-scale", "creep"): 0.9, ("camera-scale", "plate-tilt"): 0.1},
        {"camera-scale": 0.7, "cut-size": 0.0, "creep": 0.3, "plate-tilt": 0.0, NONE: 0.0, UNKNOWN: 0.0},
    )
    found = evened_out(sure)
    assert found.effects == pytest.approx({"camera-scale": 0.7, "cut-size": 0.3, "creep": 0.9, "plate-tilt": 0.1})
    assert found.leading["camera-scale"] + found.leading["cut-size"] == pytest.approx(0.7)
    assert next(iter(found.sets)) == ("camera-scale", "creep")
    assert found.sets[("creep", "cut-size")] == pytest.approx(0.27)
    assert sum(found.sets.values()) == pytest.approx(1)
    together = posterior(
        {"camera-scale": 1.0, "cut-size": 1.0},
        {("camera-scale", "cut-size"): 1.0},
        {"camera-scale": 0.6, "cut-size": 0.4},
    )
    assert evened_out(together).sets == {("camera-scale", "cut-size"): 1.0}


def test_look_alikes_are_stated_where_they_would_stand_in_the_place_of_what_acts(emulator: Emulator) -> None:
    """They were stated where they mend details beside it, a cut with the wrong sign."""
    fabric, _ = planted(emulator, ("camera-scale", "face-asymmetry"))
    sampled = weighed(fabric)
    evened = evened_out(sampled.posterior)
    sets = replace(sampled, posterior=replace(evened, weight=evened_weights(sampled, evened)))
    points, group = sets.model.points, {"camera-scale", "cut-size", "threshold", "plate-radius"}
    members = group & set(points.names)
    assert len(members) > 2
    others = [point for point in sampled.posterior.best if points.name(point) not in members]
    total = sets.model.likelihoods(others).total[:-1] + points.log_prior
    stated = likeliest_candidates(sets)
    for name in members:
        own = np.flatnonzero(points.effect == points.names.index(name))
        (point,) = (p for p in own if points.value(int(p)) == stated[name].value)
        assert total[point] > total[own].max() - 3
        assert sets.posterior.weight[own].sum() == pytest.approx(sets.posterior.effects[name], abs=1e-6)
    assert stated["camera-scale"].value["error"] < 0
    assert stated["cut-size"].value["error"] < 0, "a smaller cut looks like a smaller picture"


def test_without_repeated_captures_creep_is_not_told_from_friction() -> None:
    sure = posterior(
        {"creep": 0.9, "bending-friction": 0.04, "plate-tilt": 1.0},
        {("creep", "plate-tilt"): 0.9, ("bending-friction", "plate-tilt"): 0.04, ("plate-tilt",): 0.06},
        {"creep": 0.9, "bending-friction": 0.04, "plate-tilt": 0.06} | NOTHING,
    )
    assert finding(0.01, evened_out(sure), FITS).effects == ("plate-tilt", "creep"), "a drift was looked at"
    found = evened_out(sure, drift_known=False)
    assert found.effects == pytest.approx({"creep": 0.47, "bending-friction": 0.47, "plate-tilt": 1.0})
    assert list(found.sets)[:2] == [("bending-friction", "plate-tilt"), ("creep", "plate-tilt")]
    assert sum(found.sets.values()) == pytest.approx(1)
    stated = finding(0.01, found, FITS)
    assert stated.effects == ("plate-tilt",)
    assert stated.groups == (("bending-friction", "creep"),), "the first stands for both, and can be simulated"


def test_look_alikes_share_their_probability() -> None:
    shared = posterior(
        {"camera-offset": 0.5, "plate-tilt": 0.45, "creep": 0.9},
        {("camera-offset", "creep"): 0.5, ("creep", "plate-tilt"): 0.4, ("plate-tilt",): 0.05, (): 0.05},
        {"camera-offset": 0.5, "plate-tilt": 0.46} | NOTHING,
    )
    assert look_alikes(shared, ["creep"]) == (("camera-offset", "plate-tilt"),)
    found = finding(0.01, shared, FITS)
    assert (found.verdict, found.effects) == ("several", ("creep",))
    assert found.groups == (("camera-offset", "plate-tilt"),)
    alone = posterior(
        {"camera-offset": 0.5, "plate-tilt": 0.45}, {("camera-offset",): 0.5, ("plate-tilt",): 0.45, (): 0.05},
        {"camera-offset": 0.5, "plate-tilt": 0.46} | NOTHING,
    )  # fmt: skip
    assert finding(0.01, alone, FITS).verdict == "ambiguous"
    doubted = finding(0.01, alone, Novelty(0.01, 0.9))
    assert (doubted.verdict, UNKNOWN in doubted.set90) == ("ambiguous", True), "one of them takes the gap, whichever"
    assert finding(0.01, alone, FAILS).verdict == UNKNOWN
    assert set90({"a": 0.5, "b": 0.45, "c": 0.05}) == ("a", "b")


def test_mismatch_of_laws_is_kept_by_effect() -> None:
    learned = Calibration(law_mismatch={"creep": (0.5, 0.2)})
    assert learned.mismatch("creep") == (0.5, 0.2)
    assert learned.mismatch("shear-friction") == LAW_MISMATCH
    assert learned.mismatch("plate-tilt") == PLATE_MISMATCH
    assert Calibration(law_mismatch={"camera-offset": (0.5, 0.2)}).mismatch("camera-offset") == OUTLINE_MISMATCH
    with pytest.raises(ValueError, match="law_mismatch of creep must be two numbers"):
        Calibration(law_mismatch={"creep": (-1.0, 0.2)})
