"""The heterogeneous fit: its smooth prior, its optimiser, and runs that are killed."""

import numpy as np
import pytest
from scipy.optimize import rosen, rosen_der

from cusick_bench.problem import Budget
from cusick_bench.problem.toy import toy_problem
from cusick_bench.sim.mesh import Mesh, disc_mesh
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.heter import Heter, SharedIncumbent
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.quasi_newton import Search, descend
from cusick_bench.solvers.smooth_field import FIELDS, StiffnessField, lumped_mass, stiffness_matrix

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return disc_mesh(800)


class TestField:
    def test_finite_elements_are_exact_for_linear_fields(self, mesh):
        x = mesh.material[:, 0]
        matrix = stiffness_matrix(mesh)
        assert x @ (matrix @ x) == pytest.approx(mesh.areas.sum())
        assert np.abs(matrix @ np.ones(mesh.vertices)).max() < 1e-12
        assert lumped_mass(mesh).sum() == pytest.approx(mesh.areas.sum())

    def test_amplitude_and_correlation_are_as_asked_for(self, mesh):
        """Inside the cloth, away from the rim that reflects: Matern with nu = 1, 0.14 at the given length."""
        field = StiffnessField(mesh, amplitude=0.4, length=0.04)
        generator = np.random.default_rng(0)
        draws = np.concatenate(
            [
                field.deviation(generator.standard_normal(field.dimension))[: 24 * len(mesh.faces)].reshape(-1, 24).T
                for _ in range(12)
            ]
        )
        centre = mesh.material[mesh.faces].mean(1)
        inside = np.hypot(*centre.T) < 0.08
        assert draws[:, inside].std() == pytest.approx(0.4, rel=0.1)
        assert abs(draws[:, inside].mean()) < 0.05
        distance = np.linalg.norm(centre[inside][:, None] - centre[inside][None], axis=2)
        correlation = np.corrcoef(draws[:, inside].T)
        assert correlation[np.abs(distance - 0.04) < 0.002].mean() == pytest.approx(0.14, abs=0.06)
        assert correlation[np.abs(distance - 0.01) < 0.002].mean() > 0.7

    def test_gradients_are_pulled_back_by_the_transpose(self, mesh):
        field = StiffnessField(mesh, amplitude=0.4, length=0.04)
        generator = np.random.default_rng(1)
        z = generator.standard_normal(field.dimension)
        gradient = generator.standard_normal(24 * len(mesh.faces) + 15 * len(mesh.hinges))
        assert field.dimension == FIELDS * mesh.vertices
        assert gradient @ field.deviation(z) == pytest.approx(field.pulled_back(gradient) @ z, rel=1e-9)

    @pytest.mark.parametrize(("name", "value"), [("amplitude", 0.0), ("length", -0.1), ("length", np.nan)])
    def test_nonsense_is_refused(self, mesh, name, value):
        with pytest.raises(SolverError, match=f"{name} must be > 0"):
            StiffnessField(mesh, **{"amplitude": 0.4, "length": 0.04, name: value})


class TestQuasiNewton:
    def test_finds_the_bottom_of_a_curved_valley(self):
        def function(x):
            return float(rosen(x)), rosen_der(x)

        search = Search.at(np.full(6, -1.0), function)
        for _ in range(120):  # steepest descent would need thousands
            found = descend(search, function, first=0.1)
            if found is None:
                break
            assert found.value <= search.value
            search = found
        assert search.point == pytest.approx(np.ones(6), abs=1e-4)

    def test_ends_where_nothing_is_lower(self):
        def function(x):  # its gradient lies
            return float(np.abs(x).sum()), np.ones(2)

        assert descend(Search.at(np.zeros(2), function), function, first=1.0) is None

    def test_forgets_a_curvature_that_misleads(self):
        def function(x):
            return 0.5 * float(x @ x), x

        start = Search.at(np.array([1.0, 1.0]), function)
        misled = Search(start.point, start.value, start.gradient, np.array([[1.0, 0.0]]), np.array([[-1.0, 0.0]]))
        found = descend(misled, function, first=0.1)
        assert found is not None
        assert found.value < start.value


