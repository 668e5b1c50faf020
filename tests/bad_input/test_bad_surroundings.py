"""What surrounds a command: environment variables, terminals without Unicode, full disks, packages that register."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cusick_bench.sim.effects.registry import effect, registered
from cusick_bench.sim.errors import SimulationError
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.registry import registered as registered_solvers
from cusick_bench.solvers.registry import solver_class

SIMULATE = "simulate --density 0.2 --bending 1e-6 --vertices 97 --steps 2"
LIMIT = 6 << 30  # [bytes] of address space of a command
PLUGIN = """
class Nothing:
    pass
def broken():
    raise RuntimeError("no licence found")
number = 5
"""
UNMADE = """
from cusick_bench.sim.effects.base import Effect, Parameter
class Unmade(Effect):
    name = "odd"
    def __init__(self):
        raise RuntimeError("no licence found")
    def _apply(self, setup, value):
        return setup
class Silent(Effect):
    name = "odd"
    def _apply(self, setup, value):
        return setup
class Idle(Silent):
    kind, summary, physics, reference = "boundary", "does nothing", "nothing", "none"
    parameters = (Parameter("size", "m", 0, 1, 0.1, "none", role="size"),)
class Weather(Idle):
    kind = "weather"
    parameters = (Parameter("rain", "1", 0, 1, 0.1, "none"),)
class Untypical(Idle):
    parameters = (Parameter("load", "1", 0, 1, 7.0, "none"),)
class Undefaulted(Idle):
    parameters = (Parameter("load", "1", 0, 1, 0.5, "none"), Parameter("size", "m", 0.1, 1, 0.1, "none", role="size"))
class Commaless(Idle):
    parameters = (Parameter("load", "1", 0, 1, 0.5, "none"))
class Worded(Idle):
    parameters = ("load",)
class Boundless(Idle):
    parameters = (Parameter("load", "1", None, None, 0.5, "none"),)
class Sideways(Idle):
    parameters = (
        Parameter("load", "1", 0, 1, 0.5, "none"), Parameter("towards", "deg", 0, 360, 0, "any", role="direction")
    )
class Factor(Idle):
    parameters = (Parameter("factor", "1", 0.5, 2.0, 1.2, "none"),)
class Untold(Idle):
    parameters = (Parameter("load", "1", 0, 1, 0.0, "none"),)
class Endless(Idle):
    parameters = (Parameter("load", "1", 0, float("inf"), 0.5, "none"),)
class Twice(Idle):
    parameters = (Parameter("load", "1", 0, 1, 0.5, "none"), Parameter("load", "m", 0, 1, 0.5, "none", role="size"))
class Miswritten(Idle):
    parameters = (
        Parameter("load", "1", 0, 1, 0.5, "none"), Parameter("towards", "deg", 0, 360, 0, "any", role="directon")
    )
class Elsewhere(Weather):
    kind, located = "boundary", "sector"
class Exact(Weather):
    kind, gradient = "boundary", "exact"
class Colon(Idle):
    name = "odd:one"
"""
UNFINISHED = """
from cusick_bench.sim.effects.base import Effect
from cusick_bench.solvers.base import Solver
class Effects(Effect):
    name = "odd"
class Solvers(Solver):
    name = "odd"
class NamedEffects(Effects):
    name = "even"
    def _apply(self, setup, value):
        return setup
class NamedSolvers(Solvers):
    name = "even"
    def _solve(self, problem, generator, progress):
        raise NotImplementedError
class CommaEffects(NamedEffects):
    name = "odd,one"
class CommaSolvers(NamedSolvers):
    name = "odd,one"
class VersionEffects(NamedEffects):
    name, version = "odd", "1.1"
class VersionSolvers(NamedSolvers):
    name, version = "odd", "1.1"
class KindSolvers(NamedSolvers):
    name, kind = "odd", "gradient"
class MemberSolvers(NamedSolvers):
    name = "nlopt:LN_PRAXIS"
class FurtherSolvers(NamedSolvers):
    name = "nlopt:MINE"
"""


def command(words: str, here: Path, *, limits: str = "", **surroundings: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own, with these environment variables and limits."""
    start = (
        f"import resource, sys; resource.setrlimit(resource.RLIMIT_AS, ({LIMIT}, {LIMIT})); {limits}\n"
        "from cusick_bench.cli import main; sys.argv[0] = 'cusick-bench'; main()"
    )
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("CUSICK", "PYTHONIO"))}
    return subprocess.run(
        [sys.executable, "-c", start, *words.split()],
        cwd=here,
        env=kept | surroundings,
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        timeout=100,
        check=False,
    )


