"""Leave-one-effect-out: just the case's own effect is off the list, and nothing can be left away unnoticed."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.diagnose import Options
from cusick_bench.diagnosis.inference.single_effects.equivalents import ABSORBED
from cusick_bench.withheld.answers.leave_out import answer_left_out, left_out_effects
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import read_answers
from cusick_bench.withheld.format.causes import EFFECTS
from cusick_bench.withheld.format.label import read_label
from cusick_bench.withheld.scoring.labelled_answers import LabelledAnswers, read_labelled_answers
from cusick_bench.withheld.scoring.score import ANSWERS, score

QUICK = Options(samples=0)
SEEN = {*EFFECTS} - ABSORBED.effects


@pytest.fixture(scope="session")
def cases(small_suite: Path) -> Path:
    return small_suite / "cases"


def label(effect: Any, multiple: Any = 3.0, **more: Any) -> dict[str, Any]:
    return {"effect": effect, "multiple": multiple, "location": None, "oracle_closure": None} | more


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    """A strong effect, a weak one, and none."""
    found = {
        "case_0001": label("camera-scale"),
        "case_0002": label("perspective", 1.0),
        "case_0003": label("none", None),
    }
    (tmp_path / "labels.json").write_text(json.dumps(found))
    return tmp_path / "labels.json"


def ask(command: str, *arguments: object) -> dict[str, Any]:
    outcome = CliRunner().invoke(app, ["withheld", command, *map(str, arguments), "--json"])
    assert outcome.exit_code == 0, outcome.output
    return json.loads(outcome.stdout)


class TestWhichCases:
    def test_strong_single_effects_alone(self):
        known = {
            "strong": label("creep", 2.0),
            "weak": label("creep", 1.9),
            "null": label("none", None),
            "pair": label(["creep", "threshold"], [4, 4]),
            "outside": label("unknown", 4.0),
            "hidden": label("threshold", None, multiple_of_typical=4.0),
            "absorbed": label("density-bias", 4.0),
        }
        read = {case: read_label(entry, case) for case, entry in known.items()}
        assert left_out_effects(read, 2) == {"strong": "creep"}
        assert left_out_effects(read, 1) == {"strong": "creep", "weak": "creep"}

    def test_typical_severities_count_where_there_are_no_others(self):
        read = {"a": read_label(label("threshold", None, multiple_of_typical=2.0), "a")}
        assert left_out_effects(read, 2) == {"a": "threshold"}

    @pytest.mark.parametrize("least", [float("nan"), -1.0])
    def test_a_severity_that_is_none_is_refused(self, least):
        with pytest.raises(WithheldError, match="must be a number >= 0"):
            left_out_effects({"a": read_label(label("creep"), "a")}, least)

    def test_nothing_strong_enough_is_said(self):
        with pytest.raises(WithheldError, match="none of 1; lower --minimum-severity"):
            left_out_effects({"a": read_label(label("creep", 1.0), "a")}, 2)


@pytest.mark.slow
def test_just_the_own_effect_of_a_case_is_off_its_list(
    cases: Path, small_answers: Path, tmp_path: Path, one_thread: None
) -> None:
    whole = read_answers(small_answers).answers
    listed = {case: dict(whole[case].causes) for case in ("case_0001", "case_0002")}
    chosen = {case: next(name for name in names if name in SEEN) for case, names in listed.items()}
    known = {case: read_label(label(effect), case) for case, effect in chosen.items()}
    found = answer_left_out(cases, known, tmp_path / "leave-out.json", SHIPPED, QUICK, 2)
    assert read_answers(tmp_path / "leave-out.json") == found
    assert sorted(found.answers) == sorted(known)
    for case, answer in found.answers.items():
        assert answer.left_out == (chosen[case],)
        left = {name for name, _ in answer.causes}
        assert chosen[case] not in left
        others = {name for name, p in listed[case].items() if p > 0.01 and name != chosen[case]}
        assert left & others, "all others are weighed as before, though some may now be too unlikely to be listed"


@pytest.mark.slow
def test_the_command_goes_on_and_its_answers_are_scored(cases: Path, labels: Path, tmp_path: Path, one_thread) -> None:
    out = tmp_path / "leave-out.json"
    arguments = (cases, labels, "--out", out, "--workers", 1)
    assert ask("leave-out", *arguments)["cases"] == 1
    (part,) = out.with_name("leave-out.json.parts").rglob("*.json")
    changed = json.loads(part.read_text()) | {"verdict": "unknown", "set90": ["unknown"]}
    part.write_text(json.dumps(changed))  # an answer that is there is not made again
    assert ask("leave-out", *arguments)["verdicts"] == {"unknown": 1}
    scores = ask("score", out, labels)
    own = {f["name"]: f for f in scores["figures"] if (f["method"], f["subset"]) == (ANSWERS, "all")}
    assert (own["unknown recalled"]["value"], own["unknown recalled"]["cases"]) == (1, 1)
    assert any(note.startswith("Leave-one-effect-out: 1 cases") for note in scores["notes"])
    assert ask("leave-out", *arguments, "--minimum-severity", 1)["cases"] == 2
    assert len(list(out.with_name("leave-out.json.parts").rglob("*.json"))) == 2, "one of them was there"


def test_a_case_that_is_refused_is_not_recalled_as_unknown(
    cases: Path, labels: Path, tmp_path: Path, one_thread
) -> None:
    shutil.copytree(cases / "case_0001", tmp_path / "cases" / "case_0001")
    for image in (tmp_path / "cases").rglob("*.jpg"):
        image.unlink()
    ask("leave-out", tmp_path / "cases", labels, "--out", tmp_path / "leave-out.json", "--workers", 1)
    (row,) = score(read_labelled_answers(tmp_path / "leave-out.json", labels)).cases.to_dict("records")
    assert (row["kind"], row["recalled"]) == ("unknown", 0)


class TestWhatIsNotTaken:
    """Files that claim to be of leave-one-effect-out."""

    def reveal(self, labels: Path, answers: dict[str, Any], least: object = 2) -> LabelledAnswers:
        said = labels.with_name("said.json")
        said.write_text(json.dumps({"leave_out": {"least": least}, "answers": answers}))
        return read_labelled_answers(said, labels)

    def answer(self, *without: str) -> dict[str, Any]:
        return {"verdict": "unknown", "causes": [], "set90": ["unknown"], "without": list(without)}

    def test_the_honest_one_is(self, labels):
        found = self.reveal(labels, {"case_0001": self.answer("camera-scale")}).labels
        assert {case: label.kind for case, label in found.items()} == {"case_0001": "unknown"}, (
            "whoever's answer it gets"
        )

    def test_a_case_that_lacks(self, labels):
        with pytest.raises(WithheldError, match="lacks 1: case_0002"):
            self.reveal(labels, {"case_0001": self.answer("camera-scale")}, 1)

    def test_a_case_too_many(self, labels):
        both = {"case_0001": self.answer("camera-scale"), "case_0003": self.answer("creep")}
        with pytest.raises(WithheldError, match="lacks 1: case_0003"):
            self.reveal(labels, both)

    def test_an_effect_that_was_offered(self, labels):
        with pytest.raises(WithheldError, match="case_0001 with 'camera-scale' among its causes"):
            self.reveal(labels, {"case_0001": self.answer("creep")})

    @pytest.mark.parametrize("least", ["2", None, -1])
    def test_no_severity(self, labels, least):
        with pytest.raises(WithheldError, match="least"):
            self.reveal(labels, {"case_0001": self.answer("camera-scale")}, least)


def test_labels_of_other_cases_are_refused(cases: Path, tmp_path: Path) -> None:
    known = {"case_0009": read_label(label("creep"), "case_0009")}
    with pytest.raises(WithheldError, match="none for case_0009"):
        answer_left_out(cases, known, tmp_path / "leave-out.json", SHIPPED, QUICK, 2)
