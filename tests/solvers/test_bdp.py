"""Variational inference: its Gaussian, its steps, what it learns, and that a kill loses nothing."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.profile import drape_coefficient
from cusick_bench.problem import Budget, DrapeProblem, FieldSpace, Observation
from cusick_bench.problem.cloth_prior import CLOTH, MODES, trait_entry
from cusick_bench.problem.cloth_tables import mean_bending
from cusick_bench.problem.losses import radius_profile
from cusick_bench.problem.metering.budget import Meter
from cusick_bench.problem.scene import Scene
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.solvers.adam import Adam, cosine_rate
from cusick_bench.solvers.base import SolverError, silent
from cusick_bench.solvers.reference.silhouettes import silhouette
from cusick_bench.solvers.registry import make_solver
from cusick_bench.solvers.variational.bdp_field import _known_stiffness
from cusick_bench.solvers.variational.gaussian_posterior import Gaussian
from cusick_bench.solvers.variational.predictive import predictive_draws

pytestmark = pytest.mark.usefixtures("one_thread")


def _solve(text, problem, seed=0):
    return make_solver(text).solve(problem, np.random.default_rng(seed))


def _stop():
    raise KeyboardInterrupt


def _draws_tried(problem):
    return sum(entry.kind == "draw" for entry in problem.meter.trace)


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
        adam = Adam(q.arrays, square_decay=0.95)
        for step in range(1500):
            noise = generator.standard_normal((4, 2))
            gradient = (q.draw(noise) - observed) / 0.25 / 4
            by_mean, by_scale = q.pull_back(gradient, noise)
            _, kl_mean, kl_scale = q.divergence()
            adam.step(q.slopes(by_mean + kl_mean, by_scale + kl_scale), cosine_rate(0.05, step, 1500))
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
        coefficient = drape_coefficient(image.numpy())
        assert found["area_log_odds"] == pytest.approx(math.log(coefficient / (1 - coefficient)), abs=0.02)
        assert found["fold_depth_log"] == pytest.approx(math.log(0.01 / math.sqrt(2) / 0.06), abs=0.02)
        assert found["crest_number"] == pytest.approx(0.7, abs=0.01)
        assert found["fold_skewness"] == pytest.approx(0.0, abs=0.05)
        assert found["grain_2_real"] == pytest.approx(0.002 / 0.06 * 20, abs=0.02)
        assert found["grain_2_imaginary"] == pytest.approx(0.0, abs=0.02)

    def test_number_is_that_of_the_crests_of_random_profiles(self):
        """Random phases, power in orders 5 to 9: crests are counted on the profiles themselves (Rice's formula)."""
        angle, orders = np.arange(720) * 2 * np.pi / 720, np.arange(5, 10)
        phases = np.random.default_rng(2).uniform(0, 2 * np.pi, (12, 5, 1))
        radii = 0.12 + 0.003 * np.cos(orders[:, None] * angle + phases).sum(1)
        crests = ((radii > np.roll(radii, 1, 1)) & (radii > np.roll(radii, -1, 1))).sum(1)
        found = [
            10 * drape_statistics(self._image(radius))[STATISTICS.index("crest_number")].item() for radius in radii
        ]
        assert np.mean(found) == pytest.approx(np.mean(crests), abs=0.3)
        assert np.mean(found) > orders.mean() + 0.4  # the mean order counts too few

    def test_do_not_know_where_the_folds_are(self):
        angle = np.arange(720) * 2 * np.pi / 720
        first, second = (drape_statistics(self._image(0.12 + 0.01 * np.cos(7 * angle + p))) for p in (0, 1))
        assert first.numpy() == pytest.approx(second.numpy(), abs=0.02)

    def test_have_gradients(self):
        image = self._image(np.full(4, 0.12)).requires_grad_()
        drape_statistics(image).sum().backward()
        assert torch.isfinite(image.grad).all()
        assert radius_profile(image.detach()).std() < 1e-3


class TestPredictiveDraws:
    def _draws(self, monkeypatch, count, broken):
        """Numbers of the draws that come back when the drapes of some fail."""
        rest = Observation(np.zeros((3, 3)), np.zeros((256, 256)), 0.0)
        problem = toy_problem()
        drape = lambda self, taus: [None if int(tau[0]) in broken else rest for tau in taus]  # noqa: E731
        monkeypatch.setattr(DrapeProblem, "draw_batch", drape)
        return list(predictive_draws(problem, lambda index: np.full(problem.dimension, float(index)), count, silent))

    def test_that_fail_are_replaced_by_the_next(self, monkeypatch):
        """Best-of-n scores compare equal n only."""
        assert self._draws(monkeypatch, 10, {1, 4, 11}) == [0, 2, 3, 5, 6, 7, 8, 9, 10, 12]
        assert self._draws(monkeypatch, 3, set()) == [0, 1, 2]

    def test_are_not_tried_for_ever(self, monkeypatch):
        assert self._draws(monkeypatch, 10, set(range(3, 100))) == [0, 1, 2]


@pytest.mark.parametrize("name", ["bdp", "bdp-field", "bdp-field,pace=brisk"])
class TestSolvers:
    def test_draws_can_be_made_again(self, name):
        problem = toy_problem(space=make_solver(name).space, budget=Budget(9))
        solver = make_solver(f"{name},draws=12")
        answer = solver.solve(problem, np.random.default_rng(2))
        assert answer.posterior is not None
        assert len(answer.draws) == len(answer.posterior["draws"]) == 12
        tau = solver.redraw(problem, answer.posterior, int(answer.posterior["draws"][5]))
        (again,) = toy_problem(space=problem.space.name).at_pace(solver.pace_of_draws).draw_batch(tau[None])
        assert again.image == pytest.approx(answer.draws[5], abs=1e-9)

    def test_a_kill_among_the_draws_keeps_those_made(self, name, tmp_path):
        settings = {"space": make_solver(name).space, "budget": Budget(9), "vertices": 60}
        undisturbed = toy_problem(**settings, folder=tmp_path / "whole")
        whole = _solve(f"{name},draws=12", undisturbed)
        killed = toy_problem(**settings, folder=tmp_path / "killed")

        def kill(evaluation):
            if _draws_tried(killed) == 9:
                raise KeyboardInterrupt

        killed.meter.observers.append(kill)
        with pytest.raises(KeyboardInterrupt):
            _solve(f"{name},draws=12", killed)
        resumed = toy_problem(**settings, folder=tmp_path / "killed")
        simulated = []
        simulate = type(resumed).simulate
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                type(resumed),
                "simulate",
                lambda self, taus, **how: simulated.append(len(taus)) or simulate(self, taus, **how),
            )
            answer = _solve(f"{name},draws=12", resumed)
        assert (answer.draws == whole.draws).all()
        assert sum(simulated) <= _draws_tried(undisturbed) - 9  # one that fails is tried, and replaced

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

    @pytest.mark.parametrize("reduction", ["sum", "mean"])
    def test_bdp_steps_down_the_slopes_of_its_bound(self, reduction, monkeypatch):
        """KL(q || N(0, I)) + E |I - D|^2 / (2 sigma^2), in sums over pixels and parameters, or in means of both."""
        problem = toy_problem(space="heter", budget=Budget(9), vertices=60)
        mesh, size, slopes = problem.simulator.mesh, problem.dimension, []
        slope = np.random.default_rng(4).standard_normal(size)

        def answer(self, taus, measure=None):  # one of three drapes fails
            losses, gradients = np.array([0.1, math.inf, 0.2]), np.tile(slope, (3, 1))
            gradients[1] = 0
            return losses, gradients

        monkeypatch.setattr(DrapeProblem, "evaluate_and_gradient_batch", answer)
        monkeypatch.setattr(Adam, "step", lambda self, gradients, rate: slopes.append(gradients) or _stop())
        for factor in (1.0, 0.0):
            slope *= factor
            with pytest.raises(KeyboardInterrupt):
                _solve(f"bdp,draws=1,steps=1,samples=3,search=0,sigma=0.02,reduction={reduction}", problem)
            stretch, bending = np.split(slope, [24 * len(mesh.faces)])
            of_pairs = np.concatenate([stretch.reshape(-1, 24).sum(0), bending.reshape(-1, 15).sum(0)])
            pixels, parameters = (256**2, 1) if reduction == "sum" else (1, size)
            assert slopes[-1]["mean"] == pytest.approx(pixels / (2 * 0.02**2) * of_pairs)  # and the mean is the prior's
        entries = np.repeat([len(mesh.faces), len(mesh.hinges)], [24, 15])
        by_scale = entries * (0.3 - 1 / 0.3) / parameters
        assert slopes[-1]["raw"] == pytest.approx(by_scale * (1 - math.exp(-0.3)))  # of the scale, softplus(raw)

    def test_only_the_pixel_loss_has_a_gaussian_likelihood(self):
        with pytest.raises(SolverError, match="use loss=mse"):
            _solve("bdp", replace(toy_problem(space="heter"), loss="profile"))

    @pytest.mark.parametrize("bending", [2.0, pytest.param(8.0, marks=pytest.mark.slow)])
    def test_bdp_field_learns_the_level_of_bending(self, bending):
        """Its draws have the training cloth's drape coefficient, whichever cloth that is."""
        problem = toy_problem(space="field", bending=bending, vertices=150, budget=Budget(250))
        answer = _solve("bdp-field,draws=30,refinement=2", problem)
        drawn = np.array([drape_coefficient(image) for image in answer.draws])
        assert drawn.mean() == pytest.approx(drape_coefficient(problem.train_image), abs=0.05)
        assert drawn.std() > 0.01

    def test_bdp_field_learns_from_what_the_budget_allows(self):
        """From too few drapes it corrects nothing: what is known before the first one is what it then says."""
        learned = []
        for budget in (20, 60):
            problem = toy_problem(space="field", budget=Budget(budget))
            answer = _solve("bdp-field,draws=2,first=12,cloths=60", problem)
            assert not answer.finished
            assert answer.posterior["cloths"].std(0).max() < 1.3
            learned.append(answer.posterior["cloths"].mean(0))
        assert np.abs(learned[0] - learned[1]).max() > 0.05

    def test_bdp_field_learns_nothing_of_the_cloth_from_drapes_after_its_inference(self):
        solver = make_solver("bdp-field,draws=1,search=2,first=6,rounds=1,cloths=4,refinement=1")
        assert solver.drapes_of_inference == 12
        learned = []
        for budget in (13, 20):
            problem = toy_problem(space="field", budget=Budget(budget), vertices=60)
            learned.append(solver.solve(problem, np.random.default_rng(0)).posterior["cloths"])
        assert np.array_equal(*learned)

    def test_bdp_field_lays_a_face_that_lies_down_as_its_mirror_image(self, monkeypatch):
        """The fit of the specimen begins with the waves of the silhouette: in the cloth's frame, not the camera's."""
        laid = []
        monkeypatch.setattr(FieldSpace, "laid_like", lambda self, height: laid.append(height) or np.zeros(MODES))
        problem = toy_problem(space="field")
        for side, image in (("up", problem.train_image), ("down", problem.train_image[:, ::-1].copy())):
            scene = Scene((), problem.simulator.mesh, problem.simulator.settings, side)
            _solve(
                "bdp-field,draws=1,search=0,first=1,rounds=0,refinement=0",
                replace(problem, train_image=image, scene=scene, meter=Meter(Budget(9))),
            )
        assert np.corrcoef(*laid)[0, 1] > 0.98

    @pytest.mark.parametrize(("budget", "fitted"), [(22, False), (25, True)])
    def test_bdp_field_at_rest_fits_the_best_drape_that_it_has_met(self, budget, fitted):
        """Every specimen has folds of its own, those that were drawn and that of the fit, which has the image's."""
        problem = toy_problem(space="field", mode="equilibrium", bending=0.3, vertices=150, budget=Budget(budget))
        answer = _solve("bdp-field,draws=1,first=20,rounds=0,search=3,refinement=0", problem)
        searched, specimen = problem.meter.trace[:3], [one for one in problem.meter.trace if one.kind == "loss"]
        assert (answer.finished, len(specimen)) == (fitted, int(fitted))
        assert all(one.loss < 0.95 * min(other.loss for other in searched) for one in specimen)
        squared = np.square(answer.train_image - problem.train_image).mean()
        assert squared == pytest.approx(problem.meter.best_loss, rel=1e-6)

    def test_bdp_field_says_what_it_knows_of_the_stiffness_so_far(self):
        """From the search of the level on, long before it has ended: median and 90 % interval."""
        said = []
        problem = toy_problem(space="field", budget=Budget(24))
        solver = make_solver("bdp-field,draws=1,first=4,rounds=1,cloths=4,search=4,refinement=0")
        solver.solve(problem, np.random.default_rng(0), progress=lambda message, share: said.append(message))
        known = [message.partition("; bending ")[2] for message in said if message.startswith("inference")]
        assert len(known) == 2
        for words in known:
            middle, _, interval = words.partition(" µN m, ")
            low, high = (float(number) for number in interval.split(" to "))
            assert 0.01 < low < float(middle) < high < 1e4
        assert said[-2] == "draping draws, 0 of 1", "no word of the search stays while draws are draped"
        (fitting,) = (message for message in said if message.startswith("fitting"))
        assert re.match("fitting the training silhouette; bending .* µN m, .* to ", fitting)

    @pytest.mark.parametrize(("cloth", "answers"), [(0.15, 1), (0.14, 0)])
    def test_bdp_field_has_a_first_answer_for_the_plate_that_it_knows(self, cloth, answers):
        """For 24 cm over 18 cm it said 191 µN m, 94 to 720, of a cloth of 40."""
        said = []
        problem = toy_problem(space="field", budget=Budget(24), protocol=replace(RELEASE, cloth_radius_m=cloth))
        solver = make_solver("bdp-field,draws=1,first=4,rounds=0,search=2,refinement=0")
        solver.solve(problem, np.random.default_rng(0), progress=lambda message, share: said.append(message))
        assert sum(message.startswith("first answer: bending ") for message in said) == answers
        assert any(message.startswith("inference") for message in said)

    def test_bdp_field_writes_the_stiffness_of_stiff_cloth_without_exponents(self):
        """Of canvas it said `1.02e+03 µN m, 6.8e+02 to 1.5e+03`."""
        problem, cloths = toy_problem(space="field"), np.zeros((3, CLOTH))
        cloths[:, trait_entry("bending")] = 3.0, 3.5, 4.0
        words = _known_stiffness(problem, cloths)
        assert "e" not in words.removeprefix("bending")
        middle = 1e6 * mean_bending(problem.space.prior, cloths)[1]
        assert middle > 1000
        assert float(words.split()[1]) == pytest.approx(middle, rel=0.005)
