"""Solvers of another package that end the program or print: the grid goes on, and results stay results."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from other_package import REPLIES, install
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard.verification.verify import verified_keys
from cusick_bench.runner.grid import record_key
from cusick_bench.solvers.base import Solver, SolverError, prediction_at
from cusick_bench.solvers.registry import make_solver, registered, solver_class
from cusick_bench.solvers.variational.predictive import with_draws

pytestmark = pytest.mark.usefixtures("one_thread")

LEAVING = f"""{REPLIES}
import sys


@dataclass(frozen=True)
class Leaver(Solver):
    name: ClassVar[str] = "leaver"

    def _solve(self, problem, generator, progress):
        sys.exit(3)


@dataclass(frozen=True)
class Stopper(Solver):
    name: ClassVar[str] = "stopper"
    kind: ClassVar[str] = "null"

    def _solve(self, problem, generator, progress):
        raise KeyboardInterrupt


@dataclass(frozen=True)
class Unborn(Solver):
    name: ClassVar[str] = "unborn"

    def __post_init__(self):
        sys.exit("not today")

    def _solve(self, problem, generator, progress):
        return answer(problem)
"""
PRINTING = f"""{REPLIES}
print("PRINTED: imported")


@dataclass(frozen=True)
class Talker(Solver):
    name: ClassVar[str] = "talker"

    def __post_init__(self):
        print("PRINTED: made")

    def _solve(self, problem, generator, progress):
        print("PRINTED: solved")
        return answer(problem, tau=np.zeros(problem.dimension), posterior={{"draws": np.arange(1)}})

    def redraw(self, problem, posterior, index):
        print("PRINTED: redrawn")
        return np.zeros(problem.dimension)
"""


REDRAWING = f"""{REPLIES}
from dataclasses import replace

from cusick_bench.solvers.base import prediction_at


@dataclass(frozen=True)
class Redrawer(Solver):
    name: ClassVar[str] = "redrawer"

    def _solve(self, problem, generator, progress):
        fit = prediction_at(problem, np.zeros(problem.dimension), finished=True)
        return replace(fit, posterior={{"draws": np.arange(1)}})

    def redraw(self, problem, posterior, index):
        return np.zeros(problem.dimension)
"""
OPTIONED = f"""{REPLIES}
from enum import Enum
from math import inf


class Method(Enum):
    FAST = 1


@dataclass(frozen=True)
class Optioned(Solver):
    name: ClassVar[str] = "optioned"
    kind: ClassVar[str] = "null"
    limit: float = inf
    method: Method = Method.FAST
    sizes: tuple[int, ...] = (1, 2)
    levels: Any = np.int64(3)

    def _solve(self, problem, generator, progress):
        return answer(problem)
