"""Scoring of withheld answers: answers whose scores are known beforehand get them, and no file is taken on trust."""

import json
from dataclasses import replace
from math import log, nan, pi

import numpy as np
import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from cusick_bench.cli.diagnose.withheld_score import score as score_command
from cusick_bench.sim.effects import registered
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format import causes, location
from cusick_bench.withheld.format.answer import read_answer
from cusick_bench.withheld.format.causes import EFFECTS, class_of
from cusick_bench.withheld.format.label import read_label
from cusick_bench.withheld.format.location import Region, angular_overlap
from cusick_bench.withheld.format.seal import sealed
from cusick_bench.withheld.scoring.calibration import (
    LEAST_PROBABILITY,
    auroc,
    calibration_error,
    calibration_error_by_chance,
    wilson_interval,
)
from cusick_bench.withheld.scoring.failures import confusion_by_class, failures
from cusick_bench.withheld.scoring.judgement import judgement_of
from cusick_bench.withheld.scoring.labelled_answers import LabelledAnswers, read_labelled_answers
from cusick_bench.withheld.scoring.measures import CLEAR, Goal
from cusick_bench.withheld.scoring.score import ANSWERS, CHANCE, Scores
from cusick_bench.withheld.scoring.score import score as score_fully
from cusick_bench.withheld.scoring.table import markdown
from cusick_bench.withheld.suite.design import plan_suite
from cusick_bench.withheld.suite.labels import label_of

LOCAL = "local-stiff-patch"
PLACE = {"kind": "patch", "angle_deg": [80, 100], "radius_m": [0.11, 0.13]}
SHARES = ("exact effect", "class", "power")


def label(effect, multiple=2.0, **more):
    named = effect if isinstance(effect, str) else effect[0]
    found = {"effect": effect, "class": class_of(named), "severity": 1.0, "parameters": {}, "location": None}
    return {**found, "oracle_closure": None, "multiple": multiple, **more}


def peaked_map(angle=90.0, radius=0.12):
    """A map whose strongest cell holds that point."""
    ring = int((radius - location.PLATE_EDGE) / (location.RIM - location.PLATE_EDGE) * 4)
    values = np.zeros((4, 16))
    values[ring, int(angle / 22.5)] = 1
    return values.tolist()


def answer(verdict, *named, set90=None, p=0.5, **more):
    """An answer; `named` are names with probabilities."""
    stated = [{"effect": name, "class": class_of(name), "probability": chance} for name, chance in named]
    members = [name for name, _ in named] if set90 is None else set90
    return {"verdict": verdict, "gap": {"base": 1, "floor": 0.1, "p": p}, "causes": stated, "set90": members, **more}


def suite(nulls=30, outside=20):
    """Labels: nulls, every effect at four severities, pairs, effects outside the list."""
    names = list(EFFECTS)
    labels = {f"null_{i}": label("none", None, severity=None) for i in range(nulls)}
    for name in names:
        place = PLACE if name == LOCAL else None
        for multiple in (0.5, 1, 2, 4):
            labels[f"{name}_{multiple}"] = label(name, multiple, location=place, oracle_closure=0.8)
    labels |= {f"pair_{i}": label([names[i], names[i + 9]], [2, 4], severity=[1, 1]) for i in range(10)}
    return labels | {f"outside_{i}": label("unknown", None, severity=None, hidden="wind") for i in range(outside)}


def perfect(truth):
    effect = truth["effect"]
    if effect in ("none", "unknown"):
        return answer(effect, (effect, 1.0), p=0.9 if effect == "none" else 0.001)
    named = [effect] if isinstance(effect, str) else effect
    return answer(
        "effect",
        *((name, 1 / len(named)) for name in named),
        p=0.001,
        where={"map": peaked_map(), **PLACE, "localisable": truth["location"] is not None},
        closure={"effect": effect, "fraction": 0.75, "ci90": [0.6, 0.9]},
    )


def revealed(tmp_path, labels, answers, commitment=None):
    for name, document in (("labels", labels), ("answers", answers)):
        (tmp_path / f"{name}.json").write_text(json.dumps(document))
    return read_labelled_answers(tmp_path / "answers.json", tmp_path / "labels.json", commitment)


