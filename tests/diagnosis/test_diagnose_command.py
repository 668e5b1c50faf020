"""`cusick-bench diagnose`: what it makes of the fabrics that are named, and the table of its answers."""

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from made_up_diagnosis import NO_PROFILES, causes, document, parsed
from toy_cloths import draw, toy_profile, write_image
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis import data_set


@pytest.fixture
def diagnosed(monkeypatch) -> list[str]:
    """Fabrics in the order in which they are diagnosed, in no time."""
    done = []

    def made(name: str, **asked):
        done.append(name)
        several = document(NO_PROFILES) | {"verdict": "several", "fabric": name, "effects": ["creep", "off-centre"]}
        several["causes"] = causes(off_centre=0.9, creep=0.05)  # by what accounts for most
        for cause, acting in zip(several["causes"], (0.8, 0.97), strict=True):
            cause |= {"acting": acting, "named": True}
        return parsed(several)

    def fabrics(captures, *asked):
        return SimpleNamespace(shared=None, together=lambda name: list(captures), document=made)

    monkeypatch.setattr(data_set, "data_set_diagnosis", fabrics)
    return done


def run(folder: Path, *fabrics: str, data: str = "synthetic") -> list[dict[str, str]]:
    """Rows of the table."""
    named = [word for fabric in fabrics for word in ("--fabric", fabric)]
    asked = ["diagnose", data, *named, "--out", str(folder), "--table", str(folder / "table.csv")]
    finished = CliRunner().invoke(app, asked)
    assert finished.exit_code == 0, finished.output
    with (folder / "table.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_fabric_that_is_named_twice_is_diagnosed_once(diagnosed, tmp_path):
    rows = run(tmp_path, "fabric_2", "fabric_1", "fabric_2")
    assert diagnosed == ["fabric_2", "fabric_1"]
    assert [row["fabric"] for row in rows] == diagnosed


def test_probabilities_of_the_table_stand_in_the_order_of_the_effects(diagnosed, tmp_path):
    (row,) = run(tmp_path, "fabric_1")
    assert dict(zip(row["effects"].split(" + "), row["probability"].split(), strict=True)) == {
        "creep": "0.97",
        "off-centre": "0.80",
    }
    assert [part.split(":")[0] for part in row["parameters"].split("; ")] == ["creep", "off-centre"]


@pytest.mark.parametrize("budget", [[], [{"effect": "creep", "share": 0.7, "ci90": [0.6, 0.8]}]])
def test_nothing_is_said_to_be_unexplained_where_no_effect_explains_a_share(monkeypatch, tmp_path, budget):
    """Where no effect is found there may still be a gap in units of noise, which the base model's misfit takes."""
    left = 1.0 - sum(one["share"] for one in budget)
    made = document(NO_PROFILES, "none") | {"budget": budget, "unexplained": {"share": left, "ci90": [left, left]}}
    diagnosis = SimpleNamespace(shared=None, together=list, document=lambda name, **asked: parsed(made))
    monkeypatch.setattr(data_set, "data_set_diagnosis", lambda captures, *asked: diagnosis)
    table = tmp_path / "table.csv"
    asked = ["diagnose", "synthetic", "--fabric", "fabric_1", "--out", str(tmp_path), "--table", str(table)]
    finished = CliRunner().invoke(app, asked)
    assert finished.exit_code == 0, finished.output
    (row,) = csv.DictReader(table.read_text().splitlines())
    assert {bool(row[name]) for name in ("unexplained", "unexplained_low", "unexplained_high")} == {bool(budget)}
    (written,) = tmp_path.rglob("diagnosis.html")
    assert ("unexplained of the gap" in finished.output) == bool(budget)
    assert ("<dt>unexplained</dt>" in written.read_text()) == bool(budget)


def test_cloths_whose_names_differ_in_punctuation_have_folders_of_their_own(diagnosed, tmp_path):
    names = ["silk (a)", "silk [a]", "silk_a_"]
    for number, name in enumerate(names):
        for sample in (1, 2, 3):
            picture = tmp_path / "lab" / "bnn_image_gt" / name / f"sample_{sample}_Upward_Drape_1.png"
            write_image(picture, draw(toy_profile(number, sample, 1)))
    lab, out = str(tmp_path / "lab"), tmp_path / "out"
    run(out, data=lab)
    written = {path.parent.name: json.loads(path.read_text())["fabric"] for path in out.glob("*/diagnosis.json")}
    assert written == {"silk_a_": "silk_a_", "silk_a__2": "silk (a)", "silk_a__3": "silk [a]"}
    run(out, "silk [a]", data=lab)  # where it is does not hang on what it is asked for with
    again = {path.parent.name: json.loads(path.read_text())["fabric"] for path in out.glob("*/diagnosis.json")}
    assert again == written


@pytest.mark.parametrize("spoiled", [(3,), (1, 2, 3)])
def test_a_fabric_of_too_few_usable_samples_is_diagnosed_only_if_it_is_named(diagnosed, tmp_path, spoiled):
    for number, name in enumerate(("linen", "silk")):
        for sample in (1, 2, 3):
            picture = tmp_path / "lab" / "bnn_image_gt" / name / f"sample_{sample}_Upward_Drape_1.png"
            write_image(picture, draw(toy_profile(number, sample, 1)))
            if name == "silk" and sample in spoiled:
                picture.write_bytes(b"no image")
    asked = ["diagnose", str(tmp_path / "lab"), "--out", str(tmp_path / "out")]
    finished = CliRunner().invoke(app, asked)
    assert finished.exit_code == 0, finished.output
    assert diagnosed == ["linen"]
    assert f"silk is left out: pictures of {3 - len(spoiled)} of its samples" in " ".join(finished.stderr.split())
    named = CliRunner().invoke(app, [*asked, "--fabric", "silk"])
    assert named.exit_code == (0 if len(spoiled) == 1 else 2)


def test_table_and_terminal_say_what_the_document_says(monkeypatch, tmp_path):
    made = document(NO_PROFILES, "effect") | {
        "effects": ["off-centre"],
        "groups": [["cut-size", "threshold"], ["creep", "bending-friction"]],
        "budget": [{"effect": "off-centre", "share": 0.61, "ci90": [0.52, 0.73]}],
        "unexplained": {"share": 0.39, "ci90": [0.27, 0.48]},
        "fit": {"base": 1.5, "novelty_p": 0.21, "misfit": 0.4},
        "with_effect": ["off-centre:shift=0.008,direction=40"],
        "made": {"version": "diagnosis 99", "command": "cusick-bench diagnose lab"},
        "notes": ["answered in part"],
    }
    diagnosis = SimpleNamespace(shared=None, together=list, document=lambda name, **asked: parsed(made))
    monkeypatch.setattr(data_set, "data_set_diagnosis", lambda captures, *asked: diagnosis)
    table = tmp_path / "table.csv"
    asked = ["diagnose", "synthetic", "--fabric", "fabric_1", "--out", str(tmp_path), "--table", str(table)]
    finished = CliRunner().invoke(app, asked, env={"COLUMNS": "300"})
    assert finished.exit_code == 0, finished.output
    (row,) = csv.DictReader(table.read_text().splitlines())
    assert {name: row[name] for name in row if name not in ("parameters", "probability")} == {
        "fabric": made["fabric"],
        **{"samples": "12", "captures": "48", "verdict": "effect", "p": "0.0004", "effects": "off-centre"},
        **{"one_of": "cut-size|threshold + creep|bending-friction", "budget": "off-centre=0.61"},
        **{"unexplained": "0.39", "unexplained_low": "0.27", "unexplained_high": "0.48", "novelty_p": "0.21"},
        **{"set90": "off-centre camera-offset", "gap_base": "0.0874", "gap_floor": "0.0126"},
        **{"gap_with_effects": "0.021", "closure": "0.78", "closure_low": "0.55", "closure_high": "0.93"},
        **{"refused": "", "command": "cusick-bench diagnose lab", "code": "diagnosis 99"},
    }
    for said in (
        "gap 0.087 (floor 0.013), p = 0.0004",
        "61% (52% to 73%)",
        "unexplained of the gap on unseen samples: 39% (27% to 48%)",
        "with off-centre the gap on unseen samples shrinks by 78% (90 %: 55% to 93%)",
        "simulate with: --with-effect off-centre:shift=0.008,direction=40",
        "next: rotate by 90 degrees (0.62 bits). Drape samples turned by 90 degrees",
        "note: answered in part",
    ):
        assert said in finished.output


def test_the_table_of_a_run_that_is_stopped_has_the_fabrics_that_were_ready(diagnosed, monkeypatch, tmp_path):
    made = data_set.data_set_diagnosis({}, None, None, None)

    def stopped(name: str, **asked):
        if diagnosed:
            raise KeyboardInterrupt
        return made.document(name, **asked)

    diagnosis = SimpleNamespace(shared=None, together=list, document=stopped)
    monkeypatch.setattr(data_set, "data_set_diagnosis", lambda captures, *asked: diagnosis)
    named = ["--fabric", "fabric_2", "--fabric", "fabric_1"]
    asked = ["diagnose", "synthetic", *named, "--out", str(tmp_path), "--table", str(tmp_path / "table.csv")]
    finished = CliRunner().invoke(app, asked)
    assert finished.exit_code == 130
    assert "1 of 2 fabrics are written" in finished.stderr
    rows = csv.DictReader((tmp_path / "table.csv").read_text().splitlines())
    assert [row["fabric"] for row in rows] == ["fabric_2"]


@pytest.mark.parametrize("earlier", [True, False])
def test_of_a_refused_fabric_an_earlier_diagnosis_is_told_to_be_one(diagnosed, monkeypatch, tmp_path, earlier):
    """It stayed in its place, as if it were of the data that were refused."""
    made = document(NO_PROFILES, "none")
    if earlier:
        run(tmp_path, "fabric_1")
    refused = SimpleNamespace(refused="not today", document=parsed(made))
    diagnosis = SimpleNamespace(shared=None, together=list, document=lambda name, **asked: refused)
    monkeypatch.setattr(data_set, "data_set_diagnosis", lambda captures, *asked: diagnosis)
    asked = ["diagnose", "synthetic", "--fabric", "fabric_1", "--out", str(tmp_path)]
    finished = CliRunner().invoke(app, asked, env={"COLUMNS": "400"})
    assert finished.exit_code == 2
    assert "not today" in finished.stderr
    assert ("diagnosis.json is an earlier command's" in finished.stderr) == earlier


def test_a_table_that_cannot_be_written_is_refused_before_the_work(diagnosed, tmp_path):
    asked = ["diagnose", "synthetic", "--fabric", "fabric_1", "--out", str(tmp_path), "--table", str(tmp_path)]
    finished = CliRunner().invoke(app, asked)
    assert finished.exit_code == 2
    assert "--table must name a file" in finished.stderr
    assert diagnosed == []
