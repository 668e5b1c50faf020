"""No kernel is compiled, nor read from disk, while a meter runs.

Every case runs in a process of its own, where nothing is warm. What is looked at is which signatures the kernels have
when the search begins and when it ends, and not a clock.
"""

import subprocess
import sys

import pytest

PROGRAM = """
import gc, sys, tempfile
from pathlib import Path
from numba.core.registry import CPUDispatcher
from cusick_bench.datasets import load
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings, Store, plan, run_cell
from cusick_bench.runner.warm_up import WarmUp
from cusick_bench.sim.engine.settings import DrapeSettings

def compiled():
    kernels = [item for item in gc.get_objects() if type(item) is CPUDispatcher]
    return {(kernel.py_func.__name__, str(types)) for kernel in kernels for types in kernel.signatures}

def report(share, loss, message):
    if message == "scoring":
        late.append(compiled() - warm)

solver, mode, *causes = sys.argv[1:]
drape = DrapeSettings(mode=mode, steps=10)
settings = ProblemSettings(vertices=150, drape=drape, budget=Budget(20), causes=tuple(causes))
data, late = load("synthetic"), []
(cell,) = plan(data, solvers=[solver], cloths=["fabric_1"], settings=settings)
WarmUp().before(data, cell)
warm = compiled()
with tempfile.TemporaryDirectory() as folder:
    result = run_cell(data, cell, Store(Path(folder)), report)
assert result["status"] == "done", result["failure"]
print(len(warm), *[name for name, types in late[0]])
"""


@pytest.mark.parametrize("arguments", [("homo", "drop"), ("homo", "equilibrium")], ids=" ".join)
@pytest.mark.slow
def test_everything_is_compiled_before_the_search(arguments):
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    warm, *late = done.stdout.split()
    assert int(warm) > 10
    assert not late
