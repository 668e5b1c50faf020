"""What the runner itself costs is measured on cells that all come to an end."""

import json
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from cusick_bench.benchmark.runner_overhead import Overhead
from cusick_bench.cli import app

pytestmark = pytest.mark.usefixtures("one_thread")


def test_command_measures_trivial_cells(tmp_path):
    out = tmp_path / "new" / "runner.json"
    found = CliRunner().invoke(app, ["benchmark", "--runner-cells", "40", "--out", str(out), "--json"])
    assert found.exit_code == 0, found.output
    assert json.loads(out.read_text()) == json.loads(found.stdout)
    measured = json.loads(found.stdout)["runner"]
    assert measured["cells"] == 40
    assert all(measured[name] > 0 for name in ("wall_ms", "processor_ms", "again_ms", "memory_early_mib"))
    assert measured["memory_mib"] >= measured["memory_early_mib"]


def test_memory_of_a_cell_is_what_the_later_cells_have_added():
    assert Overhead(40, 1.0, 1.0, 1.0, memory_early_mib=100, memory_mib=102).memory_a_cell_kib == pytest.approx(102.4)


_WITHOUT = """
import sys
sys.modules["resource"] = None
import cusick_bench.benchmark.runner_overhead, cusick_bench.benchmark.suite
from cusick_bench.sim.memory import most_memory
print(most_memory())
"""


def test_benchmarks_can_be_run_where_python_does_not_tell_memory():
    """Windows has no module `resource`, and `benchmark` ended in a traceback."""
    done = subprocess.run([sys.executable, "-c", _WITHOUT], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["nan"], done.stderr