def scored(tmp_path, labels, answers) -> Scores:
    return score(revealed(tmp_path, labels, answers))


def score(answered: LabelledAnswers, seed: int = 0) -> Scores:
    """Scores with few resamples, which is fast; values and goals do not depend on them."""
    return score_fully(answered, seed, resamples=100, deals=3)


class TestKnownScores:
    def test_perfect_answers_reach_every_goal_but_that_of_a_set_that_is_too_wide(self, tmp_path):
        labels = suite(nulls=100)
        found = scored(tmp_path, labels, {case: perfect(truth) for case, truth in labels.items()})
        missed = {figure.name for figure in found.figures if figure.reached == "no"}
        assert missed == {"90 % set covers"}, "a set that always holds the truth is wider than 90 %"
        for name in SHARES:
            assert found.value(name, CLEAR) == 1
        assert found.value("expected calibration error") == 0
        assert found.value("Brier score") == 0
        assert found.value("pairs: top-2 recall") == found.value("unknown recalled") == 1
        assert found.value("pointing hit", CLEAR) == found.value("angular IoU", CLEAR) == 1
        assert found.value("falsely localised") == 0

    def test_always_none_is_never_wrong_on_nulls_and_sees_nothing(self, tmp_path):
        labels = suite()
        found = scored(tmp_path, labels, {case: answer("none", ("none", 1.0)) for case in labels})
        assert found.value("false positives") == found.value("power") == found.value("class", CLEAR) == 0
        assert found.value("detection AUROC", CLEAR) == 0.5
        assert found.value("90 % set covers", CLEAR) == 0
        assert found.value("90 % set covers, any case") == pytest.approx(30 / 138)
        assert found.value("expected calibration error") == pytest.approx(108 / 138)
        assert found.value("log score") == pytest.approx(-log(LEAST_PROBABILITY) * 108 / 138)
        assert found.value("unknown recalled") == found.value("false abstention") == 0

    def test_always_unknown_recalls_all_and_abstains_falsely(self, tmp_path):
        labels = suite()
        found = scored(tmp_path, labels, {case: answer("unknown", ("unknown", 0.9)) for case in labels})
        assert found.value("unknown recalled") == found.value("false abstention", CLEAR) == 1
        assert found.value("false positives") == 1
        assert found.value("exact effect", CLEAR) == found.value("class", CLEAR) == 0

    def test_answers_at_random_are_no_better_than_the_row_of_chance(self, tmp_path):
        labels, generator = suite(nulls=100, outside=60), np.random.default_rng(4)
        names = list(EFFECTS)
        guesses = {}
        for case in labels:
            order = generator.permutation(names)[:2]
            guesses[case] = answer("effect", (order[0], 0.5), (order[1], 0.3), p=float(generator.random()))
        found = scored(tmp_path, labels, guesses)
        assert found.value("exact effect") == pytest.approx(1 / 22, abs=0.07)
        for name in ("exact effect", "class", "90 % set covers", "detection AUROC"):
            assert found.value(name) == pytest.approx(found.value(name, method=CHANCE), abs=0.1)
        assert found.value("detection AUROC", method=CHANCE) == pytest.approx(0.5, abs=0.05)

    def test_confidence_beyond_skill_is_the_calibration_error(self, tmp_path):
        """Sure at 90 %, right in half of the cases: .4, whatever the bins."""
        labels = {f"c{i}": label("creep", 2) for i in range(200)}
        found = scored(
            tmp_path,
            labels,
            {c: answer("effect", ("creep" if i % 2 else "threshold", 0.9)) for i, c in enumerate(labels)},
        )
        asked = (ANSWERS, "expected calibration error", CLEAR)
        (figure,) = (f for f in found.figures if (f.method, f.name, f.subset) == asked)
        assert figure.value == pytest.approx(0.4)
        assert figure.low < 0.4 < figure.high
        assert figure.reached == "no"

    def test_effects_that_nobody_can_see_do_not_count_against_the_goal_of_calibration(self, tmp_path):
        labels = {f"n{i}": label("none", None, severity=None) for i in range(90)} | {
            f"w{i}": label("creep", 0.5) for i in range(60)
        }
        found = scored(tmp_path, labels, {case: answer("none", ("none", 1.0)) for case in labels})
        assert found.value("expected calibration error") == pytest.approx(60 / 150)
        assert found.value("expected calibration error", CLEAR) == 0

    def test_severity_is_that_of_the_detectable_shift_and_power_rises_with_it(self, tmp_path):
        labels = {f"c{m}_{i}": label("plate-tilt", m) for m in (0.5, 1, 2, 4) for i in range(10)}
        labels |= {f"n{i}": label("none", None) for i in range(10)}
        seen = {c: int(c.split("_")[1]) < 3 * t["multiple"] for c, t in labels.items() if t["multiple"]}
        answers = {
            c: answer("effect", ("plate-tilt", 0.9)) if seen.get(c) else answer("none", ("none", 0.9)) for c in labels
        }
        found = scored(tmp_path, labels, answers)
        assert [found.value("power", level) for level in ("0.5x", "1x", "2x", "4x")] == [0.2, 0.3, 0.6, 1.0]
        assert found.value("power", CLEAR) == 0.8
        assert found.value("class", "1x") == 0.3

    def test_typical_severities_beside_detectable_ones_are_in_no_level(self, tmp_path):
        labels = {f"c{i}": label("plate-tilt", 2) for i in range(10)} | {"n": label("none", None)}
        known = scored(tmp_path, labels, {c: answer("effect", ("plate-tilt", 0.9)) for c in labels})
        hidden = {f"h{i}": {**label("creep", None), "multiple_of_typical": 4} for i in range(5)}
        labels |= hidden
        said = {
            c: answer("none", ("none", 0.9)) if c in hidden else answer("effect", ("plate-tilt", 0.9)) for c in labels
        }
        found = scored(tmp_path, labels, said)
        assert found.value("power", CLEAR) == known.value("power", CLEAR) == 1
        assert found.value("power", "typical") == 0
        assert any("5 single effects" in note for note in found.notes)
        alone = scored(tmp_path, hidden, {c: said[c] for c in hidden})
        assert alone.value("power", "4x") == 0, "where nothing else is known, typical severities are the levels"


