"""Withheld cases answered blind: nothing but the case is looked at, nothing is lost, bad cases get no wrong answer."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from toy_cloths import write_toy
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.diagnose import Options
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.simulation.closure import Draping
from cusick_bench.files import digest
from cusick_bench.files.digest import file_digest, folder_digest
from cusick_bench.withheld.answers import blind, oracle
from cusick_bench.withheld.answers.blind import answer_case, answer_suite, case_captures, case_folders
from cusick_bench.withheld.answers.oracle import oracle_closure, oracle_closures, read_oracle_closures
from cusick_bench.withheld.answers.parts import case_digest, case_part
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import read_answers
from cusick_bench.withheld.format.label import LabelDocument, read_label_documents
from cusick_bench.withheld.format.seal import published_seals
from cusick_bench.withheld.scoring.labelled_answers import read_labelled_answers
from cusick_bench.withheld.scoring.score import score
from cusick_bench.withheld.suite.design import EFFECTS
from cusick_bench.withheld.suite.detectable import DetectableSeverities
from cusick_bench.withheld.suite.generate import Suite, generate

QUICK = Options(samples=0, always=False)


def test_answers_keep_to_the_format(small_suite: Path, small_answers: Path) -> None:
    found = read_answers(small_answers)
    assert sorted(found.answers) == ["case_0001", "case_0002", "case_0003"]
    for answer in found.answers.values():
        assert sum(probability for _, probability in answer.causes) == pytest.approx(1, abs=0.06)  # of those listed
        assert set(answer.baselines) == {"largest-marginal-score", "lasso-without-projection"}
        assert answer.where.map is not None
        assert np.array(answer.where.map).shape == (4, 16)
    assert found.content() == json.loads(small_answers.read_text())
    labels, commitment = small_suite / "labels" / "labels.json", small_suite / "cases" / "commitment.json"
    assert found.seals == published_seals(commitment), "the answers say which cases they are of"
    assert len(score(read_labelled_answers(small_answers, labels, commitment)).cases) == 3


def test_cases_with_other_pictures_than_the_sealed_ones_are_not_answered(small_suite: Path, tmp_path: Path) -> None:
    cases = shutil.copytree(small_suite / "cases", tmp_path / "cases")
    pictures = sorted((cases / "case_0002").rglob("*.jpg"))
    pictures[0].write_bytes(pictures[1].read_bytes())
    with pytest.raises(
        WithheldError, match=f"{cases} must be the cases that were published, but the files of case_0002"
    ):
        answer_suite(cases, tmp_path / "answers.json", SHIPPED, QUICK)
    with pytest.raises(WithheldError, match="the files of case_0002"):
        oracle_closures(
            cases, read_label_documents(small_suite / "labels" / "labels.json"), tmp_path / "o", SHIPPED, Draping(2)
        )


def test_answers_to_other_pictures_than_the_sealed_ones_are_not_scored(
    small_suite: Path, small_answers: Path, tmp_path: Path
) -> None:
    labels, commitment = small_suite / "labels" / "labels.json", small_suite / "cases" / "commitment.json"
    notes = read_labelled_answers(small_answers, labels, commitment).notes
    assert "The files of 3 answered cases are those that were published." in notes
    document = json.loads(small_answers.read_text())
    document["files"]["case_0002"] = "0" * 64
    answers = tmp_path / "answers.json"
    answers.write_text(json.dumps(document))
    with pytest.raises(WithheldError, match="the files of case_0002 have another SHA-256"):
        read_labelled_answers(answers, labels, commitment)
    published = json.loads(commitment.read_text())
    del published["files"]  # as suites published before their files were sealed
    (tmp_path / "commitment.json").write_text(json.dumps(published))
    old = read_labelled_answers(answers, labels, tmp_path / "commitment.json").notes
    assert not any("files" in note for note in old)


def test_labels_that_lie_change_nothing(
    small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None
) -> None:
    """Everything about a case that is no silhouette, density or protocol may say what it likes."""
    case = small_suite / "cases" / "case_0001"
    lying = tmp_path / "case_0001"
    shutil.copytree(case, lying)
    label = {"effect": "creep", "class": "history", "severity": 0.9, "parameters": {"loss": 0.9}}
    for place in (lying, lying / "Fabric 1", tmp_path):
        (place / "labels.json").write_text(json.dumps({"case_0001": label}))
    (lying / "Fabric 1" / "label.txt").write_text("perspective")
    protocol = json.loads((lying / "protocol.json").read_text())
    (lying / "protocol.json").write_text(json.dumps(protocol | {"effect": "perspective", "label": "off-centre"}))
    assert answer_case(lying, SHIPPED, QUICK) == read_answers(small_answers).answers["case_0001"]


def test_a_suite_that_was_stopped_goes_on(
    small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None
) -> None:
    first = read_answers(small_answers).answers
    out = tmp_path / "answers.json"
    shutil.copytree(small_answers.with_name("answers.json.parts"), tmp_path / "answers.json.parts")
    parts = sorted((tmp_path / "answers.json.parts").rglob("*.json"), key=lambda part: part.stem)
    assert [part.stem for part in parts] == ["case_0001", "case_0002", "case_0003"]
    changed = json.loads(parts[0].read_text()) | {"verdict": "unknown", "code": "kept"}
    parts[0].write_text(json.dumps(changed))  # an answer that is there is not made again
    parts[1].unlink()
    told: list[str] = []
    again = answer_suite(small_suite / "cases", out, SHIPPED, QUICK, step=told.append).answers
    assert again["case_0001"].content() == changed
    assert again["case_0002"] == first["case_0002"]
    assert sorted(told) == sorted(first)


def test_the_files_of_a_case_are_read_once_for_their_hash(
    small_suite: Path, small_answers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is frozen with an answer, and the name of its part, are of the same files."""
    shutil.copytree(small_answers.with_name("answers.json.parts"), tmp_path / "answers.json.parts")
    read: list[Path] = []
    monkeypatch.setattr(digest, "file_digest", lambda path: read.append(path) or file_digest(path))
    document = answer_suite(small_suite / "cases", tmp_path / "answers.json", SHIPPED, QUICK)
    assert document == read_answers(small_answers)
    assert len(read) == len(set(read)) > 0


