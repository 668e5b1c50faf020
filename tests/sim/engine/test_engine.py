"""What the engine promises: both ways to a drape agree, results repeat, folds keep apart, gradients are exact."""

import json
import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from cusick_bench.benchmark.gradients import NAMES, GradientCheck
from cusick_bench.benchmark.memory import peak_of
from cusick_bench.benchmark.reference import Comparison
from cusick_bench.benchmark.robustness import BENDING_RANGE, DENSITY_RANGE, robustness, specimen
from cusick_bench.benchmark.suite import scaling
from cusick_bench.benchmark.timing import Timing, paired_ratio, time_in_turn
from cusick_bench.cli import app
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.linear.interface import available_backends

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

CLOTH = uniform_material(density=0.192, bending=1.4e-5)


def test_drop_that_has_come_to_rest_agrees_with_equilibrium():
    mesh = disc_mesh(297)
    long = DrapeSimulator(mesh, DrapeSettings(steps=1500)).drape(CLOTH)
    rest = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium")).drape(CLOTH)
    assert long.residual < 1e-7
    assert float((long.vertices - rest.vertices).abs().max()) < 1e-6


@pytest.mark.parametrize("backend", [name for name in available_backends() if name != "multifrontal"])
def test_backends_agree_within_the_rounding_that_a_drop_amplifies(backend):
    mesh = disc_mesh(297)
    drapes = [
        DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", backend=name)).drape(CLOTH).vertices
        for name in ("multifrontal", backend)
    ]
    assert float((drapes[0] - drapes[1]).abs().max()) < 1e-7


_FORK = """
import os, sys
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.engine.settings import DrapeSettings
simulator = DrapeSimulator(disc_mesh(150), DrapeSettings(steps=3))
cloth = uniform_material(density=0.192, bending=1.4e-5)
simulator.drape(cloth)
child = os.fork()
if child == 0:
    try:
        simulator.drape(cloth)
        print("draped")
    except SimulationError as error:
        print(error)
    sys.stdout.flush()
    os._exit(0)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this platform has no fork")
@pytest.mark.parametrize("layer", ["default", "workqueue"])
def test_forked_process_simulates_or_says_how_to_start_it(layer):
    surroundings = os.environ | ({} if layer == "default" else {"NUMBA_THREADING_LAYER": layer})
    run = subprocess.run(
        [sys.executable, "-c", _FORK], capture_output=True, text=True, timeout=120, check=False, env=surroundings
    )
    assert run.returncode == 0, run.stderr
    expected = {"draped"} if layer == "workqueue" else {"draped", "this process was forked from one that has simulated"}
    assert run.stdout.split(",")[0].strip() in expected


_IMPORT = """
import os
before = dict(os.environ)
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.cloth.mesh import disc_mesh
from numba.core import config
priority = list(config.THREADING_LAYER_PRIORITY)
assert dict(os.environ) == before, "importing changed the environment"
DrapeSimulator(disc_mesh(80))
assert dict(os.environ) == before, "simulating changed the environment"
assert config.THREADING_LAYER_PRIORITY == priority, "simulating changed numba's configuration"
print("unchanged")
"""


def test_importing_and_simulating_leave_environment_and_numba_as_they_were():
    run = subprocess.run([sys.executable, "-c", _IMPORT], capture_output=True, text=True, check=False)
    assert run.stdout.strip() == "unchanged", run.stderr


_PRINT_DRAPES = """
import hashlib, numba, torch
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.engine.settings import DrapeSettings
cloth = uniform_material(density=0.192, bending=1.4e-5)
cloth.bending.requires_grad_()
for threads in (1, 2):
    numba.set_num_threads(threads)
    digest = hashlib.sha256()
    for mode in ("drop", "equilibrium"):
        cloth.bending.grad = None
        drape = DrapeSimulator(disc_mesh(297), DrapeSettings(mode=mode)).drape(cloth)
        drape.vertices.square().sum().backward()
        digest.update(drape.vertices.detach().numpy().tobytes() + cloth.bending.grad.numpy().tobytes())
    print(digest.hexdigest())