class TestJudgement:
    def judged(self, said, true):
        return judgement_of("c", read_answer(said, "a"), read_label(true, "l"))

    @pytest.mark.parametrize(
        ("effect", "members", "right"),
        [
            ("plate-radius", ["threshold", "camera-scale"], True),
            ("cut-size", ["threshold", "camera-scale", "plate-radius", "cut-size"], True),
            ("cut-size", ["threshold", "camera-tilt"], False),
            ("creep", ["creep", "bending-friction"], True),
            ("density-bias", ["density-bias", "B/rho"], True),
            ("density-bias", ["camera-scale", "threshold"], False),
            ("density-bias", [n for n in EFFECTS if n != "creep"], False),
            ("camera-tilt", ["threshold", "camera-tilt"], False),
            ("plate-tilt", ["creep", "bending-friction"], False),
        ],
    )
    def test_equivalents_are_a_right_class_only_as_the_right_set(self, effect, members, right):
        said = answer("ambiguous", ("self-contact", 0.6), set90=members, next=["weigh"])
        assert self.judged(said, label(effect)).class_right == right
        assert self.judged({**said, "next": []}, label(effect)).class_right == 0, "what to measure is not named"
        assert self.judged({**said, "verdict": "effect"}, label(effect)).class_right == 0, "one effect was claimed"

    def test_first_place_goes_by_probability_not_by_order(self):
        found = self.judged(answer("effect", ("creep", 0.2), ("threshold", 0.5)), label("threshold"))
        assert (found.exact, found.said) == (1, "threshold")

    def test_verdict_none_forfeits_the_causes_that_follow_it(self):
        found = self.judged(answer("none", ("threshold", 0.9)), label("threshold"))
        assert (found.exact, found.class_right, found.detected) == (0, 0, 0)

    def test_what_is_named_has_the_probability_that_the_answer_gives_it(self):
        causes = (("threshold", 0.5), ("camera-tilt", 0.2), ("cut-size", 0.2), ("none", 0.1))
        found = self.judged(answer("effect", *causes), label("creep"))
        assert (found.exact_stated, found.class_stated) == pytest.approx((0.5, 0.7)), "two of three are imaging"
        for verdict in ("none", "unknown"):
            found = self.judged(answer(verdict, *causes), label("threshold"))
            assert (found.exact_stated, found.class_stated) == (0, 0), "no effect is named"

    def test_what_the_causes_leave_goes_to_none_first(self):
        said = read_answer(answer("effect", ("creep", 0.7)), "a")
        assert said.probabilities()["none"] == pytest.approx(0.3)
        assert read_answer(answer("unknown", ("creep", 0.2)), "a").probabilities()["unknown"] == pytest.approx(0.8)
        spread = read_answer(answer("effect", ("creep", 0.4), ("none", 0.1), ("unknown", 0.1)), "a").probabilities()
        assert spread["threshold"] == pytest.approx(0.4 / 21)
        assert sum(spread.values()) == pytest.approx(1)

    def test_a_refusal_is_no_opinion(self):
        found = self.judged(answer("refused"), label("none", None))
        assert (found.detected, found.confidence) == (0, pytest.approx(1 / 24)), "22 effects, none and unknown alike"
        assert found.surprise == pytest.approx(log(24))
        assert found.covered == 0

    def test_an_effect_that_was_not_offered_is_unknown(self):
        said = answer("unknown", ("creep", 0.1), without=["threshold"])
        found = self.judged(said, label("threshold"))
        assert (found.kind, found.recalled) == ("unknown", 1)
        assert np.isnan(found.abstained)

    def test_scores_of_probabilities(self):
        found = self.judged(answer("effect", ("creep", 0.6), ("none", 0.3), ("unknown", 0.1)), label("none", None))
        assert found.surprise == pytest.approx(-log(0.3))
        assert found.brier == pytest.approx(0.6**2 + 0.7**2 + 0.1**2)

    def test_missing_closure_counts_as_far_off(self):
        true = label("creep", oracle_closure=0.5)
        assert self.judged(answer("none", ("none", 1.0)), true).closure_close == 0
        close = answer("effect", ("creep", 0.9), closure={"fraction": 0.6, "ci90": [0.55, 0.7]})
        found = self.judged(close, true)
        assert (found.closure_close, found.closure_covered) == (1, 0)
        close["closure"]["fraction"] = 0.61
        assert self.judged(close, true).closure_close == 0

    @pytest.mark.parametrize(
        ("place", "hit"),
        [
            ({"map": peaked_map(91)}, 1),
            ({"map": peaked_map(271)}, 0),
            ({"map": peaked_map(91, 0.149)}, 0),
            ({"map": peaked_map(91), "localisable": False}, 0),
            ({"map": np.ones((4, 16)).tolist()}, 0),
            ({"kind": "sector", "angle_deg": [70, 120]}, 1),
            ({"kind": "sector", "angle_deg": [0, 360]}, 0),
        ],
    )
    def test_pointing(self, place, hit):
        said = answer("effect", (LOCAL, 0.9), where={"localisable": True, **place})
        assert self.judged(said, label(LOCAL, location=PLACE)).pointing == hit

    def test_ring_is_found_by_its_radius(self):
        ring = {"kind": "ring", "angle_deg": [0, 360], "radius_m": [0.14, 0.15]}
        values = np.zeros((4, 16))
        values[3], values[0, 3] = 1, 5
        said = answer("effect", ("rim-stiffening", 0.9), where={"kind": "ring", "map": values.tolist()})
        said["where"]["localisable"] = True
        found = self.judged(said, label("rim-stiffening", location=ring))
        assert found.pointing == 1
        assert np.isnan(found.overlap), "a ring has no direction"

    def test_severity_without_a_multiple_is_counted_in_typical_ones(self):
        name, effect = next(iter(registered().items()))
        found = read_label(label(name, None, severity=-3 * effect.severity.typical), "l")
        assert found.unit == "typical severity"
        assert found.multiple == pytest.approx(3)
        assert found.level == "4x"
        assert read_label(label([name, "creep"], [4, 1.1]), "l").level == "1x", "the weakest of a pair"
        severities = [4 * causes.typical_severity("creep"), causes.typical_severity("threshold")]
        assert read_label(label(["creep", "threshold"], None, severity=severities), "l").level == "1x"
        assert read_label(label("creep", None, multiple_of_typical=0.5), "l").level == "0.5x"

    def test_a_direction_is_no_place(self):
        said = answer(
            "effect", ("plate-tilt", 0.9), where={"kind": "direction", "angle_deg": [3, 9], "localisable": True}
        )
        assert self.judged(said, label("plate-tilt")).localised_falsely == 0
        said["where"]["kind"] = "sector"
        assert self.judged(said, label("plate-tilt")).localised_falsely == 1


