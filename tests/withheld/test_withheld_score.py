"""Scoring of withheld answers: answers whose scores are known beforehand get them."""

from collections import defaultdict
from math import log, pi

import numpy as np
import pytest
from scored_answers import LOCAL, PLACE, answer, label, peaked_map, perfect, scored, suite

from cusick_bench.sim.effects import registered
from cusick_bench.withheld.format import causes, location
from cusick_bench.withheld.format.answer import read_answer
from cusick_bench.withheld.format.causes import EFFECTS
from cusick_bench.withheld.format.label import read_label
from cusick_bench.withheld.format.location import Region, angular_overlap
from cusick_bench.withheld.scoring.calibration import (
    LEAST_PROBABILITY,
    auroc,
    calibration_error,
    calibration_error_by_chance,
    mean_interval,
    reliability,
    wilson_interval,
)
from cusick_bench.withheld.scoring.judgement import judgement_of
from cusick_bench.withheld.scoring.measures import CLEAR, Goal
from cusick_bench.withheld.scoring.score import ANSWERS, CHANCE
from cusick_bench.withheld.scoring.table import by_severity

SHARES = ("exact effect", "class", "power")


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

    @pytest.mark.parametrize(
        ("named", "groups", "both", "told"),
        [
            (["creep"], [], 0.0, 0.0),
            (["creep"], [["camera-scale", "threshold"]], 1.0, 1.0),
            (["creep"], [["threshold", "camera-scale"]], 0.0, 1.0),
            (["creep"], [["plate-tilt", "camera-offset"]], 0.0, 0.0),
            (["creep", "camera-scale"], [], 1.0, 1.0),
            ([], [["camera-scale", "threshold"]], 1.0, 1.0),
        ],
    )
    def test_a_group_of_look_alikes_stands_behind_the_named_set(self, named, groups, both, told):
        """What looks like the first effect, here friction, is no second one."""
        causes = [("creep", 0.7), ("bending-friction", 0.3), ("camera-scale", 1e-6), ("threshold", 1e-6)]
        said = read_answer(answer("several", *causes, effects=named, groups=groups), "a")
        found = judgement_of("a", said, read_label(label(["creep", "camera-scale"]), "a"))
        assert (found.both, found.told) == (both, told)

    def test_groups_count_only_where_something_is_named(self):
        said = answer("unknown", ("unknown", 0.9), ("creep", 0.1), groups=[["creep", "camera-scale"]])
        found = judgement_of("a", read_answer(said, "a"), read_label(label(["creep", "camera-scale"]), "a"))
        assert (found.both, found.told) == (0.0, 0.0)

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
        """Answers are drawn four times: one draw's AUROC has a standard deviation of .04."""
        labels, generator = suite(nulls=100, outside=60), np.random.default_rng(4)
        names = list(EFFECTS)
        at_random, by_chance = defaultdict(list), {}
        for _ in range(4):
            guesses = {}
            for case in labels:
                order = generator.permutation(names)[:2]
                guesses[case] = answer("effect", (order[0], 0.5), (order[1], 0.3), p=float(generator.random()))
            found = scored(tmp_path, labels, guesses)
            for name in ("exact effect", "class", "90 % set covers", "detection AUROC"):
                at_random[name].append(found.value(name))
                by_chance[name] = found.value(name, method=CHANCE)
        assert np.mean(at_random["exact effect"]) == pytest.approx(1 / 22, abs=0.07)
        for name, expected in by_chance.items():
            assert np.mean(at_random[name]) == pytest.approx(expected, abs=0.1)
        assert by_chance["detection AUROC"] == pytest.approx(0.5, abs=0.05)

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
        assert np.isnan(figure.low), "chance adds to it, and once more to what is resampled"
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

    def test_a_suite_of_pairs_has_their_levels(self, tmp_path):
        named = ("plate-tilt", "creep")
        labels = {f"p{i}": label(list(named), [2, 4] if i < 4 else [4, 4]) for i in range(10)}
        both, told = "pairs: both found", answer("effect", *((name, 0.5) for name in named))
        found = scored(tmp_path, labels, {c: told if c < "p6" else answer("none", ("none", 0.9)) for c in labels})
        by_level = {f.subset: (f.value, f.cases) for f in found.figures if f.method == ANSWERS and f.name == both}
        assert by_level["2x"] == (1.0, 4)
        assert by_level["4x"] == (pytest.approx(2 / 6), 6)
        assert by_severity(found)[-1] == ["cases", "4", "6"]

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

    def test_typical_severities_of_pairs_beside_detectable_ones_are_in_no_level(self, tmp_path):
        named = ["plate-tilt", "creep"]
        labels = {f"p{i}": label(named, 2) for i in range(4)}
        labels |= {f"h{i}": {**label(named, None), "multiple_of_typical": 4} for i in range(5)}
        told, none = answer("several", *((name, 0.5) for name in named)), answer("none", ("none", 0.9))
        found = scored(tmp_path, labels, {c: told if c < "p" else none for c in labels})
        by_level = {f.subset: f.cases for f in found.figures if f.method == ANSWERS and f.name == "pairs: both found"}
        assert (by_level[CLEAR], by_level["2x"]) == (4, 4)
        assert "4x" not in by_level
        assert any("5 pairs have such multiples" in note for note in found.notes)
        assert not any("0 single effects" in note for note in found.notes)


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

    @pytest.mark.parametrize("truth", [("none", None), ("creep",)])
    def test_a_refusal_is_right_about_nothing(self, truth):
        """Of outcomes alike the first is `none`: of cases without effect refusals were right, of others wrong."""
        assert self.judged(answer("refused"), label(*truth)).right == pytest.approx(1 / 24)

    @pytest.mark.parametrize("verdict", ["none", "refused"])
    def test_a_table_of_zeros_is_no_opinion(self, verdict):
        """Scoring ended in a division by zero."""
        said = answer(verdict, *((name, 0.0) for name in read_answer(answer("refused"), "a").probabilities()))
        assert self.judged(said, label("none", None)).confidence == pytest.approx(1 / 24)

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

    def test_a_severity_that_was_cut_off_counts_as_it_is(self):
        """Four times a typical stiffening of ln 3 is more than an effect can be."""
        known = {"multiple_of_typical": 4.0}
        found = read_label(label("local-stiff-patch", None, severity=-3.0, **known), "l")
        assert found.multiple == pytest.approx(2.73, abs=0.01)
        assert found.level == "2x"
        pair = read_label(label(["creep", "rim-stiffening"], None, severity=[0.6, 3.0], **known), "l")
        assert pair.multiple == pytest.approx(2.73, abs=0.01)
        rounded = read_label(label("local-stiff-patch", None, severity=2.197, multiple_of_typical=2.0), "l")
        assert rounded.multiple == 2.0

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

    def test_interval_of_a_mean_is_that_of_students_t(self):
        assert mean_interval(np.arange(1.0, 6.0)) == pytest.approx((3 - 2.7764 * 0.7071, 3 + 2.7764 * 0.7071), abs=1e-3)
        assert mean_interval(np.array([0.2, 0.9]), 0, 1) == (0, 1), "two cases tell nothing but what a mean can be"
        assert np.isnan(mean_interval(np.array([0.5]))).all()
        assert np.isnan(mean_interval(np.full(5, 0.1))).all(), "cases that are alike tell nothing of how they scatter"

    def test_interval_of_a_mean_of_five_cases_holds_it(self):
        drawn = np.random.default_rng(0).normal(size=(2000, 5))
        holds = [low < 0 < high for low, high in map(mean_interval, drawn)]
        assert np.mean(holds) == pytest.approx(0.95, abs=0.015)

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

    def test_too_sure_and_too_unsure_answers_do_not_cancel(self):
        """At 90 % seven of ten are right, at 30 % five of ten: .2 too many and .2 too few."""
        confidence = np.repeat([0.9, 0.3], 100)
        right = np.concatenate([np.arange(100) < 70, np.arange(100) < 50]).astype(float)
        assert confidence.mean() == pytest.approx(right.mean()), "or the mean alone would tell"
        assert calibration_error(confidence, right) == pytest.approx(0.2)
        points = reliability(confidence, right)
        assert [number for *_, number in points] == [100, 100]
        assert np.array(points)[:, :2] == pytest.approx(np.array([[0.3, 0.5], [0.9, 0.7]]))

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
