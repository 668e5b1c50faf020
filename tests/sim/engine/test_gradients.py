"""Forces, Hessians and adjoints of the compiled simulator against plain torch and against central differences."""

import numpy as np
import pytest
import torch
from cotton_tables import BENDING, STRETCH

from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.dynamics.drop import drop, drop_adjoint
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.equilibrium import equilibrium, equilibrium_adjoint
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.reference.drop import drop_reference
from cusick_bench.sim.reference.laws import Reference, TorchParameters
from cusick_bench.sim.reference.tables import STRETCH_SAMPLE

STEP = 0.05  # [s]


def _system(law: str, support: str = "fixed", vertices: int = 80) -> DrapeSystem:
    mesh = disc_mesh(vertices, seed=1)
    radius = np.hypot(*mesh.material.T)
    on = radius < PLATE_RADIUS + 1e-9
    spring = np.where(radius < PLATE_RADIUS - 1e-9, 1e3, 0.0)
    held = (np.zeros_like(on), spring) if support == "springs" else (on, np.zeros(mesh.vertices))
    return DrapeSystem(mesh, law, 9.8, *held, half_hinges=support == "half hinges")  # pyright: ignore[reportArgumentType]


def _patch(law: str, support: str = "springs") -> DrapeSystem:
    """An irregular rectangle of 20 vertices: small enough for the Hessian by autograd."""
    grid = np.stack(np.meshgrid(np.arange(5) * 0.03, np.arange(4) * 0.03, indexing="ij"), axis=-1).reshape(-1, 2)
    points = grid + np.random.default_rng(2).uniform(-0.006, 0.006, grid.shape)
    corner = np.add.outer(4 * np.arange(4), np.arange(3)).ravel()
    lower, upper = [corner, corner + 4, corner + 5], [corner, corner + 5, corner + 1]
    mesh = Mesh(points, np.concatenate([np.column_stack(lower), np.column_stack(upper)]))
    left = mesh.material[:, 0] < (0.04 if support == "half hinges" else 0.01)
    held = (np.zeros(20, bool), np.where(left, 1e3, 0.0)) if support == "springs" else (left, np.zeros(20))
    return DrapeSystem(mesh, law, 9.8, *held, half_hinges=support == "half hinges")  # pyright: ignore[reportArgumentType]


def _parameters(system: DrapeSystem, *, elementwise: bool = True, rest: float = 0.02) -> Parameters:
    generator, mesh = np.random.default_rng(3), system.mesh
    faces, hinges = (len(mesh.faces), len(mesh.hinges)) if elementwise else (1, 1)
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.19 * mesh.areas / 3, 3), mesh.vertices)
    return Parameters(
        STRETCH * np.exp(generator.normal(0, 0.1, (faces, 6, 4))),
        BENDING * np.exp(generator.normal(0, 0.1, (hinges, 3, 5))),
        mass * np.exp(generator.normal(0, 0.1, mesh.vertices)),
        generator.normal(0, rest, len(mesh.hinges)),
    )


def _torch(p: Parameters, *, grad: bool = False) -> TorchParameters:
    arrays = (p.stretch, p.bending, p.mass, p.rest_angle)
    return TorchParameters(*(torch.from_numpy(a.copy()).requires_grad_(grad) for a in arrays))


def _laid(system: DrapeSystem) -> np.ndarray:
    """Uneven, and 0.1 % taut: at zero strain max(G, 0) of the step's stiffness has a kink, where slopes differ."""
    z = np.random.default_rng(4).normal(0, 1e-3, system.mesh.vertices)
    return 1.001 * system.mesh.flat + np.column_stack([np.zeros((len(z), 2)), z])


def _crumpled(system: DrapeSystem, stretch: float, noise: float, height: float) -> np.ndarray:
    generator = np.random.default_rng(5)
    x = system.mesh.flat * [stretch, 1 + 0.5 * (stretch - 1), 1]
    return x + generator.normal(0, 1, x.shape) * [noise, noise, height]


# stretch, in-plane noise [m], out-of-plane noise [m]
STATES = {
    "almost flat": (1.0, 1e-9, 1e-9),
    "gentle": (1.01, 1e-4, 1e-3),
    "compressed": (0.8, 5e-4, 5e-3),
    "beyond the tables": (1.5, 1e-3, 2e-2),
}