class TestVocabulary:
    def test_classes_agree_with_the_registered_effects(self):
        kinds = {name: found.kind for name, found in registered().items() if name in EFFECTS}
        assert kinds.items() <= EFFECTS.items()
        assert len(EFFECTS) == 22
        assert set(EFFECTS.values()) == set(causes.CLASSES)


class TestStatistics:
    def test_wilson_bounds(self):
        """Wilson 1927; the figures are those of Newcombe, Statistics in Medicine 17 (1998), Table I."""
        assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
        assert wilson_interval(0, 20) == pytest.approx((0, 0.1611), abs=1e-4)
        assert wilson_interval(10, 200)[1] > 0.08 > wilson_interval(9, 200)[1] - 0.004

    def test_goal_on_false_positives_holds_for_the_bound_too(self):
        goal = Goal(high=0.05, highest_bound=0.08)
        assert goal.reached(0.03, 0.07)
        assert not goal.reached(0.03, 0.09)
        assert not goal.reached(0.06, 0.07)

    def test_auroc_counts_ties_half(self):
        assert auroc(np.array([2.0, 3.0]), np.array([1.0, 2.0])) == pytest.approx(3.5 / 4)

    def test_auroc_of_normal_scores_is_the_normal_integral(self):
        generator = np.random.default_rng(0)
        found = auroc(generator.normal(1, 1, 20000), generator.normal(0, 1, 20000))
        assert found == pytest.approx(0.7602, abs=0.01)  # Phi(1 / sqrt 2)

    def test_calibrated_answers_have_the_error_of_their_number(self):
        """Ten bins of n cases at p = 1/2: sqrt(2/pi) sqrt(1/4 / n) on average."""
        confidence, generator = np.full(4000, 0.5), np.random.default_rng(1)
        confidence += np.linspace(-1e-3, 1e-3, 4000)
        expected = np.sqrt(2 / pi * 0.25 / 400)
        assert calibration_error_by_chance(confidence, generator) == pytest.approx(expected, rel=0.1)

    def test_order_of_cases_does_not_matter(self):
        confidence = np.repeat([0.2, 0.6, 0.6, 0.9], 50)
        right = np.tile([0.0, 1.0], 100)
        order = np.random.default_rng(2).permutation(200)
        assert calibration_error(confidence, right) == pytest.approx(calibration_error(confidence[order], right[order]))


