"""Variational inference: its Gaussian, its steps, what it learns, and that a kill loses nothing."""

import math

import numpy as np
import pytest
import torch

from cusick_bench.datasets.profile import drape_coefficient
from cusick_bench.problem import Budget
from cusick_bench.problem.losses import radius_profile
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.problem.toy import toy_image, toy_problem
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.bdp_field import surprise
from cusick_bench.solvers.registry import make_solver
from cusick_bench.solvers.silhouettes import silhouette
from cusick_bench.solvers.variational import AdamSteps, Gaussian

pytestmark = pytest.mark.usefixtures("one_thread")


def _solve(text, problem, seed=0):
    return make_solver(text).solve(problem, np.random.default_rng(seed))


class TestGaussian:
    def test_divergence_and_its_slopes_are_torchs(self):
        generator = np.random.default_rng(0)
        tie = np.array([0, 1, 1, 2, 2, 2])
        q = Gaussian(generator.normal(size=3), generator.normal(size=3), tie)
        mean, scale = (torch.tensor(values, requires_grad=True) for values in (q.mean, q.scale))
        normal = torch.distributions.Normal
        kl = torch.distributions.kl_divergence(normal(mean[tie], scale[tie]), normal(0.0, 1.0)).sum()
        kl.backward()
        value, by_mean, by_scale = q.divergence()
        assert value.sum() == pytest.approx(kl.item())
        assert by_mean == pytest.approx(mean.grad.numpy())
        assert by_scale == pytest.approx(scale.grad.numpy())

    def test_finds_a_gaussian_posterior(self):
        """Likelihood N(y; tau, 0.5^2), prior N(0, 1): the posterior is N(0.8 y, 0.2)."""
        observed, generator = np.array([1.0, -2.0]), np.random.default_rng(1)
        q = Gaussian.around(np.zeros(2), 1.0, np.arange(2))
        steps = AdamSteps(1500, 0.05)
        for _ in range(1500):
            noise = generator.standard_normal((4, 2))
            gradient = (q.draw(noise) - observed) / 0.25 / 4
            by_mean, by_scale = q.pull_back(gradient, noise)
            _, kl_mean, kl_scale = q.divergence()
            steps.step(q, by_mean + kl_mean, by_scale + kl_scale)
        assert q.mean == pytest.approx(0.8 * observed, abs=0.05)
        assert q.scale == pytest.approx(math.sqrt(0.2), rel=0.1)

    def test_ties_share_their_pair(self):
        q = Gaussian(np.array([1.0, 2.0]), np.array([0.0, 0.0]), np.array([0, 1, 1]))
        assert (q.draw(np.zeros(3)) == [1, 2, 2]).all()
        by_mean, by_scale = q.pull_back(np.array([[1.0, 10.0, 100.0]]), np.array([[2.0, 3.0, 4.0]]))
        assert (by_mean == [1, 110]).all()
        assert (by_scale == [2, 430]).all()


class TestStatistics:
    def _image(self, radius):
        return torch.as_tensor(silhouette(radius))

    def test_known_shapes(self):
        angle = np.arange(720) * 2 * np.pi / 720
        image = self._image(0.12 + 0.01 * np.cos(7 * angle) + 0.004 * np.cos(2 * angle))
        found = dict(zip(STATISTICS, drape_statistics(image).tolist(), strict=True))
        assert found["area"] == pytest.approx(drape_coefficient(image.numpy()), abs=0.005)
        assert found["depth"] == pytest.approx(math.log(0.01 / math.sqrt(2) / 0.06), abs=0.02)
        assert found["number"] == pytest.approx(0.7, abs=0.01)
        assert found["asymmetry"] == pytest.approx(0.0, abs=0.05)
        assert found["grain_2_real"] == pytest.approx(0.002 / 0.06 * 20, abs=0.02)
        assert found["grain_2_imaginary"] == pytest.approx(0.0, abs=0.02)

    def test_do_not_know_where_the_folds_are(self):
        angle = np.arange(720) * 2 * np.pi / 720
        first, second = (drape_statistics(self._image(0.12 + 0.01 * np.cos(7 * angle + p))) for p in (0, 1))
        assert first.numpy() == pytest.approx(second.numpy(), abs=0.02)

    def test_have_gradients(self):
        image = self._image(np.full(4, 0.12)).requires_grad_()
        drape_statistics(image).sum().backward()
        assert torch.isfinite(image.grad).all()
        assert radius_profile(image.detach()).std() < 1e-3