def _solve(problem, **options):
    return Heter(**options).solve(problem, np.random.default_rng(0))


class TestFit:
    def test_gradient_of_the_shared_tables(self):
        problem = toy_problem(space="heter", budget=Budget())
        shared = SharedIncumbent(Incumbent(problem))
        generator = np.random.default_rng(2)
        point, way = 0.1 * generator.standard_normal(39), generator.standard_normal(39)
        _, gradient = shared.shared_value_and_gradient(point)
        ahead, behind = (shared.shared_value_and_gradient(point + step * way)[0] for step in (1e-6, -1e-6))
        assert gradient @ way == pytest.approx((ahead - behind) / 2e-6, rel=1e-4)

    def test_fits_better_than_the_homogeneous_cloth_and_stays_smooth(self):
        problem = toy_problem(space="heter", budget=Budget(70), sample=1)
        answer = _solve(problem, shared_iterations=3)
        alone = toy_problem(space="heter", budget=Budget(70), sample=1)
        _solve(alone, shared_iterations=3, rounds=0)
        assert answer.tau is not None
        assert problem.meter.best_loss < 0.6 * alone.meter.best_loss
        mesh = problem.simulator.mesh
        bending = answer.tau[24 * len(mesh.faces) :].reshape(-1, 15)
        spread = bending.std(0).mean()
        assert spread > 1e-3, "nothing varies over the cloth"
        # hinges of one face are neighbours: what differs between them is small against what varies over the cloth
        edge = {tuple(sorted(pair)): place for place, pair in enumerate(mesh.hinges[:, :2].tolist())}
        pairs = [
            (edge[tuple(sorted((a, b)))], edge[tuple(sorted((b, c)))])
            for a, b, c in mesh.faces.tolist()
            if tuple(sorted((a, b))) in edge and tuple(sorted((b, c))) in edge
        ]
        first, second = np.array(pairs).T
        assert (bending[first] - bending[second]).std() < 0.7 * spread

    def test_a_tighter_prior_stays_nearer_to_the_homogeneous_cloth(self):
        spreads = []
        for amplitude in (0.5, 0.02):
            problem = toy_problem(space="heter", budget=Budget(50), sample=1)
            answer = _solve(problem, amplitude=amplitude, shared_iterations=0, momentum_steps=6)
            assert answer.tau is not None
            spreads.append(answer.tau[: 24 * len(problem.simulator.mesh.faces)].reshape(-1, 24).std(0).max())
        assert spreads[1] < 0.3 * spreads[0]

    def test_a_run_killed_between_rounds_ends_with_the_same_numbers(self, tmp_path, monkeypatch):
        """With gradients that are too long to be kept: only the saved state can bring it back."""
        monkeypatch.setattr("cusick_bench.problem.journal.LONGEST", 1000)
        budget, options = Budget(50), {"shared_iterations": 2, "momentum_steps": 3, "iterations": 3}
        whole = toy_problem(space="heter", budget=budget, sample=1, folder=tmp_path / "whole")
        expected = _solve(whole, **options)
        assert expected.tau is not None
        for moment in (5, 21):  # within the homogeneous stage, and some rounds later
            killed = toy_problem(space="heter", budget=budget, sample=1, folder=tmp_path / str(moment))

            def kill(evaluation, problem=killed, moment=moment):
                if problem.meter.forward == moment:
                    raise KeyboardInterrupt

            killed.meter.observers.append(kill)
            with pytest.raises(KeyboardInterrupt):
                _solve(killed, **options)
            killed.journal.close()
            resumed = toy_problem(space="heter", budget=budget, sample=1, folder=tmp_path / str(moment))
            answer = _solve(resumed, **options)
            assert (answer.tau == expected.tau).all()
            assert (answer.train_image == expected.train_image).all()
            assert [e.digest for e in resumed.meter.trace] == [e.digest for e in whole.meter.trace]
            resumed.journal.close()

    def test_its_space_is_its_own(self):
        with pytest.raises(SolverError, match="works in the space 'heter'"):
            _solve(toy_problem(space="homo"))
