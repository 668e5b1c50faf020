"""Cases of all suites have the same names: cases, answers, labels and what is measured later must be of one suite."""

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from scored_answers import answer, revealed
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.simulation.closure import Draping
from cusick_bench.withheld.answers.oracle import oracle_closures
from cusick_bench.withheld.answers.shown_shift import ShownShift, measure_shown_shifts
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.label import read_label_documents
from cusick_bench.withheld.format.seal import COMMITMENT, salt_of, sealed
from cusick_bench.withheld.scoring.labelled_answers import with_measured_severities, with_oracle_closures
from cusick_bench.withheld.suite.design import Kind
from cusick_bench.withheld.suite.generate import SUITE, Suite
from cusick_bench.withheld.suite.labels import label_of

COUNTS: dict[Kind, int] = {"null": 2, "single": 2, "pair": 2, "unknown": 1}
OWN, OTHER = Suite(1, COUNTS), Suite(2, COUNTS)
ONE_SUITE = "must be of one suite"


def labels_of(suite: Suite) -> dict[str, Any]:
    return {plan.case: sealed(label_of(plan).content(), salt_of(suite.seed, plan.case)) for plan in suite.plans()}


def seals_of(suite: Suite) -> dict[str, str]:
    return {case: label["sha256"] for case, label in labels_of(suite).items()}


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    """Folder of the own suite's cases, which hold nothing, and its seals."""
    for case in labels_of(OWN):
        (tmp_path / "cases" / case).mkdir(parents=True)
    (tmp_path / "cases" / COMMITMENT).write_text(json.dumps({"hash": "SHA-256", "cases": seals_of(OWN)}))
    return tmp_path / "cases"


def written(folder: Path, suite: Suite) -> Path:
    path = folder / "labels.json"
    path.write_text(json.dumps(labels_of(suite)))
    return path


class TestAnswersAndLabels:
    def scored(self, folder: Path, labels: Suite) -> None:
        """Answers to cases of the own suite, held against the labels and the published seals of some suite."""
        answers = {"seals": seals_of(OWN), "answers": dict.fromkeys(seals_of(OWN), answer("none"))}
        commitment = folder / COMMITMENT
        commitment.write_text(json.dumps(seals_of(labels)))
        revealed(folder, labels_of(labels), answers, commitment)

    def test_of_one_suite(self, tmp_path: Path):
        self.scored(tmp_path, OWN)

    def test_of_two(self, tmp_path: Path):
        with pytest.raises(WithheldError, match=ONE_SUITE):
            self.scored(tmp_path, OTHER)


class TestCasesAndLabels:
    def test_oracle(self, cases: Path, tmp_path: Path):
        labels = read_label_documents(written(tmp_path, OTHER))
        with pytest.raises(WithheldError, match=ONE_SUITE):
            oracle_closures(cases, labels, tmp_path / "oracle.json", SHIPPED, Draping(2))

    def test_twins(self, cases: Path, tmp_path: Path):
        labels = read_label_documents(written(tmp_path, OTHER))
        with pytest.raises(WithheldError, match=ONE_SUITE):
            measure_shown_shifts(OTHER, cases, labels, tmp_path / "twins.json", SHIPPED)

    @pytest.mark.parametrize("command", ["oracle", "twins"])
    def test_a_folder_without_the_cases_replaces_nothing(self, cases: Path, tmp_path: Path, command: str):
        """As of a typing error: what was measured before is kept."""
        (tmp_path / SUITE).write_text(json.dumps({"seed": OWN.seed, "counts": OWN.counts}))
        out = tmp_path / "found.json"
        out.write_text("{}\n")
        words = ["withheld", command, str(tmp_path / "caess"), str(written(tmp_path, OWN)), "--out", str(out)]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 2
        assert "has none of the 7 cases with a label" in " ".join(result.output.split())
        assert out.read_text() == "{}\n"

    def test_leave_out(self, cases: Path, tmp_path: Path):
        words = ["withheld", "leave-out", str(cases), str(written(tmp_path, OTHER)), "--minimum-severity", "0"]
        result = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "leave-out.json")])
        assert result.exit_code == 2
        assert ONE_SUITE in " ".join(result.output.split())
        assert not (tmp_path / "leave-out.json").exists()


class TestWhatIsMeasuredLater:
    def shifts(self, suite: Suite) -> dict[str, ShownShift]:
        """What `withheld twins` finds has these cases, and these effects of pairs."""
        return {
            plan.case: ShownShift(20.0, "", 0.0, 10.0, dict.fromkeys(plan.causes, 20.0) if len(plan.causes) > 1 else {})
            for plan in suite.plans()
            if plan.causes
        }

    def test_shifts(self, tmp_path: Path):
        answered = revealed(tmp_path, labels_of(OWN), dict.fromkeys(seals_of(OWN), answer("none")))
        own = with_measured_severities(answered, self.shifts(OWN), "twins.json")
        assert all(label.multiple > 2 for label in own.labels.values() if label.kind != "null")
        with pytest.raises(WithheldError, match=r"twins\.json must be of the suite that is scored"):
            with_measured_severities(answered, self.shifts(OTHER), "twins.json")

    def test_shifts_of_another_pair(self, tmp_path: Path):
        answered = revealed(tmp_path, labels_of(OWN), dict.fromkeys(seals_of(OWN), answer("none")))
        shifts = self.shifts(OWN)
        pair = next(case for case, shown in shifts.items() if shown.each)
        names = [name for name in ("creep", "threshold", "camera-tilt") if name not in shifts[pair].each][:2]
        shifts[pair] = ShownShift(20.0, "", 0.0, 10.0, dict.fromkeys(names, 20.0))
        with pytest.raises(WithheldError, match=f"other effects in {pair}"):
            with_measured_severities(answered, shifts, "twins.json")

    def test_shifts_of_another_single_effect(self, tmp_path: Path):
        """The effect that is nearest to what acts is never the one that acts."""
        answered = revealed(tmp_path, labels_of(OWN), dict.fromkeys(seals_of(OWN), answer("none")))
        single = next(case for case, label in answered.labels.items() if label.kind == "single")
        (acting,) = answered.labels[single].effects
        for nearest, refused in (("creep" if acting != "creep" else "threshold", False), (acting, True)):
            shifts = self.shifts(OWN) | {single: ShownShift(20.0, nearest, 0.9, 10.0)}
            with pytest.raises(WithheldError, match=f"other effects in {single}") if refused else nullcontext():
                with_measured_severities(answered, shifts, "twins.json")

    def test_closures(self, tmp_path: Path):
        answered = revealed(tmp_path, labels_of(OWN), dict.fromkeys(seals_of(OWN), answer("none")))
        single, null = (
            next(c for c, one in answered.labels.items() if one.kind == kind) for kind in ("single", "null")
        )
        found = with_oracle_closures(answered, {single: 0.5}, "oracle.json")
        assert found.labels[single].oracle_closure == 0.5
        due = [case for case, one in answered.labels.items() if one.kind in ("single", "pair")]
        assert found.notes[-1].startswith(f"oracle.json has the closures of 1 of {len(due)} cases; `withheld oracle`")
        assert with_oracle_closures(answered, dict.fromkeys(due, 0.5), "oracle.json").notes == answered.notes
        with pytest.raises(WithheldError, match=f"other effects in {null}"):
            with_oracle_closures(answered, {null: 0.5}, "oracle.json")
