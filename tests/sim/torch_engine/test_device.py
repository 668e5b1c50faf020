"""The torch engine behind the simulator and the commands: the same drapes, gradients and failures on every device."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from cusick_bench.benchmark.device import DeviceWorkload, drapes_per_second, measure_device
from cusick_bench.benchmark.plan import Plan
from cusick_bench.benchmark.suite import benchmark, measure_beside, measure_compared
from cusick_bench.benchmark.text import markdown
from cusick_bench.cli import app
from cusick_bench.cli.common import output
from cusick_bench.cli.simulate.benchmark import print_device
from cusick_bench.cli.simulate.simulate import Draws
from cusick_bench.sim import drape as drape_module
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.constants import Law
from cusick_bench.sim.drape import DrapeBatch, DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.outcome import Outcome
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.sim.torch_engine import drop as torch_drop_module

MESH = disc_mesh(120, seed=2)
CUDA = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device")
DEVICES = ["cpu:torch", pytest.param("cuda", marks=CUDA)]


pytestmark = pytest.mark.usefixtures("one_torch_thread")


def _cloths(count: int, *, per_element: bool, track: bool = False) -> list[Material]:
    generator, cloths = np.random.default_rng(1), []
    faces, hinges = (len(MESH.faces), len(MESH.hinges)) if per_element else (1, 1)
    for _ in range(count):
        base = uniform_material(density=float(0.19 * np.exp(generator.normal(0, 0.3))), bending=1e-5)
        stretch = base.stretch * torch.from_numpy(np.exp(generator.normal(0, 0.1, (faces, 6, 4))))
        bending = base.bending * torch.from_numpy(np.exp(generator.normal(0, 0.3, (hinges, 3, 5))))
        tables = (stretch, bending) if per_element else (stretch[0], bending[0])
        density = base.density.expand(faces) if per_element else base.density
        cloths.append(Material(*(table.clone().requires_grad_(track) for table in (*tables, density))))
    return cloths


def _shapes(simulator: DrapeSimulator, count: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Laid-down shapes and rest angles, with gradients. Taut and sheared: max(G00, 0) and |G01| have kinks at zero."""
    strained = np.array([[1.001, 0, 0], [0.0005, 1.001, 0], [0, 0, 1]])
    laid = torch.from_numpy(np.stack([simulator.laid_down(seed) @ strained for seed in range(count)]))
    return laid.requires_grad_(), torch.stack([simulator.rest_angles(seed) for seed in range(count)]).requires_grad_()


def _everything(device: str, *, per_element: bool, **settings: Any) -> tuple[DrapeBatch, dict[str, torch.Tensor]]:
    """A batch of three and the gradients of a random function of its positions."""
    simulator = DrapeSimulator(MESH, DrapeSettings(rest_amplitude=2e-4, **settings), device=device)
    cloths, (laid, angles) = _cloths(3, per_element=per_element, track=True), _shapes(simulator, 3)
    batch = simulator.drape_batch(cloths, initial=laid, rest_angle=angles)
    weight = torch.from_numpy(np.random.default_rng(3).normal(size=(3, MESH.vertices, 3)))
    (weight.to(batch.vertices.device) * batch.vertices).sum().backward()
    leaves = {
        f"{name} {i}": getattr(c, name) for i, c in enumerate(cloths) for name in ("stretch", "bending", "density")
    }
    gradients = {name: leaf.grad for name, leaf in (leaves | {"laid": laid, "angles": angles}).items()}
    return batch, {name: gradient for name, gradient in gradients.items() if gradient is not None}


