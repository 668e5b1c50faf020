"""What silhouettes show of an effect: known shifts are measured, chance is not taken for one, and scores follow."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.inference.detectability.power import NEEDED
from cusick_bench.diagnosis.inference.residuals.feature_rows import MEANS, faces_of
from cusick_bench.diagnosis.inference.residuals.noise import scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base, inflated
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics, sample_statistics
from cusick_bench.diagnosis.inference.single_effects.evidence import grid_at
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.withheld.answers import shown_shift as shown_shifts
from cusick_bench.withheld.answers.blind import case_captures
from cusick_bench.withheld.answers.shown_shift import (
    ShownShift,
    measure_shown_shifts,
    read_shown_shifts,
    shown_shift,
    unmatched,
)
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import read_answer
from cusick_bench.withheld.format.label import SINGLE, Label, LabelDocument, read_label_documents
from cusick_bench.withheld.scoring.labelled_answers import (
    LabelledAnswers,
    read_labelled_answers,
    with_measured_severities,
)
from cusick_bench.withheld.scoring.measures import CLEAR, DISTINCT
from cusick_bench.withheld.scoring.score import score
from cusick_bench.withheld.suite import generate as generate_module
from cusick_bench.withheld.suite.generate import SUITE, Suite, read_suite

SIZES = {"plate-radius", "cut-size", "camera-scale", "threshold"}


@pytest.fixture(scope="module")
def plain(small_suite: Path) -> SampleStatistics:
    labels = json.loads((small_suite / "labels" / "labels.json").read_text())
    name = next(case for case, label in labels.items() if label["kind"] == "null")
    return sample_statistics(case_captures(small_suite / "cases" / name))


@pytest.fixture(scope="module")
def residual(plain: SampleStatistics) -> Residual:
    emulator, calibration = load_atlas(SHIPPED)
    found = against_base(emulator, plain.features(), scatter=scatter_of(plain.specimens), drift=plain.later)
    return inflated(found, calibration.inflation)


def scaled(plain: SampleStatistics, residual: Residual, size: float) -> SampleStatistics:
    """The same fabric with what the atlas expects of a wrong camera scale, on both faces, |d| being `size`."""
    emulator, _ = load_atlas(SHIPPED)
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "camera-scale")
    value = {name: np.array([0.02 if name == "error" else column[0]]) for name, column in hypothesis.values.items()}
    row = shifts(emulator, hypothesis, residual.theta, residual.sd, plain.later, value).features
    row[:, MEANS.stop :] = 0.0
    row *= size / np.linalg.norm(residual.whiten(row))
    moved = faces_of(row[0]) * residual.sd
    return SampleStatistics(plain.specimens + moved, plain.drift, plain.later)


class TestCompare:
    def test_a_case_is_its_own_twin(self, plain: SampleStatistics):
        assert shown_shift(plain, plain, SHIPPED, ("creep",)) == ShownShift(0.0, "", 0.0, 0.0)

    @pytest.mark.parametrize("size", [4.0, 10.0])
    def test_a_known_shift_has_its_size_and_its_name(self, plain: SampleStatistics, residual: Residual, size: float):
        found = shown_shift(scaled(plain, residual, size), plain, SHIPPED, ())
        assert found.shift == pytest.approx(size, rel=0.3)
        assert found.shift <= size + 1e-6, "base parameters may take some of it up, but add nothing"
        assert found.nearest in SIZES
        assert found.alike > 0.95
        assert found.multiple == pytest.approx(found.shift / NEEDED)
        assert found.unlike < 0.35 * found.multiple

    def test_of_several_effects_the_one_counts_that_shows_least(self):
        pair = ShownShift(8 * NEEDED, "threshold", 0.6, 6.4 * NEEDED, {"creep": 7 * NEEDED, "cut-size": 1.5 * NEEDED})
        assert pair.multiple == pytest.approx(1.5)
        assert pair.unlike == pytest.approx(6.4), "what is left of the whole shift"

    def test_two_effects_together_may_stand_for_another(self, plain: SampleStatistics, residual: Residual):
        """Either alone leaves the other's part."""
        units = {}
        for name in ("camera-scale", "face-asymmetry"):
            hypothesis = next(one for one in hypotheses(load_atlas(SHIPPED)[0]) if one.name == name)
            shift = grid_at(load_atlas(SHIPPED)[0], hypothesis, residual).shift
            units[name] = shift[-1] / np.linalg.norm(shift[-1])
        both = 10 * (units["camera-scale"] + units["face-asymmetry"])
        alone = {name: both - both @ unit * unit for name, unit in units.items()}
        assert all(np.linalg.norm(one) > 6 for one in alone.values())
        one_each = {name: unit[None] for name, unit in units.items()}
        assert unmatched(both, one_each) == pytest.approx(0, abs=1e-9)
        assert unmatched(-both, one_each) == pytest.approx(both @ both), "no effect acts with the other sign"

    def test_an_effect_is_compared_in_each_of_its_frames(self, plain: SampleStatistics, residual: Residual):
        """Along x a shift with the cloth and one with the camera are two things: the cloth is turned over about y."""
        emulator = load_atlas(SHIPPED)[0]
        frames = [one for one in hypotheses(emulator) if one.name == "camera-offset"]
        assert len(frames) == 2
        for hypothesis in frames:
            value = {"shift": np.array([5e-3]), "direction": np.array([0.0])}
            row = shifts(emulator, hypothesis, residual.theta, residual.sd, plain.later, value).features
            row[:, MEANS.stop :] = 0.0
            row *= 12 / np.linalg.norm(residual.whiten(row))
            case = SampleStatistics(plain.specimens + faces_of(row[0]) * residual.sd, plain.drift, plain.later)
            found = shown_shift(case, plain, SHIPPED, ())
            assert found.alike > 0.9
            assert found.left < 0.5 * found.shift

    def test_what_acts_is_not_compared_with(self, plain: SampleStatistics, residual: Residual):
        found = shown_shift(scaled(plain, residual, 10.0), plain, SHIPPED, tuple(SIZES))
        assert found.nearest not in SIZES

    def test_chance_is_taken_off(self, plain: SampleStatistics):
        """Drapes that fell into other folds: no mean shift, but a large difference."""
        sizes = []
        for seed in range(5):
            sign = np.random.default_rng(seed).choice([-1.0, 1.0], size=(len(plain.specimens), 2, 1))
            other = plain.specimens + 0.5 * sign * plain.specimens.std(0)
            sizes.append(shown_shift(SampleStatistics(other, plain.drift, plain.later), plain, SHIPPED, ()).multiple)
        assert np.median(sizes) < 1


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["withheld", *map(str, arguments), "--json"])