def _state(system: DrapeSystem, name: str) -> np.ndarray:
    return _crumpled(system, *STATES[name])


def _dense(system: DrapeSystem, blocks: np.ndarray) -> np.ndarray:
    """The symmetric matrix of which the linear solver reads the needed slots."""
    layout, free = system.layout, len(system.free)
    rows = np.repeat(np.arange(free), np.diff(layout.indptr))
    matrix = np.zeros((free, 3, free, 3))
    for slot in system.linear.needed_slots:
        row, column = rows[slot], layout.indices[slot]
        matrix[row, :, column, :] = blocks[slot]
        matrix[column, :, row, :] = blocks[slot].T
    return matrix.reshape(3 * free, 3 * free)


def _free_coordinates(system: DrapeSystem) -> np.ndarray:
    return (3 * system.free[:, None] + np.arange(3)).ravel()


def _relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _assert_slope(
    function, base: np.ndarray, direction: np.ndarray, expected: float, steps: list[float], noise: float = 0.0
) -> None:
    """Some step of the ladder gives the expected slope to 1e-6, or to the noise of a difference of rounded values.

    max(G, 0) and the published tables make drops piecewise smooth: a difference across a kink is off however right the
    gradient, and a smaller one is needed. A wrong gradient matches none of them.
    """
    slopes = []
    for step in steps:
        slopes.append(_slope(function, base, direction, step))
        if slopes[-1] == pytest.approx(expected, rel=1e-6, abs=noise):
            return
    pytest.fail(f"gradient says {expected:.10g}, central differences {slopes} at steps {steps}")


def _slope(function, base: np.ndarray, direction: np.ndarray, step: float) -> float:
    """Derivative along a direction: fourth-order central difference."""
    f = [function(base + n * step * direction) for n in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step)


def test_states_reach_every_regime_of_the_tables():
    system = _patch("paper")
    reference = Reference(system)
    curvature, size = {}, {}
    for name in STATES:
        x = torch.from_numpy(_state(system, name))
        curvature[name] = (reference.angles(x[reference.hinges]) * reference.length / reference.hinge_area).numpy()
        size[name] = reference.strain(x).flatten(1).norm(dim=1).numpy()
    sample = (STRETCH_SAMPLE**2 - 1) / 2
    assert size["almost flat"].max() < 1e-6
    assert size["gentle"].max() < sample < size["beyond the tables"].min()
    assert curvature["beyond the tables"].min() < -45 < 45 < curvature["beyond the tables"].max()
    assert curvature["gentle"].min() < 0 < curvature["gentle"].max()


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("support", ["fixed", "half hinges", "springs"])
def test_paper_energy_forces_and_hessian_equal_autograd(name: str, support: str):
    system = _patch("paper", support)
    p, reference = _parameters(system), Reference(system)
    x, anchor = _state(system, name), system.mesh.flat
    held = torch.from_numpy(anchor)

    def energy(moved):
        return reference.energy(moved, held, _torch(p))

    force, blocks, joule = system.forces(x, anchor, p, exact=True)
    at = torch.from_numpy(x).requires_grad_()
    expected = -torch.autograd.grad(energy(at), at)[0].numpy()
    assert joule == pytest.approx(float(energy(at).detach()), rel=1e-10, abs=1e-17)
    assert _relative(force, expected) < 1e-9
    hessian = torch.autograd.functional.hessian(energy, at.detach(), vectorize=True).numpy()
    keep = _free_coordinates(system)
    hessian = hessian.reshape(x.size, x.size)[np.ix_(keep, keep)]
    assert _relative(_dense(system, blocks), hessian) < 1e-9


