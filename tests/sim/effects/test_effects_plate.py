"""Effects with internal variables under law `plate`: at the points of a shell, and beside law `paper`."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import parse
from cusick_bench.sim.effects.history.bending_friction import YIELD_CURVATURE
from cusick_bench.sim.effects.history.shear_friction import YIELD_SHEAR
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.strains import ShellStrains
from cusick_bench.sim.history import State
from cusick_bench.sim.setup import Setup, drape_setups

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(297)
B = 2e-5  # [N m]
SIZES = {"face-asymmetry": 1.0, "creep": -1.0, "bending-friction": 1.0, "shear-friction": 1.0}
"""Effects with internal variables, and whether they enlarge the drape's projection."""


def _setup(law: str = "plate", steps: int = 20, bending: float = 4e-5) -> Setup:
    height = smooth_field(1e-3, 0.03, np.random.default_rng(3))
    cloth = uniform_material(density=0.192, bending=bending)
    settings = DrapeSettings(law=law, steps=steps)  # pyright: ignore[reportArgumentType]
    return Setup(MESH, settings, cloth, laying=lambda p: torch.from_numpy(height(p.numpy())), later=True)


@pytest.fixture(scope="module")
def shell() -> ShellSystem:
    system = DrapeSimulator(MESH, DrapeSettings(law="plate")).system
    assert isinstance(system, ShellSystem)
    return system


def _parameters(shell: ShellSystem, rows: tuple[float, float, float] = (B, B, B), rest: float = 0.0) -> Parameters:
    table = np.repeat(np.array(rows)[:, None], 5, axis=1)[None]
    stretch = np.tile(np.array([300.0, 0.0, 300.0, 60.0]), (1, 6, 1))
    return Parameters(stretch, table, np.full(MESH.vertices, 1e-4), np.full(3 * shell.edges, rest))


def _bent(shell: ShellSystem, height: float, seed: int = 5) -> np.ndarray:
    """Control points lifted by a height times a smooth field: curvatures of all kinds, in proportion to it."""
    x = MESH.flat.copy()
    field = smooth_field(1.0, 0.05, np.random.default_rng(seed))
    x[shell.free, 2] = height * field(MESH.material[shell.free])
    return x


def _size(curvature: np.ndarray) -> np.ndarray:
    return np.sqrt(curvature[:, 0] ** 2 + curvature[:, 1] ** 2 + 0.5 * curvature[:, 2] ** 2)


def _moment(p: Parameters, curvature: np.ndarray) -> np.ndarray:
    """Moments of a plate of constant tables without Poisson's ratio (M11, M22, M12)."""
    k = curvature - p.rest_angle.reshape(-1, 3)
    b = np.broadcast_to(p.bending[:, :, 0], (len(k), 3))
    d33 = b[:, 1] - (b[:, 0] + b[:, 2]) / 4
    return np.column_stack([b[:, 2] * k[:, 0], b[:, 0] * k[:, 1], d33 * k[:, 2]])


def _started(text: str, shell: ShellSystem, p: Parameters) -> State:
    return parse(text).apply(_setup()).states[0].start(shell, p)


def test_where_bending_has_slid_the_friction_couple_is_that_of_a_cylinder(shell):
    """|M_f| = HB = ratio B for curvature tensors of every kind, against the way on which they came."""
    ratio, p = 20.0, _parameters(shell)
    state = _started(f"bending-friction:ratio={ratio}", shell, p)
    curvature = {}
    for height in (2e-3, 8e-3, 4e-3):
        x = _bent(shell, height)
        curvature[height] = shell.curvature(x)
        _, q = state.advance(shell, p, x, 0.0)
        friction = _moment(q, curvature[height]) - _moment(p, curvature[height])
        away = (
            np.sqrt(friction[:, 0] ** 2 + friction[:, 1] ** 2 + 2 * friction[:, 2] ** 2),
            (friction * curvature[height]).sum(1),
        )
        if height == 8e-3:
            slid = _size(curvature[height] - curvature[2e-3]) > 3 * YIELD_CURVATURE
            assert slid.mean() > 0.3
            np.testing.assert_allclose(away[0][slid], ratio * B, rtol=1e-9)
            assert (away[1][slid] > 0).all()
        if height == 4e-3:
            back = _size(curvature[8e-3] - curvature[height]) > 3 * YIELD_CURVATURE
            assert back.mean() > 0.1
            np.testing.assert_allclose(away[0][back], ratio * B, rtol=1e-9)
            assert np.mean(away[1][back] < 0) > 0.9
        assert away[0].max() < ratio * B * (1 + 1e-9)


def test_the_linear_law_has_the_moments_of_the_tables(shell):
    """Constant tables and a rest of their own give the forces of a table that depends on curvature."""
    generator = np.random.default_rng(2)
    p = _parameters(shell, rest=3.0)
    p = replace(p, bending=1e-5 * generator.uniform(0.5, 2.0, (1, 3, 5)), poisson=np.array(0.2))
    x = _bent(shell, 6e-3)
    linear = ShellStrains(shell).at_secant(shell.curvature(x).ravel(), p)
    expected, found = (shell.forces(x, x, own, exact=False)[0] for own in (p, linear))
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    assert np.ptp(linear.bending, axis=2).max() == 0


