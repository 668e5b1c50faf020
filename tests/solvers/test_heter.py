"""The heterogeneous fit: its smooth prior, its optimiser, and runs that are killed."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.problem import Budget
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.gradient.blurred_misfit import BlurredMisfit
from cusick_bench.solvers.gradient.gauss_newton import MEMORY, Adjoints, damped_step
from cusick_bench.solvers.gradient.heter import FLOOR, BlurredIncumbent, Heter, RegularisedFit, Walk
from cusick_bench.solvers.gradient.smooth_field import FIELDS, StiffnessField, stiffness_matrix

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return disc_mesh(800)


def _alone(z):
    """Without what all elements share."""
    return np.concatenate([np.zeros(FIELDS), z[FIELDS:]])


class TestField:
    def test_finite_elements_are_exact_for_linear_fields(self, mesh):
        x = mesh.material[:, 0]
        matrix = stiffness_matrix(mesh)
        assert x @ (matrix @ x) == pytest.approx(mesh.areas.sum())
        assert np.abs(matrix @ np.ones(mesh.vertices)).max() < 1e-12
        assert mesh.vertex_areas.sum() == pytest.approx(mesh.areas.sum())

    def test_amplitude_and_correlation_are_as_asked_for(self, mesh):
        """Inside the cloth, away from the rim that reflects: Matern with nu = 1, 0.14 at the given length."""
        field = StiffnessField(mesh, amplitude=0.4, length=0.04)
        generator = np.random.default_rng(0)
        draws = np.concatenate(
            [
                field.deviation(_alone(generator.standard_normal(field.dimension)))[: 24 * len(mesh.faces)]
                .reshape(-1, 24)
                .T
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
        assert field.dimension == FIELDS * (1 + mesh.vertices)
        assert gradient @ field.deviation(z) == pytest.approx(field.pulled_back(gradient) @ z, rel=1e-9)

    def test_what_is_shared_moves_all_elements_alike(self, mesh):
        field = StiffnessField(mesh, amplitude=0.4, length=0.04, shared=0.7)
        z = np.concatenate([np.arange(FIELDS), np.zeros(FIELDS * mesh.vertices)])
        stretch, bending = np.split(field.deviation(z), [24 * len(mesh.faces)])
        assert np.allclose(stretch.reshape(-1, 24), 0.7 * np.arange(24), rtol=1e-12)
        assert np.allclose(bending.reshape(-1, 15), 0.7 * np.arange(24, 39), rtol=1e-12)

    @pytest.mark.parametrize(
        ("name", "value"), [("amplitude", 0.0), ("length", -0.1), ("length", np.nan), ("shared", 0.0)]
    )
    def test_nonsense_is_refused(self, mesh, name, value):
        with pytest.raises(SolverError, match=f"{name} must be > 0"):
            StiffnessField(mesh, **{"amplitude": 0.4, "length": 0.04, name: value})


def _protocol(cloth: float, finer: float, size: int) -> Protocol:
    """Of a cloth that is so many times as large, in pictures of so many times as many pixels to the metre."""
    return Protocol(
        cloth_radius_m=cloth * RELEASE.cloth_radius_m, plate_radius_m=cloth * RELEASE.plate_radius_m,
        px_per_m=finer * RELEASE.px_per_m, image_size_px=size, centre_px=((size - 1) / 2, (size - 1) / 2),
    )  # fmt: skip


class TestBlurredMisfit:
    def test_grows_with_the_square_of_small_shifts_where_pixels_differ_in_proportion(self):
        """A disc shifted by u: area between the outlines ~ |u|, blurred ~ u^2."""
        y, x = torch.meshgrid(torch.arange(256.0), torch.arange(256.0), indexing="ij")
        disc, shifts = lambda u: (80 - torch.hypot(x - 127.5 - u, y - 127.5)).clamp(0, 1).double(), (1.0, 2.0)
        misfit = BlurredMisfit(disc(0.0).numpy(), width=6.0)
        blurred = [float(misfit({0: disc(u)})) for u in shifts]
        sharp = [float((disc(u) - disc(0.0)).square().mean()) for u in shifts]
        assert blurred[1] / blurred[0] == pytest.approx(4.0, rel=0.1)
        assert sharp[1] / sharp[0] < 3.0
        assert misfit.residual @ misfit.residual == pytest.approx(blurred[1], rel=1e-6)  # thinning loses nothing

    def test_one_edge_a_third_of_a_pixel_off_costs_what_is_taken_for_the_floor(self):
        y, x = torch.meshgrid(torch.arange(256.0), torch.arange(256.0), indexing="ij")
        disc = [(radius - torch.hypot(x - 127.5, y - 127.5)).clamp(0, 1).double() for radius in (90.0, 90.3)]
        assert float(BlurredMisfit(disc[0].numpy(), 2.0)({0: disc[1]})) == pytest.approx(FLOOR, rel=0.3)

    @pytest.mark.parametrize(("cloth", "finer", "size"), [(2.0, 1.0, 600), (1.0, 2.0, 512), (0.5, 3.0, 400)])
    def test_is_the_same_number_under_any_protocol(self, cloth, finer, size):
        """The same outlines in units of the cloth, of another size, resolution and field of view."""
        found = []
        for pixels, protocol in ((256, RELEASE), (size, _protocol(cloth, finer, size))):
            scale, middle = protocol.px_per_m / RELEASE.px_per_m * protocol.cloth_scale, (pixels - 1) / 2
            y, x = torch.meshgrid(*[torch.arange(float(pixels))] * 2, indexing="ij")
            waves = 1 + 0.1 * torch.cos(7 * torch.atan2(y - middle, x - middle))
            rings = [r * scale * waves - torch.hypot(x - middle, y - middle) for r in (80.0, 81.0)]
            first, second = ((ring + 0.5).clamp(0, 1).double() for ring in rings)
            misfit = BlurredMisfit(first.numpy(), 3.0, protocol)
            found.append(float(misfit({0: second})))
            assert misfit.residual @ misfit.residual == pytest.approx(found[-1], rel=1e-3)
        assert found[1] == pytest.approx(found[0], rel=0.02)


@pytest.fixture(scope="module")
def system() -> tuple[np.ndarray, np.ndarray]:
    """A (12, 60), of condition number about 20, and b."""
    generator = np.random.default_rng(3)
    return generator.standard_normal((12, 60)) * np.geomspace(1, 0.05, 12)[:, None], generator.standard_normal(12)


class TestGaussNewton:
    """J(z) = 50 |A z - b|^2 + |z|^2 / 2, seen through A^T r alone."""

    @staticmethod
    def _walk(system, *, steps, radius, leaps=0.0):
        """The point reached; the residual leaps by so much from step to step."""
        matrix, target = system
        generator, z, adjoints, lengths = np.random.default_rng(4), np.zeros(60), None, []
        for _ in range(steps):
            residual = matrix @ z - target + leaps * generator.standard_normal(12)
            pair = residual, matrix.T @ residual
            adjoints = Adjoints.of(*pair) if adjoints is None else adjoints.and_of(*pair)
            step = damped_step(100 * pair[1] + z, adjoints, weight=50.0, radius=radius)
            lengths.append(np.linalg.norm(step))
            z = z + step
        return z, np.array(lengths)

    @staticmethod
    def _excess(system, z):
        """How far J is above its minimum, as a share of what there was to gain."""
        matrix, target = system

        def value(point):
            return 50 * np.sum((matrix @ point - target) ** 2) + 0.5 * point @ point

        best = value(np.linalg.solve(100 * matrix.T @ matrix + np.eye(60), 100 * matrix.T @ target))
        return (value(z) - best) / (value(np.zeros(60)) - best)

    def test_finds_the_minimum_in_a_few_times_as_many_steps_as_outputs(self, system):
        z, _ = self._walk(system, steps=40, radius=100.0)
        assert self._excess(system, z) < 1e-3  # steepest descent would need hundreds

    def test_no_step_is_longer_than_the_radius_and_far_away_all_are_as_long(self, system):
        _, lengths = self._walk(system, steps=6, radius=0.05)
        assert lengths == pytest.approx(0.05, rel=1e-6)

    def test_leaping_residuals_do_not_spoil_the_curvature(self, system):
        """Secants of gradients would be 100 A^T (leap) wrong; steps stay near the minimum."""
        z, lengths = self._walk(system, steps=60, radius=100.0, leaps=0.02)
        assert self._excess(system, z) < 0.05
        assert lengths[-20:].max() < 0.5 * lengths.max()

    def test_what_is_kept_is_bounded(self, system):
        matrix, target = system
        adjoints = Adjoints.of(target, matrix.T @ target)
        for _ in range(2 * MEMORY):
            adjoints = adjoints.and_of(target, matrix.T @ target)
        assert adjoints.residuals.shape == (MEMORY, 12)
        assert np.isfinite(damped_step(matrix.T @ target, adjoints, weight=50.0, radius=1.0)).all()  # all pairs alike

    @pytest.mark.parametrize("size", [1e12, 1e17, 1e200])
    def test_an_adjoint_that_explodes_makes_no_step_longer_than_the_radius(self, system, size):
        """On the brink of another fold they grow without bound; a step of their size would make stiffness infinite."""
        matrix, target = system
        direction = np.random.default_rng(6).standard_normal(60)
        adjoints = Adjoints.of(-target, -matrix.T @ target).and_of(target, size * direction)
        for pair in ((-target, -matrix.T @ target), (target, size * direction)):
            step = damped_step(100 * pair[1], adjoints.and_of(*pair), weight=50.0, radius=0.5)
            assert np.linalg.norm(step) <= 0.5 * (1 + 1e-5)
            assert step @ pair[1] < 0


def _solve(problem, **options):
    return Heter(**options).solve(problem, np.random.default_rng(0))


class TestFit:
    def test_gradient_of_the_fit(self):
        problem = toy_problem(space="heter", budget=Budget())
        field = StiffnessField(problem.simulator.mesh, 0.5, 0.05)
        fit = RegularisedFit(BlurredIncumbent(problem, 2.0), field, problem.space.bending_level(2.0))
        generator = np.random.default_rng(2)
        point, way = (0.1 * generator.standard_normal(field.dimension) for _ in range(2))

        def look(z):
            seen = fit.look(z)
            assert seen is not None
            return fit.value(seen), fit.gradient(seen)

        _, gradient = look(point)
        ahead, behind = (look(point + step * way)[0] for step in (1e-5, -1e-5))
        assert gradient @ way == pytest.approx((ahead - behind) / 2e-5, rel=1e-3)

    def test_fits_better_than_the_homogeneous_cloth_and_stays_smooth(self):
        problem = toy_problem(space="heter", budget=Budget(70), sample=1)
        answer = _solve(problem)
        alone = toy_problem(space="heter", budget=Budget(70), sample=1)
        _solve(alone, amplitude=1e-6)
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
            answer = _solve(problem, amplitude=amplitude)
            assert answer.tau is not None
            spreads.append(answer.tau[: 24 * len(problem.simulator.mesh.faces)].reshape(-1, 24).std(0).max())
        assert spreads[1] < 0.3 * spreads[0]

    def test_a_run_killed_between_rounds_ends_with_the_same_numbers(self, tmp_path, monkeypatch):
        """With gradients that are too long to be kept: only the saved state can bring it back."""
        monkeypatch.setattr("cusick_bench.problem.metering.journal.LONGEST", 1000)
        budget, options = Budget(50), {"steps": 20}
        whole = toy_problem(space="heter", budget=budget, sample=1, folder=tmp_path / "whole")
        expected = _solve(whole, **options)
        assert expected.tau is not None
        for moment in (5, 21):  # before or after the first step, and some savings later
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

    def test_a_walk_ends_by_itself_and_a_budget_before_it_does_no_harm(self):
        long, short = (toy_problem(space="heter", budget=Budget(budget)) for budget in (60, 12))
        assert _solve(long, steps=10).finished
        answer = _solve(short, steps=10)
        assert not answer.finished
        assert short.meter.forward_equivalents <= 12
        assert np.mean((answer.train_image - short.train_image) ** 2) == pytest.approx(short.meter.best_loss)

    def test_from_a_drape_that_fails_it_returns_to_the_lowest_point_and_goes_in_shorter_steps(self, monkeypatch):
        problem = toy_problem(space="heter", budget=Budget())
        field = StiffnessField(problem.simulator.mesh, 0.5, 0.05)
        fit = RegularisedFit(BlurredIncumbent(problem, 2.0), field, problem.space.bending_level(2.0))
        begin, high = fit.look(np.zeros(field.dimension)), fit.look(np.full(field.dimension, 0.3))
        assert begin is not None
        assert high is not None
        assert fit.value(high) > fit.value(begin)
        walk, looks = replace(Walk.at(begin), here=high), []
        monkeypatch.setattr(RegularisedFit, "look", lambda self, z: looks.append(z))
        for _ in range(3):
            walk = walk.on(fit, 0.1)
        origins = (high.z, begin.z, begin.z)
        lengths = [np.linalg.norm(z - origin) for z, origin in zip(looks, origins, strict=True)]
        assert lengths == pytest.approx([0.1, 0.05, 0.025], rel=1e-6)
        assert walk.here is begin
        monkeypatch.setattr(RegularisedFit, "look", lambda self, z: replace(begin, z=z))
        assert walk.on(fit, 0.1).caution > walk.caution

    @pytest.mark.parametrize("options", [{"radius": 0.0}, {"blur": float("nan")}])
    def test_options_without_meaning_are_refused(self, options):
        with pytest.raises(SolverError, match="must be > 0 and finite"):
            Heter(**options)

    def test_its_space_is_its_own(self):
        with pytest.raises(SolverError, match="works in the space 'heter'"):
            _solve(toy_problem(space="homo"))
