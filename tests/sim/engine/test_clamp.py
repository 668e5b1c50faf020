"""Hinges on the plate's edge: what of them bends, against the exact plate and against the published way.

`test_gradients` holds their forces, Hessians and adjoints against plain torch.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from cusick_bench.benchmark.convergence.linear_plate import exact_rim_deflection
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.shape import dihedral_angles
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import effect
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.triangles.elements import elements_of
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.history import drop_with_history
from cusick_bench.sim.setup import Setup
from cusick_bench.sim.torch_engine.engine import TORCH_ON_CPU

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(150, seed=1)
POISSON = -1 / 3  # of the hinge energy on equilateral triangles
DENSITY = 0.2  # [kg/m2]


def _system(mesh: Mesh, clamp: str, **settings) -> DrapeSystem:
    return DrapeSimulator(mesh, DrapeSettings(clamp=clamp, **settings)).system  # pyright: ignore[reportArgumentType]


def _on_clamp(mesh: Mesh, fixed: np.ndarray) -> dict[int, float]:
    """Hinges between held and free cloth, with the area of the free face, face by face."""
    areas = {frozenset(face.tolist()): float(area) for face, area in zip(mesh.faces, mesh.areas, strict=True)}
    found = {}
    for number, (start, end, *outer) in enumerate(mesh.hinges.tolist()):
        free = [vertex for vertex in outer if not fixed[vertex]]
        if fixed[start] and fixed[end] and len(free) == 1:
            found[number] = areas[frozenset((start, end, free[0]))]
    return found


def _linear_rim(mesh: Mesh, clamp: str) -> float:
    """The same of a mesh: stiffness of the flat cloth against its weight, mean over the rim [m]."""
    system = _system(mesh, clamp, mode="equilibrium")
    bending = DENSITY * GRAVITY * CLOTH_RADIUS**3
    cloth = uniform_material(density=DENSITY, bending=bending)
    mass = cloth.vertex_mass(mesh).numpy()
    p = Parameters(cloth.stretch[None].numpy(), cloth.bending[None].numpy(), mass, np.zeros(len(mesh.hinges)))
    force, blocks, _ = system.forces(mesh.flat, mesh.flat, p, exact=True)
    moved = np.zeros((mesh.vertices, 3))
    moved[system.free] = system.linear.factorise(blocks).solve(force[system.free])
    return -float(moved[mesh.boundary, 2].mean())


@pytest.mark.parametrize("radius", [PLATE_RADIUS, 0.095], ids=["on the edge", "between vertices"])
def test_hinges_on_the_edge_bend_in_their_free_face_alone(radius: float):
    """Also where the plate's edge runs between vertices, so that the held cloth ends in a jagged line."""
    system = _system(MESH, "half", plate_radius=radius)
    on_clamp = _on_clamp(MESH, system.fixed)
    assert len(on_clamp) > 10
    plain, found = elements_of(MESH), system.elements
    length = plain.hinge_weight / plain.hinge_scale
    for number, area in on_clamp.items():
        assert found.hinge_scale[number] == pytest.approx(length[number] / area, rel=1e-12)
        assert found.hinge_weight[number] == pytest.approx(length[number] ** 2 / area, rel=1e-12)
        assert found.hinge_share[number] == pytest.approx(plain.hinge_scale[number] * area / length[number], rel=1e-12)
    others = np.setdiff1d(np.arange(len(MESH.hinges)), list(on_clamp))
    for name in ("hinge_scale", "hinge_weight", "hinge_share"):
        np.testing.assert_array_equal(getattr(found, name)[others], getattr(plain, name)[others])
    assert (plain.hinge_share == 1).all()


def test_a_clamp_is_about_twice_as_stiff():
    whole, half = (_system(MESH, clamp).elements for clamp in ("whole", "half"))
    on_clamp = list(_on_clamp(MESH, _system(MESH, "half").fixed))
    ratio = half.hinge_weight[on_clamp] / whole.hinge_weight[on_clamp]
    assert ratio.mean() == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize("name", ["with_mesh", "plate-radius"])