class TestRegions:
    @pytest.mark.parametrize(
        ("first", "second", "share"),
        [
            ((0, 90), (0, 90), 1),
            ((0, 90), (45, 90), 1 / 3),
            ((350, 20), (0, 20), 1 / 3),
            ((0, 90), (180, 90), 0),
            ((0, 360), (300, 90), 0.25),
            ((10, 270), (190, 200), 110 / 360),
        ],
    )
    def test_overlap_of_arcs(self, first, second, share):
        one, other = (Region(*map(float, arc), 0.09, 0.15) for arc in (first, second))
        assert angular_overlap(one, other) == pytest.approx(share)
        assert angular_overlap(other, one) == pytest.approx(share)

    def test_arc_goes_counter_clockwise_over_zero(self):
        assert location.arc((350.0, 20.0)) == (350, 30)
        assert location.arc((0.0, 360.0)) == (0, 360)
        assert Region(350.0, 30.0, 0.1, 0.12).overlaps(Region(15.0, 0.0, 0.12, 0.12))
        assert not Region(350.0, 30.0, 0.1, 0.12).overlaps(Region(25.0, 0.0, 0.12, 0.12))


class TestBaselines:
    def test_simpler_methods_are_scored_by_the_same_code(self, tmp_path):
        labels = {f"c{i}": label("creep" if i % 4 else "threshold") for i in range(40)}
        answers = {c: perfect(t) for c, t in labels.items()}
        for said in answers.values():
            said["baselines"] = {"largest-marginal": {"causes": [{"effect": "creep", "probability": 0.95}]}}
        found = scored(tmp_path, labels, answers)
        assert found.value("exact effect", CLEAR, "largest-marginal") == 0.75
        assert found.value("90 % set covers", CLEAR, "largest-marginal") == 0.75, "its set follows from its causes"
        assert found.value("exact effect", CLEAR) == 1


