"""Withheld cases answered blind: nothing but the case is looked at, nothing is lost, bad cases get no wrong answer."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.diagnose import Options
from cusick_bench.diagnosis.inference.evidence import UNKNOWN
from cusick_bench.diagnosis.simulation.closure import Draping
from cusick_bench.withheld.answers.blind import answer_case, answer_suite, case_folders
from cusick_bench.withheld.answers.oracle import oracle_closure, oracle_closures
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import read_answer
from cusick_bench.withheld.scoring.revealed import reveal
from cusick_bench.withheld.scoring.score import score
from cusick_bench.withheld.suite.design import EFFECTS
from cusick_bench.withheld.suite.detectable import Detectable
from cusick_bench.withheld.suite.generate import Suite, generate

QUICK = Options(samples=0)


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cases, small."""
    folder = tmp_path_factory.mktemp("suite")
    counts = {"null": 1, "single": 1, "pair": 0, "unknown": 0}
    generate(Suite(4, counts, 250, 4, None), folder / "cases", folder / "labels")  # pyright: ignore[reportArgumentType]
    return folder


def test_answers_keep_to_the_format(suite: Path, tmp_path: Path, one_thread: None) -> None:
    found = answer_suite(suite / "cases", tmp_path / "answers.json", SHIPPED, QUICK)
    assert sorted(found["answers"]) == ["case_0001", "case_0002"]
    for name, answer in found["answers"].items():
        read = read_answer(answer, name)
        assert sum(probability for _, probability in read.causes) == pytest.approx(1, abs=0.06)
        assert set(read.baselines) == {"largest-marginal-score", "lasso-without-projection"}
        assert len(answer["where"]["map"]) == 4
        assert all(len(ring) == 16 for ring in answer["where"]["map"])
    assert json.loads((tmp_path / "answers.json").read_text()) == found
    revealed = reveal(tmp_path / "answers.json", suite / "labels" / "labels.json", suite / "cases" / "commitment.json")
    assert score(revealed).cases.shape[0] == 2


def test_labels_that_lie_change_nothing(suite: Path, tmp_path: Path, one_thread: None) -> None:
    """Everything about a case that is no silhouette, density or protocol may say what it likes."""
    case = suite / "cases" / "case_0001"
    honest = answer_case(case, SHIPPED, QUICK)
    lying = tmp_path / "case_0001"
    shutil.copytree(case, lying)
    label = {"effect": "creep", "class": "history", "severity": 0.9, "parameters": {"loss": 0.9}}
    for place in (lying, lying / "Fabric 1", tmp_path):
        (place / "labels.json").write_text(json.dumps({"case_0001": label}))
    (lying / "Fabric 1" / "label.txt").write_text("perspective")
    protocol = json.loads((lying / "protocol.json").read_text())
    (lying / "protocol.json").write_text(json.dumps(protocol | {"effect": "perspective", "label": "off-centre"}))
    assert answer_case(lying, SHIPPED, QUICK) == honest


def test_a_suite_that_was_stopped_goes_on(suite: Path, tmp_path: Path, one_thread: None) -> None:
    out = tmp_path / "answers.json"
    told: list[str] = []
    first = answer_suite(suite / "cases", out, SHIPPED, QUICK, step=told.append)
    parts = list(out.with_name("answers.json.parts").rglob("*.json"))
    assert len(parts) == 2
    kept = json.loads(parts[0].read_text()) | {"verdict": "unknown"}
    parts[0].write_text(json.dumps(kept))  # an answer that is there is not made again
    parts[1].unlink()
    again = answer_suite(suite / "cases", out, SHIPPED, QUICK, step=told.append)
    assert again["answers"][parts[0].stem]["verdict"] == "unknown"
    assert again["answers"][parts[1].stem] == first["answers"][parts[1].stem]
    assert len(told) == 4