""".replace("import ClassVar", "import Any, ClassVar")


@pytest.fixture
def redrawing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type[Solver]:
    install(monkeypatch, tmp_path / "site", "cusick_redrawing", REDRAWING, {"redrawer": "Redrawer"})
    return solver_class("redrawer")


@pytest.fixture
def leaving(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    solvers = {"leaver": "Leaver", "stopper": "Stopper", "unborn": "Unborn"}
    install(monkeypatch, tmp_path / "site", "cusick_leaving", LEAVING, solvers)


def _words(out: Path, *solvers: str, workers: int = 1) -> list[str]:
    words = ["run", "--cloth", "fabric_1", "--vertices", "97", "--steps", "3", "--budget", "16", "--space", "homo"]
    words += [word for solver in solvers for word in ("--solver", solver)]
    return [*words, "--workers", str(workers), "--out", str(out), "--json"]


@pytest.mark.usefixtures("leaving")
class TestEnd:
    @pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
    def test_a_solver_that_calls_sys_exit_fails_its_own_cell_alone(self, tmp_path: Path, workers: int):
        result = CliRunner().invoke(app, _words(tmp_path / "run", "leaver", "null:disc", workers=workers))
        assert result.exit_code == 1, result.output
        failed, done = json.loads(result.stdout)["cells"]
        assert (failed["status"], done["status"]) == ("failed", "done")
        assert "called sys.exit(3) in" in failed["failure"]
        assert "cusick_leaving.py, line" in failed["failure"]
        record = json.loads((Path(failed["path"]) / "result.json").read_text())
        assert "_solve" in record["traceback"]

    def test_ctrl_c_in_a_solver_stops_the_grid(self, tmp_path: Path):
        result = CliRunner().invoke(app, _words(tmp_path / "run", "stopper", "null:disc"))
        assert result.exit_code == 130, result.output
        assert "0 of 2 cells are finished" in result.stderr
        assert not list(tmp_path.glob("run/cells/*/result.json"))

    def test_a_solver_that_ends_the_program_while_it_is_made_is_told(self):
        with pytest.raises(SolverError, match=r"unborn cannot be made: .* sys.exit\('not today'\)"):
            make_solver("unborn")

    def test_a_command_that_a_solver_ends_says_so(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("cusick_bench.solvers.registry.registered", lambda: sys.exit(0))
        result = CliRunner().invoke(app, ["solvers"])
        assert result.exit_code == 2
        assert "called sys.exit(0)" in result.stderr


def test_a_module_that_ends_the_program_while_it_is_imported_is_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    install(monkeypatch, tmp_path, "cusick_never_imported", "raise SystemExit(0)", {"never": "Never"})
    with pytest.warns(RuntimeWarning, match="'never' .* cannot be imported .SystemExit"):
        assert "homo" in registered()


@pytest.fixture
def printing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    install(monkeypatch, tmp_path / "site", "cusick_printing", PRINTING, {"talker": "Talker"})
    return tmp_path / "site"


def _all_said_elsewhere(output: str, messages: str) -> bool:
    """Whether standard output is the results alone, and all that was printed is among the messages."""
    assert [cell["status"] for cell in json.loads(output)["cells"]] == ["done", "done"], messages
    return all(f"PRINTED: {what}" in messages for what in ("imported", "made", "solved", "redrawn"))


def test_what_a_solver_prints_never_reaches_standard_output(printing: Path, tmp_path: Path):
    result = CliRunner().invoke(app, _words(tmp_path / "run", "talker", "null:disc"))
    assert _all_said_elsewhere(result.stdout, result.stderr)


@pytest.mark.slow
def test_nor_does_what_it_prints_in_a_worker(printing: Path, tmp_path: Path):
    """Of a process of its own, whose workers share its standard output."""
    path = os.pathsep.join([str(printing), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "cusick_bench.cli", *_words(tmp_path / "run", "talker", "null:disc", workers=2)],
        env=os.environ | {"PYTHONPATH": path, "NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert _all_said_elsewhere(done.stdout, done.stderr)


@pytest.mark.parametrize("ending", [RuntimeError("no device here"), SystemExit(3)], ids=["error", "exit"])
def test_a_solver_that_fails_while_its_cell_is_verified_leaves_the_other_cells(
    monkeypatch: pytest.MonkeyPatch, redrawing: type[Solver], tmp_path: Path, ending: BaseException
):
    def redraw(self, problem, posterior, index):
        raise ending

    assert CliRunner().invoke(app, _words(tmp_path / "run", "null:disc", "redrawer")).exit_code == 0
    monkeypatch.setattr(redrawing, "redraw", redraw)
    result = CliRunner().invoke(app, ["verify", str(tmp_path / "run"), "--json"])
    assert result.exit_code == 1, result.output
    cells = {cell["solver"]: cell for cell in json.loads(result.stdout)["cells"]}
    assert {solver: cell["status"] for solver, cell in cells.items()} == {
        "null:disc": "verified",
        "redrawer": "unreadable",
    }
    assert type(ending).__name__ in cells["redrawer"]["notes"][0]
    assert len(verified_keys(tmp_path / "run")) == 1


def test_drapes_of_a_prediction_that_are_no_draws_are_not_missed(
    monkeypatch: pytest.MonkeyPatch, redrawing: type[Solver], tmp_path: Path
):
    """A fit that is draped for the answer is none: further draws were tried, and the cell said to leave them out."""

    def solve(self, problem, generator, progress):
        fit = prediction_at(problem, np.zeros(problem.dimension), finished=True)
        seen = problem.draw_batch(np.stack([self.redraw(problem, {}, index) for index in range(2)]))
        return with_draws(fit, dict(enumerate(seen)), {})

    monkeypatch.setattr(redrawing, "_solve", solve)
    monkeypatch.setattr(redrawing, "redraw", lambda self, problem, _, index: np.full(problem.dimension, index / 9))
    monkeypatch.setattr(redrawing, "drapes_of_prediction", 3)
    run = CliRunner().invoke(app, _words(tmp_path / "run", "redrawer"))
    assert run.exit_code == 0, run.output
    result = CliRunner().invoke(app, ["verify", str(tmp_path / "run"), "--json"])
    assert [cell["status"] for cell in json.loads(result.stdout)["cells"]] == ["verified"], result.stdout


def test_a_solver_that_redraws_too_few_numbers_is_told_how_many(
    monkeypatch: pytest.MonkeyPatch, redrawing: type[Solver], tmp_path: Path
):
    monkeypatch.setattr(redrawing, "redraw", lambda *_: np.zeros(3))
    result = CliRunner().invoke(app, _words(tmp_path / "run", "redrawer"))
    assert result.exit_code == 1, result.output
    (cell,) = json.loads(result.stdout)["cells"]
    assert "`redraw` of redrawer must give 39 numbers, got shape (3,) for draw 0" in cell["failure"]


def test_help_stays_on_standard_output():
    done = CliRunner().invoke(app, ["run", "--help"])
    assert "--solver" in done.stdout


def test_options_that_json_has_not_are_kept_as_text(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """The key of a cell is the hash of its record, as it can be read again."""
    install(monkeypatch, tmp_path / "site", "cusick_optioned", OPTIONED, {"optioned": "Optioned"})
    result = CliRunner().invoke(app, _words(tmp_path / "run", "optioned"))
    assert result.exit_code == 0, result.output
    (cell,) = tmp_path.glob("run/cells/*")
    record = json.loads((cell / "cell.json").read_text())
    assert record["solver_options"] == {"limit": "inf", "method": "Method.FAST", "sizes": [1, 2], "levels": 3}
    assert record_key(record) == cell.name
