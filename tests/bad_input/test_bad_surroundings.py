"""What surrounds a command: environment variables, terminals without Unicode, full disks, packages that register."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SIMULATE = "simulate --density 0.2 --bending 1e-6 --vertices 97 --steps 2"
LIMIT = 6 << 30  # [bytes] of address space of a command
PLUGIN = """
class Nothing:
    pass
def broken():
    raise RuntimeError("no licence found")
number = 5
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
        (SIMULATE, {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}),
        ("data audit synthetic", {"PYTHONIOENCODING": "latin-1"}),
        ("effects", {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}),
        (SIMULATE, {"TERM": "dumb", "COLUMNS": "0"}),
        ("data info synthetic", {"COLUMNS": "1"}),
        ("data info synthetic", {"COLUMNS": "wide"}),
        ("data info synthetic", {"CUSICK_BENCH_CACHE": "/dev/null/cache"}),
        ("data info synthetic", {"CUSICK_BENCH_CACHE": "/proc/cache"}),
        ("data info synthetic", {"HOME": "/nowhere", "XDG_CACHE_HOME": "/nowhere"}),
        (SIMULATE, {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}),
    ],
    ids=str,
)
def test_odd_surroundings_change_nothing(tmp_path, words, surroundings):
    made = command(words, tmp_path, **surroundings)
    assert made.returncode == 0, made.stderr[-2000:]
    assert made.stdout.strip()
    assert "Traceback" not in made.stderr


@pytest.mark.parametrize("threads", ["0", "-1", "many", "1000000000"])
@pytest.mark.parametrize("variable", ["NUMBA_NUM_THREADS"])
def test_a_number_of_threads_that_is_none_is_refused(tmp_path, variable, threads):
    refused(command(SIMULATE, tmp_path, **{variable: threads}), variable, threads)


@pytest.mark.parametrize("data", ["", "/nowhere", "/dev/null", "\u00fc\u00df\u2603"])
def test_a_release_that_is_not_there_is_refused(tmp_path, data):
    refused(command("data info cusick", tmp_path, CUSICK_DATA=data), "CUSICK_DATA" if not data else data)


def test_a_disk_that_is_full_is_told_in_one_line(tmp_path):
    full = "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)); import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)"
    refused(command(f"{SIMULATE} --out out", tmp_path, limits=full), "File too large", "free some space")


def test_little_memory_is_told_in_one_line(tmp_path):
    little = "resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))"
    made = command("simulate --density 0.2 --bending 1e-6 --vertices 100000 --steps 2", tmp_path, limits=little)
    refused(made, "not enough memory", "vertices")


def write_plugin(here: Path, group: str, *entries: str) -> dict[str, str]:
    """A package that registers something, and the variable that makes it found."""
    (here / "odd_plugin.py").write_text(PLUGIN)
    (here / "odd_import.py").write_text("raise ImportError('it needs a library that is not here')\n")
    folder = here / "odd_plugin-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-plugin\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("\n".join([f"[{group}]", *entries, ""]))
    return {"PYTHONPATH": os.pathsep.join([str(here), os.environ.get("PYTHONPATH", "")])}


@pytest.mark.parametrize("group", ["solvers", "effects"])
@pytest.mark.parametrize(
    "entry",
    [
        "odd = odd_import:Thing",
        "odd = odd_plugin:absent",
        "odd = odd_plugin:broken",
        "odd = odd_plugin:Nothing",
        "odd = odd_plugin:number",
        "odd = no_such_module:Thing",
    ],
)
def test_a_package_that_registers_nonsense_is_named_and_left_out(tmp_path, group, entry):
    variables = write_plugin(tmp_path, f"cusick_bench.{group}", entry)
    made = command(f"{group} --json", tmp_path, **variables)
    assert made.returncode == 0, made.stderr[-2000:]
    names = {row["name"] for row in json.loads(made.stdout)[group]}
    assert "odd" not in names
    assert len(names) > 5
    assert "odd" in made.stderr
    assert "Traceback" not in made.stderr


@pytest.mark.parametrize(("group", "taken"), [("solvers", "homo"), ("effects", "creep")])
def test_a_package_does_not_take_a_built_in_name(tmp_path, group, taken):
    variables = write_plugin(tmp_path, f"cusick_bench.{group}", f"{taken} = odd_plugin:Nothing")
    made = command(f"{group} --json", tmp_path, **variables)
    assert made.returncode == 0, made.stderr[-2000:]
    assert taken in {row["name"] for row in json.loads(made.stdout)[group]}
    assert taken in made.stderr
