"""Batches of drops in torch against the compiled simulator, one drape at a time; on every device there is."""

from typing import Any

import numpy as np
import pytest
import torch
from cotton_tables import BENDING, STRETCH

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.engine.dynamics.drop import drop, drop_adjoint
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear.interface import BlockPattern
from cusick_bench.sim.torch_engine import forces as torch_forces
from cusick_bench.sim.torch_engine.drop import drop_members
from cusick_bench.sim.torch_engine.forces import BatchParameters, TorchForces
from cusick_bench.sim.torch_engine.laws import tension
from cusick_bench.sim.torch_engine.multifrontal import MultifrontalTorch
from cusick_bench.sim.torch_engine.rollout import adjoint, member_bytes, plan_batch, rollout

STEP = 0.05  # [s]
NAMES = ("stretch", "bending", "mass", "rest_angle")
DEVICES = [
    "cpu",
    pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device")),
]
LAWS = ["paper", "published"]
# stretch, in-plane noise [m], out-of-plane noise [m]
STATES = {"flat": (1.0, 1e-9, 1e-9), "gentle": (1.01, 1e-4, 1e-3), "far": (1.5, 1e-3, 2e-2), "tight": (0.8, 5e-4, 5e-3)}


pytestmark = pytest.mark.usefixtures("one_torch_thread")


def _system(law: str, support: str = "fixed", vertices: int = 80) -> DrapeSystem:
    mesh = disc_mesh(vertices, seed=1)
    radius = np.hypot(*mesh.material.T)
    on, spring = radius < PLATE_RADIUS + 1e-9, np.where(radius < PLATE_RADIUS - 1e-9, 1e3, 0.0)
    held = (on, np.zeros(mesh.vertices)) if support == "fixed" else (np.zeros_like(on), spring)
    return DrapeSystem(mesh, law, 9.8, *held)  # pyright: ignore[reportArgumentType]


def _batch(system: DrapeSystem, members: int, *, elementwise: bool = True, shared: tuple[str, ...] = ()) -> dict:
    """Random cloths and laid-down shapes, those in `shared` the same for all members."""
    generator, mesh = np.random.default_rng(3), system.mesh
    faces, hinges = (len(mesh.faces), len(mesh.hinges)) if elementwise else (1, 1)
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.19 * mesh.areas / 3, 3), mesh.vertices)
    height = np.concatenate(
        [np.zeros((members, mesh.vertices, 2)), generator.normal(0, 1e-3, (members, mesh.vertices, 1))], 2
    )
    coupling = np.where(generator.random((members, faces, 6, 1)) < 0.5, -8.0, 1.0) ** ([0, 1, 0, 0])  # c12 < 0 in half
    given = {
        "stretch": coupling * STRETCH * np.exp(generator.normal(0, 0.1, (members, faces, 6, 4))),
        "bending": BENDING * np.exp(generator.normal(0, 0.3, (members, hinges, 3, 5))),
        "mass": mass * np.exp(generator.normal(0, 0.1, (members, mesh.vertices))),
        "rest_angle": generator.normal(0, 0.02, (members, len(mesh.hinges))),
        "initial": 1.001 * mesh.flat + height,  # taut: max(G, 0) has a kink at zero strain
    }
    return {name: value[:1] if name in shared else value for name, value in given.items()}


def _tensors(given: dict, *, grad: bool = False) -> dict[str, Any]:
    return {name: torch.from_numpy(value.copy()).requires_grad_(grad) for name, value in given.items()}