@pytest.mark.parametrize("name", ["gentle", "compressed", "beyond the tables"])
def test_paper_force_is_minus_the_slope_of_the_compiled_energy(name: str):
    system = _patch("paper")
    p, x, anchor = _parameters(system), _state(system, name), system.mesh.flat
    direction = np.random.default_rng(6).normal(size=x.shape)
    slope = _slope(lambda at: system.forces(at, anchor, p, exact=True)[2], x, direction, 1e-7)
    force = system.forces(x, anchor, p, exact=True)[0]
    assert slope == pytest.approx(-(force * direction).sum(), rel=1e-7)


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("law", ["paper", "published"])
def test_forces_and_gauss_newton_stiffness_equal_the_reference(law: str, name: str):
    system = _patch(law)
    p, x, anchor = _parameters(system), _state(system, name), system.mesh.flat
    reference = Reference(system)
    force, blocks, _ = system.forces(x, anchor, p, exact=False)
    with torch.no_grad():
        expected = reference.forces(torch.from_numpy(x), torch.from_numpy(anchor), _torch(p)).numpy()
        stiffness = reference.gauss_newton(torch.from_numpy(x), _torch(p)).numpy()
    stiffness += np.diag(np.repeat(system.spring, 3))
    assert _relative(force, expected) < 1e-9
    assert _relative(_dense(system, blocks), stiffness) < 1e-9


def _contracting(p: Parameters) -> Parameters:
    """The cloth with c12 < 0, nearly as far as C stays positive definite: stretched one way, it contracts the other."""
    stretch = p.stretch.copy()
    stretch[..., 1] = -0.95 * np.sqrt(stretch[..., 0] * stretch[..., 2])
    return Parameters(stretch, p.bending, p.mass, p.rest_angle)


def test_gauss_newton_stiffness_stays_positive_where_warp_and_weft_pull_against_each_other():
    system = _patch("paper")
    x, p = 1.02 * system.mesh.flat * [1, 0.5, 1], _contracting(_parameters(system))
    x[:, 2] = np.random.default_rng(12).normal(0, 1e-3, len(x))
    blocks = system.forces(x, system.mesh.flat, p, exact=False)[1]
    stiffness = Reference(system).gauss_newton(torch.from_numpy(x), _torch(p)).detach().numpy()
    stiffness += np.diag(np.repeat(system.spring, 3))
    assert _relative(_dense(system, blocks), stiffness) < 1e-9
    eigenvalues = np.linalg.eigvalsh(stiffness)
    assert eigenvalues[0] > -1e-9 * eigenvalues[-1]


def test_adjoint_where_the_stiffness_is_cut_off_equals_plain_autograd():
    system = _system("paper")
    p, laid = _contracting(_parameters(system)), _laid(system) * [1.02, 1, 1]
    laid[system.fixed] = system.mesh.flat[system.fixed]
    weight = np.random.default_rng(13).normal(size=laid.shape)
    tensors = _torch(p, grad=True)
    last = drop_reference(system, tensors, torch.from_numpy(laid), steps=4, step_seconds=STEP)
    (last * torch.from_numpy(weight)).sum().backward()
    rollout = drop(system, p, laid, steps=4, step_seconds=STEP)
    gradient, _ = drop_adjoint(system, p, rollout, weight, step_seconds=STEP)
    assert np.abs(rollout.positions[-1] - last.detach().numpy()).max() < 1e-12
    for name in ("stretch", "bending", "mass", "rest_angle"):
        assert _relative(getattr(gradient, name), getattr(tensors, name).grad.numpy()) < 1e-8, name


def test_published_law_rectifies_negative_table_values_as_the_reference_does():
    system = _patch("published")
    p, x, anchor = _parameters(system), _state(system, "beyond the tables"), system.mesh.flat
    p.stretch[:, 2] *= -1
    p.bending[:, 1] *= -1
    force = system.forces(x, anchor, p, exact=False)[0]
    expected = Reference(system).forces(torch.from_numpy(x), torch.from_numpy(anchor), _torch(p))
    assert _relative(force, expected.detach().numpy()) < 1e-9


def test_published_law_has_no_energy():
    system = _system("published")
    flat = torch.from_numpy(system.mesh.flat)
    with pytest.raises(SimulationError, match="no energy"):
        Reference(system).energy(flat, flat, _torch(_parameters(system)))


