"""A command line that is wrong, or that names what is not there, leaves no folder behind."""

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.cli.written_paths import folder_made

CLOTH = "--density 0.2 --bending 1e-5"
WRONG = {
    "unknown solver": "run --solver no-such-solver",
    "solver's unknown option": "run --solver homo,steps=3",
    "unknown cloth": "run --solver homo --cloth none",
    "no such shard": "run --solver null:disc --shard 3/2",
    "no such data": "run --solver null:disc --data nowhere",
    "clamp of another law": f"simulate {CLOTH} --law plate --clamp half",
    "no such mesh": f"simulate {CLOTH} --mesh missing.obj",
    "unknown device": f"simulate {CLOTH} --device nonsense",
    "mesh too coarse": f"simulate {CLOTH} --vertices 10",
    "unknown cloth to identify": "identify synthetic --cloth none",
    "unknown solver to identify": "identify synthetic --solver no-such-solver",
    "nothing to identify": "identify nowhere",
    "unknown fabric": "diagnose synthetic --cloth none",
    "folder for a table": "diagnose synthetic --table .",
    "skirt of a few vertices": f"garment skirt {CLOTH} --vertices 10",
    "unknown solver of a benchmark": "export benchopt OUT --solver no-such-solver",
    "unknown method": "optimisers --solver none",
    "unknown cloth of a curve": "learning-curve --data synthetic --cloth none",
    "unknown cloth of a table": "paper table-1 --data synthetic --cloth none",
    "world that is none": "withheld generate --world none --labels LABELS",
}
FILES = {
    "unknown fabric to control": "diagnose-controls synthetic --cloth none",
    "few vertices": "benchmark --vertices 5",
    "no such reference": "convergence --reference nowhere",
    "real drapes that are nowhere": "fold-selection --data nowhere",
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _refused(command: str, here: Path) -> None:
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 2, result.output
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_command_line_makes_no_folder(name: str, here: Path):
    command = WRONG[name]
    _refused(command if "OUT" in command else f"{command} --out new/out", here)


@pytest.mark.parametrize("name", FILES)
def test_a_wrong_command_line_makes_no_folder_of_a_file(name: str, here: Path):
    option = "--picture" if FILES[name].startswith(("convergence", "fold-selection")) else "--out"
    _refused(f"{FILES[name]} {option} new/out.csv", here)


def test_data_that_are_refused_make_no_folder(here: Path, make_lab, tmp_path_factory: pytest.TempPathFactory):
    lab = make_lab((2.0,), samples=2)
    (lab / "protocol.json").write_text(json.dumps({"px_per_m": 1200.0}))  # cloth smaller than its plate
    _refused(f"run --data {lab} --solver null:disc --out out", here)


def _fails(folder: Path, *written: Path) -> None:
    with folder_made(folder):
        for path in written:
            path.touch()
        raise KeyError


def test_a_folder_that_holds_something_stays(tmp_path: Path):
    outer, kept = tmp_path / "a", tmp_path / "a" / "kept"
    with pytest.raises(KeyError):
        _fails(outer / "b", kept)
    assert list(outer.iterdir()) == [kept]
    with pytest.raises(KeyError):
        _fails(outer)
    assert kept.exists()


def test_drapes_of_an_earlier_run_stay_where_no_others_are_made(tmp_path: Path):
    pytest.importorskip("ipctk")
    earlier = tmp_path / "drape_0000.obj"
    earlier.touch()
    for out in (tmp_path, tmp_path / "new"):
        words = [*CLOTH.split(), "--vertices", "60", "--self-contact", "0.05", "--out", str(out)]
        found = CliRunner().invoke(app, ["simulate", *words], env={"COLUMNS": "400"})
        assert found.exit_code == 2
        assert "contact thickness must be less than" in found.stderr
    assert list(tmp_path.iterdir()) == [earlier]


@pytest.mark.skipif(sys.platform != "linux", reason="a folder that not even root may write to")
def test_a_folder_that_is_there_and_cannot_be_written_to_is_told_before_any_work():
    begun = []
    with pytest.raises(OSError), folder_made(Path("/proc")):  # noqa: PT011
        begun.append("work")
    assert not begun
