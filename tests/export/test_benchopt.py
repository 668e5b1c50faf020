"""The benchmark that is written for benchopt: passes its own tests where benchopt is installed, and runs anywhere."""

import importlib.util
import json
import math
import os
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import pytest
from other_package import REPLIES, install
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.export.benchopt import write_benchmark
from cusick_bench.export.drape_task import FEWEST_DRAPES
from cusick_bench.export.errors import ExportError
from cusick_bench.runner import ProblemSettings, Source, load_once, plan, run
from cusick_bench.sim.engine.settings import DrapeSettings

TOY = ProblemSettings(vertices=97, drape=DrapeSettings(law="plate", steps=3))


class _Base:
    """What the classes of a benchmark inherit from benchopt, as far as these files use it."""

    parameters: ClassVar[dict[str, list[Any]]] = {}

    def __init__(self) -> None:
        for name, values in self.parameters.items():
            setattr(self, name, values[0])

    def get_seed(self, *, use_repetition: bool) -> int:
        assert use_repetition
        return 7


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module `benchopt`, so that the files run where the real one is not installed."""
    module: Any = ModuleType("benchopt")
    module.BaseObjective = module.BaseSolver = module.BaseDataset = _Base
    monkeypatch.setitem(sys.modules, "benchopt", module)


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("benchopt") / "benchmark"
    write_benchmark(folder, solvers=["sobol", "null:random-phase,draws=3"], settings=TOY)
    return folder


def _class(path: Path, name: str) -> Any:
    spec = importlib.util.spec_from_file_location(f"written_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name)


def _solved(benchmark: Path, solver_file: str, drapes: int) -> tuple[Any, dict[str, float]]:
    """A solver's way through benchopt's calls, and its scores."""
    data = _class(benchmark / "datasets/simulated.py", "Dataset")().get_data()
    objective = _class(benchmark / "objective.py", "Objective")()
    objective.set_data(**data)
    solver = _class(benchmark / "solvers" / solver_file, "Solver")()
    task = objective.get_objective()
    assert solver.skip(**task) == (False, None)
    solver.set_objective(**task)
    solver.warm_up()
    solver.pre_run_hook(drapes)
    solver.run(drapes)
    return solver, objective.evaluate_result(**solver.get_result())


@pytest.mark.usefixtures("stand_in")
def test_a_solver_gets_the_scores_of_a_run_with_the_same_seed_and_budget(benchmark: Path, tmp_path: Path):
    solver, scores = _solved(benchmark, "sobol.py", 0)
    assert solver.attempt.problem.meter.forward_equivalents == FEWEST_DRAPES
    asked = solver.attempt.cell.settings
    assert (asked.space, asked.vertices, asked.drape) == (TOY.space, TOY.vertices, TOY.drape)
    source = Source("synthetic")
    (cell,) = plan(
        load_once(source), solvers=["sobol"], cloths=["fabric_1"], seeds=[7], settings=solver.attempt.cell.settings
    )
    (result,) = run(source, [cell], tmp_path / "run")
    for name, value in result["metrics"].items():
        assert scores[name] == value or math.isnan(value)
    assert scores["value"] == scores["train_mse"]
    drapes = solver.get_next(0)
    assert drapes > FEWEST_DRAPES
    assert solver.get_next(drapes) == 2 * drapes
    solver.pre_run_hook(drapes)
    assert solver.attempt.problem.meter.budget.forward_equivalents == drapes


@pytest.mark.usefixtures("stand_in")
def test_options_of_a_solver_are_parameters(benchmark: Path):
    solver, scores = _solved(benchmark, "null_random_phase.py", 1)
    assert solver.parameters == {"draws": [3]}
    assert solver.sampling_strategy == "run_once"
    assert solver.text == "null:random-phase,draws=3"
    assert scores["draws"] == 3


@pytest.mark.usefixtures("stand_in")
def test_a_solver_that_does_not_fit_says_why(tmp_path: Path):
    write_benchmark(tmp_path / "b", solvers=["equilibrium-gap"], settings=TOY)
    objective = _class(tmp_path / "b/objective.py", "Objective")()
    objective.set_data(data="synthetic", cloth="fabric_1")
    skipped, reason = _class(tmp_path / "b/solvers/equilibrium_gap.py", "Solver")().skip(**objective.get_objective())
    assert skipped
    assert "--law paper" in reason


@pytest.mark.skipif(importlib.util.find_spec("benchopt") is None, reason="benchopt is not installed")
def test_benchopt_accepts_it(benchmark: Path, tmp_path: Path):
    # In the environment of these tests: benchopt calls the `python` of the PATH.
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        [sys.executable, "-m", "benchopt", "test", str(benchmark), "--skip-install"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert " passed" in done.stdout


def test_the_command_writes_it_and_says_how_to_go_on(tmp_path: Path):
    folder = tmp_path / "new"
    result = CliRunner().invoke(
        app, ["export", "benchopt", str(folder), "--vertices", "297", "--law", "paper", "--json"]
    )
    assert result.exit_code == 0, result.output
    assert "benchopt test" in result.stderr
    written = {Path(path).relative_to(folder).as_posix() for path in json.loads(result.stdout)["files"]}
    assert {"objective.py", "datasets/simulated.py", "solvers/homo.py", "README.md"} <= written
    assert written == {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    text = (folder / "objective.py").read_text(encoding="utf-8")
    assert '"vertices": [297]' in text
    assert '"law": ["paper"]' in text


def test_own_data_are_a_data_set_beside_the_shipped_one(tmp_path: Path, stand_in: None):
    shipped = Path(str(importlib.util.find_spec("cusick_bench.datasets").submodule_search_locations[0]))  # pyright: ignore
    write_benchmark(tmp_path / "b", solvers=["null:disc"], data=str(shipped / "synthetic/data"))
    data = _class(tmp_path / "b/datasets/drapes.py", "Dataset")
    assert data.name == "drapes"
    assert load_once(Source(data().get_data()["data"])).cloths == data.parameters["cloth"]


ANOTHER = f"""{REPLIES}
@dataclass(frozen=True)
class Mirror(Solver):
    name: ClassVar[str] = "mirror"

    def _solve(self, problem, generator, progress):
        return answer(problem)