class TestSurprise:
    def test_is_least_for_the_cloth_it_came_from(self):
        images = {name: torch.as_tensor(toy_image(1, bending=b)) for name, b in (("limp", 0.5), ("stiff", 8.0))}
        draws = {}
        for name, bending in (("limp", 0.5), ("stiff", 8.0)):
            problem = toy_problem(space="field")
            taus = np.random.default_rng(0).standard_normal((6, problem.dimension))
            taus[:, : problem.space.specimen_level.start] = 0
            seen = problem.draw_batch(taus + problem.space.bending_level(bending))
            draws[name] = {i: torch.as_tensor(one.image) for i, one in enumerate(seen) if one is not None}
        for name, other in (("limp", "stiff"), ("stiff", "limp")):
            observed = drape_statistics(images[name])
            assert surprise(observed, draws[name], 6) < surprise(observed, draws[other], 6) - 2

    def test_cloths_of_one_specimen_say_nothing(self):
        image = torch.as_tensor(toy_image(0)).requires_grad_()
        value = surprise(drape_statistics(image.detach()), {0: image, 2: image}, 2)
        assert value.item() == 0


@pytest.mark.parametrize("name", ["bdp", "bdp-field"])
class TestSolvers:
    def test_draws_can_be_made_again(self, name):
        problem = toy_problem(space=make_solver(name).space, budget=Budget(9))
        solver = make_solver(f"{name},draws=12")
        answer = solver.solve(problem, np.random.default_rng(2))
        assert answer.posterior is not None
        assert len(answer.draws) == len(answer.posterior["draws"]) == 12
        tau = solver.redraw(problem, answer.posterior, int(answer.posterior["draws"][5]))
        (again,) = toy_problem(space=problem.space.name).draw_batch(tau[None])
        assert again.image == pytest.approx(answer.draws[5], abs=1e-9)

    def test_a_kill_among_the_draws_keeps_those_made(self, name, tmp_path):
        settings = {"space": make_solver(name).space, "budget": Budget(9)}
        whole = _solve(f"{name},draws=20", toy_problem(**settings, folder=tmp_path / "whole"))
        killed = toy_problem(**settings, folder=tmp_path / "killed")

        def kill(evaluation):
            if sum(entry.kind == "draw" for entry in killed.meter.trace) == 11:
                raise KeyboardInterrupt

        killed.meter.observers.append(kill)
        with pytest.raises(KeyboardInterrupt):
            _solve(f"{name},draws=20", killed)
        resumed = toy_problem(**settings, folder=tmp_path / "killed")
        simulated = []
        simulate = type(resumed).simulate
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                type(resumed), "simulate", lambda self, taus: simulated.append(len(taus)) or simulate(self, taus)
            )
            answer = _solve(f"{name},draws=20", resumed)
        assert (answer.draws == whole.draws).all()
        assert sum(simulated) <= 9

    def test_nonsense_options_are_refused(self, name):
        with pytest.raises(SolverError, match="draws must be"):
            make_solver(f"{name},draws=0")


class TestLearning:
    def test_bdp_descends_and_narrows(self):
        problem = toy_problem(space="heter", budget=Budget(150))
        start = problem.evaluate(np.zeros(problem.dimension))
        answer = _solve("bdp,draws=4,steps=15", problem)
        assert problem.meter.best_loss < 0.5 * start
        assert answer.posterior is not None
        assert len(answer.posterior["mean"]) == 39

    def test_sums_and_means_weigh_the_prior_differently(self):
        found = []
        for reduction in ("sum", "mean"):
            problem = toy_problem(space="heter", budget=Budget(60))
            found.append(_solve(f"bdp,draws=2,steps=5,reduction={reduction}", problem).posterior["mean"])
        assert np.abs(found[0] - found[1]).max() > 1e-3

    def test_only_the_pixel_loss_has_a_gaussian_likelihood(self):
        from dataclasses import replace

        with pytest.raises(SolverError, match="use loss=mse"):
            _solve("bdp", replace(toy_problem(space="heter"), loss="profile"))

    def test_bdp_field_learns_the_level_of_bending(self):
        """Its draws have the training cloth's drape coefficient, whichever cloth that is."""
        for bending in (0.6, 4.0):
            problem = toy_problem(space="field", bending=bending, budget=Budget(260))
            answer = _solve("bdp-field,draws=30,steps=6,refinement=2", problem)
            drawn = np.array([drape_coefficient(image) for image in answer.draws])
            assert drawn.mean() == pytest.approx(drape_coefficient(problem.train_image), abs=0.1)
            assert drawn.std() > 0.005