@pytest.mark.parametrize("support", ["fixed", "half hinges", "springs"])
@pytest.mark.parametrize("law", ["paper", "published"])
def test_drop_and_its_adjoint_equal_plain_autograd(law: str, support: str):
    system = _system(law, support)
    p, laid = _parameters(system), _laid(system)
    weight = np.random.default_rng(7).normal(size=laid.shape)
    tensors, initial = _torch(p, grad=True), torch.from_numpy(laid).requires_grad_()
    last = drop_reference(system, tensors, initial, steps=4, step_seconds=STEP)
    (last * torch.from_numpy(weight)).sum().backward()
    rollout = drop(system, p, laid, steps=4, step_seconds=STEP)
    gradient, by_initial = drop_adjoint(system, p, rollout, weight, step_seconds=STEP)
    assert np.abs(rollout.positions[-1] - last.detach().numpy()).max() < 1e-12
    for name in ("stretch", "bending", "mass", "rest_angle"):
        assert _relative(getattr(gradient, name), getattr(tensors, name).grad.numpy()) < 1e-8, name
    assert initial.grad is not None
    assert _relative(by_initial, initial.grad.numpy()) < 1e-8


# First step of the differences, relative to the value where the value has a scale.
STEPS = {"stretch": 1e-3, "bending": 1e-3, "mass": 1e-3, "rest_angle": 1e-4, "initial": 1e-7}


def _ladder(name: str) -> list[float]:
    return [STEPS[name] * factor for factor in (1, 0.1, 0.03, 0.01, 0.003, 1e-3)]


@pytest.mark.parametrize("name", STEPS)
@pytest.mark.parametrize("elementwise", [True, False], ids=["per element", "shared"])
@pytest.mark.parametrize("support", ["fixed", "springs"])
@pytest.mark.parametrize("law", ["paper", "published"])
def test_drop_adjoint_equals_central_differences(law: str, support: str, elementwise: bool, name: str):
    system = _system(law, support)
    p, laid = _parameters(system, elementwise=elementwise), _laid(system)
    generator = np.random.default_rng(8)
    weight = generator.normal(size=laid.shape)
    rollout = drop(system, p, laid, steps=4, step_seconds=STEP, keep_factors=True)
    gradient, by_initial = drop_adjoint(system, p, rollout, weight, step_seconds=STEP)
    base = laid if name == "initial" else getattr(p, name)
    direction = generator.normal(size=base.shape)
    if name not in ("initial", "rest_angle"):
        direction *= base

    def lands(value: np.ndarray) -> float:
        fields = {f: getattr(p, f) for f in ("stretch", "bending", "mass", "rest_angle")} | {name: value}
        start = fields.pop("initial", laid)
        return float(
            (weight * drop(system, Parameters(**fields), start, steps=4, step_seconds=STEP).positions[-1]).sum()
        )

    found = by_initial if name == "initial" else getattr(gradient, name)
    if name in ("stretch", "bending") and not elementwise:
        found = found.sum(0, keepdims=True)
    _assert_slope(lands, base, direction, (found * direction).sum(), _ladder(name))


def test_recomputed_factors_give_the_same_gradient_as_kept_ones():
    system = _system("paper")
    p, laid = _parameters(system), _laid(system)
    weight = np.random.default_rng(9).normal(size=laid.shape)
    drops = (drop(system, p, laid, steps=5, step_seconds=STEP, keep_factors=keep) for keep in (True, False))
    kept, again = (drop_adjoint(system, p, rollout, weight, step_seconds=STEP) for rollout in drops)
    assert np.array_equal(kept[0].stretch, again[0].stretch)
    assert np.array_equal(kept[1], again[1])


@pytest.mark.parametrize("support", ["fixed", "half hinges", "springs"])
def test_equilibrium_gradient_equals_central_differences(support: str):
    system = _system("paper", support)
    p, laid = _parameters(system), _laid(system)
    generator = np.random.default_rng(10)
    weight = generator.normal(size=laid.shape)
    fallen = drop(system, p, laid, steps=30, step_seconds=STEP).positions[-1]
    rest = equilibrium(system, p, fallen, laid, tolerance=1e-12)
    assert rest.converged
    gradient, by_initial = equilibrium_adjoint(system, p, rest, weight)

    def lands(name: str, value: np.ndarray) -> float:
        fields = {f: getattr(p, f) for f in ("stretch", "bending", "mass", "rest_angle")} | {name: value}
        anchor = fields.pop("initial", laid)
        start = rest.positions.copy()
        start[system.fixed] = anchor[system.fixed]
        warm = equilibrium(system, Parameters(**fields), start, anchor, tolerance=1e-12, mu=0.0)
        assert warm.converged
        return float((weight * warm.positions).sum())

    for name in STEPS:
        base = laid if name == "initial" else getattr(p, name)
        direction = generator.normal(size=base.shape) * (1 if name in ("rest_angle", "initial") else base)
        if name == "initial" and support == "springs":  # free of the plate, where the cloth starts does not matter
            assert np.abs(by_initial[system.spring == 0]).max() == 0
        found = by_initial if name == "initial" else getattr(gradient, name)
        expected = (found * direction).sum()
        _assert_slope(lambda value, name=name: lands(name, value), base, direction, expected, _ladder(name))