def test_a_case_is_what_it_is_read_from(tmp_path: Path) -> None:
    """Tables above a folder that is named like a fabric's are its own: answers outlived a change of the protocol."""
    for name in ("Fabric 1", "case_0001"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "picture.png").write_bytes(b"0")
    alone = case_digest(tmp_path / "Fabric 1")
    assert alone == case_digest(tmp_path / "case_0001") == folder_digest(tmp_path / "case_0001")
    digests = set()
    for table in ("protocol.json", "fabrics.csv"):
        (tmp_path / table).write_text("{}")
        digests.add(case_digest(tmp_path / "Fabric 1"))
        assert case_digest(tmp_path / "case_0001") == alone
    (tmp_path / "protocol.json").write_text('{"turn_over": "about y"}')
    assert len(digests | {alone, case_digest(tmp_path / "Fabric 1")}) == 4


@pytest.mark.parametrize("changed", ["atlas.npz", "cases/case_0001/fabrics.csv"])
def test_answers_from_files_that_were_changed_meanwhile_are_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str
) -> None:
    """As where `atlas calibrate` writes the atlas anew: they would be kept under the hash of the earlier file."""
    (tmp_path / "cases" / "case_0001").mkdir(parents=True)
    (tmp_path / "cases" / "case_0001" / "fabrics.csv").touch()
    shutil.copy(SHIPPED, tmp_path / "atlas.npz")
    contents = [b"after the first answer", b"", b""]

    def read(_: Path) -> None:
        with (tmp_path / changed).open("ab") as file:
            file.write(contents.pop(0))
        raise WithheldError("no silhouettes")

    monkeypatch.setattr(blind, "case_captures", read)
    words = tmp_path / "cases", tmp_path / "answers.json", tmp_path / "atlas.npz", QUICK
    with pytest.raises(WithheldError, match=f"({changed}|case_0001) must stay as it is"):
        answer_suite(*words)
    assert not list(tmp_path.rglob("answers.json*"))
    assert answer_suite(*words).answers["case_0001"].refused == "no silhouettes"


def test_other_options_are_other_answers(
    small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None
) -> None:
    shutil.copytree(small_suite / "cases" / "case_0001", tmp_path / "cases" / "case_0001")
    shutil.copytree(small_answers.with_name("answers.json.parts"), tmp_path / "answers.json.parts")
    options = Options(samples=0, always=False, without=tuple(EFFECTS))
    (answer,) = answer_suite(tmp_path / "cases", tmp_path / "answers.json", SHIPPED, options).answers.values()
    assert set(answer.left_out) == set(EFFECTS)
    assert {name for name, _ in answer.causes} <= {"none", "unknown", "density-bias"}