def test_a_plate_that_moves_takes_its_half_hinges_along(name: str):
    setup = effect("plate-radius").apply(Setup(MESH, DrapeSettings(), uniform_material(density=DENSITY, bending=1e-5)),
                                         {"error": 0.006})  # fmt: skip
    if name == "with_mesh":
        system = _system(MESH, "half").with_mesh(setup.mesh)
    else:
        system = DrapeSimulator(setup.mesh, setup.settings).system
    on_clamp = _on_clamp(setup.mesh, system.fixed)
    plain = elements_of(setup.mesh)
    area = plain.hinge_weight / plain.hinge_scale**2
    bends = system.elements.hinge_weight / system.elements.hinge_scale**2
    assert on_clamp
    np.testing.assert_allclose(bends[list(on_clamp)], list(on_clamp.values()), rtol=1e-12)
    others = np.setdiff1d(np.arange(len(area)), list(on_clamp))
    np.testing.assert_allclose(bends[others], area[others], rtol=1e-12)


@pytest.mark.parametrize(
    "settings", [{"law": "published"}, {"support": "springs"}, {"law": "published", "support": "springs"}], ids=str
)
def test_published_clamp_and_springs_are_bitwise_as_before(settings: dict[str, Any]):
    cloth = uniform_material(density=DENSITY, bending=1e-5)
    plain = DrapeSettings(steps=8, rest_amplitude=1e-3, **settings)
    default, whole = (DrapeSimulator(MESH, one) for one in (plain, replace(plain, clamp="whole")))
    assert torch.equal(default.drape(cloth).vertices, whole.drape(cloth).vertices)
    for name, value in vars(elements_of(MESH)).items():
        np.testing.assert_array_equal(getattr(default.system.elements, name), value)


def test_law_paper_has_half_hinges_unless_asked_for_whole_ones():
    cloth = uniform_material(density=DENSITY, bending=5e-4)
    plain = DrapeSettings(steps=40)
    asked = (plain, replace(plain, clamp="half"), replace(plain, clamp="whole"))
    default, half, whole = (DrapeSimulator(MESH, one).drape(cloth).vertices for one in asked)
    assert torch.equal(default, half)
    lower = whole[MESH.boundary, 2].mean() / half[MESH.boundary, 2].mean()
    assert float(lower) > 1.15  # a softer clamp lets a stiff cloth hang lower


@pytest.mark.parametrize("settings", [{"law": "published"}, {"support": "springs"}], ids=str)
def test_half_hinges_are_refused_where_there_are_none(settings: dict[str, Any]):
    with pytest.raises(SimulationError, match="clamp 'half' is for law 'paper' on support 'fixed'"):
        DrapeSettings(clamp="half", **settings)


@pytest.mark.parametrize("vertices", [480, 1205])
def test_a_stiff_cloth_hangs_as_deep_as_the_exact_plate(vertices: int):
    """Three meshes each: 1.03 to 1.04 at 480, .98 to .99 at 1205; with whole hinges at least 1.40 and 1.22."""
    mesh = disc_mesh(vertices)
    exact = exact_rim_deflection(POISSON)
    half, whole = (_linear_rim(mesh, clamp) / exact for clamp in ("half", "whole"))
    assert half == pytest.approx(1, abs=0.05 if vertices == 480 else 0.03)
    assert whole > 1.2


def test_the_torch_engine_has_the_same_clamp():
    settings = DrapeSettings(steps=8, rest_amplitude=1e-3)
    cloth = uniform_material(density=DENSITY, bending=1e-5)
    drapes = [DrapeSimulator(MESH, settings, device=device).drape(cloth).vertices for device in ("cpu", TORCH_ON_CPU)]
    np.testing.assert_allclose(drapes[0].numpy(), drapes[1].numpy(), atol=1e-11)