class TestFailures:
    def test_every_failure_is_listed_and_nothing_else(self, tmp_path):
        labels = suite()
        answers = {case: perfect(truth) for case, truth in labels.items()}
        answers["null_3"] = answer("effect", ("creep", 0.8), p=0.01)
        answers["creep_4"] = answer("none", ("none", 0.9))
        answers["threshold_2"] = answer("effect", ("perspective", 0.8), set90=["perspective", "threshold"])
        answers["plate-tilt_4"] = answer("effect", ("creep", 0.8))
        answers["outside_1"] = answer("effect", ("creep", 0.8))
        answers["off-centre_2"] = answer("unknown", ("off-centre", 0.2))
        answers["pair_0"] = answer("effect", ("creep", 0.8))
        both = revealed(tmp_path, labels, answers)
        found = {item.case: item for item in failures(both, score(both).cases)}
        assert {case: item.faults for case, item in found.items()} == {
            "null_3": ("false positive",),
            "creep_4": ("missed",),
            "plate-tilt_4": ("wrong class", "not in the 90 % set", "closure off"),
            "threshold_2": ("wrong effect", "closure off"),
            "outside_1": ("not in the 90 % set", "taken for a known effect"),
            "off-centre_2": ("abstained", "closure off"),
            "pair_0": ("pair not found",),
        }
        assert next(iter(found)) == "null_3"
        assert found["plate-tilt_4"].label == "plate-tilt 4x"
        assert found["plate-tilt_4"].answer == "effect: creep 0.80; {creep}; p 0.5"
        assert found["outside_1"].label == "unknown (wind)"
        confusion = confusion_by_class(score(both).cases)
        assert confusion.loc["boundary", "history"] == 1
        assert confusion.to_numpy().sum() == len(labels)