@pytest.mark.slow
def test_another_case_of_the_same_name_is_another_answer(
    small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None
) -> None:
    shutil.copytree(small_suite / "cases" / "case_0001", tmp_path / "cases" / "case_0001")
    shutil.copytree(small_answers.with_name("answers.json.parts"), tmp_path / "answers.json.parts")
    others = sorted((small_suite / "cases" / "case_0002").rglob("*.jpg"))
    for path, other in zip(sorted((tmp_path / "cases").rglob("*.jpg")), others, strict=True):
        shutil.copy(other, path)
    (found,) = answer_suite(tmp_path / "cases", tmp_path / "answers.json", SHIPPED, QUICK).answers.values()
    assert found.causes != read_answers(small_answers).answers["case_0001"].causes


@pytest.mark.parametrize(
    "damage",
    [
        "no image",
        "one sample",
        "one face",
        pytest.param("rotated", marks=pytest.mark.slow),
        pytest.param("no density", marks=pytest.mark.slow),
        "other plate",
        "empty",
    ],
)
def test_bad_cases_get_no_confident_answer(small_suite: Path, tmp_path: Path, one_thread: None, damage: str) -> None:
    case = tmp_path / "case"
    shutil.copytree(small_suite / "cases" / "case_0001", case)
    images = sorted(case.rglob("*.jpg"))
    if damage == "no image":
        images[0].write_bytes(b"no image")
    elif damage == "one sample":
        for path in images:
            if "Sample_1_" not in path.name:
                path.unlink()
    elif damage == "one face":
        for path in images:
            if path.stem.endswith(("3", "4")):
                path.unlink()
    elif damage == "rotated":
        for path in images[:3]:
            Image.open(path).rotate(90).save(path)
    elif damage == "no density":
        (case / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n1,,\n")
    elif damage == "other plate":
        protocol = json.loads((case / "protocol.json").read_text())
        (case / "protocol.json").write_text(json.dumps(protocol | {"plate_radius_m": 0.06}))
    else:
        for path in images:
            path.unlink()
    found = answer_case(case, SHIPPED, QUICK)
    if damage in ("other plate", "one sample", "empty"):
        assert found.verdict == "refused"
        assert found.refused
        return
    assert not found.refused, "what is left of the case can be diagnosed"
    assert all(probability < 0.5 for name, probability in found.causes if name in EFFECTS), found.causes


def test_an_atlas_that_cannot_be_used_answers_no_case(tmp_path: Path) -> None:
    """It says nothing of the cases: none of them is refused, and nothing is frozen."""
    (tmp_path / "cases" / "case_0001").mkdir(parents=True)
    atlas, out = tmp_path / "atlas.npz", tmp_path / "answers.json"
    atlas.write_bytes(SHIPPED.read_bytes()[:1000])  # a copy that was cut short
    with pytest.raises(DiagnosisError, match=r"the atlas .*atlas\.npz cannot be used"):
        answer_suite(tmp_path / "cases", out, atlas, QUICK)
    assert [path.name for path in tmp_path.rglob("*.json")] == []


@pytest.mark.parametrize(
    ("label", "message"),
    [
        ({"effect": "creep", "severity": 0.6}, "the label of case_0001 lacks loss of creep"),
        ({"effect": "plate-tilt", "parameters": {"angle": 2}}, "the label of case_0001 lacks direction of plate-tilt"),
        ({"effect": ["creep", "camera-scale"], "severity": [0.6, 0.1]}, "lacks loss of creep"),
        ({"effect": ["creep", "camera-scale"], "parameters": {"loss": 0.6}}, "lacks error of camera-scale"),
        ({"effect": "creep", "parameters": {"loss": "much"}}, "the label of case_0001 lacks loss of creep"),
        ({"effect": "creep", "parameters": None}, "the label of case_0001 lacks loss of creep"),
        ({"effect": "creep", "parameters": {"loss": 1.5}}, "the label of case_0001 is of nothing .* got 1.5; correct"),
    ],
)
def test_what_a_label_leaves_out_is_not_taken_as_typical(tmp_path: Path, label: dict, message: str) -> None:
    (tmp_path / "cases" / "case_0001").mkdir(parents=True)
    labels = {"case_0001": LabelDocument.model_validate(label)}
    with pytest.raises(WithheldError, match=message):
        oracle_closures(tmp_path / "cases", labels, tmp_path / "oracle.json", SHIPPED, Draping(2))
    assert not (tmp_path / "oracle.json").exists()


def test_what_a_label_states_besides_is_no_parameter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other programs may write what they like, such as a seed."""
    acting: list[Candidate] = []

    def closed(captures: object, emulator: object, causes: Sequence[Candidate], draping: object) -> None:
        acting.extend(causes)

    monkeypatch.setattr(oracle, "closure_by", closed)
    monkeypatch.setattr(oracle, "case_captures", lambda folder: None)
    label = LabelDocument.model_validate({"effect": "creep", "parameters": {"loss": 0.6, "seed": 3}})
    assert oracle_closure(tmp_path, label, SHIPPED, Draping(2)) is None
    assert [one.value for one in acting] == [{"loss": 0.6}]


@pytest.mark.slow
def test_oracle_closure_is_judged(small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None) -> None:
    """The true cause with its true parameters; nulls have none, effects that the atlas lacks have no closure."""
    labels = read_label_documents(small_suite / "labels" / "labels.json")
    single = next(name for name, label in labels.items() if label.kind == "single")
    truth = {"effect": "camera-scale", "class": "imaging", "severity": 0.1, "parameters": {"error": 0.1}}
    camera = LabelDocument.model_validate(labels[single].content() | truth | {"location": None})
    out = tmp_path / "oracle.json"
    known = labels | {single: camera}
    out.write_text(json.dumps({"case_0099": 0.1}))
    found = oracle_closures(small_suite / "cases", known, out, SHIPPED, Draping(2))
    assert list(found) == [single]
    assert read_oracle_closures(out) == found, "of these cases alone"
    absent = camera.model_copy(update={"effect": "density-bias"})
    assert oracle_closure(small_suite / "cases" / single, absent, SHIPPED, Draping(2)) is None
    (part,) = out.with_name("oracle.json.parts").rglob("*.json")
    part.write_text(json.dumps({single: 0.5}))
    more = oracle_closures(small_suite / "cases", known, out, SHIPPED, Draping(4))
    assert read_oracle_closures(out) == more != {single: 0.5}, "more samples are another closure"
    again = oracle_closures(small_suite / "cases", known, out, SHIPPED, Draping(2))
    assert again == {single: 0.5}, "what is there already is kept"
    arguments = ["withheld", "score", str(small_answers), str(small_suite / "labels" / "labels.json")]
    result = CliRunner().invoke(app, [*arguments, "--oracle", str(out), "--json"])
    assert result.exit_code == 0, result.output
    closure = [f for f in json.loads(result.stdout)["figures"] if f["name"] == "closure within .1"]
    assert any(figure["cases"] == 1 for figure in closure), "the closure of the oracle is what answers are held against"


def test_a_case_of_several_fabrics_is_refused(tmp_path: Path, small_suite: Path) -> None:
    """An answer from the first of them would be taken for one to the case."""
    case = shutil.copytree(small_suite / "cases" / "case_0001", tmp_path / "cases" / "case_0001")
    other = shutil.copytree(case / "Fabric 1", case / "Fabric 2")
    for path in sorted(other.rglob("*.jpg")):
        path.rename(path.with_name(path.name.replace("Fabric_1", "Fabric_2")))
    found = answer_suite(tmp_path / "cases", tmp_path / "answers.json", SHIPPED, QUICK).answers["case_0001"]
    assert found.verdict == "refused"
    assert "a case must hold one fabric, got 2: fabric_1, fabric_2" in found.refused


def test_folder_without_cases(tmp_path: Path) -> None:
    with pytest.raises(WithheldError, match="no case folders"):
        case_folders(tmp_path / "nothing")


def test_answers_beside_the_cases_are_no_case(tmp_path: Path) -> None:
    (tmp_path / "case_0001").mkdir()
    case_part(tmp_path / "answers.json", "case_0001", "0" * 64, SHIPPED).parent.mkdir(parents=True)
    assert case_folders(tmp_path) == [tmp_path / "case_0001"]


def test_folders_that_archives_and_disks_add_are_no_cases(tmp_path: Path) -> None:
    for name in ("case_0001", "__MACOSX", "@eaDir", ".cache"):
        (tmp_path / name).mkdir()
    assert case_folders(tmp_path) == [tmp_path / "case_0001"]


def test_a_case_may_be_called_as_a_data_set_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Given by `.`, it was taken for the shipped set of that name."""
    write_toy(tmp_path / "synthetic", samples=2)
    monkeypatch.chdir(tmp_path)
    (case,) = case_folders(Path())
    assert str(case) == "synthetic"
    assert len(np.unique(case_captures(case).sample)) == 2


def test_a_folder_of_answers_among_the_cases_is_none(tmp_path: Path) -> None:
    cases = tmp_path / "cases"
    for name in ("case_0001", "answers"):
        (cases / name).mkdir(parents=True)
    assert list(answer_suite(cases, cases / "answers" / "answers.json", SHIPPED, QUICK).answers) == ["case_0001"]
    (cases / "case_0001").rename(tmp_path / "case_0001")
    with pytest.raises(WithheldError, match=r"no case folders in .* but that of .*answers\.json"):
        answer_suite(cases, cases / "answers" / "answers.json", SHIPPED, QUICK)


def test_answers_within_a_case_are_refused(tmp_path: Path) -> None:
    """The case would be taken for the folder of the answers, and left out."""
    cases = tmp_path / "cases"
    for name in ("case_0001", "case_0002"):
        write_toy(cases / name, samples=2)
    with pytest.raises(WithheldError, match=r"answers\.json lies within the case case_0002; give a file outside"):
        answer_suite(cases, cases / "case_0002" / "answers.json", SHIPPED, QUICK)


def test_command_says_how_many_cases_are_refused(tmp_path: Path) -> None:
    (tmp_path / "cases" / "case_0001").mkdir(parents=True)
    arguments = ["withheld", "answer", str(tmp_path / "cases"), "--samples", "0", "--workers", "1", "--json"]
    result = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "new" / "answers.json")])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["verdicts"] == {"refused": 1}
    assert "1 of 1 cases are answered by a refusal, such as case_0001: " in result.stderr
    assert "holds no silhouettes" in result.stderr
    (said,) = json.loads((tmp_path / "new" / "answers.json").read_text())["answers"].values()
    assert said.keys() >= {"effects", "groups", "budget", "unexplained", "gap", "causes", "set90", "closure", "next"}
    assert said["unexplained"] == {"share": None, "ci90": None}
    assert said["closure"] == {"effect": [], "fraction": None, "ci90": None}
    assert said["where"].keys() == {"stage", "map", "kind", "angle_deg", "radius_m", "localisable", "why_not"}