def _dropped(
    system: DrapeSystem, *, steps: int, step_seconds: float, device: str = "cpu",
    memory_limit: int | None = None, initial: torch.Tensor, **parameters: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:  # fmt: skip
    """Last positions of a batch of cloths, and who is sound."""
    dropped = drop_members(
        system, BatchParameters(**parameters), initial, steps=steps, step_seconds=step_seconds, device=device,
        memory_limit=memory_limit,
    )  # fmt: skip
    return dropped.positions, dropped.good


def _one(given: dict, member: int) -> tuple[Parameters, np.ndarray]:
    picked = {name: value[member if len(value) > 1 else 0] for name, value in given.items()}
    return Parameters(*(picked[name] for name in NAMES)), picked["initial"]


def _crumpled(system: DrapeSystem, stretch: float, noise: float, height: float) -> np.ndarray:
    x = system.mesh.flat * [stretch, 1 + 0.5 * (stretch - 1), 1]
    return x + np.random.default_rng(5).normal(0, 1, x.shape) * [noise, noise, height]


def _relative(found, expected: np.ndarray) -> float:
    found = found.detach().cpu().numpy() if isinstance(found, torch.Tensor) else found
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _pattern(system: DrapeSystem) -> BlockPattern:
    return BlockPattern(system.layout.indptr, system.layout.indices, system.mesh.material[system.free])


def _dense(pattern: BlockPattern, slots: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """The symmetric matrix with the given blocks in either of its triangles."""
    matrix = np.zeros((pattern.vertices, 3, pattern.vertices, 3))
    for slot, block in zip(slots, blocks, strict=True):
        row, column = pattern.rows[slot], pattern.indices[slot]
        matrix[row, :, column], matrix[column, :, row] = block, block.T
    return matrix.reshape(3 * pattern.vertices, -1)


@pytest.mark.parametrize("elementwise", [True, False], ids=["per element", "shared"])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("device", DEVICES)
def test_forces_and_stiffness_equal_the_compiled_ones(device: str, law: str, elementwise: bool):
    for support in ("fixed", "springs"):
        system = _system(law, support)
        slots = np.sort(system.linear.needed_slots)
        x = np.stack([_crumpled(system, *numbers) for numbers in STATES.values()])
        given = _batch(system, len(x), elementwise=elementwise)
        p = BatchParameters(*(_tensors(given)[name].to(device) for name in NAMES))
        anchor = torch.from_numpy(given["initial"]).to(device)
        force, blocks = TorchForces(system, device, slots).evaluate(torch.from_numpy(x).to(device), anchor, p)
        for member in range(len(x)):
            one, laid = _one(given, member)
            expected, stiffness, _ = system.forces(x[member], laid, one, exact=False)
            assert _relative(force[member], expected) < 1e-11
            assert _relative(blocks[member], stiffness[slots]) < 1e-11


def _smallest_eigenvalue() -> float:
    """Of the stiffness of a cloth stretched along the warp, with coupling c12 < 0; relative to the largest."""
    system = _system("paper")
    given = _batch(system, 1, elementwise=False)
    given["stretch"][..., 1] = -140.0
    forces, pattern = TorchForces(system, "cpu"), _pattern(system)
    p = BatchParameters(*(_tensors(given)[name] for name in NAMES))
    x = torch.from_numpy(system.mesh.flat * [1.15, 1.0, 1.0])[None]
    values = np.linalg.eigvalsh(_dense(pattern, forces.slots, forces.evaluate(x, x, p)[1][0].numpy()))
    return values[0] / values[-1]


def test_stiffness_of_law_paper_is_never_indefinite(monkeypatch: pytest.MonkeyPatch):
    assert _smallest_eigenvalue() > -1e-14
    monkeypatch.setattr(torch_forces, "tension", lambda _, k, strain: tension("published", k, strain))
    assert _smallest_eigenvalue() < -1e-4  # or the cloth was no test


def test_gradient_where_the_stiffness_is_clamped_equals_central_differences():
    system = _system("paper")
    given = _batch(system, 1, elementwise=False)
    given["stretch"][..., 1] = -60.0
    given["initial"] = system.mesh.flat[None] * [1.05, 1.0, 1.0] + given["initial"] * [0, 0, 1]
    weight = np.random.default_rng(8).normal(size=given["initial"].shape)
    direction = {"stretch": given["stretch"], "initial": weight * 1e-3}

    def lands(shift: float) -> float:
        moved = given | {name: given[name] + shift * along for name, along in direction.items()}
        x, _ = _dropped(system, **_tensors(moved), steps=3, step_seconds=STEP)
        return float((weight * x.numpy()).sum())

    tensors = _tensors(given, grad=True)
    x, _ = _dropped(system, **tensors, steps=3, step_seconds=STEP)
    (x * torch.from_numpy(weight)).sum().backward()
    slope = sum(float((tensors[name].grad.numpy() * along).sum()) for name, along in direction.items())
    differences = [(lands(step) - lands(-step)) / (2 * step) for step in (1e-5, 1e-6)]  # one may cross a kink
    assert any(value == pytest.approx(slope, rel=1e-6) for value in differences)


@pytest.mark.parametrize("vertices", [80, 300])
@pytest.mark.parametrize("device", DEVICES)
def test_linear_solver_solves_and_flags_the_member_without_a_factor(device: str, vertices: int):
    pattern = _pattern(_system("paper", vertices=vertices))
    linear = MultifrontalTorch(pattern, device)
    generator = np.random.default_rng(6)
    blocks = generator.normal(size=(3, pattern.slots, 3, 3))
    transposed = np.lexsort((pattern.rows, pattern.indices))
    blocks = blocks + blocks[:, transposed].swapaxes(2, 3)
    diagonal = np.flatnonzero(pattern.rows == pattern.indices)
    blocks[:, diagonal] += 40 * np.eye(3)
    blocks[1, diagonal[pattern.vertices // 2]] = -np.eye(3)
    right = generator.normal(size=(3, pattern.vertices, 3))
    factor = linear.factorise(torch.from_numpy(blocks[:, linear.slots]).to(device))
    solution = factor.solve(torch.from_numpy(right).to(device)).cpu().numpy()
    assert factor.good.tolist() == [True, False, True]
    for member in (0, 2):
        matrix = _dense(pattern, np.arange(pattern.slots), blocks[member])
        residual = matrix @ solution[member].ravel() - right[member].ravel()
        assert np.abs(residual).max() < 1e-12 * np.abs(right[member]).max()


@pytest.mark.parametrize("shared", [(), ("bending", "mass", "initial"), ("stretch", "rest_angle")], ids=str)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("device", DEVICES)
def test_drops_and_gradients_equal_the_compiled_ones_member_by_member(device: str, law: str, shared: tuple[str, ...]):
    for support in ("fixed", "springs"):
        system = _system(law, support, 150)
        given = _batch(system, 3, elementwise=not shared, shared=shared)
        weight = np.random.default_rng(7).normal(size=(3, system.mesh.vertices, 3))
        long, good = _dropped(system, **_tensors(given), steps=20, step_seconds=STEP, device=device)
        assert long.device.type == device
        assert good.all()
        tensors = _tensors(given, grad=True)
        x, _ = _dropped(system, **tensors, steps=10, step_seconds=STEP, device=device)
        (x * torch.from_numpy(weight).to(device)).sum().backward()
        expected = {name: np.zeros_like(value) for name, value in given.items()}
        for member in range(3):
            one, laid = _one(given, member)
            rollout = drop(system, one, laid, steps=20, step_seconds=STEP)
            assert np.abs(long[member].cpu().numpy() - rollout.positions[-1]).max() < 1e-9
            rollout = drop(system, one, laid, steps=10, step_seconds=STEP)  # rounding grows with every step
            gradient, by_initial = drop_adjoint(system, one, rollout, weight[member], step_seconds=STEP)
            found = {name: getattr(gradient, name) for name in NAMES} | {"initial": by_initial}
            for name, value in found.items():
                per_element = expected[name][0].shape == value.shape
                row = member if len(expected[name]) > 1 else 0
                expected[name][row] += value if per_element else value.sum(0, keepdims=True)
        for name, value in expected.items():
            assert _relative(tensors[name].grad, value) < 1e-8, name


@pytest.mark.parametrize("device", DEVICES)
def test_a_member_does_not_depend_on_its_batch_mates_and_repeats_bit_by_bit(device: str):
    system = _system("paper")
    given = _batch(system, 4)

    def run(chosen: dict) -> tuple[torch.Tensor, torch.Tensor]:
        tensors = _tensors(chosen, grad=True)
        x, _ = _dropped(system, **tensors, steps=10, step_seconds=STEP, device=device)
        (x**2).sum().backward()
        assert tensors["stretch"].grad is not None
        return x.detach(), tensors["stretch"].grad

    together, again = run(given), run(given)
    alone = run({name: value[2:3] for name, value in given.items()})
    for all_members, repeated, one in zip(together, again, alone, strict=True):
        assert torch.equal(all_members, repeated)
        assert _relative(all_members[2], one[0].cpu().numpy()) < 1e-9  # rounding, after ten steps
        assert _relative(all_members[1], one[0].cpu().numpy()) > 1e-3


@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device")
def test_steps_launched_as_graphs_give_the_same_drops_and_gradients():
    system, steps = _system("paper"), 10
    forces, linear = TorchForces(system, "cuda"), MultifrontalTorch(_pattern(system), "cuda")
    kept, at_work = member_bytes(forces, linear, steps, differentiate=True)
    results = []
    for limit, graphs in ((3 * kept + 4 * at_work, False), (3 * kept + 9 * at_work, True)):
        plan = plan_batch(forces, linear, 3, steps=steps, h=STEP, limit=limit, differentiate=True)
        assert (plan.graphs is not None) == graphs
        tensors = _tensors(_batch(system, 3), grad=True)
        x, good = _dropped(system, **tensors, steps=steps, step_seconds=STEP, device="cuda", memory_limit=limit)
        (x**2).sum().backward()
        assert good.all()
        results.append([x.detach(), *(tensor.grad for tensor in tensors.values())])
    for plain, launched in zip(*results, strict=True):
        assert _relative(launched, plain.cpu().numpy()) < 1e-8


@pytest.mark.parametrize("law", LAWS)
def test_steps_never_wait_for_the_device(law: str):
    """Tensors without values: looking at one, or mixing devices, raises."""
    system = _system(law, "springs")
    linear = MultifrontalTorch(_pattern(system), "meta")
    forces = TorchForces(system, "meta", linear.slots)
    plan = plan_batch(forces, linear, 2, steps=2, h=STEP, limit=2**28, differentiate=True)
    given = {name: value.to("meta") for name, value in _tensors(_batch(system, 2, shared=("mass",))).items()}
    p, anchor = BatchParameters(*(given[name] for name in NAMES)), given["initial"]
    x, record = rollout(plan, p, anchor, 2, keep=1)
    gradient, by_initial = adjoint(plan, p, anchor, record, torch.ones_like(x))
    assert x.shape == by_initial.shape == anchor.shape
    assert [getattr(gradient, name).shape for name in NAMES] == [given[name].shape for name in NAMES]


def _limits(system: DrapeSystem, members: int, steps: int) -> dict[str, int]:
    """Memory limits under which all factors are kept, few are, and members run in groups."""
    forces, linear = TorchForces(system, "cpu"), MultifrontalTorch(_pattern(system), "cpu")
    kept, at_work = member_bytes(forces, linear, steps, differentiate=True)
    few = members * (kept + at_work) + 2 * members * linear.factor_bytes
    return {"all": 2**30, "few": few, "groups": members * kept + 2 * at_work, "too small": members * kept}


def test_memory_limit_changes_groups_and_factors_but_no_numbers():
    system, members, steps = _system("paper"), 5, 8
    given, limits = _batch(system, members, shared=("mass",)), _limits(system, members, steps)
    forces, linear = TorchForces(system, "cpu"), MultifrontalTorch(_pattern(system), "cpu")
    plans = {
        name: plan_batch(forces, linear, members, steps=steps, h=STEP, limit=limits[name], differentiate=True)
        for name in ("all", "few", "groups")
    }
    assert plans["all"].factor_memory > steps * members * linear.factor_bytes > plans["few"].factor_memory > 0
    assert plans["groups"].groups == [(0, 2), (2, 3), (3, 5)]
    results = []
    for name in plans:
        tensors = _tensors(given, grad=True)
        x, _ = _dropped(system, **tensors, steps=steps, step_seconds=STEP, memory_limit=limits[name])
        (x**3).sum().backward()
        results.append([x.detach().numpy(), *(tensor.grad.numpy() for tensor in tensors.values())])
    for other in results[1:]:
        for found, expected in zip(other, results[0], strict=True):
            assert _relative(found, expected) < 1e-10
    with pytest.raises(SimulationError, match=r"memory_limit is .* raise it"):
        _dropped(system, **_tensors(given, grad=True), steps=steps, step_seconds=STEP, memory_limit=limits["too small"])


@pytest.mark.parametrize(("table", "factor"), [("stretch", -1.0), ("bending", -1e4), ("initial", 0.0)])
@pytest.mark.parametrize("device", DEVICES)
def test_a_member_that_blows_up_is_flagged_and_leaves_the_others_alone(device: str, table: str, factor: float):
    system = _system("paper")
    given = _batch(system, 3, elementwise=False, shared=("mass",))
    sound = _tensors({n: v if len(v) == 1 else v[[0, 2]] for n, v in given.items()}, grad=True)
    given[table][1] *= factor
    broken = _tensors(given, grad=True)
    x, good = _dropped(system, **broken, steps=5, step_seconds=STEP, device=device)
    y, _ = _dropped(system, **sound, steps=5, step_seconds=STEP, device=device)
    assert good.tolist() == [True, False, True]
    assert x[1].isnan().all()
    assert torch.allclose(x[[0, 2]], y, rtol=0, atol=1e-13)
    (x**2).sum().backward()  # NaN, and so is the derivative to the lost member's positions
    (y**2).sum().backward()
    for name in given:
        found, expected = broken[name].grad, sound[name].grad
        assert found is not None
        assert expected is not None
        if len(found) > 1:
            assert not found[1].any()
            found = found[[0, 2]]
        assert _relative(found, expected.numpy()) < 1e-9, name


BAD = {
    "stretch": (lambda t: t[:, :3], r"stretch of 2 drops must have shape \(2 or 1, .* or 1, 6, 4\)"),
    "bending": (lambda t: t[0], "bending of 2 drops must have shape"),
    "mass": (lambda t: t - t[0, 0], "vertex masses must be > 0 kg"),
    "rest_angle": (lambda t: t * torch.nan, "rest_angle must be finite"),
    "initial": (lambda t: t.repeat(2, 1, 1)[:3], "of 3 drops must have shape"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.unchecked_arrays
def test_bad_tensors_are_named(name: str):
    system = _system("paper")
    tensors = _tensors(_batch(system, 2))
    spoil, message = BAD[name]
    tensors[name] = spoil(tensors[name])
    with pytest.raises(SimulationError, match=message):
        _dropped(system, **tensors, steps=1, step_seconds=STEP)


def test_bad_settings_are_named():
    system = _system("paper")
    tensors = _tensors(_batch(system, 2))
    cases: tuple[tuple[dict[str, Any], str], ...] = (
        ({"steps": 0}, "steps must be >= 1"),
        ({"step_seconds": -1.0}, "step_seconds > 0"),
    )
    for settings, message in cases:
        with pytest.raises(SimulationError, match=message):
            _dropped(system, **tensors, **({"steps": 1, "step_seconds": STEP} | settings))
    linear = MultifrontalTorch(_pattern(system), "cpu")
    with pytest.raises(SimulationError, match="blocks must have shape"):
        linear.factorise(torch.zeros((2, len(linear.slots) + 1, 3, 3)))
