"""Stiffness from three-dimensional shapes: the linear map, what it recovers, what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.metrics.distances.ruled import ruled_surface
from cusick_bench.problem import Budget, DrapeProblem, HomogeneousSpace, Meter, StiffnessPrior, TrainMesh
from cusick_bench.problem.train_mesh import with_reference
from cusick_bench.sim.cloth.heterogeneity import modulated
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.shape import dihedral_angles, smooth_field
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.triangles.force_basis import stiffness, unit_forces
from cusick_bench.sim.engine.triangles.force_modes import field_modes, uneven_forces
from cusick_bench.sim.reference.laws import Reference, TorchParameters
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.convex import force_balance
from cusick_bench.solvers.convex.equilibrium_gap import EquilibriumGap, edge_strain
from cusick_bench.solvers.convex.force_balance import (
    NAMES,
    Errors,
    Shape,
    balance,
    relative_scale,
    tables_at,
    whitened,
)

DENSITY = 0.2  # [kg/m2]
VERTICES = 150
PRIOR = StiffnessPrior("paper", DENSITY)
ROUNDED = Errors(3e-6, 0.02)  # of meshes written to 0.01 mm


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return disc_mesh(VERTICES)


def _mass(mesh: Mesh) -> np.ndarray:
    return DENSITY * np.bincount(mesh.faces.ravel(), np.repeat(mesh.areas / 3, 3), mesh.vertices)


def _drape(mesh: Mesh, tau: np.ndarray, seed: int) -> Shape:
    """A drape at rest of a cloth without rest shape, written to 0.01 mm."""
    simulator = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", seed=seed))
    material = HomogeneousSpace(mesh, PRIOR).specimen(torch.as_tensor(tau)).material
    drape = simulator.drape(material, rest_angle=torch.zeros(len(mesh.hinges), dtype=torch.float64))
    return Shape(simulator.system, np.round(drape.vertices.numpy(), 5), _mass(mesh))


def _problem(train_mesh: TrainMesh | None, mesh: Mesh, **settings) -> DrapeProblem:
    simulator = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", **settings))
    vertices = mesh.flat if train_mesh is None else train_mesh.vertices
    faces = mesh.faces if train_mesh is None else train_mesh.faces
    image = render(torch.as_tensor(vertices), faces, ParallelCamera()).numpy()
    return DrapeProblem(
        train_image=image,
        simulator=simulator,
        space=HomogeneousSpace(mesh, PRIOR),
        meter=Meter(Budget(5)),
        train_mesh=train_mesh,
    )


def _ruled(mesh: Mesh, folds: int = 8) -> np.ndarray:
    """Positions of a surface built from a silhouette, on the triangles of a flat mesh."""
    x, y = mesh.material.T
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    along = np.maximum(radius - 0.09, 0)
    rise = (0.55 + 0.25 * np.cos(folds * angle)) * along
    out = np.minimum(radius, 0.09) + rise
    return np.column_stack([out * np.cos(angle), out * np.sin(angle), -np.sqrt(along**2 - rise**2)])


class TestForceBasis:
    @pytest.mark.parametrize("law", ["paper", "published"])
    def test_unit_forces_add_up_to_those_of_any_cloth(self, mesh, law):
        generator = np.random.default_rng(0)
        system = DrapeSimulator(mesh, DrapeSettings(law=law)).system
        x = mesh.flat + generator.normal(0, 1e-3, (mesh.vertices, 3))
        rest = generator.normal(0, 0.1, len(mesh.hinges))
        theta = np.exp(generator.normal(0, 1, 39))
        reference = Reference(system)
        parameters = TorchParameters(
            torch.from_numpy(theta[:24].reshape(1, 6, 4)),
            torch.from_numpy(theta[24:].reshape(1, 3, 5)),
            torch.zeros(mesh.vertices, dtype=torch.float64),
            torch.from_numpy(rest),
        )
        expected = reference.forces(torch.from_numpy(x), torch.from_numpy(x), parameters).detach().numpy()
        found = unit_forces(system, x, rest) @ theta
        assert found == pytest.approx(expected[system.free].ravel(), abs=1e-9 * np.abs(expected).max())

    def test_stiffness_is_minus_the_derivative_of_the_forces(self, mesh):
        generator = np.random.default_rng(1)
        system = DrapeSimulator(mesh, DrapeSettings()).system
        x = mesh.flat + generator.normal(0, 1e-3, (mesh.vertices, 3))
        rest, theta = np.zeros(len(mesh.hinges)), tables_at(PRIOR, np.zeros(39))[0]
        way = np.zeros_like(x)
        way[system.free] = generator.standard_normal((len(system.free), 3))
        ahead, behind = (unit_forces(system, x + step * way, rest) @ theta for step in (1e-8, -1e-8))
        matrix = stiffness(system, x, theta, rest)
        product = matrix @ way[system.free].ravel()
        assert product == pytest.approx((behind - ahead) / 2e-8, abs=1e-5 * np.abs(product).max())
        assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()


class TestUnevenForces:
    """First order in the fields, against the forces of a cloth that has them."""

    def test_forces_of_a_rest_shape_and_of_uneven_stiffness(self, mesh):
        generator = np.random.default_rng(7)
        system = DrapeSimulator(mesh, DrapeSettings()).system
        x = _ruled(mesh)
        theta = tables_at(PRIOR, np.zeros(39))[0]
        modes = field_modes(mesh, 0.05)
        columns = uneven_forces(system, x, theta, modes, modes)
        weights = np.split(generator.standard_normal(3 * modes.shape[1]), 3)
        rest, on_faces, on_hinges = (1e-4 * modes @ weight for weight in weights)
        parameters = TorchParameters(
            torch.from_numpy(theta[:24].reshape(1, 6, 4))
            * torch.from_numpy(np.exp(on_faces[mesh.faces].mean(1)))[:, None, None],
            torch.from_numpy(theta[24:].reshape(1, 3, 5))
            * torch.from_numpy(np.exp(on_hinges[mesh.hinges[:, :2]].mean(1)))[:, None, None],
            torch.zeros(mesh.vertices, dtype=torch.float64),
            dihedral_angles(torch.from_numpy(np.column_stack([mesh.material, rest])), mesh.hinges)
            * torch.from_numpy(system.elements.hinge_share),  # as drapes have it, of which a clamp bends in part
        )
        reference = Reference(system)
        uneven = reference.forces(torch.from_numpy(x), torch.from_numpy(x), parameters).detach().numpy()
        change = uneven[system.free].ravel() - unit_forces(system, x, np.zeros(len(mesh.hinges))) @ theta
        predicted = columns @ (1e-4 * np.concatenate(weights))
        assert predicted == pytest.approx(change, abs=2e-2 * np.abs(change).max())

    def test_modes_have_the_covariance(self, mesh):
        modes = field_modes(mesh, 0.05)
        distance = np.linalg.norm(mesh.material[:, None] - mesh.material[None], axis=2)
        assert modes @ modes.T == pytest.approx(np.exp(-0.5 * (distance / 0.05) ** 2), abs=0.05)
        assert modes.shape[1] < 0.6 * mesh.vertices


class TestPriorMap:
    def test_whitening_is_undone(self):
        tau = np.random.default_rng(2).standard_normal(39)
        theta, slope = tables_at(PRIOR, tau)
        assert whitened(PRIOR, theta) == pytest.approx(tau, abs=1e-9)
        step = 1e-6 * np.random.default_rng(3).standard_normal(39)
        moved = (tables_at(PRIOR, tau + step)[0] - tables_at(PRIOR, tau - step)[0]) / 2
        assert slope @ step == pytest.approx(moved, rel=1e-6, abs=1e-9 * np.abs(moved).max())


class TestRecovery:
    """Cloths drawn from the prior, drapes written to 0.01 mm, several ways of laying them down."""

    @pytest.mark.parametrize("seed", [5])
    def test_identifiable_combinations_are_found_within_five_per_cent(self, mesh, seed):
        truth = 0.5 * np.random.default_rng(seed).standard_normal(39)
        theta, _ = tables_at(PRIOR, truth)
        found = balance([_drape(mesh, truth, laying) for laying in (0, 1)], PRIOR, ROUNDED)
        relative = (found.theta - theta) / relative_scale(theta)
        known = found.identifiable
        assert known.sum() >= 8
        assert np.abs(found.directions[known] @ relative).max() < 0.05
        # stretch at rest and bending where the cloth is bent are told apart entry by entry
        for name in ("C[0,c11]", "C[0,c22]", "C[0,c33]", "B[0,40]", "B[45,40]", "B[90,40]"):
            assert found.relative_sd[NAMES.index(name)] < 0.05
            assert abs(relative[NAMES.index(name)]) < 0.05
        assert found.misfit == pytest.approx(1.0, abs=0.25)
        assert found.correction == pytest.approx(1e-5 / np.sqrt(12), rel=0.15)

    def test_what_the_shape_does_not_show_is_said_to_be_unknown(self, mesh):
        """A drape's membrane strain is a hundredth of the samples 1 to 5: their entries hardly act."""
        found = balance([_drape(mesh, np.zeros(39), 0)], PRIOR, ROUNDED)
        stretched = [k for k, name in enumerate(NAMES) if name.startswith("C[") and not name.startswith("C[0")]
        assert np.median(found.relative_sd[stretched]) > 1.0
        unseen = found.directions[found.singular_values < 0.5]
        assert len(unseen) > 5
        share = np.square(unseen[:, stretched]).sum(1)
        assert share.mean() > 0.7

    def test_errors_of_the_estimate_are_as_large_as_it_says(self, mesh):
        """Normalised errors of identifiable combinations over cloths have a variance of about 1."""
        scores = []
        for seed in range(3):
            truth = 0.5 * np.random.default_rng([seed, 9]).standard_normal(39)
            theta, _ = tables_at(PRIOR, truth)
            found = balance([_drape(mesh, truth, seed)], PRIOR, ROUNDED)
            known = found.identifiable
            relative = found.directions[known] @ ((found.theta - theta) / relative_scale(theta))
            scores.extend(relative * found.singular_values[known])
        assert len(scores) > 15
        assert 0.2 < np.mean(np.square(scores)) < 2.5

    def test_uneven_cloths_of_unknown_rest_shape(self, mesh):
        """With what the model leaves out in its errors the fit is as good as it says; without, it is too sure."""
        theta, _ = tables_at(PRIOR, np.zeros(39))
        generator = np.random.default_rng(8)
        material = HomogeneousSpace(mesh, PRIOR).specimen(torch.zeros(39, dtype=torch.float64)).material
        material = modulated(material, mesh, *(smooth_field(0.1, 0.03, generator) for _ in range(2)))
        rest = mesh.flat.copy()
        rest[:, 2] = smooth_field(4e-4, 0.03, generator)(mesh.material)
        simulator = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium"))
        drape = simulator.drape(material, rest_angle=dihedral_angles(torch.from_numpy(rest), mesh.hinges))
        shape = Shape(simulator.system, np.round(drape.vertices.numpy(), 5), _mass(mesh))
        naive = balance([shape], PRIOR, ROUNDED)
        aware = balance([shape], PRIOR, Errors(3e-6, 0.02, 4e-4, 0.03, 0.1, 0.03))
        assert naive.misfit > 2 * aware.misfit
        assert aware.misfit < 1.5
        known = aware.identifiable
        assert known.sum() >= 3
        relative = aware.directions[known] @ ((aware.theta - theta) / relative_scale(theta))
        assert np.abs(relative).max() < 0.1
        assert np.mean(np.square(relative * aware.singular_values[known])) < 3

    def test_tables_are_admissible_even_on_nonsense(self, mesh):
        shape = _drape(mesh, np.zeros(39), 0)
        spoilt = shape.x + np.random.default_rng(4).normal(0, 1e-3, shape.x.shape)
        found = balance([Shape(shape.system, spoilt, shape.mass)], PRIOR, ROUNDED)
        table, bending = found.theta[:24].reshape(6, 4), found.theta[24:]
        assert (table[:, 0] * table[:, 2] > table[:, 1] ** 2).all()
        assert (table[:, [0, 2, 3]] > 0).all()
        assert (bending > 0).all()
        assert found.misfit > 25