class TestFiles:
    def test_missing_and_extra_cases_are_named(self, tmp_path):
        labels = {"a": label("none"), "b": label("creep")}
        with pytest.raises(WithheldError, match=r"lacks 1: b; answer every case"):
            revealed(tmp_path, labels, {"a": answer("none")})
        with pytest.raises(WithheldError, match=r"labels.json lacks 1: c"):
            revealed(tmp_path, labels, {c: answer("none") for c in "abc"})

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"verdict": "maybe"}, "verdict must be a known name"),
            ({"causes": [{"effect": "plate-tlit", "probability": 0.5}]}, "did you mean 'plate-tilt'"),
            ({"causes": [{"effect": "creep", "probability": 1.5}]}, "must lie between 0 and 1, got 1.5"),
            ({"causes": [{"effect": n, "probability": 0.6} for n in ("creep", "none")]}, "sum to at most 1, got 1.2"),
            ({"causes": [{"effect": "creep", "probability": 0.1}] * 2}, "got creep twice"),
            ({"causes": [{"effect": "creep"}]}, r"causes\[0\].probability must be there"),
            ({"verdict": "effect", "causes": []}, "a verdict of effect must name causes"),
            ({"set90": None}, "set90 must be there"),
            ({"set90": ["nobody"]}, r"set90\[0\] must be a known name"),
            ({"gap": {"p": -1}}, "gap.p must lie between 0 and 1, got -1"),
            ({"where": {"map": [[0] * 16] * 3}}, "where.map must be a list of 4"),
            ({"where": {"kind": "sector", "angle_deg": ["a", 3]}}, "angle_deg"),
            ({"where": {"kind": "patch", "radius_m": [0.2, 0.1]}}, "swap them"),
            ({"closure": {"fraction": "much"}}, "finite number or null"),
        ],
    )
    def test_a_bad_answer_is_refused_with_its_place(self, tmp_path, change, message):
        said = {key: value for key, value in {**answer("none"), **change}.items() if value is not None}
        with pytest.raises(WithheldError, match=message) as caught:
            revealed(tmp_path, {"a": label("none")}, {"a": said})
        assert "answers.json: a" in str(caught.value)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"effect": "gravity-waves"}, "effect must be a known name"),
            ({"effect": []}, "must be a name or a list"),
            ({"effect": ["none", "creep"]}, "must be a name or a list"),
            ({"location": {"kind": "blob"}}, "kind must be a known name"),
            ({"oracle_closure": True}, "oracle_closure must be a finite number"),
        ],
    )
    def test_a_bad_label_is_refused_with_its_place(self, tmp_path, change, message):
        with pytest.raises(WithheldError, match=message) as caught:
            revealed(tmp_path, {"a": {**label("creep"), **change}}, {"a": answer("none")})
        assert "labels.json: a" in str(caught.value)

    @pytest.mark.parametrize("text", ["[1]", "{", '{"a": {}, "a": {}}', '{"a": 1e999}' * 2])
    def test_what_is_no_document_is_refused(self, tmp_path, text):
        (tmp_path / "labels.json").write_text(json.dumps({"a": label("none")}))
        (tmp_path / "answers.json").write_text(text)
        with pytest.raises(WithheldError, match=r"answers\.json"):
            read_labelled_answers(tmp_path / "answers.json", tmp_path / "labels.json")

    def test_labels_must_be_those_whose_seals_were_published(self, tmp_path):
        labels = {c: sealed(label("creep"), f"salt {c}") for c in "ab"}
        commitment = tmp_path / "commitment.json"
        commitment.write_text(json.dumps({"cases": {c: t["sha256"] for c, t in labels.items()}}))
        answers = {c: answer("none") for c in "ab"}
        assert "All 2 labels fit" in revealed(tmp_path, labels, answers, commitment).notes[0]
        changed = labels | {"b": sealed(label("threshold"), "salt b")}
        with pytest.raises(WithheldError, match=r"label of b must be the one that was sealed"):
            revealed(tmp_path, changed, answers, commitment)
        commitment.write_text(json.dumps({"a": labels["a"]["sha256"]}))
        with pytest.raises(WithheldError, match=r"lacks b"):
            revealed(tmp_path, labels, answers, commitment)

    def test_labels_of_a_generated_suite_are_understood(self, tmp_path):
        plans = plan_suite(5, {"null": 20, "single": 88, "pair": 10, "unknown": 12})
        labels = {plan.case: sealed(label_of(plan).content(), f"salt {plan.case}") for plan in plans}
        (tmp_path / "commitment.json").write_text(json.dumps({"cases": {c: t["sha256"] for c, t in labels.items()}}))
        both = revealed(tmp_path, labels, {c: perfect(t) for c, t in labels.items()}, tmp_path / "commitment.json")
        assert {kind: sum(t.kind == kind for t in both.labels.values()) for kind in ("null", "single", "pair")} == {
            "null": 20,
            "single": 88,
            "pair": 10,
        }
        assert {t.level for t in both.labels.values() if t.kind == "single"} == {"0.5x", "1x", "2x", "4x"}
        assert {t.location_kind for t in both.labels.values()} == {"", "patch", "ring"}
        assert all(t.hidden for t in both.labels.values() if t.kind == "unknown")
        assert score(both).value("exact effect") == score(both).value("pairs: both found") == 1

    def test_detection_falls_back_to_probabilities_and_to_the_verdict(self, tmp_path):
        labels = {"a": label("none"), "b": label("creep"), "c": label("creep")}
        stated = {"a": answer("none", ("none", 0.6)), "b": answer("effect", ("creep", 0.7), ("none", 0.3))}
        stated["c"] = answer("effect", ("creep", 0.3), ("none", 0.7))
        for said in stated.values():
            said["gap"] = {}
        found = scored(tmp_path, labels, stated)
        assert (found.detection, found.value("detection AUROC")) == ("none", 0.5)
        bare = {
            c: {**said, "causes": [x for x in said["causes"] if x["effect"] != "none"]} for c, said in stated.items()
        }
        found = scored(tmp_path, labels, bare)
        assert (found.detection, found.value("detection AUROC")) == ("verdict", 1)

    def test_an_answer_that_states_no_p_value_counts_against_its_giver(self, tmp_path):
        labels = {"a": label("none"), "b": label("creep"), "c": label("none")}
        answers = {"a": answer("none", p=0.5), "b": answer("none", p=0.1), "c": answer("none")}
        answers["c"]["gap"] = {}
        assert scored(tmp_path, labels, answers).value("detection AUROC") == 0.5


