"""Results folders mend themselves: whatever is torn, lost or changed is run again, to the undisturbed numbers."""

import json
import logging
import multiprocessing
import shutil
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from killed_run import ended_at, run_until_killed

from cusick_bench.datasets import load
from cusick_bench.problem import Budget, HomogeneousSpace
from cusick_bench.runner import Cell, ProblemSettings, Source, Store, load_once, plan, run, run_cell
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.setup import Simulators

SOLVERS = ("homo,search=2", "heter,search=2,steps=9", "bdp,steps=4,samples=2,draws=3", "nlopt:LN_BOBYQA")
CLOTHS = ("fabric_1", "fabric_2")
SMALL = ProblemSettings(vertices=97, drape=DrapeSettings(steps=12), budget=Budget(19))
STOPPED_AT = 11  # evaluations: after the first checkpoint of every solver that has one
FINISHED = ("cell.json", "trace.jsonl", "prediction.npz", "result.json", "done")
JOURNALS = [
    (solver, name)
    for solver, names in zip(
        SOLVERS,
        (("trace.jsonl", "state.bin"), *2 * [("trace.jsonl", "state.bin", "state.npz")], ("trace.jsonl",)),
        strict=True,
    )
    for name in names
]  # of each solver, what it keeps for resumption

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


def _truncated(share: float) -> Callable[[Path, Path], None]:
    def damage(file: Path, _: Path) -> None:
        content = file.read_bytes()
        file.write_bytes(content[: int(share * len(content))])

    return damage


def _flipped(share: float) -> Callable[[Path, Path], None]:
    def damage(file: Path, _: Path) -> None:
        content = bytearray(file.read_bytes())
        content[int(share * (len(content) - 1))] ^= 4
        file.write_bytes(content)

    return damage


DAMAGES: dict[str, Callable[[Path, Path], object]] = {
    "cut at 1 %": _truncated(0.01),
    "cut in the middle": _truncated(0.53),
    "cut near the end": _truncated(0.97),
    "emptied": lambda file, _: file.write_bytes(b""),
    "deleted": lambda file, _: file.unlink(),
    "another cell's": lambda file, other: shutil.copyfile(other, file),
    "flipped early": _flipped(0.1),
    "flipped late": _flipped(0.8),
}


class _Lab:
    """A data set, and what every cell on it comes to when nothing disturbs it."""

    def __init__(self, data: Path, root: Path) -> None:
        self.root, self.dataset, self.simulators = root, load(data), Simulators()
        self.source = Source(str(data))

    def cell(self, solver: str, cloth: str = CLOTHS[0]) -> Cell:
        (cell,) = plan(self.dataset, solvers=[solver], cloths=[cloth], settings=SMALL)
        return cell

    def finished(self, solver: str, cloth: str = CLOTHS[0]) -> Path:
        """The folder of results of an undisturbed run."""
        return self._made("finished", solver, cloth, run_on)

    def killed(self, solver: str, cloth: str = CLOTHS[0]) -> Path:
        """The folder of results of a run that ended in the middle of a cell."""
        return self._made("killed", solver, cloth, run_and_stop)

    def _made(self, name: str, solver: str, cloth: str, make: Callable[["_Lab", Cell, Path], None]) -> Path:
        out = self.root / f"{name}-{SOLVERS.index(solver)}-{cloth}"
        if not out.exists():
            make(self, self.cell(solver, cloth), out)
        return out


def run_on(lab: _Lab, cell: Cell, out: Path) -> None:
    Store(out).prepare()
    result = run_cell(lab.dataset, cell, Store(out), lambda *_: None, lab.simulators)
    assert result["status"] == "done", result["failure"]


def run_and_stop(lab: _Lab, cell: Cell, out: Path, at: int = STOPPED_AT) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    Store(out).prepare()
    with pytest.raises(KeyboardInterrupt), ended_at(at, stop):
        run_cell(lab.dataset, cell, Store(out), lambda *_: None, lab.simulators)