@pytest.mark.parametrize("command", ["answer", "oracle", "leave-out"])
def test_a_folder_for_the_file_is_refused_before_the_work(tmp_path: Path, command: str) -> None:
    (tmp_path / "cases" / "case_0001").mkdir(parents=True)
    label = {"effect": "creep", "severity": 0.6, "parameters": {"loss": 0.6}, "multiple": 4.0}
    (tmp_path / "labels.json").write_text(json.dumps({"case_0001": label}))
    labels = [] if command == "answer" else [str(tmp_path / "labels.json")]
    result = CliRunner().invoke(
        app, ["withheld", command, str(tmp_path / "cases"), *labels, "--out", str(tmp_path), "--workers", "1"]
    )
    assert result.exit_code == 2
    assert f"--out must name a file, got the folder {tmp_path}; give for instance" in result.output
    assert not list(tmp_path.parent.glob("*.parts")), "nothing has been answered"


def test_command(small_suite: Path, small_answers: Path, tmp_path: Path, one_thread: None) -> None:
    out = tmp_path / "answers.json"
    shutil.copytree(small_answers.with_name("answers.json.parts"), tmp_path / "answers.json.parts")
    (part,) = (tmp_path / "answers.json.parts").rglob("case_0001.json")
    part.unlink()  # it is answered anew
    arguments = ["withheld", "answer", str(small_suite / "cases"), "--out", str(out), "--samples", "0"]
    result = CliRunner().invoke(app, [*arguments, "--workers", "1", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["cases"] == 3
    assert out.read_bytes() == small_answers.read_bytes()
    result = CliRunner().invoke(app, [*arguments, "--without-effect", "no-such-effect"])
    assert result.exit_code == 2


@pytest.mark.slow
def test_small_suite_keeps_its_figures(tmp_path: Path) -> None:
    """A regression check: strong effects are found and named, fabrics without effect are left in peace."""
    strong = DetectableSeverities((0.0,), {name: (4 * draw.typical,) for name, draw in EFFECTS.items()})
    counts = {"null": 6, "single": 8, "pair": 0, "unknown": 0}
    generate(Suite(31, counts, 450, 8, strong), tmp_path / "cases", tmp_path / "labels", workers=2)
    answer_suite(tmp_path / "cases", tmp_path / "answers.json", SHIPPED, QUICK, workers=2)
    answered = read_labelled_answers(
        tmp_path / "answers.json", tmp_path / "labels" / "labels.json", tmp_path / "cases" / "commitment.json"
    )
    cases = score(answered).cases
    nulls, singles = cases[cases["kind"] == "null"], cases[cases["kind"] == "single"]
    assert nulls["detected"].mean() <= 0.34
    assert singles["detected"].mean() >= 0.5
