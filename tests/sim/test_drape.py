"""The simulator's entry point: materials, random shapes, settings, and what happens when a drape cannot be had."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
import torch
from scipy.interpolate import LinearNDInterpolator

from cusick_bench.sim.cloth.material import Material, project_admissible, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.cloth.shape import dihedral_angles, smooth_field
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.drape import Drape, DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import CusickError, DrapeDiverged, SimulationError

MESH = disc_mesh(100)


def _material(**changes) -> Material:
    return dataclasses.replace(uniform_material(density=0.2, bending=1e-4), **changes)


# --- materials --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stretch": torch.ones(4, 6)}, r"stretch must have shape \(6, 4\)"),
        ({"stretch": torch.ones(2, 2, 6, 4)}, "stretch must have shape"),
        ({"bending": torch.ones(15)}, r"bending must have shape \(3, 5\)"),
        ({"density": torch.ones(2, 2)}, "density must have shape"),
        ({"stretch": torch.full((6, 4), torch.nan)}, "stretch must be finite.*nan at index"),
        ({"bending": torch.full((3, 5), torch.inf)}, "bending must be finite.*inf at index"),
        ({"density": torch.tensor(torch.nan)}, "density must be finite"),
        ({"density": torch.tensor(0.0)}, "areal density must be > 0"),
        ({"density": torch.tensor(-0.1)}, r"areal density must be > 0 kg/m2, got -0\.1"),
    ],
)
@pytest.mark.unchecked_arrays
def test_impossible_materials_are_refused(changes: dict, message: str):
    with pytest.raises(SimulationError, match=message):
        _material(**changes)


@pytest.mark.parametrize(("name", "value"), [("bending", 0.0), ("stretch", -1.0), ("shear", float("nan"))])
def test_uniform_material_refuses_stiffness_that_is_not_positive(name: str, value: float):
    with pytest.raises(SimulationError, match=f"{name} stiffness must be > 0"):
        uniform_material(**({"density": 0.2, "bending": 1e-5} | {name: value}))


@pytest.mark.parametrize("name", ["density", "bending", "stretch", "shear", "poisson"])
@pytest.mark.unchecked_arrays
def test_uniform_material_refuses_a_gradient_that_it_would_lose(name: str):
    value = torch.tensor(0.2, dtype=torch.float64, requires_grad=True)
    for given in [value, (0.1, value, 0.1)] if name == "bending" else [value]:
        with pytest.raises(SimulationError, match=f"{name} must be a number, got a tensor with a gradient"):
            uniform_material(**({"density": 0.2, "bending": 1e-5} | {name: given}))


@pytest.mark.unchecked_arrays
def test_uniform_material_takes_one_bending_stiffness_or_three():
    with pytest.raises(SimulationError, match=r"bending must be one number or three .*, got shape \(2,\)"):
        uniform_material(density=0.2, bending=(1e-5, 2e-5))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("name", "shape"), [("stretch", (7, 6, 4)), ("bending", (7, 3, 5)), ("density", (7,))])
def test_tables_of_another_mesh_are_refused(name: str, shape: tuple):
    with pytest.raises(SimulationError, match=f"{name} has 7 tables"):
        DrapeSimulator(MESH).drape(_material(**{name: torch.ones(shape)}))


def test_vertex_masses_add_up_to_the_cloth():
    density = torch.linspace(0.1, 0.3, len(MESH.faces), dtype=torch.float64)
    mass = _material(density=density).vertex_mass(MESH)
    assert float(mass.sum()) == pytest.approx(float((density.numpy() * MESH.areas).sum()), rel=1e-12)
    assert float(_material().vertex_mass(MESH).sum()) == pytest.approx(0.2 * MESH.areas.sum(), rel=1e-12)


def _clipped(table: np.ndarray, floor: float) -> np.ndarray:
    """Nearest table with eigenvalues of [[c11, c12], [c12, c22]] and c33 of at least `floor`: clip them."""
    out = table.copy()
    for row in out:
        values, vectors = np.linalg.eigh([[row[0], row[1]], [row[1], row[2]]])
        clipped = vectors @ np.diag(np.maximum(values, floor)) @ vectors.T
        row[:] = clipped[0, 0], clipped[0, 1], clipped[1, 1], max(row[3], floor)
    return out


@pytest.mark.parametrize("tables", [(), (9,)], ids=["shared", "per element"])
def test_projection_is_the_nearest_admissible_cloth(tables: tuple):
    """In the Frobenius norm of the symmetric matrix, the nearest one has its eigenvalues clipped at the margin."""
    generator = np.random.default_rng(0)
    stretch = generator.normal(20, 60, (*tables, 6, 4))
    bending = generator.normal(1e-5, 2e-5, (*tables, 3, 5))
    given = _material(stretch=torch.from_numpy(stretch), bending=torch.from_numpy(bending))
    found = project_admissible(given, margin=1e-2)
    flat = stretch.reshape(-1, 4)
    expected = _clipped(flat, 1e-2 * np.abs(flat[:, [0, 2]]).mean())
    assert np.abs(expected - flat).max() > 10  # the draw was far from admissible
    assert found.stretch.shape == stretch.shape
    assert np.abs(found.stretch.numpy().reshape(-1, 4) - expected).max() < 1e-3
    assert np.array_equal(found.bending.numpy(), np.maximum(bending, 1e-2 * np.abs(bending).mean()))


def test_projection_refuses_tables_without_magnitude():
    """Their margin is 0, and so was the bending stiffness of the projected cloth."""
    nothing = torch.zeros(3, 5, dtype=torch.float64)
    with pytest.raises(SimulationError, match="bending must have a magnitude"):
        project_admissible(_material(bending=nothing))
    with pytest.raises(SimulationError, match="stretch must have a magnitude"):
        project_admissible(_material(stretch=torch.zeros(6, 4, dtype=torch.float64)))
    for margin in (0.0, -1e-3, float("nan")):
        with pytest.raises(SimulationError, match="margin must be > 0 and finite"):
            project_admissible(_material(), margin=margin)


def test_projection_leaves_an_admissible_cloth_alone():
    given = _material(stretch=torch.tensor([100.0, -20.0, 60.0, 10.0], dtype=torch.float64).repeat(6, 1))
    found = project_admissible(given)
    assert float((found.stretch - given.stretch).abs().max()) < 1e-3
    assert torch.equal(found.bending, given.bending)


def test_projection_keeps_density_and_poissons_ratio():
    given = _material(stretch=torch.full((6, 4), -1.0), density=torch.tensor(0.3), poisson=torch.tensor(0.25))
    found = project_admissible(given)
    assert (float(found.density), float(found.poisson)) == pytest.approx((0.3, 0.25))


def test_projection_refuses_a_gradient_that_it_would_lose():
    given = _material()
    given.stretch.requires_grad_()
    with pytest.raises(SimulationError, match="must have no gradient"):
        project_admissible(given)
    with torch.no_grad():
        assert not project_admissible(given).stretch.requires_grad


# --- random shapes ----------------------------------------------------------------------------------------------------


def test_smooth_fields_have_the_asked_deviation_and_correlation():
    """Covariance a^2 exp(-d^2 / 2 l^2), over draws."""
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.02], [0.03, 0.03]])
    draws = np.array([smooth_field(2e-3, 0.02, np.random.default_rng(seed))(points) for seed in range(1500)])
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = 2e-3**2 * np.exp(-(distance**2) / (2 * 0.02**2))
    assert np.abs(draws.mean(0)).max() < 4 * 2e-3 / np.sqrt(1500)
    assert np.abs(np.cov(draws.T) - expected).max() < 0.15 * 2e-3**2


def test_the_same_seed_lays_any_mesh_down_alike():
    coarse, fine = (DrapeSimulator(disc_mesh(n)) for n in (297, 1205))
    between = LinearNDInterpolator(fine.mesh.material, fine.laid_down(seed=3)[:, 2])
    inner = np.hypot(*coarse.mesh.material.T) < 0.99 * CLOTH_RADIUS
    interpolated = between(coarse.mesh.material[inner])
    same, *others = (coarse.laid_down(seed=seed)[inner, 2] for seed in (3, *range(10, 40)))
    assert np.corrcoef(interpolated, same)[0, 1] > 0.999
    strangers = [np.corrcoef(interpolated, other)[0, 1] for other in others]
    assert abs(np.mean(strangers)) < 0.15  # a single one may be as far as 0.5 from 0: a cloth has few humps
    assert np.max(np.abs(strangers)) < 0.6


def test_cloth_is_laid_flat_on_the_plate_and_uneven_around_it():
    simulator = DrapeSimulator(disc_mesh(297), DrapeSettings(laying_amplitude=2e-3))
    z = simulator.laid_down()[:, 2]
    radius = np.hypot(*simulator.mesh.material.T)
    assert (z[radius <= PLATE_RADIUS] == 0).all()
    assert 1e-3 < z[radius > PLATE_RADIUS + 0.01].std() < 4e-3


def test_angles_are_positive_where_the_cloth_is_convex_and_measure_its_curvature():
    x, y = MESH.material.T
    dome = torch.from_numpy(np.column_stack([x, y, -0.5 * (x**2 + y**2)]))
    angles = dihedral_angles(dome, MESH.hinges)
    assert (angles > 0).all()
    assert torch.allclose(dihedral_angles(dome * torch.tensor([1.0, 1.0, -1.0]), MESH.hinges), -angles)
    assert float(DrapeSimulator(MESH).rest_angles().abs().max()) == 0
    assert float(DrapeSimulator(MESH, DrapeSettings(rest_amplitude=1e-3)).rest_angles().abs().max()) > 1e-3


def test_the_rest_shape_goes_with_a_cloth_that_lies_beside_the_axis():
    settings, beside = DrapeSettings(rest_amplitude=1e-3), Mesh(MESH.material + np.array([0.03, -0.01]), MESH.faces)
    angles, moved = (DrapeSimulator(mesh, settings).rest_angles(3) for mesh in (MESH, beside))
    torch.testing.assert_close(moved, angles, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("amplitude", "length"), [(-1.0, 0.03), (1e-3, 0.0), (np.nan, 0.03), (1e-3, np.inf)])
def test_impossible_fields_are_refused(amplitude: float, length: float):
    with pytest.raises(SimulationError, match="amplitude >= 0 and length > 0"):
        smooth_field(amplitude, length, np.random.default_rng(0))


# --- settings and drapes ----------------------------------------------------------------------------------------------


NUMBERS = [field.name for field in dataclasses.fields(DrapeSettings) if field.type == "float"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mode": "fall"}, "mode must be one of drop, equilibrium, got 'fall'"),
        ({"support": "glue"}, "support must be one of fixed, springs"),
        ({"clamp": "glue"}, "clamp must be half or whole, got 'glue'"),
        ({"steps": 0}, "steps must be > 0"),
        ({"step_seconds": -0.05}, "step_seconds must be > 0"),
        ({"gravity": float("nan")}, "gravity must be > 0 and finite, got nan"),
        ({"plate_radius": 0.0}, "plate_radius must be > 0"),
        ({"mode": "equilibrium", "law": "published"}, "no energy"),
        ({"law": None}, "law must be one of plate, paper, published, got None"),
        ({"law": "hooke"}, "law must be one of plate, paper, published, got 'hooke'"),
        ({"steps": "100"}, "steps must be a whole number, got '100'"),
        ({"steps": 1.5}, "steps must be a whole number, got 1.5"),
        ({"steps": True}, "steps must be a whole number, got True"),
        ({"iterations": float("inf")}, "iterations must be a whole number, got inf"),
        ({"seed": -1}, "seed must be >= 0, got -1"),
        ({"seed": None}, "seed must be a whole number, got None"),
        ({"backend": None}, "backend must be the name of a linear solver, or auto, got None"),
        *(({name: "1"}, f"{name} must be a number, got '1'") for name in NUMBERS),
        *(({name: None}, f"{name} must be a number, got None") for name in NUMBERS),
        *(({name: float("nan")}, "got.* nan") for name in NUMBERS),
        *(({name: float("inf")}, "got.* inf") for name in NUMBERS),
    ],
)
def test_impossible_settings_are_refused(changes: dict, message: str):
    with pytest.raises(SimulationError, match=message):
        DrapeSettings(**changes)
    assert issubclass(SimulationError, ValueError)


def test_numbers_of_numpy_are_settings():
    asked = DrapeSettings(steps=np.int64(7), gravity=np.float32(9.5), seed=np.uint8(3))  # pyright: ignore[reportArgumentType]
    assert asked == DrapeSettings(steps=7, gravity=9.5, seed=3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plate_radius": 0.2}, "larger than the cloth"),
        ({"plate_radius": 1e-6}, "nothing holds the cloth"),
        ({"laying_amplitude": -1.0}, "amplitude >= 0"),
        ({"backend": "abacus"}, "linear solver must be one of"),
    ],
)
def test_settings_that_do_not_fit_are_refused_when_draping(changes: dict, message: str):
    with pytest.raises(SimulationError, match=message):
        DrapeSimulator(MESH, DrapeSettings(**changes)).drape(_material())


def test_initial_shape_and_rest_angles_must_fit_the_mesh():
    simulator = DrapeSimulator(MESH)
    flat = torch.from_numpy(MESH.flat.copy())
    for wrong in (flat[:-1], flat * torch.nan):
        with pytest.raises(SimulationError, match="initial must be finite with shape"):
            simulator.drape(_material(), initial=wrong)
    with pytest.raises(SimulationError, match="rest_angle must be finite with shape"):
        simulator.drape(_material(), rest_angle=torch.zeros(3, dtype=torch.float64))


def test_the_shape_of_another_laying_is_taken_as_it_is_given():
    simulator = DrapeSimulator(MESH, DrapeSettings(steps=3))
    laid = simulator.laid_down(seed=7)
    drapes = [simulator.drape(_material(), initial=one).vertices for one in (laid, torch.from_numpy(laid))]
    assert torch.equal(*drapes)
    assert not torch.equal(drapes[0], simulator.drape(_material()).vertices)


@pytest.mark.unchecked_arrays
def test_an_array_that_is_filled_again_changes_no_earlier_cloth():
    """Every cloth of a loop over one array had the stiffness of the last."""
    table = np.full((3, 5), 1e-5)
    cloth = Material(torch.ones(6, 4, dtype=torch.float64), table, 0.2)  # pyright: ignore[reportArgumentType]
    table *= 10
    assert (cloth.bending == 1e-5).all()


def test_arrays_are_shapes_of_a_batch_as_tensors_are():
    simulator = DrapeSimulator(MESH, DrapeSettings(steps=2))
    laid, angles = np.stack([simulator.laid_down(seed) for seed in (1, 2)]), simulator.rest_angles(3).expand(2, -1)
    cloths = [_material(), _material()]
    given = simulator.drape_batch(cloths, initial=torch.from_numpy(laid), rest_angle=angles)
    assert torch.equal(simulator.drape_batch(cloths, initial=laid, rest_angle=angles.numpy()).vertices, given.vertices)
    alone = simulator.drape(_material(), initial=laid[0], rest_angle=angles[0].numpy())
    assert torch.allclose(alone.vertices, given.vertices[0], atol=1e-9)


def test_a_drape_that_does_not_come_to_rest_says_so_and_what_to_do():
    simulator = DrapeSimulator(MESH, DrapeSettings(mode="equilibrium", steps=1, iterations=2))
    with pytest.raises(DrapeDiverged, match=r"after 2 Newton steps \(tolerance 1e-09\); raise `iterations`"):
        simulator.drape(_material())
    assert issubclass(DrapeDiverged, CusickError)
    batch = simulator.drape_batch([_material()])
    assert np.isnan(batch.residual).all()
    assert torch.isnan(batch.vertices).all()


def test_a_drop_that_blows_up_says_in_which_step():
    with pytest.raises(DrapeDiverged, match="step 1 of 100"), np.errstate(over="ignore", invalid="ignore"):
        DrapeSimulator(MESH, DrapeSettings(gravity=1e308)).drape(_material(density=torch.tensor(1e5)))


def test_a_short_drop_is_reported_as_not_at_rest_and_a_long_one_as_at_rest():
    short, long = (DrapeSimulator(MESH, DrapeSettings(steps=n)).drape(_material(bending=torch.full((3, 5), 1e-3)))
                   for n in (2, 60))  # fmt: skip
    assert not short.converged
    assert long.converged
    assert long.residual < 1e-3 < short.residual
    assert long.iterations == 60


def test_warm_start_follows_the_branch_in_few_steps():
    simulator = DrapeSimulator(MESH, DrapeSettings(mode="equilibrium"))
    bending = torch.full((3, 5), 3e-4)
    cold = simulator.drape(_material(bending=bending))
    warm = simulator.drape(_material(bending=1.02 * bending), warm=cold)
    again = simulator.drape(_material(bending=bending), warm=warm)
    assert max(warm.iterations, again.iterations) <= 6
    moved = float((warm.vertices - cold.vertices).abs().max())
    assert 1e-5 < moved < 5e-3
    assert float((again.vertices - cold.vertices).abs().max()) < 1e-7


def test_warm_starts_are_for_equilibria():
    flat = Drape(torch.from_numpy(MESH.flat), True, 0.0, 0.0, 0)
    with pytest.raises(SimulationError, match="mode 'equilibrium'"):
        DrapeSimulator(MESH).drape(_material(), warm=flat)


@pytest.mark.parametrize("support", ["fixed", "springs"])
def test_cloth_stays_on_its_plate_and_hangs_around_it(support):
    drape = DrapeSimulator(MESH, DrapeSettings(support=support, steps=60)).drape(_material())
    radius = np.hypot(*MESH.material.T)
    z = drape.vertices[:, 2].numpy()
    assert np.abs(z[radius < PLATE_RADIUS - 1e-6]).max() <= (0 if support == "fixed" else 1e-3)
    assert z[MESH.boundary].max() < -5e-3
    held = radius[radius < PLATE_RADIUS + 1e-9 if support == "fixed" else radius < PLATE_RADIUS - 1e-9].max()
    assert z.min() > -1.1 * (CLOTH_RADIUS - held)  # it hangs no lower than the cloth, little stretched, is long


@pytest.mark.parametrize("vertices", [150, 297])
def test_springs_leave_all_of_the_plates_edge_free(vertices: int):
    """Rounding puts some vertices of its ring a last digit inside, and these were held."""
    mesh = disc_mesh(vertices)
    radius = np.hypot(*mesh.material.T)
    on_edge = np.isclose(radius, PLATE_RADIUS, rtol=0, atol=1e-9)
    assert (radius[on_edge] < PLATE_RADIUS).any()
    held = DrapeSimulator(mesh, DrapeSettings(support="springs")).system.spring > 0
    np.testing.assert_array_equal(held, (radius < PLATE_RADIUS) & ~on_edge)


def test_springs_need_a_vertex_within_the_plates_edge():
    """On this mesh all that lies on the plate is the ring on its edge, which springs leave free."""
    mesh = disc_mesh(150, plate_radius=0.02)
    DrapeSimulator(mesh, DrapeSettings(plate_radius=0.02))
    with pytest.raises(SimulationError, match=r"within the edge of the plate of radius 0\.02 m: nothing holds"):
        DrapeSimulator(mesh, DrapeSettings(plate_radius=0.02, support="springs"))


def test_the_same_drape_twice_is_bitwise_the_same():
    first, second = (DrapeSimulator(MESH, DrapeSettings(steps=20)).drape(_material()).vertices for _ in range(2))
    assert torch.equal(first, second)


@pytest.mark.parametrize("law", ["plate", "paper"])
def test_a_simulator_that_has_draped_can_be_copied_and_sent_to_another_process(law: str):
    simulator = DrapeSimulator(cloth_mesh(law, 80), DrapeSettings(law=law, steps=2))  # pyright: ignore[reportArgumentType]
    drape = simulator.drape(_material()).vertices
    for other in (pickle.loads(pickle.dumps(simulator)), copy.deepcopy(simulator)):
        assert torch.equal(other.drape(_material()).vertices, drape)


def test_cloth_on_the_edge_of_the_plate_is_held():
    drape = DrapeSimulator(MESH, DrapeSettings(steps=20)).drape(_material())
    on_edge = np.isclose(np.hypot(*MESH.material.T), PLATE_RADIUS, rtol=0, atol=1e-9)
    assert on_edge.sum() > 10  # the mesher puts vertices there
    moved = np.abs(drape.vertices[on_edge].numpy() - MESH.flat[on_edge])
    assert moved.max() < 1e-15  # [m]; weight and stiffness act on it, it stays to the last digit


@pytest.mark.parametrize("decimals", [8, 6])
@pytest.mark.parametrize(("law", "support"), [("paper", "fixed"), ("published", "springs"), ("plate", "fixed")])
def test_coordinates_that_a_file_has_rounded_hold_the_same_vertices(law, support, decimals):
    """Two thirds of the plate's edge came free in a mesh of six decimals, and the cloth hung 13 points deeper."""
    mesh = cloth_mesh(law, 297)
    rounded = Mesh(np.round(mesh.material, decimals), mesh.faces)
    assert not np.array_equal(rounded.material, mesh.material)
    settings = DrapeSettings(law=law, support=support)
    exact, found = (DrapeSimulator(one, settings).system for one in (mesh, rounded))
    assert np.array_equal(found.free, exact.free)
    if law != "plate":
        assert np.array_equal(found.spring, exact.spring)


def test_gradients_of_many_drapes_keep_the_storage_of_one(monkeypatch):
    """Of a batch of drapes that are differentiated together all factors were kept as long as the simulator lived."""
    simulator = DrapeSimulator(disc_mesh(80), DrapeSettings(steps=5))
    material = uniform_material(density=0.2, bending=1e-4)
    material.bending.requires_grad_()
    sum(simulator.drape(material).vertices.square().sum() for _ in range(3)).backward()
    assert 0 < len(simulator.system.linear._spare) <= 5