def numbers(folder: Path) -> dict:
    """Whatever must come out alike: all but times and the machine's state."""
    result = json.loads((folder / "result.json").read_text())
    spent = {name: value for name, value in result["spent"].items() if name != "wall_seconds"}
    trace = [json.loads(line) for line in (folder / "trace.jsonl").read_text().splitlines()]
    evaluations = [[line[name] for name in ("kind", "digest", "loss", "forward_equivalents")] for line in trace]
    record = json.loads((folder / "cell.json").read_text())
    prediction = (folder / "prediction.npz").read_bytes()
    return {"metrics": result["metrics"], "spent": spent, "trace": evaluations, "cell": record, "answer": prediction}


def _blamed(folder: Path, name: str) -> Path:
    """A marker that is wrong may put the blame on any file."""
    return folder if name == "done" else folder / name


def _folder(lab: _Lab, out: Path, solver: str, cloth: str = CLOTHS[0]) -> Path:
    return Store(out).folder(lab.cell(solver, cloth).key)


@pytest.fixture(scope="module")
def lab(make_lab, tmp_path_factory) -> _Lab:
    return _Lab(make_lab((2.0, 4.0), samples=2), tmp_path_factory.mktemp("runs"))


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", FINISHED)
def test_a_finished_cell_that_is_damaged_is_run_again(lab, tmp_path, caplog, name, damage):
    solver = SOLVERS[0]
    out = Path(shutil.copytree(lab.finished(solver), tmp_path / "out"))
    folder, other = _folder(lab, out, solver), _folder(lab, lab.finished(solver, CLOTHS[1]), solver, CLOTHS[1])
    DAMAGES[damage](folder / name, other / name)
    assert not Store(out).is_done(folder.name)
    with caplog.at_level(logging.WARNING):
        run_on(lab, lab.cell(solver), out)
    assert numbers(folder) == numbers(Store(lab.finished(solver)).folder(folder.name))
    assert Store(out).is_done(folder.name)
    said = [record.getMessage() for record in caplog.records]
    assert (name, damage) == ("done", "deleted") or any(str(_blamed(folder, name)) in line for line in said), said


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(("solver", "name"), JOURNALS)
def test_a_cell_that_was_killed_and_damaged_ends_as_undisturbed(lab, tmp_path, caplog, solver, name, damage):
    out = Path(shutil.copytree(lab.killed(solver), tmp_path / "out"))
    folder, other = _folder(lab, out, solver), _folder(lab, lab.killed(solver, CLOTHS[1]), solver, CLOTHS[1])
    DAMAGES[damage](folder / name, other / name)
    with caplog.at_level(logging.WARNING):
        run_on(lab, lab.cell(solver), out)
    assert numbers(folder) == numbers(Store(lab.finished(solver)).folder(folder.name))
    arrays = (Store(lab.killed(solver)).folder(folder.name) / "state.bin").stat().st_size
    silent = {("state.npz", "deleted"), ("trace.jsonl", "" if arrays else "emptied")}
    said = [record.getMessage() for record in caplog.records]
    assert (name, damage) in silent or any(str(folder) in line for line in said), said


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("keep", [1, 4, 9])
def test_a_shorter_trace_is_gone_on_from(lab, tmp_path, solver, keep):
    """Whole lines are missing at the end, so that nothing can be found wrong: also in the middle of a batch."""
    out = Path(shutil.copytree(lab.killed(solver), tmp_path / "out"))
    folder = Store(out).folder(lab.cell(solver).key)
    trace = folder / "trace.jsonl"
    trace.write_bytes(b"".join(trace.read_bytes().splitlines(keepends=True)[:keep]))
    run_on(lab, lab.cell(solver), out)
    assert numbers(folder) == numbers(Store(lab.finished(solver)).folder(folder.name))


def test_a_state_without_its_evaluations_has_no_fresh_budget(lab, tmp_path, caplog):
    """What `heter` once made a better fit of than its budget allows."""
    solver = SOLVERS[1]
    out = Path(shutil.copytree(lab.killed(solver), tmp_path / "out"))
    folder = Store(out).folder(lab.cell(solver).key)
    (folder / "trace.jsonl").unlink()
    (folder / "state.bin").unlink()
    with caplog.at_level(logging.WARNING):
        run_on(lab, lab.cell(solver), out)
    assert numbers(folder) == numbers(Store(lab.finished(solver)).folder(folder.name))
    (said,) = [record.getMessage() for record in caplog.records]
    assert str(folder / "state.npz") in said
    assert "trace.jsonl does not hold" in said