def refused(made: subprocess.CompletedProcess[str], *words: str) -> None:
    message = " ".join(made.stderr.split())
    assert made.returncode == 2, message
    assert "Traceback" not in made.stderr
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("words", "surroundings"),
    [
        ("solvers", {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0"}),
        ("datasets", {"TERM": "dumb"}),
        ("datasets", {"COLUMNS": "wide"}),
        ("datasets", {"COLUMNS": "0"}),
        ("data info synthetic", {"CUSICK_BENCH_CACHE": "/dev/null/cache"}),
        ("datasets", {"HOME": "/nowhere", "XDG_CACHE_HOME": "/nowhere"}),
        (SIMULATE, {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}),
    ],
    ids=str,
)
def test_odd_surroundings_change_nothing(tmp_path, words, surroundings):
    made = command(words, tmp_path, **surroundings)
    assert made.returncode == 0, made.stderr[-2000:]
    assert any(character.isalpha() for character in made.stdout)
    assert "Traceback" not in made.stderr


@pytest.mark.parametrize("threads", ["0", "-1", "many", "1000000000"])
def test_a_number_of_threads_that_is_none_is_refused(tmp_path, threads):
    refused(command(SIMULATE, tmp_path, NUMBA_NUM_THREADS=threads), "NUMBA_NUM_THREADS", threads)


@pytest.mark.parametrize("data", ["", "/dev/null"])
def test_a_release_that_is_not_there_is_refused(tmp_path, data):
    refused(command("data info cusick", tmp_path, CUSICK_DATA=data), data or "CUSICK_DATA")


def test_a_disk_that_is_full_is_told_in_one_line(tmp_path):
    limit = "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))"
    full = f"{limit}; import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)"
    refused(command(f"{SIMULATE} --out out", tmp_path, limits=full), "File too large", "free some space")


@pytest.fixture
def register(tmp_path, monkeypatch):
    """Makes a package that registers something, and forgets it afterwards."""

    def registering(group: str, entry: str) -> None:
        (tmp_path / "odd_plugin.py").write_text(PLUGIN)
        (tmp_path / "odd_effect.py").write_text(UNMADE)
        (tmp_path / "odd_class.py").write_text(UNFINISHED)
        (tmp_path / "odd_import.py").write_text("raise ImportError('it needs a library that is not here')\n")
        folder = tmp_path / "odd_plugin-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-plugin\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[cusick_bench.{group}]\n{entry}\n")
        monkeypatch.syspath_prepend(tmp_path)
        registered.cache_clear()

    yield registering
    monkeypatch.undo()
    registered.cache_clear()
    for name in ("odd_plugin", "odd_import", "odd_effect", "odd_class"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("group", ["solvers", "effects"])
@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ("odd = odd_import:Thing", "it needs a library that is not here"),
        ("odd = odd_plugin:absent", "cannot be imported"),
        ("odd = odd_plugin:broken", "must be a subclass"),
        ("odd = odd_plugin:Nothing", "must be a subclass"),
        ("odd = odd_plugin:number", "must be a subclass"),
        ("odd = no_such_module:Thing", "No module named"),
        ("odd = odd_class:{group}", "lacks _[as]"),
        ("odd = odd_class:Named{group}", "must have the name that it is registered under, got name = 'even'"),
        ("odd = odd_class:Version{group}", "must have a version that is a whole number >= 1, got version = '1.1'"),
    ],
)
def test_a_package_that_registers_nonsense_is_named_and_left_out(register, group, entry, reason):
    register(group, entry.format(group=group.capitalize()))
    with pytest.warns(RuntimeWarning, match=f"'odd'.*{reason}.*left out"):
        names = registered() if group == "effects" else registered_solvers()
    assert "odd" not in names
    assert len(names) > 5


@pytest.mark.parametrize(
    ("group", "entry", "reason"),
    [
        ("solvers", "odd,one = odd_class:CommaSolvers", "name without commas"),
        ("effects", "odd,one = odd_class:CommaEffects", "name without commas"),
        ("effects", "odd:one = odd_effect:Colon", "name without colons"),
    ],
)
def test_a_name_that_nobody_could_ask_for_is_left_out(register, group, entry, reason):
    """Commas and colons part a name from options and parameters."""
    register(group, entry)
    with pytest.warns(RuntimeWarning, match=f"'odd.one'.*must have a {reason}.*left out"):
        names = registered() if group == "effects" else registered_solvers()
    assert not {name for name in names if name.startswith("odd")}