def test_creep_takes_its_share_of_every_moment(shell):
    p, x = _parameters(shell, rest=1.0), _bent(shell, 6e-3)
    curvature = shell.curvature(x)
    state = _started("creep:loss=0.35", shell, p)
    first, last = (state.advance(shell, p, x, share)[1] for share in (0.5, 0.99))
    np.testing.assert_allclose(_moment(first, curvature), _moment(p, curvature), rtol=1e-12)
    np.testing.assert_allclose(_moment(last, curvature), 0.65 * _moment(p, curvature), rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("side", [1, -1])
def test_asymmetry_is_whole_where_the_sheet_bends_to_one_side_and_none_on_a_saddle(shell, side):
    own, n = ShellStrains(shell), shell.edges
    angle = np.linspace(0, np.pi, n)
    c, s = np.cos(angle), np.sin(angle)
    cylinder = side * 7.0 * np.column_stack([c * c, s * s, 2 * c * s])
    bowl = side * np.column_stack([np.full(n, 4.0), np.full(n, 9.0), np.zeros(n)])
    saddle = np.column_stack([c, -c, 2 * s])
    np.testing.assert_allclose(own.convexity(cylinder.ravel()), -side, rtol=1e-12)  # hollow upwards: concave
    np.testing.assert_allclose(own.convexity(bowl.ravel()), -side, rtol=1e-12)
    np.testing.assert_allclose(own.convexity(saddle.ravel()), 0.0, atol=1e-12)
    assert (own.convexity(np.zeros(3 * n)) == 0).all()


def test_shear_friction_holds_its_stress_and_leaves_threads_unstretched(shell):
    ratio, p = np.radians(4.0), _parameters(shell)
    p = replace(p, bending=np.zeros_like(p.bending) + 1e-30)
    state = _started("shear-friction:ratio=4", shell, p)

    def sheared(angle: float) -> np.ndarray:
        """The whole cloth with its plate, threads unstretched."""
        half = angle / 2
        turned = np.array([[np.cos(half), np.sin(half)], [np.sin(half), np.cos(half)]])
        return np.column_stack([MESH.material @ turned, np.zeros(MESH.vertices)])

    most = np.radians(6.0)
    control = np.column_stack([shell.stencils.control_material, np.zeros(len(shell.free))])
    found = {}
    for angle in (most, most / 2):
        x = sheared(angle)
        x[shell.free] = np.column_stack([control[:, :2] @ np.linalg.lstsq(MESH.material, x[:, :2])[0], control[:, 2]])
        np.testing.assert_allclose(shell.shear(x), np.sin(angle), rtol=1e-9)
        system, q = state.advance(shell, p, x, 0.0)
        assert isinstance(system, ShellSystem)
        rest, c33 = system.rest_shear, q.stretch[0, 0, 3]
        found[angle] = c33 * (shell.shear(x) - rest) - 60.0 * shell.shear(x)
        threads = replace(q, stretch=q.stretch * np.array([1.0, 1.0, 1.0, 0.0]))
        assert system.forces(x, x, threads, exact=True)[2] < 1e-12
    np.testing.assert_allclose(found[most], 60.0 * ratio, rtol=1e-9)  # T_f = HG, and back with the other sign
    np.testing.assert_allclose(found[most / 2], -60.0 * ratio, rtol=1e-9)
    assert most / 4 > YIELD_SHEAR


@pytest.mark.parametrize("name", SIZES)
def test_an_effect_changes_the_drape_as_under_law_paper(name):
    changes = []
    for law in ("paper", "plate"):
        base = _setup(law)
        shapes = drape_setups([base, parse(name).apply(base)])
        plain, changed = (_projected(shape) for shape in shapes if shape is not None)
        changes.append(changed - plain)
    assert all(np.sign(change) == SIZES[name] for change in changes)
    assert 0.5 < changes[1] / changes[0] < 2.0


def test_poissons_ratio_reaches_every_drape():
    """Alone, beside a cloth with tables of its own for every element, and in a drop with history."""
    base = _setup(steps=4)
    ratio = replace(base, material=replace(base.material, poisson=torch.tensor(0.6, dtype=torch.float64)))
    simulator = DrapeSimulator(MESH, base.settings)
    without, expected = (
        simulator.drape(one.material, initial=one.initial(), rest_angle=one.rest_angle()).vertices
        for one in (base, ratio)
    )
    assert float((expected - without).abs().max()) > 1e-5
    uneven, hardly_creeping = parse("local-stiff-patch").apply(ratio), parse("creep:loss=1e-9").apply(ratio)
    found, _, crept = drape_setups([ratio, uneven, hardly_creeping])
    assert found is not None
    assert crept is not None
    for shape in (found, crept):
        torch.testing.assert_close(shape, expected, rtol=0, atol=1e-9)


def _projected(shape: torch.Tensor) -> float:
    x, y = shape[torch.from_numpy(MESH.boundary), :2].T.numpy()
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