class TestSolver:
    def test_answer_is_the_drape_of_the_fitted_tables(self, mesh):
        truth = HomogeneousSpace(mesh, PRIOR).bending_level(2.0)
        shape = _drape(mesh, truth, 0)
        problem = _problem(TrainMesh(shape.x, mesh.faces, mesh.material), mesh)
        answer = EquilibriumGap(rest_height=0, unevenness=0).solve(problem, np.random.default_rng(0))
        assert answer.tau is not None
        assert problem.meter.forward_equivalents == 1
        level = (PRIOR.bending_root @ (answer.tau[24:] - truth[24:])).reshape(3, 5)
        assert np.abs(level[:, 3:]).max() < 0.1
        assert answer.train_image == pytest.approx(problem.image(answer.tau), abs=1e-9)
        assert set(answer.notes["entries"]) == set(NAMES)
        assert answer.notes["entries"]["B[0,40]"]["identifiable"]
        assert not answer.notes["entries"]["C[3,c11]"]["identifiable"]
        assert len(answer.notes["combinations"]) == 39
        assert answer.notes["edge_strain_rms"] < 0.01

    def test_the_drape_of_a_fit_that_took_all_the_time_is_granted(self, mesh, monkeypatch):
        shape = _drape(mesh, HomogeneousSpace(mesh, PRIOR).bending_level(2.0), 0)
        problem = _problem(TrainMesh(shape.x, mesh.faces, mesh.material), mesh)
        problem = replace(problem, meter=Meter(Budget(seconds=1.0)))
        fitted = force_balance.balance

        def slowly(*words):
            problem.meter._clock_zero -= 60
            return fitted(*words)

        monkeypatch.setattr(force_balance, "balance", slowly)
        answer = EquilibriumGap(rest_height=0, unevenness=0).solve(problem, np.random.default_rng(0))
        assert problem.meter.forward == 1
        assert answer.vertices is not None

    def test_fits_on_the_mesh_of_the_data_not_on_the_simulators(self, mesh):
        shape = _drape(disc_mesh(VERTICES, seed=3), np.zeros(39), 0)
        other = shape.system.mesh
        problem = _problem(TrainMesh(shape.x, other.faces, other.material), mesh)
        answer = EquilibriumGap().solve(problem, np.random.default_rng(0))
        assert answer.vertices is not None
        assert answer.vertices.shape == (mesh.vertices, 3)
        assert answer.notes["misfit"] < 2

    def test_a_drape_on_springs_is_balanced_outside_the_plate(self, mesh):
        """There springs pull at nothing; their own forces would follow from no measured position."""
        space = HomogeneousSpace(mesh, PRIOR)
        truth = space.bending_level(2.0)
        simulator = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", support="springs"))
        drape = simulator.drape(space.specimen(torch.as_tensor(truth)).material).vertices.numpy()
        problem = _problem(TrainMesh(np.round(drape, 5), mesh.faces, mesh.material), mesh, support="springs")
        answer = EquilibriumGap(rest_height=0, unevenness=0).solve(problem, np.random.default_rng(0))
        assert answer.notes["misfit"] < 2
        level = (PRIOR.bending_root @ (answer.tau[24:] - truth[24:])).reshape(3, 5)
        assert np.abs(level[:, 3:]).max() < 0.1

    def test_law_plate_is_refused_with_the_law_to_use(self, mesh):
        problem = _problem(TrainMesh(mesh.flat, mesh.faces, mesh.material), mesh, law="plate")
        with pytest.raises(SolverError, match="--law paper"):
            EquilibriumGap().solve(problem, np.random.default_rng(0))

    def test_without_a_mesh_it_is_refused(self, mesh):
        with pytest.raises(SolverError, match=r"no mesh of it.*folder `meshes`"):
            EquilibriumGap().solve(_problem(None, mesh), np.random.default_rng(0))

    def test_a_mesh_without_flat_shape_is_refused(self, mesh):
        shape = _drape(mesh, np.zeros(39), 0)
        problem = _problem(TrainMesh(shape.x, mesh.faces), mesh)
        with pytest.raises(
            SolverError, match=r"triangles are those of no known flat mesh.*`simulate --law paper --mode"
        ):
            EquilibriumGap().solve(problem, np.random.default_rng(0))

    def test_a_surface_built_from_a_silhouette_says_so(self, mesh):
        angle = np.arange(360) * (2 * np.pi / 360)
        surface = ruled_surface(0.123 + 0.015 * np.cos(8 * angle), strips=4)
        problem = _problem(with_reference(surface.vertices, surface.faces, [mesh]), mesh)
        with pytest.raises(SolverError, match=r"strained by \d+\.\d% rms.*built from a silhouette"):
            EquilibriumGap().solve(problem, np.random.default_rng(0))

    def test_a_surface_built_from_a_silhouette_balances_nothing(self, mesh):
        ruled = _ruled(mesh)
        assert edge_strain(ruled, mesh) > 0.03
        problem = _problem(TrainMesh(ruled, mesh.faces, mesh.material), mesh)
        with pytest.raises(SolverError, match=r"no stiffness holds.*strained by.*gap that is left") as caught:
            EquilibriumGap().solve(problem, np.random.default_rng(0))
        assert "of gravity stay unbalanced whatever the stiffness" in str(caught.value)
        assert "use rests that `simulate --law paper --mode equilibrium --out` writes" in str(caught.value)
        assert problem.meter.forward == 0

    @pytest.mark.parametrize(
        ("name", "value"), [("position", 0.0), ("force", -1.0), ("position", np.nan), ("rest_height", -1.0)]
    )
    def test_errors_must_be_positive(self, name, value):
        with pytest.raises(SolverError, match=f"{name} error must be >"):
            Errors(**{"position": 1e-6, "force": 0.02, name: value})


class TestReference:
    def test_triangles_tell_the_flat_mesh(self, mesh):
        other = disc_mesh(VERTICES, seed=3)
        draped = _ruled(mesh)
        assert with_reference(draped, mesh.faces, (other, mesh)).material is mesh.material
        assert with_reference(draped, mesh.faces, (other,)).material is None

    def test_a_cloth_turned_over_is_mirrored_back(self, mesh):
        draped = _ruled(mesh)
        turned = with_reference(draped * [-1, 1, 1], mesh.faces[:, ::-1], (mesh,))
        assert turned.vertices == pytest.approx(draped)
        assert (turned.faces == mesh.faces).all()