def test_a_solver_of_an_unknown_kind_is_left_out(register):
    """It would count as one without physics: its cells would forget the effects that are asked for."""
    register("solvers", "odd = odd_class:KindSolvers")
    with pytest.warns(RuntimeWarning, match="'odd'.*of a kind among solver, null, oracle, got kind = 'gradient'"):
        names = registered_solvers()
    assert "odd" not in names
    with pytest.warns(RuntimeWarning, match="left out"), pytest.raises(SolverError, match="must be of a kind among"):
        solver_class("odd")


@pytest.mark.filterwarnings("ignore:'odd'")
@pytest.mark.parametrize(("group", "found"), [("solvers", solver_class), ("effects", effect)])
def test_who_asks_for_what_was_left_out_is_told_why_though_warnings_are_hidden(register, group, found):
    register(group, "odd = odd_import:Thing")
    with pytest.raises((SolverError, SimulationError), match=r"'odd'.*it needs a library that is not here"):
        found("odd")
    with pytest.raises((SolverError, SimulationError), match=f"unknown {group[:-1]} 'even'"):
        found("even")


@pytest.mark.parametrize(("group", "taken"), [("solvers", "homo"), ("effects", "creep")])
def test_a_package_does_not_take_a_built_in_name(register, group, taken):
    register(group, f"{taken} = odd_plugin:Nothing")
    with pytest.warns(RuntimeWarning, match=f"'{taken}'.*name that is taken"):
        names = registered() if group == "effects" else registered_solvers()
    assert taken in names


def test_a_package_does_not_stand_for_a_member_of_a_built_in_family(register):
    register("solvers", "nlopt:LN_PRAXIS = odd_class:MemberSolvers\nnlopt:MINE = odd_class:FurtherSolvers")
    with pytest.warns(RuntimeWarning, match="'nlopt:LN_PRAXIS'.*has a name of the family nlopt.*left out"):
        names = registered_solvers()
    assert not {"nlopt:LN_PRAXIS", "nlopt:MINE"} & names.keys()


@pytest.mark.filterwarnings("ignore:'nlopt")
def test_members_of_a_built_in_family_stay_what_they_are(register):
    register("solvers", "nlopt:LN_PRAXIS = odd_class:MemberSolvers\nnlopt:MINE = odd_class:FurtherSolvers")
    assert solver_class("nlopt:LN_PRAXIS").__module__ == "cusick_bench.solvers.black_box.nlopt_family"
    with pytest.raises(SolverError, match=r"'nlopt:MINE' .*has a name of the family nlopt"):
        solver_class("nlopt:MINE")
    with pytest.raises(SolverError, match="NLopt has no algorithm 'LN_MAGIC'"):
        solver_class("nlopt:LN_MAGIC")


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("Unmade", "no licence found"),
        ("Silent", "lacks kind, summary, physics, reference, parameters"),
        ("Idle", "must have one parameter with the role severity, has 0"),
        ("Weather", "must be of a class .kind. among material, history, boundary, contact, imaging, got 'weather'"),
        ("Untypical", "must have a typical load of 0 to 1, got 7"),
        ("Undefaulted", "must have a default size of 0.1 to 1 m, got 0"),
        ("Commaless", "cannot be used .TypeError: 'Parameter' object is not iterable"),
        ("Worded", "must have parameters of the class Parameter, got 'load'; correct it"),
        ("Boundless", "cannot be used .TypeError"),
        ("Factor", "must have a factor that is 0 where the effect is absent.*got 0.5 to 2, typical 1.2; correct it"),
        ("Untold", "typical value must be another, got 0 to 1, typical 0; correct it"),
        ("Endless", "must have finite bounds of load, got 0 to inf"),
        ("Twice", "must have parameters of different names, got 'load' twice"),
        ("Miswritten", "must have a role of towards among severity, direction, radius, size, got 'directon'"),
        ("Elsewhere", "must state `located` as one of '', 'direction', 'patch', 'ring', got 'sector'"),
        ("Exact", "must state `gradient` as one of 'adjoint', 'differences', got 'exact'"),
        ("Sideways", "has a direction, so it must be located 'direction' or 'patch', got ''; state `located`"),
    ],
)
def test_an_effect_that_cannot_be_used_is_named_and_left_out(register, kind, reason):
    register("effects", f"odd = odd_effect:{kind}")
    with pytest.warns(RuntimeWarning, match=f"'odd'.*{reason}.*left out"):
        names = registered()
    assert "odd" not in names