"""


SUMMARY = r'descent along \xi, "exact"'  # \x would be an escape without its digits


@pytest.fixture
def another_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A solver of a package whose name is unlike its module's."""
    site = tmp_path / "site"
    install(monkeypatch, site, "cusick_mirror", ANOTHER, {"mirror": "Mirror"}, distribution="silk-mirrors")
    return site


@pytest.mark.usefixtures("stand_in", "another_package")
def test_a_solver_of_another_package_asks_for_that_package(tmp_path: Path):
    write_benchmark(tmp_path / "b", solvers=["mirror", "null:disc"], settings=TOY)
    asked = {name: _class(tmp_path / f"b/solvers/{name}.py", "Solver").requirements for name in ("mirror", "null_disc")}
    assert asked == {"mirror": ["pip::cusick-bench", "pip::silk-mirrors"], "null_disc": ["pip::cusick-bench"]}
    assert 'pip install "benchopt[test]" cusick-bench silk-mirrors\n' in (tmp_path / "b/README.md").read_text()


@pytest.mark.usefixtures("another_package")
def test_a_package_without_a_name_is_told_by_its_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    nameless = EntryPoint("mirror", "cusick_mirror:Mirror", "cusick_bench.solvers")
    monkeypatch.setattr("cusick_bench.export.benchopt.entry_point_of", lambda name: nameless)
    write_benchmark(tmp_path / "b", solvers=["mirror"], settings=TOY)
    assert (
        "the package with the module `cusick_mirror`, which has the solver `mirror`"
        in (tmp_path / "b/README.md").read_text()
    )


def test_the_readme_of_solvers_that_are_built_in_asks_for_nothing_else(benchmark: Path):
    text = (benchmark / "README.md").read_text()
    assert 'pip install "benchopt[test]" cusick-bench\nbenchopt test .' in text
    assert "Install besides" not in text


def test_a_folder_with_files_is_left_alone(tmp_path: Path):
    kept = tmp_path / "objective.py"
    kept.write_text("mine", encoding="utf-8")
    with pytest.raises(ExportError, match="give another one"):
        write_benchmark(tmp_path)
    assert kept.read_text(encoding="utf-8") == "mine"


def test_one_solver_twice_is_refused_before_anything_is_written(tmp_path: Path):
    with pytest.raises(ExportError, match="each solver once"):
        write_benchmark(tmp_path / "b", solvers=["null:random-phase", "null:random-phase,draws=9"])
    assert not (tmp_path / "b").exists()


def test_a_folder_whose_name_ends_a_docstring_is_no_code(make_lab, tmp_path: Path):
    lab = make_lab([1e-5], samples=2)
    odd = lab.rename(lab.with_name('lab"""\\'))
    try:
        write_benchmark(tmp_path, solvers=["null:disc"], data=str(odd))
        compile((tmp_path / "datasets" / "drapes.py").read_text(), "drapes.py", "exec")
    finally:
        odd.rename(lab)


def test_a_summary_of_another_package_is_no_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    name = 'name: ClassVar[str] = "mirror"'
    odd = ANOTHER.replace(name, f"{name}\n    summary: ClassVar[str] = {SUMMARY!r}")
    install(monkeypatch, tmp_path / "site", "cusick_described", odd, {"mirror": "Mirror"}, distribution="silk-mirrors")
    write_benchmark(tmp_path / "b", solvers=["mirror"], settings=TOY)
    text = (tmp_path / "b/solvers/mirror.py").read_text()
    compile(text, "mirror.py", "exec")
    assert text.splitlines()[0] == '"""Descent along \'xi, \'exact\'."""'


@pytest.mark.skipif(sys.platform != "linux", reason="other file systems have names in Unicode only")
@pytest.mark.parametrize("place", ["\U0001f9f5", os.fsdecode(b"caf\xe9")], ids=["emoji", "no UTF-8"])
def test_a_folder_of_any_name_is_found_again(make_lab, tmp_path: Path, stand_in: None, place: str):
    """A literal of JSON has an emoji as two characters, which Python does not join."""
    data = tmp_path / place / "lab"
    shutil.copytree(make_lab([1e-5], samples=2), data)
    write_benchmark(tmp_path / "b", solvers=["null:disc"], data=str(data))
    written = _class(tmp_path / "b/datasets/drapes.py", "Dataset")
    assert Path(written().get_data()["data"]) == data
