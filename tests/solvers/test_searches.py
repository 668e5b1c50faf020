"""Gradient-free searches, their Gaussian processes and trust regions, on functions with known answers."""

import itertools
import math
import threading
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from search_losses import losses_of_search

from cusick_bench.benchmark.optimisers.runs import Plan, run_once
from cusick_bench.solvers.bayesian_optimisation import baxus, gaussian_process, trust_region
from cusick_bench.solvers.bayesian_optimisation.baxus import Baxus, nesting
from cusick_bench.solvers.bayesian_optimisation.trust_region import (
    LONGEST,
    TrustRegion,
    candidates_around,
    local_search,
)
from cusick_bench.solvers.bayesian_optimisation.vanilla_bo import VanillaBo
from cusick_bench.solvers.black_box.box import digestible, run_search
from cusick_bench.solvers.black_box.cmaes import CmaEs
from cusick_bench.solvers.black_box.sobol import sobol_block, sobol_points
from cusick_bench.solvers.registry import make_solver

BAYESIAN = ("rembo", "hesbo", "vanilla-bo", "turbo", "baxus")


class TestSearches:
    def test_failures_count_as_the_worst_success(self):
        assert digestible([3.0, math.inf, 1.0, math.nan]).tolist() == [3.0, 3.0, 1.0, 3.0]
        assert digestible([math.inf, math.inf]).tolist() == [0.0, 0.0]

    def test_run_search_asks_no_more_than_allowed(self):
        def endless():
            while True:
                yield np.zeros(1)

        asked = []
        assert not run_search(endless(), lambda point: asked.append(point) or 0.0, 7)
        assert len(asked) == 7
        assert run_search((np.zeros(1) for _ in range(3)), lambda point: 0.0)  # pyright: ignore[reportArgumentType]

    def test_sobol_points_are_stratified_in_every_coordinate(self):
        block = sobol_block(64, 39, np.random.default_rng(5))
        assert (np.sort(np.floor(64 * block), axis=0) == np.arange(64)[:, None]).all()
        points = sobol_points(39, np.random.default_rng(5))
        assert np.stack([next(points) for _ in range(64)]) == pytest.approx(block)

    def test_sobol_goes_beyond_its_direction_numbers(self):
        block = sobol_block(20, 30_000, np.random.default_rng(6))
        assert block.shape == (20, 30_000)
        assert block[:, 25_000:].mean() == pytest.approx(0.5, abs=0.005)
        assert 0 <= block.min() < block.max() < 1

    def test_cmaes_descends_and_ends(self):
        target = np.array([0.5, -0.3, 0.1, 0.9, -1.0])
        values = losses_of_search(CmaEs(), lambda point: float(np.square(point - target).sum()), 5, 700)
        assert min(values) < 1e-6

    @pytest.mark.parametrize("fails", [lambda k: True, lambda k: k < 30, lambda k: k % 14 != 3], ids=range(3))
    def test_cmaes_goes_on_where_nearly_all_of_a_generation_fails(self, fails):
        """Always, for the first two generations, and all but one of each."""
        count = itertools.count()
        values = losses_of_search(
            CmaEs(), lambda point: math.inf if fails(next(count)) else float(np.square(point - 0.2).sum()), 39, 280
        )
        assert len(values) == 280

    def test_cmaes_of_many_coordinates_keeps_no_matrix(self):
        values = losses_of_search(CmaEs(), lambda point: float(np.square(point - 0.2).mean()), 20_000, 90)
        assert min(values[60:]) < min(values[:30])

    @pytest.mark.threads
    @pytest.mark.parametrize("name", BAYESIAN)
    def test_same_seed_same_points_and_torch_is_left_alone(self, name):
        threads = torch.get_num_threads()
        plan = Plan(dimension=10, evaluations=12)
        first = run_once(plan, name, 0)
        assert run_once(plan, name, 0) == first
        assert run_once(Plan(dimension=10, evaluations=2, seed=1), name, 0) != first[:2]
        assert torch.get_num_threads() == threads

    @pytest.mark.slow
    def test_modelling_beats_guessing(self):
        plan = Plan(dimension=6, evaluations=35)
        best = {name: [min(run_once(plan, name, run)) for run in range(3)] for name in ("vanilla-bo", "turbo", "sobol")}
        assert np.mean(best["vanilla-bo"]) < 0.6
        assert np.mean(best["turbo"]) < 0.5 * np.mean(best["sobol"])

    def test_failed_points_do_not_spoil_the_process(self):
        def half_failing(point):
            return math.inf if point[0] > 0.4 else float(np.square(point - 0.3).sum())

        values = losses_of_search(VanillaBo(initial=6), half_failing, 2, 18)
        assert math.inf in values
        assert min(values) < 0.01

    @pytest.mark.parametrize("name", ["vanilla-bo", "turbo"])
    def test_thousands_of_coordinates(self, name):
        solver = make_solver(f"{name},initial=6")
        values = losses_of_search(solver, lambda point: float(np.square(point - 0.2).mean()), 2000, 9)
        assert len(values) == 9
        assert min(values[6:]) < min(values[:6])

    def test_a_process_of_failures_only_still_asks(self):
        assert losses_of_search(VanillaBo(initial=3), lambda point: math.inf, 4, 5) == [math.inf] * 5


