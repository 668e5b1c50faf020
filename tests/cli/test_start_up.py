"""Nothing is imported before it is used: what simulates nothing waits for no library of those that simulate.

Every case runs in a process of its own. What is looked at is which libraries it has imported, and not a clock.
"""

import os
import subprocess
import sys

import pytest

SLOW = {"torch", "numba", "pandas", "scipy", "matplotlib", "trimesh", "botorch", "gpytorch", "cvxpy", "cma", "jinja2"}
PROGRAM = """
import atexit, sys

def tell():
    print("imported:", *sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)

atexit.register(tell)
sys.argv[0] = "cusick-bench"
from cusick_bench.cli import main
main()
"""


def _imported(*arguments: str, **environment: str) -> tuple[set[str], str]:
    """Slow libraries that a command imports, and what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments],
        capture_output=True, text=True, env=os.environ | environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    names = next(line for line in done.stderr.splitlines() if line.startswith("imported:")).split()[1:]
    return SLOW & set(names), done.stdout


@pytest.mark.parametrize(
    "command", ["--help", "--version", "run --help", "simulate --help", "withheld score --help", "solvers", "effects"]
)
def test_what_only_tells_waits_for_nothing(command):
    imported, printed = _imported(*command.split())
    assert not imported
    assert printed


@pytest.mark.parametrize(
    ("command", "needed"), [("datasets", {"scipy"}), ("data info", {"pandas", "scipy"})], ids=["datasets", "data info"]
)
def test_what_only_reads_data_waits_for_no_simulator(command, needed):
    assert _imported(*command.split())[0] <= needed


def _completed(words: str, **environment: str) -> tuple[set[str], list[str]]:
    """Slow libraries imported while a shell completes the last word, and what it is offered."""
    asked = {
        "_CUSICK_BENCH_COMPLETE": "complete_bash",
        "COMP_WORDS": f"cusick-bench {words}",
        "COMP_CWORD": str(len(words.split(" "))),
    }
    imported, printed = _imported(**asked, **environment)
    return imported, printed.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("lead", ["leaderboard"]),
        ("run --solver bdp", ["bdp", "bdp-field"]),
        ("run --solver nlopt:LN", ["nlopt:LN_BOBYQA", "nlopt:LN_COBYLA", "nlopt:LN_SBPLX"]),
        ("simulate --with-effect cre", ["creep"]),
        ("diagnose --without-effect camera-", ["camera-scale", "camera-offset", "camera-tilt"]),
        ("run --data syn", ["synthetic"]),
        ("data info syn", ["synthetic"]),
        ("run --law pub", ["published"]),
    ],
)
def test_names_are_completed_without_waiting(words, offered):
    assert _completed(words) == (set(), offered)


def test_cloths_of_the_data_are_completed():
    imported, offered = _completed("run --data synthetic --cloth fab")
    assert imported <= {"scipy"}
    assert offered == [f"fabric_{fabric}" for fabric in range(1, 6)]


@pytest.mark.parametrize("words", ["data stats DATA", "identify DATA", "diagnose DATA", "run --data DATA"])
def test_cloths_are_those_of_the_data_that_are_named(words, tmp_path):
    """The shell asks while `--cloth` lacks its value, and the parser has not come to the arguments then."""
    picture = tmp_path / "data" / "Fabric 7" / "silhouettes" / "Fabric_7_Sample_1_Capture_1.jpg"
    picture.parent.mkdir(parents=True)
    picture.touch()
    assert _completed(f"{words.replace('DATA', str(tmp_path))} --cloth ")[1] == ["fabric_7"]


def test_cloths_of_a_run_are_not_those_of_the_shipped_data(tmp_path):
    assert _completed(f"verify {tmp_path} --cloth ")[1] == []


def test_no_cloth_is_offered_of_data_that_cannot_be_read():
    assert _completed("run --data nowhere --cloth fab")[1] == []


def test_a_leaderboard_waits_for_no_simulator():
    modules = "cells.loading", "board", "formats", "text"
    code = (
        f"import sys; {'; '.join(f'import cusick_bench.leaderboard.{name}' for name in modules)}; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert SLOW & set(done.stdout.split()) <= {"pandas", "scipy", "jinja2"}