"""


def test_bits_do_not_depend_on_the_number_of_threads():
    environment = {"NUMBA_NUM_THREADS": "2", "OMP_NUM_THREADS": "2", "PATH": "/usr/bin:/bin"}
    run = subprocess.run(
        [sys.executable, "-c", _PRINT_DRAPES], env=environment, capture_output=True, text=True, check=True
    )
    one, two = run.stdout.split()
    assert one == two


@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
def test_gradients_of_the_whole_pipeline_equal_central_differences(mode):
    check = GradientCheck(DrapeSimulator(disc_mesh(100), DrapeSettings(mode=mode, tolerance=1e-12)))
    errors = [check.error(name, per_element=per_element) for name in NAMES for per_element in (False, True)]
    smooth = [error for error in errors if not error.branch_changed]
    assert len(smooth) >= 5  # a jump to another rest has no derivative, but is rare
    for error in smooth:
        assert error.relative_error < 1e-6, error


def test_gradient_check_sees_a_wrong_gradient():
    check = GradientCheck(DrapeSimulator(disc_mesh(80), DrapeSettings(steps=20)))
    grad = check.material.bending.grad
    assert grad is not None
    grad *= 1.001
    assert check.error("bending", per_element=False).relative_error > 1e-4


class TestSelfContact:
    @pytest.fixture(autouse=True)
    def _needs_ipctk(self):
        pytest.importorskip("ipctk", reason="the extra `contact` is not installed")

    def test_keeps_folds_apart_and_differentiable(self):
        from cusick_bench.sim.contact.intersections import intersections

        mesh, limp = disc_mesh(300), uniform_material(density=0.25, bending=1e-6)
        settings = DrapeSettings(mode="equilibrium", plate_radius=0.04)
        free = DrapeSimulator(mesh, settings).drape(limp).vertices
        limp.bending.requires_grad_()
        simulator = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", plate_radius=0.04, self_contact=1e-3))
        apart = simulator.drape(limp)
        assert intersections(mesh, free.detach().numpy()) > 0
        assert intersections(mesh, apart.vertices.detach().numpy()) == 0
        weight = torch.from_numpy(np.random.default_rng(1).normal(size=(mesh.vertices, 3)))
        (weight * apart.vertices).sum().backward()
        assert limp.bending.grad is not None
        ends = [uniform_material(density=0.25, bending=1e-6 * factor) for factor in (1 - 1e-5, 1 + 1e-5)]
        values = [float((weight * simulator.drape(end, warm=apart).vertices).sum()) for end in ends]
        slope = (values[1] - values[0]) / 2e-5
        assert float((limp.bending.grad * limp.bending.detach()).sum()) == pytest.approx(slope, rel=1e-4)

    def test_belongs_to_mode_equilibrium(self):
        with pytest.raises(SimulationError, match="mode 'equilibrium'"):
            DrapeSettings(self_contact=1e-3)
        with pytest.raises(SimulationError, match="self_contact must be >= 0"):
            DrapeSettings(mode="equilibrium", self_contact=-1.0)


class TestRobustness:
    def test_specimens_span_the_measured_fabrics(self):
        drawn = [specimen(seed) for seed in range(300)]
        for name, (low, high) in (("density", DENSITY_RANGE), ("bending", BENDING_RANGE), ("anisotropy", (0.1, 10))):
            values = np.array([getattr(one, name) for one in drawn])
            assert low <= values.min() < 1.1 * low * (high / low) ** 0.05
            assert high >= values.max() > 0.9 * high / (high / low) ** 0.05
        for one in drawn:
            c11, c12, c22, c33 = one.material.stretch.unbind(-1)
            assert ((c11 * c22 > c12**2) & (c33 > 0)).all()
            assert (one.material.bending > 0).all()

    def test_all_come_to_rest(self):
        found = robustness(DrapeSimulator(disc_mesh(150), DrapeSettings(mode="equilibrium")), 40)
        assert found["fraction"] == 1.0
        assert found["failures"] == []

    def test_every_law_drapes_the_same_cloths(self, monkeypatch):
        """The published program bends a plate as if it had a quarter of its table."""
        tables = {}
        draped = DrapeSimulator.drape_batch

        def seen(simulator, materials, **laid):
            tables[simulator.settings.law] = torch.stack([one.bending for one in materials])
            return draped(simulator, materials, **laid)

        monkeypatch.setattr(DrapeSimulator, "drape_batch", seen)
        for law in ("paper", "published"):
            robustness(DrapeSimulator(disc_mesh(150), DrapeSettings(law=law, steps=1)), 3)
        assert torch.equal(tables["published"], 4 * tables["paper"])

    def test_failures_are_listed_with_their_cloth(self):
        found = robustness(DrapeSimulator(disc_mesh(150), DrapeSettings(mode="equilibrium", iterations=1)), 4)
        assert found["converged"] + len(found["failures"]) == 4
        assert found["failures"]
        assert "did not come to rest" in found["failures"][0]["reason"]
        assert found["failures"][0]["density"] == specimen(found["failures"][0]["seed"]).density

    @pytest.mark.slow
    def test_thousand_cloths_at_1205_vertices(self):
        found = robustness(DrapeSimulator(disc_mesh(1205), DrapeSettings(mode="equilibrium")), 1000)
        assert found["fraction"] >= 0.995, found["failures"]

    def test_cloth_that_flies_apart_is_told_from_one_at_rest(self):
        wild = specimen(16)  # extremely limp: the long steps of a drop blow it up, at twice the usual length for sure
        mesh = disc_mesh(297)
        laid = torch.from_numpy(DrapeSimulator(mesh).laid_down(16))
        with pytest.raises(DrapeDiverged, match="flies apart"):  # hinges that bend as a whole on the clamp: no halving
            DrapeSimulator(mesh, DrapeSettings(step_seconds=0.1, clamp="whole")).drape(wild.material, initial=laid)
        rest = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium")).drape(wild.material, initial=laid)
        assert rest.converged


class TestBenchmark:
    def test_cases_are_timed_in_turn_after_warming_up(self):
        calls: list[str] = []
        timings = time_in_turn({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3)
        assert calls == ["a", "b"] * 4
        assert [len(timing.seconds) for timing in timings.values()] == [3, 3]

    def test_ratios_are_paired(self):
        assert paired_ratio(Timing((2.0, 20.0, 6.0)), Timing((1.0, 10.0, 2.0))) == {"median": 2, "low": 2, "high": 3}

    def test_memory_is_that_of_the_case(self):
        assert 95e6 < peak_of(partial, np.ones, 12_500_000) < 120e6

    def test_scaling_exponent_is_recovered(self):
        meshes = [{"vertices": n, "cases": {"drop": {"median_s": 1e-6 * n**1.3}}} for n in (300, 1205, 2699, 7496)]
        assert scaling(meshes) == pytest.approx(1.3)
        assert scaling(meshes[:2]) is None

    def test_engine_and_plain_autograd_agree(self):
        assert Comparison(150, 5).difference() < 1e-8

    @pytest.mark.slow
    def test_command_prints_one_document(self, tmp_path):
        arguments = ["benchmark", "--vertices", "80", "--rounds", "1", "--batch", "2", "--reference-steps", "1"]
        result = CliRunner().invoke(
            app, [*arguments, "--gradient-vertices", "80", "--out", str(tmp_path / "b.json"), "--json"]
        )
        assert result.exit_code == 0, result.output
        document = json.loads(result.stdout)
        assert json.loads((tmp_path / "b.json").read_text()) == document
        table = (tmp_path / "b.md").read_text()
        assert f"| drop / floor | {document['ratios']['drop / floor']:.3g} |" in table
        assert f"{document['meshes'][0]['cases']['drop']['median_s']:.3f}" in table
        assert document["ratios"]["drop / floor"] > 0
        assert {row["target"] for row in document["targets"]} >= {
            "drop / floor",
            "gradient error",
            "start-up, law paper (s)",
        }
        assert len(document["gradient_error"]) == 12
        assert document["meshes"][0]["memory_bytes"].keys() == {"kept", "checkpointed"}