@pytest.fixture
def command():
    app = typer.Typer()
    app.command()(score_command)
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


class TestCommand:
    def test_writes_a_table_a_page_and_a_document(self, tmp_path, command):
        labels = suite()
        answers = {case: perfect(truth) for case, truth in labels.items()}
        answers["null_3"] = answer("effect", ("creep", 0.8), p=0.01)
        revealed(tmp_path, labels, answers)
        files = (tmp_path / "answers.json", tmp_path / "labels.json")
        ran = command(*files, "--out", tmp_path / "board" / "withheld.csv", "--json")
        assert ran.exit_code == 0, ran.output
        document = json.loads(ran.stdout)
        rate = next(f for f in document["figures"] if f["name"] == "false positives" and f["method"] == ANSWERS)
        assert rate["value"] == pytest.approx(1 / 30)
        assert rate["high"] == pytest.approx(wilson_interval(1, 30)[1])
        assert document["failures"][0]["case"] == "null_3"
        assert document["missed"] == ["false positives (all)", "90 % set covers (>= 2x)"]
        table = pd.read_csv(tmp_path / "board" / "withheld.csv")
        assert set(table["row"]) == {"figure", "confusion by class", "confusion by effect", "failure"}
        assert list(table.loc[table["row"] == "failure", "case"]) == ["null_3"]
        page = (tmp_path / "board" / "withheld.md").read_text()
        assert "| false positives | all | 30 | 3.3 % [0.6, 16.7] |" in page
        assert "null_3" in page

    def test_same_seed_same_table(self, tmp_path):
        labels = suite()
        both = revealed(tmp_path, labels, {case: perfect(truth) for case, truth in labels.items()})
        assert markdown(score(both, 3), [], {}) == markdown(score(both, 3), [], {})

    def test_bad_input_is_a_message_and_status_2(self, tmp_path, command):
        revealed(tmp_path, {"a": label("none")}, {"a": answer("none")})
        files = (tmp_path / "answers.json", tmp_path / "labels.json")
        assert command(*files, "--out", tmp_path / "table.txt").exit_code == 2
        assert command(tmp_path / "absent.json", files[1]).exit_code == 2
        assert command(*files).exit_code == 0, "one case is enough for a table"


def test_no_figure_of_no_cases_claims_to_have_reached_its_goal(tmp_path):
    found = scored(tmp_path, {"a": label("none")}, {"a": answer("none")})
    empty = [figure for figure in found.figures if not figure.cases]
    assert empty
    assert all(figure.reached == "" for figure in empty)
    assert replace(empty[0], value=nan).reached == ""


def test_a_page_lists_what_had_no_cases_instead_of_empty_lines(tmp_path):
    truth = {
        "case_1": label("none", None, severity=None),
        "case_2": label("unknown", None, severity=None, hidden="wind"),
    }
    page = markdown(scored(tmp_path, truth, {case: perfect(one) for case, one in truth.items()}), [], {})
    assert "| unknown recalled | all | 1 |" in page
    assert "| power |" not in page
    assert "Not judged, for want of cases: " in page
    assert "exact effect" in page.split("Not judged")[1].split("\n")[0]
    whole = suite()
    assert "**By severity**" in markdown(
        scored(tmp_path, whole, {case: perfect(one) for case, one in whole.items()}), [], {}
    )
