"""Files of a scoring: none is taken on trust, and what had no cases is said."""

import json
from dataclasses import replace
from math import isnan, nan
from pathlib import Path

import pandas as pd
import pytest
import typer
from doc_examples import examples
from scored_answers import answer, label, perfect, revealed, score, scored, suite
from typer.testing import CliRunner

from cusick_bench.cli.diagnose.withheld_score import score as score_command
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.label import read_label_documents
from cusick_bench.withheld.format.seal import published_files, published_seals, sealed
from cusick_bench.withheld.scoring.calibration import (
    wilson_interval,
)
from cusick_bench.withheld.scoring.failures import confusion_by_class, confusion_by_effect, failures
from cusick_bench.withheld.scoring.labelled_answers import read_labelled_answers
from cusick_bench.withheld.scoring.measures import AUROC, CLEAR
from cusick_bench.withheld.scoring.score import ANSWERS
from cusick_bench.withheld.scoring.table import markdown
from cusick_bench.withheld.suite.design import plan_suite
from cusick_bench.withheld.suite.labels import label_of


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

    def test_a_refusal_is_taken_for_nothing(self, tmp_path):
        labels = {"listed": label("creep"), "outside": label("unknown", None, hidden="wind"), "null": label("none")}
        both = revealed(tmp_path, labels, dict.fromkeys(labels, answer("refused")))
        cases = score(both).cases
        assert {item.case: item.faults for item in failures(both, cases)} == dict.fromkeys(
            ("listed", "outside"), ("refused",)
        )
        assert confusion_by_class(cases)["refused"].sum() == confusion_by_effect(cases)["refused"].sum() == 3
        assert confusion_by_class(cases)["unknown"].sum() == 0


class TestFiles:
    def test_missing_and_extra_cases_are_named(self, tmp_path):
        labels = {"a": label("none"), "b": label("creep")}
        with pytest.raises(WithheldError, match=r"lacks 1: b; answer every case; a refusal has the verdict refused"):
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

    @pytest.mark.parametrize(
        "parameters",
        [None, {"loss": 0.2, "kind": "log"}, {"direction": [0.6, 0.8]}, {"loss": {"value": 0.2, "unit": "1"}}, [None]],
    )
    def test_parameters_of_another_program_are_scored_and_sealed_as_they_stand(self, tmp_path, parameters):
        truth = sealed(label("creep", parameters=parameters), "salt")
        (tmp_path / "commitment.json").write_text(json.dumps({"a": truth["sha256"]}))
        both = revealed(tmp_path, {"a": truth}, {"a": answer("none")}, tmp_path / "commitment.json")
        assert both.labels["a"].effects == ("creep",)
        assert both.notes[0].startswith("All 1 labels fit the seals")
        known = read_label_documents(tmp_path / "labels.json")["a"].parameters_of_effects
        assert known == ({"loss": 0.2} if "kind" in (parameters or {}) else {},)

    def test_null_in_an_answer_is_what_it_leaves_out(self, tmp_path):
        nothing = {"stage": None, "map": None, "kind": None, "localisable": None}
        said = answer("effect", ("creep", 0.8), where=nothing, without=None, refused=None)
        said["causes"][0]["parameters"] = None
        found = revealed(tmp_path, {"a": label("creep")}, {"a": said}).answers["a"]
        assert (found.localisable, found.left_out, found.refused) == (False, (), "")
        said["where"] = {"stage": {"material": 0.5, "history": None}}
        revealed(tmp_path, {"a": label("creep")}, {"a": said})

    @pytest.mark.parametrize(
        ("said", "verdict"),
        [
            ({"causes": [("none", 0.9), ("creep", 0.1)], "set90": ["none"]}, "none"),
            ({"causes": [("creep", 0.1), ("unknown", 0.9)], "set90": ["unknown"]}, "unknown"),
            ({"causes": [("creep", 0.6), ("none", 0.4)], "set90": ["creep", "none"]}, "effect"),
            ({"causes": [("none", 0.6), ("creep", 0.4)], "set90": ["creep"], "effects": ["creep"]}, "effect"),
            ({"set90": ["none"]}, "none"),
            ({"refused": "no pictures"}, "refused"),
        ],
    )
    @pytest.mark.parametrize("given", [{}, {"verdict": None}])
    def test_the_verdict_of_an_answer_without_one_is_what_it_says(self, tmp_path, said, verdict, given):
        """An answer that found `none` the likeliest of its causes was taken for a false alarm."""
        stated = [{"effect": name, "probability": p} for name, p in said.get("causes", [])]
        found = revealed(tmp_path, {"a": label("none")}, {"a": {**said, "causes": stated, **given}})
        assert found.answers["a"].verdict == verdict
        assert score(found).value("false positives") == (verdict in ("effect", "unknown"))

    def test_a_refusal_needs_no_more_than_its_verdict(self, tmp_path):
        """So says the message on a case without an answer."""
        found = revealed(tmp_path, {"a": label("creep")}, {"a": {"verdict": "refused"}})
        assert (found.answers["a"].set90, score(found).value("power")) == ((), 0)

    def test_a_refusal_without_a_label_is_not_scored(self, tmp_path):
        """A folder that lies beside the cases is answered, too; it says nothing of them."""
        answers = {"a": answer("none"), "checks": answer("refused")}
        both = revealed(tmp_path, {"a": label("none")}, answers)
        assert set(both.answers) == {"a"}
        assert "1 refusals without a label are not scored: checks." in both.notes
        assert len(score(both).cases) == 1

    def test_a_refused_case_whose_label_is_lost_is_not_left_out(self, tmp_path):
        """It was sealed, so that it is one of the cases: without it a suite would be scored by the easier ones."""
        labels = {case: sealed(label("none"), case) for case in "ab"}
        seals = {case: one["sha256"] for case, one in labels.items()}
        answers, path = {"a": answer("none"), "b": answer("refused")}, tmp_path / "commitment.json"
        path.write_text(json.dumps(seals))
        for document, commitment in ((answers, path), ({"seals": seals, "answers": answers}, None)):
            with pytest.raises(WithheldError, match=r"labels\.json lacks 1: b"):
                revealed(tmp_path, {"a": labels["a"]}, document, commitment)

    def test_seals_stand_in_the_first_object_that_holds_any(self, tmp_path):
        facts = {"made_by": {"program": "another"}, "files": {"a": {"1.png": "0" * 64}, "b": "1" * 64}}
        path = tmp_path / "commitment.json"
        path.write_text(json.dumps({**facts, "seals": {"a": "2" * 64}}))
        assert published_seals(path) == {"a": "2" * 64}
        assert published_files(path) == {"b": "1" * 64}

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
        fit = "labels fit the seals published in commitment.json"
        assert revealed(tmp_path, labels, answers, commitment).notes[0] == f"All 2 {fit}."
        few = revealed(tmp_path, {"a": labels["a"]}, {"a": answers["a"]}, commitment)
        assert few.notes[0] == f"All 1 {fit}; 1 cases sealed there are not scored: b."
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

    def test_a_method_that_states_none_only_where_it_finds_nothing_detects_what_it_names(self, tmp_path):
        """As the baselines do: what they name was taken for less than nothing."""
        labels = {"a": label("none"), "b": label("creep"), "c": label("none")}
        stated = {
            "a": answer("none", ("none", 1.0)),
            "b": answer("effect", ("creep", 0.5), ("plate-tilt", 0.2)),
            "c": answer("none", ("none", 1.0)),
        }
        for said in stated.values():
            said["gap"] = {}
        found = scored(tmp_path, labels, stated)
        assert (found.detection, found.value("detection AUROC")) == ("none", 1)

    def test_an_answer_that_states_no_p_value_counts_against_its_giver(self, tmp_path):
        labels = {"a": label("none"), "b": label("creep"), "c": label("none")}
        answers = {"a": answer("none", p=0.5), "b": answer("none", p=0.1), "c": answer("none")}
        answers["c"]["gap"] = {}
        assert scored(tmp_path, labels, answers).value("detection AUROC") == 0.5


