"""The test functions of the optimisers' benchmark and its command."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.benchmark.optimisers.functions import (
    FUNCTIONS,
    BenchmarkError,
    branin,
    hartmann6,
    hide,
)
from cusick_bench.benchmark.optimisers.runs import METHODS, Published, summary
from cusick_bench.cli import app
from cusick_bench.solvers.registry import make_solver


class TestFunctions:
    def test_known_minima(self):
        for x, y in ((-math.pi, 12.275), (math.pi, 2.275), (9.42478, 2.475)):
            assert branin(np.array([(x + 5) / 15, y / 15])) == pytest.approx(FUNCTIONS["branin"].optimum, abs=1e-5)
        best = np.array([0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573])
        assert hartmann6(best) == pytest.approx(FUNCTIONS["hartmann6"].optimum, abs=1e-5)

    def test_only_active_coordinates_matter(self):
        hidden = hide("hartmann6", 50, np.random.default_rng(3))
        generator = np.random.default_rng(4)
        point, other = generator.uniform(-1, 1, (2, 50))
        other[hidden.active] = point[hidden.active]
        assert len(set(hidden.active)) == 6
        assert hidden(point) == hidden(other) == hartmann6((point[hidden.active] + 1) / 2)
        for index in hidden.active:
            moved = point.copy()
            moved[index] *= 0.5
            assert hidden(moved) != hidden(point)

    def test_impossible_ones_are_refused(self):
        with pytest.raises(BenchmarkError, match="unknown test function 'ackley'; use one of branin"):
            hide("ackley", 10, np.random.default_rng(0))
        with pytest.raises(BenchmarkError, match="6 coordinates, got dimension 5"):
            hide("hartmann6", 5, np.random.default_rng(0))


class TestBenchmark:
    def test_summary_compares_in_standard_errors(self):
        found = summary([1.0, 3.0, 2.0, 6.0], Published(1.0, 0.5, 0.9))
        assert found["mean"] == 3.0
        assert found["standard_error"] == pytest.approx(math.sqrt(14 / 3 / 4))
        assert found["median"] == 2.5
        assert found["z"] == pytest.approx(2.0 / math.hypot(found["standard_error"], 0.5))
        assert math.isnan(summary([1.0, 2.0], None)["z"])

    def test_command_prints_ours_beside_theirs(self):
        arguments = ["optimisers", "--function", "hartmann6", "--runs", "20", "--solver", "sobol"]
        document = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
        (row,) = document["methods"]
        assert document["evaluations"] == 200
        assert row["published"] == {"mean": -2.325, "standard_error": 0.039, "median": None}
        assert abs(row["z"]) < 3
        assert len(row["best"]) == 20
        table = CliRunner().invoke(app, arguments)
        assert "-2.325" in table.stdout

    def test_bad_input_is_refused(self):
        for arguments, message in (
            (["--solver", "magic"], "unknown method 'magic'"),
            (["--function", "ackley"], "unknown test function"),
            (["--runs", "0"], "--runs"),
            (["--dimension", "1"], "got dimension 1"),
            (["--dimension", "3"], "hesbo searches 4 numbers of branin, got dimension 3; raise it, or name other"),
        ):
            result = CliRunner().invoke(app, ["optimisers", *arguments])
            assert result.exit_code == 2
            assert message in result.output

    def test_every_method_is_a_registered_solver(self):
        for name, make in METHODS.items():
            assert make(FUNCTIONS["branin"]).name == name
            assert make_solver(name).kind == "solver"
