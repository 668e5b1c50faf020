"""Every bad or odd input of the corpus ends in a clear refusal or the right answer: no traceback, nothing runs away."""

import shutil
from importlib import import_module
from pathlib import Path

import pytest
from bad_input.case import Case, Stock, run_case
from toy_cloths import write_toy
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.store import SHIPPED

KINDS = ("images", "meshes", "tables", "protocols", "numbers", "results", "baselines", "atlases", "withheld_files")
CORPUS = {f"{kind}: {case.name}": case for kind in KINDS for case in import_module(f"bad_input.{kind}").CASES}


@pytest.fixture(scope="session")
def stock(tmp_path_factory) -> Stock:
    folder = tmp_path_factory.mktemp("stock")
    lab = write_toy(folder / "lab", fabrics=(7,), samples=3, captures=1)
    (lab / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n7,0.2,0.0004\n")
    run = folder / "run"
    words = f"run --data {lab} --out {run} --vertices 97 --steps 10 --budget 4 --solver null:disc --solver homo"
    outcome = CliRunner().invoke(app, words.split(), catch_exceptions=False)
    assert outcome.exit_code == 0, outcome.stderr
    (folder / "atlas").mkdir()
    shutil.copy(SHIPPED, folder / "atlas" / "atlas.npz")
    return Stock(lab, run, folder / "atlas")


@pytest.fixture(autouse=True)
def _own_folders(tmp_path_factory, tmp_path, monkeypatch):
    """A cache of measures of their own, and a working folder in which nothing is."""
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(tmp_path_factory.getbasetemp() / "bad-input-cache"))
    monkeypatch.delenv("CUSICK_DATA", raising=False)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path)


def _marked(name: str, case: Case) -> object:
    marks = [pytest.mark.xfail(reason=case.awaits, strict=False)] if case.awaits else []
    return pytest.param(case, id=name, marks=marks)


@pytest.mark.unchecked_arrays
@pytest.mark.parametrize("case", [_marked(name, case) for name, case in CORPUS.items()])
def test_bad_input(case: Case, tmp_path: Path, stock: Stock) -> None:
    run_case(case, tmp_path / "here", stock)