@pytest.mark.parametrize("elementwise", [True, False], ids=["per element", "shared"])
@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
@pytest.mark.parametrize("law", ["paper", "plate"])
def test_drape_is_differentiable_through_torch_from_end_to_end(law, mode, elementwise: bool):
    mesh = disc_mesh(80, seed=1)
    simulator = DrapeSimulator(mesh, DrapeSettings(law=law, mode=mode, steps=5, tolerance=1e-12))
    generator = np.random.default_rng(11)
    p = _parameters(_system("paper"), elementwise=elementwise)
    density = np.full(len(mesh.faces), 0.19) if elementwise else np.array(0.19)
    initial = simulator.laid_down()
    if mode == "equilibrium":  # held vertices have a say in the equilibrium
        uneven = generator.normal(0, 1e-3, mesh.vertices)
        sloping = mesh.material @ [0.01, 0.02]  # law `plate` holds the cloth flat on its plate
        initial[:, 2] += np.where(simulator.system.fixed, sloping, uneven) if law == "plate" else uneven
    shape = (lambda a: a) if elementwise else (lambda a: a[0])
    given = {"stretch": shape(p.stretch), "bending": shape(p.bending), "density": density,
             "initial": initial, "rest_angle": p.rest_angle}  # fmt: skip
    if law == "plate":
        given["poisson"] = np.array(0.2)
    weight = torch.from_numpy(generator.normal(size=(mesh.vertices, 3)))
    warm = None

    def loss(values: dict[str, torch.Tensor]) -> torch.Tensor:
        material = Material(**{name: value for name, value in values.items() if name not in ("initial", "rest_angle")})
        drape = simulator.drape(material, initial=values["initial"], rest_angle=values["rest_angle"], warm=warm)
        return (drape.vertices * weight).sum()

    leaves = {name: torch.from_numpy(value.copy()).requires_grad_() for name, value in given.items()}
    if mode == "equilibrium":
        material = Material(**{name: leaf for name, leaf in leaves.items() if name not in ("initial", "rest_angle")})
        warm = simulator.drape(material, initial=leaves["initial"], rest_angle=leaves["rest_angle"])
    loss(leaves).backward()
    steepest = 0.0
    for name, value in given.items():
        scale = 1e-3 if name == "initial" else (0.1 if name == "rest_angle" else np.abs(value))
        direction = generator.normal(size=value.shape) * scale
        if name == "initial" and mode == "drop":
            direction[:, :2] = 0.0
            direction[initial[:, 2] == 0] = 0.0

        def moved(at: np.ndarray, name=name) -> float:
            with torch.no_grad():
                return float(loss({**leaves, name: torch.as_tensor(at)}))

        gradient = leaves[name].grad
        assert gradient is not None
        assert gradient.shape == value.shape
        expected = float((gradient.numpy() * direction).sum())
        steepest = max(steepest, abs(expected))  # beside which a parameter that hardly matters is rounding
        _assert_slope(moved, value, direction, expected, [1e-4, 1e-5, 1e-6], noise=1e-9 * steepest)


def test_drape_without_gradients_is_the_same_drape():
    simulator = DrapeSimulator(disc_mesh(80), DrapeSettings(steps=5))
    material = uniform_material(density=0.2, bending=1e-5)
    tracked = Material(material.stretch.clone().requires_grad_(), material.bending, material.density)
    plain, traced = simulator.drape(material).vertices, simulator.drape(tracked).vertices
    assert not plain.requires_grad
    assert traced.requires_grad
    assert torch.equal(plain, traced.detach())