class TestProcess:
    def test_shared_length_scale_sees_distances_only(self, monkeypatch):
        generator = np.random.default_rng(7)
        points = generator.random((12, 40))
        losses = [float(np.square(point - 0.4).sum()) for point in points]
        monkeypatch.setattr(gaussian_process, "SHARED_FROM", 40)
        spanned = gaussian_process.same_distances(torch.as_tensor(points))
        assert spanned.shape == (12, 12)
        assert torch.cdist(spanned, spanned) == pytest.approx(
            torch.cdist(torch.as_tensor(points), torch.as_tensor(points)), abs=1e-6
        )
        predicted = []
        for span in (gaussian_process.same_distances, lambda inputs: inputs):
            monkeypatch.setattr(gaussian_process, "same_distances", span)
            with gaussian_process.local_torch(0):
                surrogate = gaussian_process.fit(points, losses)
                assert surrogate.lengthscale.shape == (1,)
                with torch.no_grad():
                    predicted.append(surrogate.model.posterior(torch.full((1, 40), 0.4).double()).mean.item())
        assert predicted[0] == pytest.approx(predicted[1], rel=1e-3)
        assert predicted[0] > 0, "better than the mean where the loss is least"

    def test_improvement_is_expected_where_it_is(self):
        points = np.linspace(0, 1, 9)[:, None]
        losses = [float((x - 0.66) ** 2) for x in points[:, 0]]
        with gaussian_process.local_torch(0):
            surrogate = gaussian_process.fit(points, losses)
            assert gaussian_process.most_promising(surrogate)[0] == pytest.approx(0.66, abs=0.03)
            offered = np.array([[0.1], [0.65], [0.9]])
            assert gaussian_process.thompson(surrogate, offered)[0] == 0.65

    def test_threads_take_turns_with_torchs_settings_and_put_them_back(self):
        """The other thread drew from this one's seed, and left its seed and its silence to the process."""
        drawn, inside = [], threading.Event()

        def other():
            with gaussian_process.local_torch(1):
                inside.set()
                drawn.append(torch.rand(1).item())
                ended.wait(60)

        ended, thread = threading.Event(), threading.Thread(target=other)
        state, filters = torch.random.get_rng_state(), list(warnings.filters)
        with gaussian_process.local_torch(0):
            thread.start()
            inside.wait(0.5)
            drawn.append(torch.rand(1).item())
        ended.set()
        thread.join()
        alone = [torch.rand(1, generator=torch.Generator().manual_seed(seed)).item() for seed in (0, 1)]
        assert drawn == alone
        assert torch.equal(torch.random.get_rng_state(), state)
        assert warnings.filters == filters

    def test_a_warm_fit_agrees_with_a_fresh_one(self):
        generator = np.random.default_rng(8)
        points = generator.random((70, 3))
        losses = [float(math.sin(5 * point[0]) + point[1] ** 2) for point in points]
        with gaussian_process.local_torch(0):
            fresh = gaussian_process.fit(points, losses)
            before = gaussian_process.fit(points[:69], losses[:69])
            warm = gaussian_process.fit(points, losses, last=before.hyperparameters)
        assert np.log(warm.lengthscale[:2]) == pytest.approx(np.log(fresh.lengthscale[:2]), abs=0.2)
        assert fresh.lengthscale[2] > 2 * fresh.lengthscale[:2].max(), "the third coordinate does nothing"