@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
def test_gradients_equal_central_differences(mode: str):
    """To bending stiffness and rest angles of the hinges on the clamp, which are nearly all that it changes."""
    settings = DrapeSettings(mode=mode, steps=5, tolerance=1e-12)  # pyright: ignore[reportArgumentType]
    simulator = DrapeSimulator(MESH, settings)
    on_clamp = list(_on_clamp(MESH, simulator.system.fixed))
    generator = np.random.default_rng(7)
    weight = torch.from_numpy(generator.normal(size=(MESH.vertices, 3)))
    plain = uniform_material(density=DENSITY, bending=3e-5)
    tables = plain.bending.expand(len(MESH.hinges), 3, 5)
    angles = torch.from_numpy(generator.normal(0, 0.02, len(MESH.hinges)))
    chosen = torch.zeros(len(MESH.hinges), dtype=torch.float64)
    chosen[on_clamp] = torch.from_numpy(generator.normal(size=len(on_clamp)))
    start = simulator.drape(Material(plain.stretch.expand(len(MESH.faces), 6, 4), tables, plain.density),
                            rest_angle=angles) if mode == "equilibrium" else None  # fmt: skip

    def loss(stiffer: torch.Tensor, turned: torch.Tensor) -> torch.Tensor:
        bending = tables * (1 + stiffer * chosen)[:, None, None]
        cloth = Material(plain.stretch.expand(len(MESH.faces), 6, 4), bending, plain.density)
        drape = simulator.drape(cloth, rest_angle=angles + turned * chosen, warm=start)
        return (drape.vertices * weight).sum()

    at = [torch.zeros((), dtype=torch.float64, requires_grad=True) for _ in range(2)]
    loss(*at).backward()
    for place, size in enumerate((1e-3, 1e-4)):
        ends = []
        for sign in (1, -1):
            moved = [torch.tensor(sign * size if other == place else 0.0, dtype=torch.float64) for other in range(2)]
            with torch.no_grad():
                ends.append(float(loss(*moved)))
        gradient = at[place].grad
        assert gradient is not None
        assert float(gradient) == pytest.approx((ends[0] - ends[1]) / (2 * size), rel=1e-5)


def _strip(cells: int, size: float) -> Mesh:
    """A strip along x from -2 cells, one cell wide, about the plate's axis; its lines across lie at multiples of x."""
    x = size * np.arange(-2, cells + 1)
    points = np.concatenate([np.column_stack([x, np.full_like(x, y)]) for y in (-size / 2, size / 2)])
    lower, upper = np.arange(len(x)), len(x) + np.arange(len(x))
    quads = [(a, b, d, c) for (a, b), (c, d) in zip(pairwise(lower), pairwise(upper), strict=True)]
    return Mesh(points, np.array([face for a, b, d, c in quads for face in ((a, b, d), (a, d, c))]))


@pytest.mark.parametrize("history", [False, True], ids=["plain", "with history"])
def test_a_curled_strip_without_weight_curls_from_the_clamp_on(history: bool):
    """Cloth that is curled at rest is flat on the plate: the hinge at its edge takes the curl of its free half only."""
    size, curvature = 0.01, 4.0
    mesh = _strip(6, size)
    settings = DrapeSettings(mode="drop" if history else "equilibrium", gravity=1e-4, plate_radius=0.0215,
                             steps=200, step_seconds=0.2, tolerance=1e-4)  # fmt: skip
    simulator = DrapeSimulator(mesh, settings)
    rolled = mesh.flat.copy()
    rolled[:, 2] = -0.5 * curvature * mesh.material[:, 0] ** 2
    rest = dihedral_angles(torch.from_numpy(rolled), mesh.hinges)
    cloth, flat = uniform_material(density=DENSITY, bending=1e-5), torch.from_numpy(mesh.flat)
    if history:
        shape = drop_with_history(simulator, cloth, flat, rest, [])
    else:
        shape = simulator.drape(cloth, initial=flat, rest_angle=rest).vertices
    angle = dihedral_angles(shape, mesh.hinges).numpy()
    along = np.ptp(mesh.material[mesh.hinges[:, :2], 0], axis=1) > 1e-9  # diagonals and the strip's own edges
    place = mesh.material[mesh.hinges[:, 0], 0] / size
    turned, curled = (
        {round(float(at)): float(one) for at, one, skew in zip(place, angles, along, strict=True) if not skew}
        for angles in (angle, rest)
    )
    assert curled[2] == pytest.approx(curvature * size, rel=0.02)
    assert turned[2] == pytest.approx(curled[2] / 2, rel=0.01)
    assert [turned[line] for line in (3, 4, 5)] == pytest.approx([curled[line] for line in (3, 4, 5)], rel=0.01)
    assert [turned[line] for line in (-1, 0, 1)] == pytest.approx([0] * 3, abs=1e-9)