def test_other_options_are_other_answers(suite: Path, tmp_path: Path, one_thread: None) -> None:
    out = tmp_path / "answers.json"
    answer_suite(suite / "cases", out, SHIPPED, QUICK)
    without = answer_suite(suite / "cases", out, SHIPPED, Options(samples=0, without=tuple(EFFECTS)))
    for answer in without["answers"].values():
        assert set(answer["without"]) == set(EFFECTS)
        assert {cause["effect"] for cause in answer["causes"]} <= {"none", "unknown", "density-bias"}


@pytest.mark.parametrize(
    "damage", ["no image", "one sample", "one face", "rotated", "no density", "other plate", "empty"]
)
def test_bad_cases_get_no_confident_answer(suite: Path, tmp_path: Path, one_thread: None, damage: str) -> None:
    case = tmp_path / "case"
    shutil.copytree(suite / "cases" / "case_0001", case)
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
        from PIL import Image

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
    read_answer(found, damage)
    if damage in ("other plate", "empty"):
        assert found["verdict"] == UNKNOWN
        assert found["refused"]
    elif damage == "one sample":
        assert found["verdict"] != "effect"


def test_oracle_closure_is_judged(suite: Path, tmp_path: Path, one_thread: None) -> None:
    """The true cause with its true parameters; nulls have none, effects that the atlas lacks have no closure."""
    labels = json.loads((suite / "labels" / "labels.json").read_text())
    single = next(name for name, label in labels.items() if label["kind"] == "single")
    null = next(name for name in labels if name != single)
    truth = {"effect": "camera-scale", "class": "imaging", "severity": 0.1, "parameters": {"error": 0.1}}
    changed = {single: labels[single] | truth | {"location": None}, null: labels[null]}
    found = oracle_closures(suite / "cases", changed, tmp_path / "oracle.json", SHIPPED, Draping(2))
    assert list(found) == [single]
    assert oracle_closure(suite / "cases" / single, truth | {"effect": "density-bias"}, SHIPPED, Draping(2)) is None
    again = oracle_closures(suite / "cases", changed, tmp_path / "oracle.json", SHIPPED, Draping(2))
    assert again == found
    answers = tmp_path / "answers.json"
    answer_suite(suite / "cases", answers, SHIPPED, QUICK)
    (tmp_path / "oracle.json").write_text(json.dumps({single: 0.5}))
    arguments = ["withheld", "score", str(answers), str(suite / "labels" / "labels.json")]
    result = CliRunner().invoke(app, [*arguments, "--oracle", str(tmp_path / "oracle.json"), "--json"])
    assert result.exit_code == 0, result.output


def test_folder_without_cases(tmp_path: Path) -> None:
    with pytest.raises(WithheldError, match="no case folders"):
        case_folders(tmp_path / "nothing")


def test_command(suite: Path, tmp_path: Path, one_thread: None) -> None:
    out = tmp_path / "answers.json"
    arguments = [
        "withheld",
        "answer",
        str(suite / "cases"),
        "--out",
        str(out),
        "--samples",
        "0",
        "--workers",
        "1",
        "--json",
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert out.exists()
    result = CliRunner().invoke(app, [*arguments, "--without-effect", "no-such-effect"])
    assert result.exit_code == 2


@pytest.mark.slow
def test_small_suite_keeps_its_figures(tmp_path: Path) -> None:
    """A regression check: strong effects are found and named, fabrics without effect are left in peace."""
    strong = Detectable((0.0,), {name: (4 * draw.typical,) for name, draw in EFFECTS.items()})
    counts = {"null": 6, "single": 8, "pair": 0, "unknown": 0}
    generate(Suite(31, counts, 450, 8, strong), tmp_path / "cases", tmp_path / "labels", workers=2)
    answer_suite(tmp_path / "cases", tmp_path / "answers.json", SHIPPED, QUICK, workers=2)
    revealed = reveal(
        tmp_path / "answers.json", tmp_path / "labels" / "labels.json", tmp_path / "cases" / "commitment.json"
    )
    cases = score(revealed).cases
    nulls, singles = cases[cases["kind"] == "null"], cases[cases["kind"] == "single"]
    assert nulls["detected"].mean() <= 0.34
    assert singles["detected"].mean() >= 0.5