class TestTrustRegion:
    def test_follows_success_and_failure(self):
        region = TrustRegion(tolerance=4)
        for _ in range(2):
            region = region.after(True)
        assert region.length == 0.8
        assert region.after(True).length == LONGEST
        assert region.after(True).after(True).after(True).after(True).length == LONGEST, "no further"
        assert region.after(False).after(True).after(True).length == 0.8, "only successes in a row count"
        for _ in range(4):
            region = region.after(False)
        assert region.length == 0.4
        halvings = 0
        while not region.exhausted:
            for _ in range(4):
                region = region.after(False)
            halvings += 1
        assert halvings == 6

    def test_candidates_stay_inside_and_near(self):
        centre, scales = np.full(100, 0.9), np.geomspace(0.1, 10, 100)
        offered = candidates_around(centre, scales, 0.2, 500, np.random.default_rng(9))
        sides = 0.2 * scales / np.exp(np.log(scales).mean())
        assert offered.shape == (500, 100)
        assert (np.abs(offered - centre) <= sides / 2 + 1e-12).all()
        assert offered.max() <= 1
        moved = (offered != centre).sum(1)
        assert moved.min() >= 1
        assert moved.mean() == pytest.approx(20.8, abs=1.0)
        assert np.prod(sides ** (1 / 100)) == pytest.approx(0.2)

    def test_follows_the_best_point_and_what_becomes_of_it(self, monkeypatch):
        """Three improvements double its side, as many failures as it tolerates halve it; a thousandth is none."""
        seen, surrogate = [], SimpleNamespace(hyperparameters=None, lengthscale=np.ones(1))

        def around(centre, lengthscale, length, most, generator):
            seen.append((centre[0], length))
            return np.array([[0.01 * len(seen)]])

        monkeypatch.setattr(gaussian_process, "fit", lambda points, losses, **how: surrogate)
        monkeypatch.setattr(gaussian_process, "thompson", lambda surrogate, offered: offered[0])
        monkeypatch.setattr(trust_region, "candidates_around", around)
        losses = [0.9, 0.8, 0.7, 0.6995, 0.75, 0.5]
        search = local_search(np.array([[0.5]]), [math.inf], TrustRegion(tolerance=2), 9, np.random.default_rng(0))
        asked = [next(search)[0], *(search.send(loss)[0] for loss in losses)]
        assert asked == pytest.approx([2 * 0.01 * (number + 1) - 1 for number in range(7)])
        assert [centre for centre, _ in seen] == pytest.approx([0.5, 0.01, 0.02, 0.03, 0.04, 0.04, 0.06])
        assert [length for _, length in seen] == [0.8, 0.8, 0.8, 1.6, 1.6, 0.8, 0.8]

    def test_nested_subspaces_spend_the_budget(self):
        assert nesting(100, 4) == nesting(128, 4), "2 x 4 x 4 x 4 is nearest to both"
        plan = nesting(128, 4)
        assert (plan.first, plan.splits) == (2, 3)
        tolerances = [plan.tolerance(2 * 4**level, 10_000) for level in range(4)]
        assert tolerances == [2, 8, 32, 128], "never more failures than dimensions"
        shares = [plan.tolerance(2 * 4**level, 700) * 6 for level in range(1, 4)]
        assert sum(shares) == pytest.approx(700, rel=0.1)
        assert nesting(241_734, 4).tolerance(1, 500) == 1

    def test_nested_subspaces_keep_what_was_evaluated_until_all_coordinates_are_apart(self, monkeypatch):
        """Of 2, 8 and 10 dimensions of 10, then of 2 anew; each is left after one point."""
        finer, seen, asked, split = [], [], [], baxus.split

        def recorded(*words):
            found = split(*words)
            finer.append(found[0])
            return found

        def once(points, losses, region, candidates, generator):
            seen.append((points, list(losses), region.tolerance))
            point = generator.random(points.shape[1])
            loss = yield 2 * point - 1
            return np.vstack([points, point]), [*losses, loss]

        monkeypatch.setattr(baxus, "split", recorded)
        monkeypatch.setattr(baxus, "local_search", once)
        search = Baxus(initial=3).search(10, 40, np.random.default_rng(1))
        run_search(search, lambda point: asked.append(point) or float(len(asked)), 10)
        assert [points.shape for points, *_ in seen] == [(3, 2), (4, 8), (5, 10), (3, 2)]
        assert [losses for _, losses, _ in seen] == [[1, 2, 3], [1, 2, 3, 4], [1, 2, 3, 4, 5], [7, 8, 9]]
        assert [tolerance for *_, tolerance in seen] == [1, 5, 10, 1]
        for embedding, (points, *_) in zip(finer, seen[1:], strict=False):
            assert np.stack([embedding.lift(2 * point - 1) for point in points]) == pytest.approx(
                np.stack(asked[: len(points)])
            )
