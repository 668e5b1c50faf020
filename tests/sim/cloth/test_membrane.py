"""The membrane that a mesh can bend: limp cloth does not lock on coarse meshes, and fine meshes have it as given."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.datasets.profile import drape_coefficient
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.membrane import RATIO, softened, softening
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.history import drop_with_history
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.sim.torch_engine.engine import TORCH_ON_CPU

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

LIMP = uniform_material(density=0.15, bending=8e-7, stretch=600.0)
STIFF = uniform_material(density=0.2, bending=3e-4, stretch=300.0)


def _drape(material: Material, vertices: int, **settings) -> float:
    """Its drape coefficient [points]."""
    mesh = ring_mesh(vertices)
    drape = DrapeSimulator(mesh, DrapeSettings(law="plate", backend="lockstep", **settings)).drape(material)
    return 100 * drape_coefficient(render(drape.vertices, torch.from_numpy(mesh.faces), ParallelCamera()))


def test_factor_is_that_of_springs_in_a_row():
    """Stiffness of the membrane and RATIO B / h^2, one after the other."""
    mesh = ring_mesh(297)
    cloth = uniform_material(density=0.15, bending=(1e-6, 2e-6, 3e-6), stretch=300.0)
    spacing = np.sqrt(2 / np.sqrt(3) * np.pi * CLOTH_RADIUS**2 / 297)
    assert spacing == pytest.approx(0.0165, abs=2e-4)
    most = RATIO * 2e-6 / spacing**2
    assert float(softening(cloth, mesh)) == pytest.approx(most / (300.0 + most), rel=0.01)  # the disc is a polygon
    soft = softened(cloth, mesh)
    assert torch.equal(soft.stretch, cloth.stretch * softening(cloth, mesh))
    assert torch.equal(soft.bending, cloth.bending)


def test_cloth_of_fine_meshes_is_left_as_it_is():
    factors = [float(softening(LIMP, ring_mesh(size))) for size in (120, 480, 1920)]
    rest = [1 / factor - 1 for factor in factors]
    assert rest[0] / rest[1] == pytest.approx(4, rel=0.05)
    assert rest[1] / rest[2] == pytest.approx(4, rel=0.05)
    assert float(softening(STIFF, ring_mesh(2699))) > 0.99


def test_tables_of_elements_are_taken_by_their_mean():
    mesh = ring_mesh(120)
    faces, hinges = len(mesh.faces), len(mesh.hinges)
    uneven = torch.linspace(0.5, 1.5, hinges, dtype=torch.float64)[:, None, None]
    spread = Material(LIMP.stretch.expand(faces, 6, 4), LIMP.bending.expand(hinges, 3, 5) * uneven, LIMP.density)
    assert float(softening(spread, mesh)) == pytest.approx(float(softening(LIMP, mesh)))


@pytest.mark.parametrize("bending", [0.0, -1e-6])
def test_what_is_no_cloth_still_has_a_factor(bending: float):
    cloth = replace(LIMP, bending=torch.full((3, 5), bending))
    assert 0 < float(softening(cloth, ring_mesh(120))) < 1e-2


def test_limp_cloth_hardly_locks_on_coarse_meshes():
    """At 5400 vertices it has 18 points, at 480 27 of them, and 51 with its membrane as given."""
    fine = _drape(LIMP, 1205)
    assert fine == pytest.approx(21.2, abs=2)
    assert _drape(LIMP, 480) == pytest.approx(fine, abs=8)
    assert _drape(LIMP, 480, membrane="given") > fine + 25


def test_the_default_softens_and_given_does_not():
    mesh = ring_mesh(120)
    plain = DrapeSettings(law="plate", steps=6)
    default, soft, given = (
        DrapeSimulator(mesh, one).drape(LIMP).vertices
        for one in (plain, replace(plain, membrane="softened"), replace(plain, membrane="given"))
    )
    assert torch.equal(default, soft)
    by_hand = DrapeSimulator(mesh, replace(plain, membrane="given")).drape(softened(LIMP, mesh)).vertices
    assert torch.equal(soft, by_hand)
    assert not torch.allclose(soft, given, atol=1e-5)


@pytest.mark.parametrize("law", ["paper", "published"])
def test_laws_of_hinges_take_the_membrane_as_given(law: str):
    mesh = ring_mesh(120)
    plain = DrapeSettings(law=law, steps=4)  # pyright: ignore[reportArgumentType]
    same = [DrapeSimulator(mesh, one).drape(LIMP).vertices for one in (plain, replace(plain, membrane="given"))]
    assert torch.equal(*same)
    with pytest.raises(SimulationError, match="membrane 'softened' is for law 'plate'"):
        replace(plain, membrane="softened")


def test_drops_with_history_and_the_torch_engine_soften_it_too():
    mesh = ring_mesh(120)
    simulator = DrapeSimulator(mesh, DrapeSettings(law="plate", steps=6))
    drape = simulator.drape(LIMP).vertices
    laid, rest = torch.from_numpy(simulator.laid_down()), simulator.rest_angles()
    np.testing.assert_allclose(drop_with_history(simulator, LIMP, laid, rest, ()), drape, atol=1e-12)
    elsewhere = DrapeSimulator(mesh, simulator.settings, device=TORCH_ON_CPU).drape(LIMP).vertices
    np.testing.assert_allclose(elsewhere, drape, atol=1e-11)


@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
def test_gradients_equal_central_differences(mode: str):
    """To both tables, by which the factor moves."""
    mesh = ring_mesh(120)
    settings = DrapeSettings(law="plate", mode=mode, steps=6, tolerance=1e-11)  # pyright: ignore[reportArgumentType]
    simulator = DrapeSimulator(mesh, settings)
    cloth = uniform_material(density=0.2, bending=1e-3, stretch=5e4)
    assert 0.2 < float(softening(cloth, mesh)) < 0.9
    start = simulator.drape(cloth) if mode == "equilibrium" else None
    weight = torch.from_numpy(np.random.default_rng(3).normal(size=(mesh.vertices, 3)))

    def loss(by: torch.Tensor) -> torch.Tensor:
        moved = replace(cloth, stretch=cloth.stretch * (1 + by[0]), bending=cloth.bending * (1 + by[1]))
        return (simulator.drape(moved, warm=start).vertices * weight).sum()

    at = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(loss(at), at)
    with torch.no_grad():
        for entry in range(2):
            step = torch.zeros(2, dtype=torch.float64)
            step[entry] = 1e-5
            difference = float(loss(step) - loss(-step)) / 2e-5
            assert float(slope[entry]) == pytest.approx(difference, rel=1e-4)


def test_a_word_that_is_none_is_refused():
    with pytest.raises(SimulationError, match="membrane must be softened or given, got 'limp'"):
        DrapeSettings(law="plate", membrane="limp")  # pyright: ignore[reportArgumentType]