def test_a_journal_of_another_machine_is_begun_anew(lab, tmp_path, caplog, monkeypatch):
    """Its evaluations are sound, but the solver now asks for others."""
    solver = SOLVERS[0]
    out = tmp_path / "out"
    cell, level = lab.cell(solver), HomogeneousSpace.bending_level
    with monkeypatch.context() as patch:
        patch.setattr(HomogeneousSpace, "bending_level", lambda self, factor: level(self, factor) + 1e-15)
        run_and_stop(lab, cell, out)
    with caplog.at_level(logging.WARNING):
        run_on(lab, cell, out)
    assert numbers(Store(out).folder(cell.key)) == numbers(Store(lab.finished(solver)).folder(cell.key))
    assert "the cell is run again from its start" in caplog.text


EVALUATIONS = (1, 2, 3, 4, 5, 6, 8, 9, 10, 11)


@pytest.mark.parametrize("solver", SOLVERS)
def test_ten_stops_and_a_resume_are_bit_identical(lab, tmp_path, solver):
    out, cell = tmp_path / "out", lab.cell(solver)
    for evaluation in EVALUATIONS:
        run_and_stop(lab, cell, out, evaluation)
    run_on(lab, cell, out)
    assert numbers(Store(out).folder(cell.key)) == numbers(Store(lab.finished(solver)).folder(cell.key))


@pytest.mark.slow
def test_ten_kills_and_a_resume_are_bit_identical(lab, tmp_path):
    """SIGKILL at one evaluation after the other, each in a process of its own, of a solver that saves its state."""
    solver = SOLVERS[1]
    out, cell = tmp_path / "out", lab.cell(solver)
    Store(out).prepare()
    for evaluation in EVALUATIONS:
        process = multiprocessing.get_context("spawn").Process(
            target=run_until_killed, args=(lab.source, cell, out, evaluation)
        )
        process.start()
        process.join(120)
        assert process.exitcode == -signal.SIGKILL, f"it ended by itself before evaluation {evaluation}"
    run_on(lab, cell, out)
    assert numbers(Store(out).folder(cell.key)) == numbers(Store(lab.finished(solver)).folder(cell.key))


@pytest.mark.parametrize("content", ["", "{", "[]", '{"history": 3}', '{"history": null}'])
def test_a_damaged_record_of_commands_stops_nobody(lab, tmp_path, caplog, content):
    out = Path(shutil.copytree(lab.finished(SOLVERS[0]), tmp_path / "out"))
    (out / "run.json").write_text(content)
    with caplog.at_level(logging.WARNING):
        (result,) = run(lab.source, [lab.cell(SOLVERS[0])], out, command=["again"])
    assert result["status"] == "done"
    assert json.loads((out / "run.json").read_text())["command"] == ["again"]
    assert str(out / "run.json") in caplog.text


def test_runners_on_one_folder_lose_no_command(lab, tmp_path):
    load_once(lab.source)
    with ThreadPoolExecutor(8) as runners:
        list(runners.map(lambda number: run(lab.source, [], tmp_path, command=[str(number)]), range(24)))
    last = json.loads((tmp_path / "run.json").read_text())
    assert sorted(int(made["command"][0]) for made in [*last["history"], last]) == list(range(24))


def test_what_a_kill_left_half_written_is_removed(lab, tmp_path):
    out = Path(shutil.copytree(lab.killed(SOLVERS[0]), tmp_path / "out"))
    folder = Store(out).folder(lab.cell(SOLVERS[0]).key)
    for name in ("prediction.npz.part", "state.npz.part", "result.json.4711.part"):
        (folder / name).write_bytes(b"half")
    run_on(lab, lab.cell(SOLVERS[0]), out)
    assert not list(folder.glob("*.part"))