@pytest.mark.parametrize("per_element", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("settings", [{}, {"law": "published", "support": "springs"}], ids=["paper", "published"])
@pytest.mark.parametrize("device", DEVICES)
def test_engines_agree(device: str, settings: dict, per_element: bool):
    (ours, found), (compiled, expected) = (
        _everything(name, per_element=per_element, steps=15, **settings) for name in (device, "cpu")
    )
    assert ours.vertices.device.type == device.split(":")[0]
    assert float((ours.vertices.detach().cpu() - compiled.vertices.detach()).abs().max()) < 1e-10
    assert found.keys() == expected.keys()
    assert len(found) == 11
    for name, gradient in expected.items():
        limit = 1e-6 if gradient.ndim == 0 else 1e-8  # one density: a sum over the cloth that cancels
        assert float((found[name].cpu() - gradient).abs().max()) < limit * float(gradient.abs().max()), name
    assert np.allclose(ours.residual, compiled.residual, rtol=1e-6)
    assert ours.failures == compiled.failures == [None] * 3
    assert (ours.iterations == 15).all()
    assert float((ours.vertices[0] - ours.vertices[1]).detach().abs().max()) > 1e-4


@pytest.mark.parametrize("device", DEVICES)
def test_single_drape_is_at_rest_where_the_compiled_one_is(device: str):
    stiff, limp = (uniform_material(density=0.2, bending=bending) for bending in (1e-3, 1e-6))
    for cloth, steps in ((stiff, 40), (limp, 4)):
        drape, compiled = (
            DrapeSimulator(MESH, DrapeSettings(steps=steps), device=name).drape(cloth) for name in (device, "cpu")
        )
        assert drape.residual == pytest.approx(compiled.residual, rel=1e-6)
        assert (drape.converged, drape.iterations) == (compiled.converged, steps)
        assert drape.converged == (steps == 40)
        assert drape.seconds > 0


@pytest.mark.parametrize("device", DEVICES)
def test_cloths_that_diverge_say_why_and_spoil_no_other(device: str):
    cloths = _cloths(4, per_element=False, track=True)
    cloths[1] = Material(-1e3 * cloths[1].stretch.detach(), cloths[1].bending, cloths[1].density)
    cloths[2] = uniform_material(density=0.2, bending=1e-12, stretch=1e-9, shear=1e-9)  # falls freely, 3 m in 16 steps
    batches = {
        name: DrapeSimulator(MESH, DrapeSettings(steps=18), device=name).drape_batch(cloths) for name in (device, "cpu")
    }
    batch = batches[device]
    assert [failure is None for failure in batch.failures] == [failure is None for failure in batches["cpu"].failures]
    assert [failure is None for failure in batch.failures] == [True, False, False, True]
    assert "step 1 of 18: the step matrix must be positive definite" in str(batch.failures[1])
    for failures in (batch.failures, batches["cpu"].failures):
        assert "step 62 of 72: the cloth flies apart" in str(failures[2])  # with half the step, and half of that
    assert np.isnan(batch.residual[1])
    assert batch.iterations.tolist() == batches["cpu"].iterations.tolist()
    assert torch.isnan(batch.vertices[1]).all()
    assert not batch.converged[1]
    for member in (0, 3):
        assert (
            float((batch.vertices[member].detach().cpu() - batches["cpu"].vertices[member].detach()).abs().max())
            < 1e-10
        )
    batch.vertices[[0, 3]].sum().backward()
    assert cloths[3].stretch.grad is not None
    assert float(cloths[3].stretch.grad.abs().max()) > 0
    assert torch.isfinite(cloths[3].stretch.grad).all()
    with pytest.raises(DrapeDiverged, match="positive definite"):
        batch.member(1)


def test_gradients_by_the_compiled_engine_lie_where_their_tensors_do(monkeypatch: pytest.MonkeyPatch):
    """A table on device "meta", which has no numbers, stands for one on a GPU, which is copied."""
    simulator, copied = DrapeSimulator(MESH, DrapeSettings(steps=2)), drape_module._array
    cloth = uniform_material(density=0.2, bending=1e-5)
    elsewhere = torch.empty((1, 1, 3, 5), dtype=torch.float64, device="meta", requires_grad=True)
    numbers = cloth.bending.numpy()[None, None]
    monkeypatch.setattr(drape_module, "_array", lambda tensor: numbers if tensor.is_meta else copied(tensor))
    laid = torch.from_numpy(simulator.laid_down())[None].requires_grad_()
    vertices: Any = drape_module._DrapeFunction.apply(
        cloth.stretch[None, None], elsewhere, cloth.vertex_mass(MESH)[None], simulator.rest_angles()[None],
        cloth.poisson[None], laid, Outcome(simulator.system, simulator.unknowns, simulator.settings, 0, None),
    )  # fmt: skip
    vertices.sum().backward()
    assert elsewhere.grad is not None
    assert laid.grad is not None
    assert (elsewhere.grad.device.type, laid.grad.device.type) == ("meta", "cpu")


@pytest.mark.parametrize("device", DEVICES)
def test_memory_limit_changes_no_drape_and_too_little_is_named(device: str):
    free = DrapeSimulator(MESH, DrapeSettings(steps=8), device=device)
    cloths = _cloths(5, per_element=False)
    limited = DrapeSimulator(MESH, DrapeSettings(steps=8), device=device, device_memory=2 * 2**20)
    assert 1 <= limited.at_once() < 5 < free.at_once() <= 256
    difference = limited.drape_batch(cloths).vertices - free.drape_batch(cloths).vertices
    assert float(difference.abs().max()) < 1e-12
    with pytest.raises(SimulationError, match="memory_limit is 0 MiB; raise it, or drop fewer"):
        DrapeSimulator(MESH, DrapeSettings(), device=device, device_memory=1000).drape(cloths[0])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_silhouettes_of_a_drape_elsewhere_carry_gradients_to_the_cloth(device: str, method):
    gradients = []
    for name in (device, "cpu"):
        cloth = _cloths(1, per_element=False, track=True)[0]
        vertices = DrapeSimulator(MESH, DrapeSettings(steps=15), device=name).drape(cloth).vertices
        image = render(vertices, MESH.faces, ParallelCamera(), method=method)
        assert image.device == vertices.device
        image.square().mean().backward()
        gradients.append(cloth.bending.grad)
    assert float(gradients[1].abs().max()) > 0
    assert float((gradients[0] - gradients[1]).abs().max()) < 1e-6 * float(gradients[1].abs().max())


BAD = {
    "gpu": "device must be cpu, cpu:torch, cuda or cuda:N, got 'gpu'",
    "cuda:x": "device must be cpu, cpu:torch, cuda or cuda:N, got 'cuda:x'",
    "cuda:": "device must be cpu, cpu:torch, cuda or cuda:N, got 'cuda:'",
    "mps": "device must be",
    "": "device must be",
}


@pytest.mark.parametrize("name", BAD)
def test_unknown_devices_are_named(name: str):
    with pytest.raises(SimulationError, match=BAD[name]):
        DrapeSimulator(MESH, device=name)


def test_a_gpu_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(SimulationError, match=r"'cuda' needs a CUDA GPU, and torch .* sees none; .* device 'cpu'"):
        DrapeSimulator(MESH, device="cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with pytest.raises(SimulationError, match="one of the 2 GPUs, from cuda:0, got 'cuda:2'"):
        DrapeSimulator(MESH, device="cuda:2")
    assert DrapeSimulator(MESH, device="cuda:1").device == "cuda:1"
    assert DrapeSimulator(MESH, device=torch.device("cuda", 1)).device == "cuda:1"


def test_a_device_of_torch_is_taken_by_its_name():
    """It ended in an AttributeError."""
    simulator = DrapeSimulator(MESH, DrapeSettings(steps=2), device=torch.device("cpu"))
    assert (simulator.device, simulator.engine) == ("cpu", None)
    assert simulator.drape(_cloths(1, per_element=False)[0]).iterations == 2
    for nothing in (torch.device("meta"), None, 0):
        with pytest.raises(SimulationError, match=f"device must be cpu, cpu:torch, .* got '{nothing}'"):
            DrapeSimulator(MESH, device=nothing)  # pyright: ignore[reportArgumentType]


def test_what_only_the_compiled_engine_knows_is_named():
    with pytest.raises(SimulationError, match=r"'cpu:torch' drapes in mode 'drop' only, .* or device 'cpu'"):
        DrapeSimulator(MESH, DrapeSettings(mode="equilibrium"), device="cpu:torch")
    with pytest.raises(SimulationError, match="'multifrontal' only, got backend 'splu'"):
        DrapeSimulator(MESH, DrapeSettings(backend="splu"), device="cpu:torch")
    with pytest.raises(SimulationError, match="'cpu' is that one; name another"):
        Plan(device="cpu")


def test_simulators_of_either_engine_travel_between_processes():
    for device in ("cpu", "cpu:torch"):
        simulator = pickle.loads(pickle.dumps(DrapeSimulator(MESH, DrapeSettings(steps=2), device=device)))
        assert (simulator.device, simulator.drape(_cloths(1, per_element=False)[0]).iterations) == (device, 2)


# --- commands ---------------------------------------------------------------------------------------------------------

ARGUMENTS = ["simulate", "--density", "0.19", "--bending", "1e-5", "--vertices", "80", "--steps", "10", "--json"]


def _document(*arguments: str, status: int = 0) -> dict:
    result = CliRunner().invoke(app, [*ARGUMENTS, *arguments])
    assert result.exit_code == status, result.output
    return json.loads(result.stdout)


@pytest.mark.parametrize("heterogeneity", ["0", "0.3"])
def test_draws_in_batches_equal_draws_one_by_one(monkeypatch: pytest.MonkeyPatch, heterogeneity: str):
    documents, sizes = [], []
    dropped = DrapeSimulator.drape_batch

    def counted(self, materials, **shapes):
        sizes.append(len(materials))
        return dropped(self, materials, **shapes)

    monkeypatch.setattr(DrapeSimulator, "drape_batch", counted)
    for most in (1, 3):
        monkeypatch.setattr(drape_module, "_MOST_COMPILED", most)
        document = _document("--draws", "7", "--heterogeneity", heterogeneity)
        documents.append([{**draw, "seconds": 0.0} for draw in document["draws"]])
    assert sum(sizes) == 14
    assert max(sizes) < 7  # several batches, whose size goes with the number of threads
    assert documents[0] == documents[1]
    assert [draw["draw"] for draw in documents[0]] == list(range(7))
    assert len({draw["drape_coefficient"] for draw in documents[0]}) == 7


def test_draws_on_another_device_are_the_same_drapes(tmp_path):
    ours, compiled = (
        _document("--draws", "5", "--device", device, "--out", str(tmp_path / device[-5:]))
        for device in ("cpu:torch", "cpu")
    )
    assert ours.keys() == compiled.keys() >= {"drape_coefficient", "folds", "converged", "residual", "seconds", "draws"}
    assert (ours["device"], compiled["device"]) == ("cpu:torch", "cpu")
    for mine, theirs in zip(ours["draws"], compiled["draws"], strict=True):
        assert mine["drape_coefficient"] == pytest.approx(theirs["drape_coefficient"], abs=1e-7)
        assert (mine["folds"], mine["converged"]) == (theirs["folds"], theirs["converged"])
        assert mine["seconds"] > 0
    assert len(list((tmp_path / "torch").glob("*.obj"))) == 5


def test_diverged_draws_are_told_apart(monkeypatch: pytest.MonkeyPatch):
    drawn = Draws.material_of

    def spoilt(self, number: int) -> Material:
        cloth = drawn(self, number)
        return Material(-1e3 * cloth.stretch, cloth.bending, cloth.density) if number in (1, 4) else cloth

    monkeypatch.setattr(Draws, "material_of", spoilt)
    for device in ("cpu", "cpu:torch"):
        result = CliRunner().invoke(app, [*ARGUMENTS, "--draws", "6", "--device", device])
        document = json.loads(result.stdout)
        assert [("failure" in draw) for draw in document["draws"]] == [False, True, False, False, True, False]
        assert (document["failed"], document["converged"]) == (2, False)
        assert "2 of 6 draws diverged" in result.stderr
        assert "draw 1, 4: step 1 of 10" in result.stderr
        table = CliRunner().invoke(app, [*ARGUMENTS[:-1], "--draws", "6", "--device", device])
        assert (table.exit_code, table.stdout.count("failed")) == (0, 2)
        assert "mean ± sd" in table.stdout
    monkeypatch.setattr(Draws, "material_of", lambda self, number: spoilt(self, 1))
    document = _document("--draws", "2", status=1)
    assert (document["failed"], document["drape_coefficient"]) == (2, None)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--device", "gpu"], "device must be cpu"),
        (["--device", "cpu:torch", "--mode", "equilibrium"], "in mode 'drop' only"),
        pytest.param(
            ["--device", "cuda"], "needs a CUDA GPU",
            marks=pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device"),
        ),
    ],
    ids=["unknown", "mode", "absent"],
)  # fmt: skip
def test_simulate_refuses_devices_that_cannot_do_it(arguments: list[str], message: str):
    result = CliRunner().invoke(app, [*ARGUMENTS, *arguments])
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