class TestCommands:
    @pytest.mark.slow
    def test_scores_follow_what_is_shown(
        self, small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None
    ):
        labels, out = small_suite / "labels" / "labels.json", tmp_path / "twins.json"
        result = invoke("twins", small_suite / "cases", labels, "--out", out, "--workers", 1)
        assert result.exit_code == 0, result.output
        shown = read_shown_shifts(out)
        kinds = {case: label["kind"] for case, label in json.loads(labels.read_text()).items()}
        assert set(shown) == {case for case, kind in kinds.items() if kind != "null"}
        for case, one in shown.items():
            acting = json.loads(labels.read_text())[case]["effect"]
            assert set(one.each) == (set(acting) if kinds[case] == "pair" else set())
        strong = {case: ShownShift(3 * NEEDED, "threshold", 0.8, 1.8 * NEEDED) for case in shown}
        for part in out.with_name("twins.json.parts").rglob("*.json"):
            part.write_text(json.dumps({part.stem: asdict(strong[part.stem])}))
        suite, documents = read_suite(small_suite / "labels" / SUITE), read_label_documents(labels)
        again = measure_shown_shifts(suite, small_suite / "cases", documents, out, SHIPPED)
        assert again == read_shown_shifts(out) == strong, "what is there already is kept"
        result = invoke("score", small_answers, labels, "--twins", out)
        assert result.exit_code == 0, result.output
        found = json.loads(result.stdout)
        multiples = {case["kind"]: case["multiple"] for case in found["cases"]}
        assert multiples["single"] == pytest.approx(3.0)
        assert multiples["unknown"] == pytest.approx(3.0)
        own = [figure for figure in found["figures"] if figure["method"] == "answers"]
        for subset in (CLEAR, DISTINCT):
            cases = {figure["name"]: figure["cases"] for figure in own if figure["subset"] == subset}
            assert cases["power"] == cases["unknown recalled"] == 1
        assert any("twin" in note for note in found["notes"])

    def test_twins_are_draped_on_one_thread(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        """As the cases are, so that a twin differs by its effect alone."""
        threads: list[int] = []
        monkeypatch.setattr(
            shown_shifts, "write_case", lambda suite, plan, out: threads.append(torch.get_num_threads())
        )
        monkeypatch.setattr(shown_shifts, "_data", lambda folder: None)
        before = torch.get_num_threads()
        torch.set_num_threads(2)
        suite = Suite(4, {"null": 0, "single": 1, "pair": 0, "unknown": 0})
        shown_shifts._twin(suite, suite.plans()[0], ())  # pyright: ignore[reportPrivateUsage]
        torch.set_num_threads(before)
        assert threads == [1]

    @pytest.mark.parametrize(("shown", "subsets"), [
        (ShownShift(3 * NEEDED, "threshold", 0.8, 1.8 * NEEDED), {CLEAR, DISTINCT}),
        (ShownShift(3 * NEEDED, "threshold", 0.8, 0.4 * NEEDED), {CLEAR}),
        (ShownShift(1.9 * NEEDED, "threshold", 0.1, 1.9 * NEEDED), set()),
    ])  # fmt: skip
    def test_what_others_make_is_not_distinct(self, shown: ShownShift, subsets: set[str]):
        """A threefold shift of which other effects leave 1.8 or .4, and one that is too weak to be clear."""
        label = Label(("creep",), SINGLE, "history", multiple=0.1)
        for without, name in (([], "power"), (["creep"], "unknown recalled")):  # listed, and left out for this answer
            said = {"verdict": "none", "causes": [], "set90": ["none"], "without": without}
            answers = LabelledAnswers({"a": read_answer(said, "answer")}, {"a": label}, ())
            answered = with_measured_severities(answers, {"a": shown}, "twins.json")
            assert answered.labels["a"].multiple == shown.multiple
            found = {figure.subset for figure in score(answered).figures if figure.cases and figure.name == name}
            assert found & {CLEAR, DISTINCT} == subsets

    def test_labels_of_another_suite_are_refused(self, small_suite: Path, tmp_path: Path):
        labels = read_label_documents(small_suite / "labels" / "labels.json")
        case, label = next((case, label) for case, label in labels.items() if label.kind == "single")
        assert isinstance(label.severity, float)
        labels[case] = LabelDocument.model_validate(label.content() | {"severity": label.severity + 1.0})
        suite = read_suite(small_suite / "labels" / SUITE)
        with pytest.raises(WithheldError, match=f"{case} has another label"):
            measure_shown_shifts(suite, small_suite / "cases", labels, tmp_path / "twins.json", SHIPPED)

    def test_cases_by_other_code_have_no_twins(
        self, small_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ):
        """What differs between two codes would count as what the cases show."""
        labels = read_label_documents(small_suite / "labels" / "labels.json")
        suite = read_suite(small_suite / "labels" / SUITE)
        monkeypatch.setattr(generate_module, "NUMERICS_VERSION", 99)
        with pytest.raises(WithheldError, match=r"twins must be made by the code that made their cases.*withheld 99"):
            measure_shown_shifts(suite, small_suite / "cases", labels, tmp_path / "twins.json", SHIPPED)

    def test_cases_without_their_suite_are_refused(self, small_suite: Path, tmp_path: Path):
        (tmp_path / "labels.json").write_text("{}")
        result = invoke("twins", small_suite / "cases", tmp_path / "labels.json")
        assert result.exit_code == 2
        assert "suite.json" in result.output
        assert "`withheld generate` leaves it beside labels.json" in result.output
        (tmp_path / SUITE).write_text('{"seed": 3}')
        with pytest.raises(WithheldError, match="no description of a suite"):
            read_suite(tmp_path / SUITE)

    @pytest.mark.parametrize(
        "wrong", [{"shift": -1}, {"left": -1}, {"left": None}, {"alike": 1.5}, {"shift": "much"}, {"shift": None}]
    )
    def test_a_broken_file_is_refused(self, tmp_path: Path, wrong: dict[str, Any]):
        entry = {"shift": 3.0, "nearest": "creep", "alike": 0.5, "left": 2.0} | wrong
        (tmp_path / "twins.json").write_text(json.dumps({"case_0001": entry}))
        with pytest.raises(WithheldError, match="case_0001"):
            read_shown_shifts(tmp_path / "twins.json")

    def test_every_case_with_an_effect_must_be_there(self, small_suite: Path, small_answers: Path):
        with pytest.raises(WithheldError, match="lacks case_"):
            with_measured_severities(
                read_labelled_answers(small_answers, small_suite / "labels" / "labels.json"), {}, "twins.json"
            )