def test_labels_and_answers_of_the_documentation_are_scored(tmp_path):
    page = Path(__file__).resolve().parents[2] / "docs" / "diagnose.md"
    labels, answers = (json.loads(one.text) for one in examples(page) if one.language == "json")
    found = scored(tmp_path, labels, answers)
    assert found.value("exact effect") == found.value("pairs: both found") == found.value("90 % set covers") == 1
    assert found.value("false positives") == found.value("unknown recalled") == 0


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


@pytest.mark.parametrize("truth", [label("none", None, severity=None), label("creep", 2.0)])
def test_the_area_under_the_curve_has_no_cases_where_nulls_or_effects_are_missing(tmp_path, truth):
    scores = scored(tmp_path, {"a": truth, "b": truth}, {case: perfect(truth) for case in "ab"})
    areas = [figure for figure in scores.figures if figure.name == AUROC]
    assert areas
    assert all(isnan(figure.value) and figure.cases == 0 for figure in areas)
    page = markdown(scores, [], {})
    assert f"| {AUROC} |" not in page
    assert AUROC in page.split("Not judged")[1].split("\n")[0]


def test_what_all_resamples_agree_on_has_no_interval(tmp_path):
    """Two effects and three nulls that are told apart had an area of 1.000 [1.000, 1.000]."""
    labels = {f"n{i}": label("none", None, severity=None) for i in range(3)}
    labels |= {f"c{i}": label("creep", 2.0) for i in range(2)}
    answers = {case: perfect(truth) for case, truth in labels.items()}

    def clear(answers):
        figures = scored(tmp_path, labels, answers).figures
        return {figure.name: figure for figure in figures if (figure.method, figure.subset) == (ANSWERS, CLEAR)}

    found = clear(answers)
    for name in (AUROC, "90 % set size"):
        assert (found[name].value, isnan(found[name].low), isnan(found[name].high)) == (1.0, True, True)
    assert found["power"].low > 0
    mistaken = clear(answers | {"n0": answer("effect", ("creep", 0.9), p=1e-4)})[AUROC]
    assert mistaken.low < mistaken.value < 1


def test_means_of_two_cases_have_the_wide_interval_that_two_cases_give(tmp_path):
    """Sets of one and three names: Student's t with one degree of freedom, not the 1 to 3 of resamples."""
    labels = {f"c{i}": label("creep", 2.0) for i in range(2)}
    answers = {
        "c0": answer("effect", ("creep", 1.0), p=1e-4),
        "c1": answer("effect", ("creep", 0.5), ("camera-scale", 0.25), ("cut-size", 0.2), p=1e-4),
    }
    figures = scored(tmp_path, labels, answers).figures
    found = {figure.name: figure for figure in figures if (figure.method, figure.subset) == (ANSWERS, CLEAR)}
    size, stated = found["90 % set size"], found["exact effect (stated)"]
    assert (size.value, size.low, size.high) == (2, 0, pytest.approx(2 + 12.706, abs=1e-3))
    assert (stated.value, stated.low, stated.high) == (0.75, 0, 1)


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