def test_benchmark_refuses_a_device_before_it_measures():
    for device, message in (("gpu", "device must be cpu"), ("cpu", "name another")):
        result = CliRunner().invoke(app, ["benchmark", "--device", device])
        assert result.exit_code == 2
        assert message in " ".join(result.stderr.split())


class TestDeviceBenchmark:
    def test_rate_is_the_best_of_single_drops_and_batches(self):
        cases = {
            "drop": {"median_s": 0.5}, "batch of 16": {"median_s": 4.0}, "batch of 64": {"median_s": 32.0},
            "drop+gradient": {"median_s": 1.0}, "batch of 16+gradient": {"median_s": 32.0},
            "drop+gradient, checkpointed": {"median_s": 1e-3}, "silhouette+gradient": {"median_s": 1e-3},
        }  # fmt: skip
        assert drapes_per_second(cases) == 4.0
        assert drapes_per_second(cases, "+gradient") == 1.0

    @pytest.mark.parametrize("device", DEVICES)
    def test_agreement_is_that_of_the_engines(self, device: str, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("cusick_bench.benchmark.device.STEPS", 20)
        found = DeviceWorkload(80, device).agreement()
        assert found["positions_m"] < 1e-8
        assert found["gradient"].keys() == {"stretch", "bending", "density", "initial"}
        assert max(found["gradient"].values()) < 1e-5
        monkeypatch.setattr(
            DeviceWorkload, "simulator",
            lambda self, name: DrapeSimulator(self.mesh, DrapeSettings(steps=10 + len(name)), device=name),
        )  # fmt: skip
        assert DeviceWorkload(80, device).agreement()["positions_m"] > 1e-4

    @pytest.mark.parametrize("device", DEVICES)
    def test_device_is_measured_and_printed_beside_the_cpu(self, device: str, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("cusick_bench.benchmark.device.STEPS", 4)
        monkeypatch.setattr("cusick_bench.benchmark.device._SILHOUETTES", 2)
        cpu = {"cases": {"drop": {"median_s": 1.0}, "drop+gradient": {"median_s": 2.0}}}
        plan = Plan(vertices=(80,), rounds=2, device=device, device_batches=(2, 10**6))
        document = measure_beside([cpu], plan, lambda name, share: None)
        (mesh,) = document["meshes"]
        assert document["device"] == device
        assert {"drop", "drop+gradient", "batch of 2", "batch of 2+gradient"} < mesh["cases"].keys()
        assert len(mesh["cases"]) == 6  # the batch of a million is too large
        assert mesh["peak_memory_bytes"].keys() == mesh["cases"].keys()
        assert (mesh["peak_memory_bytes"]["drop"] is None) == (device == "cpu:torch")
        for what, rate in mesh["drapes_per_second"].items():
            assert rate["cpu"] == {"forward": 1.0, "gradient": 0.5}[what]
            assert mesh["times_faster"][what] == pytest.approx(rate["device"] / rate["cpu"])
        with output.capture() as printed:
            print_device(mesh, document)
        assert "batch of 2+gradient" in printed.get()
        assert "engines differ by" in printed.get()

    def test_device_alone_is_measured_and_what_is_measured_is_kept(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ):
        monkeypatch.setattr("cusick_bench.benchmark.device.STEPS", 2)
        monkeypatch.setattr("cusick_bench.benchmark.device._SILHOUETTES", 2)
        kept: list[tuple[int, list[str]]] = []

        def keep(document: dict[str, Any]) -> None:
            meshes = document.get("device", {}).get("meshes", [])
            kept.append((len(meshes[-1]["cases"]) if meshes else 0, list(document["missing"])))

        plan = Plan(vertices=(80,), rounds=1, device="cpu:torch", device_batches=(2,), device_only=True)
        document = benchmark(plan, keep=keep)
        assert document["meshes"][0]["cases"].keys() == {"drop", "drop+gradient", "batch of 16, lockstep"}
        assert [cases for cases, _ in kept] == [0, 0, 1, 2, 3, 4, 5, 6, 6]
        assert "device" in kept[-2][1]
        assert document["missing"] == ["laws", "reference", "gradient_error", "start_up_s"]
        text = markdown(document, "the command")
        assert "## Torch engine on cpu:torch" in text
        assert "| batch of 2+gradient | " in text
        assert "## Targets" not in text
        out = tmp_path / "x.json"
        result = CliRunner().invoke(app, ["benchmark", "--device-only", "--out", str(out)])
        assert result.exit_code == 2
        assert "name it: --device cuda --device-only" in " ".join(result.stderr.split())
        assert not out.exists()

    def test_drops_by_a_law_without_rests_are_compared(self):
        """The bare linear algebra, which is not compared, starts from a rest."""
        plan = Plan(vertices=(80,), rounds=1, law="published", support="springs", device="cpu:torch", device_only=True)
        found = measure_compared(80, plan, lambda name, share: None)
        assert found["cases"].keys() == {"drop", "drop+gradient", "batch of 16, lockstep"}

    @pytest.mark.parametrize("law", ["paper", "plate"])
    def test_device_drops_by_the_law_of_the_plan(self, law: Law, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("cusick_bench.benchmark.device.STEPS", 2)
        monkeypatch.setattr("cusick_bench.benchmark.device._SILHOUETTES", 2)
        monkeypatch.setattr(DeviceWorkload, "agreement", lambda self: {"law": self.there.settings.law})
        cpu = {"cases": {"drop": {"median_s": 1.0}, "drop+gradient": {"median_s": 2.0}}}
        plan = Plan(vertices=(80,), rounds=1, law=law, device="cpu:torch", device_batches=())
        (mesh,) = measure_beside([cpu], plan, lambda name, share: None)["meshes"]
        assert mesh["agreement"]["law"] == law

    def test_engines_agree_under_law_plate(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("cusick_bench.benchmark.device.STEPS", 20)
        found = DeviceWorkload(80, "cpu:torch", law="plate").agreement()
        assert found["positions_m"] < 1e-8
        assert max(found["gradient"].values()) < 1e-5

    def test_what_does_not_fit_the_device_is_left_out_with_the_reason(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("cusick_bench.benchmark.device.STEPS", 2)
        monkeypatch.setattr("cusick_bench.benchmark.device._SILHOUETTES", 2)
        monkeypatch.setattr(torch_drop_module, "CPU_MEMORY", 900 * 2**10)
        monkeypatch.setattr(DeviceWorkload, "agreement", lambda self: {})
        mesh = measure_device(80, "cpu:torch", (2, 50), 1, "fixed", "paper", lambda name: None)
        assert "drop" in mesh["cases"]
        assert mesh["left_out"].keys() == {"batch of 50+gradient"}
        assert "raise it, or drop fewer cloths at a time" in mesh["left_out"]["batch of 50+gradient"]
