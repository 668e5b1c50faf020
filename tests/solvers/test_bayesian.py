"""Gradient-free searches: embeddings, processes, trust regions, and what they reach on functions with known answers."""

import json
import math
import subprocess
import sys
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar
from toy_problem import toy_problem
from typer.testing import CliRunner

from cusick_bench.benchmark.optimisers.functions import (
    FUNCTIONS,
    BenchmarkError,
    HiddenFunction,
    branin,
    hartmann6,
    hide,
)
from cusick_bench.benchmark.optimisers.runs import METHODS, Plan, Published, run_once, summary
from cusick_bench.cli import app
from cusick_bench.problem import Budget
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.bayesian_optimisation import gaussian_process, trust_region
from cusick_bench.solvers.bayesian_optimisation.baxus import nesting
from cusick_bench.solvers.bayesian_optimisation.embedding import (
    balanced_embedding,
    gaussian_embedding,
    hash_embedding,
    split,
)
from cusick_bench.solvers.bayesian_optimisation.hesbo import Hesbo
from cusick_bench.solvers.bayesian_optimisation.rembo import in_turn
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

# Least values of Branin's function where one number moves both of its coordinates, the same way or opposite ways.
COLLISION = {1: 17.17809, -1: 0.92482}


def _values(solver, function, dimension: int, evaluations: int, seed: int = 0) -> list[float]:
    """Losses of a run."""
    seen: list[float] = []

    def value(point):
        assert point.shape == (dimension,)
        assert np.abs(point).max() <= 1, "left the box"
        seen.append(function(point))
        return seen[-1]

    run_search(solver.search(dimension, evaluations, np.random.default_rng(seed)), value, evaluations)
    return seen


class TestEmbeddings:
    def test_rembo_clips_random_directions(self):
        generator = np.random.default_rng(0)
        embedding = gaussian_embedding(4000, 4, generator)
        assert embedding.matrix.mean(0) == pytest.approx(np.zeros(4), abs=0.06)
        assert np.cov(embedding.matrix.T) == pytest.approx(np.eye(4), abs=0.1)
        corner = np.array([1.0, -1.0, 1.0, 1.0])
        raw = embedding.matrix @ (2 * corner)  # y reaches to sqrt(d) = 2
        lifted = embedding.lift(corner)
        inside = np.abs(raw) <= 1
        assert 0 < inside.sum() < 4000
        assert (lifted[inside] == raw[inside]).all()
        assert (lifted[~inside] == np.sign(raw[~inside])).all()

    def test_hesbo_hashes_evenly_with_random_signs(self):
        embedding = hash_embedding(6000, 6, np.random.default_rng(1))
        point = np.linspace(-1, 1, 6)
        assert (embedding.lift(point) == embedding.signs * point[embedding.bins]).all()
        assert set(embedding.signs) == {-1.0, 1.0}
        assert embedding.signs.mean() == pytest.approx(0, abs=0.05)
        sizes = np.bincount(embedding.bins, minlength=6)
        assert np.square(sizes - 1000).sum() / 1000 < 20.5, "chi-square of 5 degrees of freedom at 0.001"
        assert np.ptp(sizes) > 1, "bins are independent, not balanced"

    def test_split_subspaces_contain_the_coarser_ones(self):
        generator = np.random.default_rng(2)
        embedding = balanced_embedding(103, 3, generator)
        assert np.ptp(np.bincount(embedding.bins)) <= 1
        for _ in range(4):
            finer, parents = split(embedding, 4, generator)
            point = generator.uniform(-1, 1, embedding.embedded)
            assert len(parents) == finer.embedded > embedding.embedded
            assert (finer.lift(point[parents]) == embedding.lift(point)).all()
            sizes = np.bincount(finer.bins)
            assert sizes.min() >= 1
            assert sizes.max() <= math.ceil(np.bincount(embedding.bins).max() / 4)
            embedding = finer
            if embedding.embedded == 103:
                break
        assert embedding.embedded == 103

    def test_too_many_dimensions_are_refused(self):
        for draw in (gaussian_embedding, hash_embedding, balanced_embedding):
            with pytest.raises(SolverError, match="1 to 5 of its own, got 6"):
                draw(5, 6, np.random.default_rng(0))

    def test_searches_take_turns_and_learn_their_own_losses(self):
        told: dict[str, list[float]] = {"a": [], "b": []}

        def search(name):
            while True:
                told[name].append((yield np.array([ord(name)])))

        asked: list[str] = []
        run_search(in_turn([search("a"), search("b")]), lambda p: asked.append(chr(int(p[0]))) or float(len(asked)), 5)
        assert asked == ["a", "b", "a", "b", "a"]
        assert told == {"a": [1.0, 3.0], "b": [2.0]}


class TestCollision:
    """Where a hash puts both coordinates of Branin's function into one bin, one number t is all that is left."""

    @pytest.mark.parametrize("sign", COLLISION)
    def test_best_reachable_value(self, sign):
        def along(t):
            return branin((np.array([t, sign * t]) + 1) / 2)

        grid = np.linspace(-1, 1, 401)
        start = grid[int(np.argmin([along(t) for t in grid]))]
        best = minimize_scalar(along, bounds=(start - 0.01, start + 0.01), method="bounded", options={"xatol": 1e-10})
        assert best.fun == pytest.approx(COLLISION[sign], abs=5e-6)

    @pytest.mark.parametrize("sign", COLLISION)
    def test_hesbo_reaches_it_and_no_more(self, sign):
        """Searches a 100-dimensional box through an embedding whose active coordinates collide."""
        for seed in count():
            embedding = hash_embedding(100, 2, np.random.default_rng(seed))
            if embedding.bins[3] == embedding.bins[7] and embedding.signs[3] * embedding.signs[7] == sign:
                break
        hidden = HiddenFunction(FUNCTIONS["branin"], np.array([3, 7]))
        values = _values(Hesbo(embedded=2, initial=5), hidden, 100, 16, seed=seed)
        assert min(values) >= COLLISION[sign] - 5e-6
        assert min(values) <= COLLISION[sign] + 0.1


class TestFunctions:
    def test_known_minima(self):
        for x, y in ((-math.pi, 12.275), (math.pi, 2.275), (9.42478, 2.475)):
            assert branin(np.array([(x + 5) / 15, y / 15])) == pytest.approx(FUNCTIONS["branin"].optimum, abs=1e-5)
        best = np.array([0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573])
        assert hartmann6(best) == pytest.approx(FUNCTIONS["hartmann6"].optimum, abs=1e-5)

    def test_only_active_coordinates_matter(self):
        hidden = hide("hartmann6", 50, np.random.default_rng(3))
        generator = np.random.default_rng(4)
        point, other = generator.uniform(-1, 1, (2, 50))
        other[hidden.active] = point[hidden.active]
        assert len(set(hidden.active)) == 6
        assert hidden(point) == hidden(other) == hartmann6((point[hidden.active] + 1) / 2)
        for index in hidden.active:
            moved = point.copy()
            moved[index] *= 0.5
            assert hidden(moved) != hidden(point)

    def test_impossible_ones_are_refused(self):
        with pytest.raises(BenchmarkError, match="unknown test function 'ackley'; use one of branin"):
            hide("ackley", 10, np.random.default_rng(0))
        with pytest.raises(BenchmarkError, match="6 coordinates, got dimension 5"):
            hide("hartmann6", 5, np.random.default_rng(0))


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
        values = _values(CmaEs(), lambda point: float(np.square(point - target).sum()), 5, 700)
        assert min(values) < 1e-6

    def test_cmaes_of_many_coordinates_keeps_no_matrix(self):
        values = _values(CmaEs(), lambda point: float(np.square(point - 0.2).mean()), 20_000, 90)
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

        values = _values(VanillaBo(initial=6), half_failing, 2, 18)
        assert math.inf in values
        assert min(values) < 0.01

    @pytest.mark.parametrize("name", ["vanilla-bo", "turbo"])
    def test_thousands_of_coordinates(self, name):
        solver = make_solver(f"{name},initial=6")
        values = _values(solver, lambda point: float(np.square(point - 0.2).mean()), 2000, 9)
        assert len(values) == 9
        assert min(values[6:]) < min(values[:6])

    def test_a_process_of_failures_only_still_asks(self):
        assert _values(VanillaBo(initial=3), lambda point: math.inf, 4, 5) == [math.inf] * 5


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


class TestDrapes:
    def _answer(self, text, problem, seed=0):
        return make_solver(text).solve(problem, np.random.default_rng(seed))

    @pytest.mark.parametrize("text", ["rembo,embeddings=2,embedded=3", "hesbo,initial=3,embedded=4", "cmaes", "sobol"])
    def test_heterogeneous_cloth_and_resumption(self, text, tmp_path):
        """A parameter for every element; a killed run ends with the numbers of an undisturbed one."""
        problem = toy_problem(space="heter", budget=Budget(8), folder=tmp_path / "whole")
        expected = self._answer(text, problem)
        assert expected.tau is not None
        assert expected.tau.shape == (problem.dimension,)
        assert np.abs(expected.tau).max() <= 3
        killed = toy_problem(space="heter", budget=Budget(8), folder=tmp_path / "killed")

        def kill(evaluation):
            if killed.meter.forward == 6:
                raise KeyboardInterrupt

        killed.meter.observers.append(kill)
        with pytest.raises(KeyboardInterrupt):
            self._answer(text, killed)
        resumed = toy_problem(space="heter", budget=Budget(8), folder=tmp_path / "killed")
        answer = self._answer(text, resumed)
        assert (answer.tau == expected.tau).all()
        assert [e.loss for e in resumed.meter.trace] == [e.loss for e in problem.meter.trace]

    def test_hesbo_fits_a_homogeneous_cloth(self):
        problem = toy_problem(budget=Budget(16))
        answer = self._answer("hesbo,embedded=3,initial=6", problem, seed=1)
        first = min(evaluation.loss for evaluation in problem.meter.trace[:6])
        assert problem.meter.best_loss < 0.6 * first
        assert not answer.finished

    def test_failures_are_told_as_such(self, monkeypatch, fail_drapes):
        problem, told = toy_problem(budget=Budget(6)), []
        fail_drapes(lambda count: True)

        def listen(self, dimension, evaluations, generator):
            while True:
                told.append((yield np.zeros(dimension)))

        monkeypatch.setattr(VanillaBo, "search", listen)
        with pytest.raises(DrapeDiverged):
            self._answer("vanilla-bo", problem)
        assert told == [math.inf] * 5

    @pytest.mark.parametrize(("budget", "expected"), [(Budget(6), 5), (Budget(1), 1), (Budget(seconds=60), 500)])
    def test_a_search_plans_with_what_the_last_drape_leaves_of_the_budget(self, budget, expected, monkeypatch):
        plans = []

        def planned(self, dimension, evaluations, generator):
            plans.append(evaluations)
            return (np.zeros(dimension) for _ in range(1))

        monkeypatch.setattr(VanillaBo, "search", planned)
        self._answer("vanilla-bo", toy_problem(budget=budget, vertices=60))
        assert plans == [expected]

    def test_progress_is_told(self):
        heard: list[tuple[str, float]] = []
        make_solver("sobol").solve(
            toy_problem(budget=Budget(5)), np.random.default_rng(0), lambda *news: heard.append(news)
        )
        assert [fraction for _, fraction in heard] == pytest.approx([0.2, 0.4, 0.6, 0.8])

    @pytest.mark.parametrize("name", [*BAYESIAN, "cmaes", "sobol"])
    def test_a_budget_is_needed(self, name):
        with pytest.raises(SolverError, match="give --budget"):
            self._answer(name, toy_problem(budget=Budget()))

    @pytest.mark.parametrize(
        "text", ["rembo,initial=1", "hesbo,initial=0", "rembo,embeddings=0", "baxus,parts=1", "cmaes,sigma=0"]
    )
    def test_odd_options_are_refused(self, text):
        with pytest.raises(SolverError, match="got"):
            make_solver(text)


def test_the_list_of_solvers_waits_for_no_slow_package():
    code = (
        "import sys; from cusick_bench.solvers.registry import registered; names = registered()\n"
        "print(*names, '|', *{'botorch', 'gpytorch', 'linear_operator', 'cma'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names, loaded = done.stdout.split("|")
    assert {*BAYESIAN, "cmaes", "sobol"} <= set(names.split())
    assert not loaded.split()


class TestBenchmark:
    def test_summary_compares_in_standard_errors(self):
        found = summary([1.0, 3.0, 2.0, 6.0], Published(1.0, 0.5, 0.9))
        assert found["mean"] == 3.0
        assert found["standard_error"] == pytest.approx(math.sqrt(14 / 3 / 4))
        assert found["median"] == 2.5
        assert found["z"] == pytest.approx(2.0 / math.hypot(found["standard_error"], 0.5))
        assert math.isnan(summary([1.0, 2.0], None)["z"])

    def test_command_prints_ours_beside_theirs(self):
        arguments = ["optimisers", "--function", "hartmann6", "--runs", "20", "--solver", "sobol"]
        document = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
        (row,) = document["methods"]
        assert document["evaluations"] == 200
        assert row["published"] == {"mean": -2.325, "standard_error": 0.039, "median": None}
        assert abs(row["z"]) < 3
        assert len(row["best"]) == 20
        table = CliRunner().invoke(app, arguments)
        assert "-2.325" in table.stdout

    def test_bad_input_is_refused(self):
        for arguments, message in (
            (["--solver", "magic"], "unknown method 'magic'"),
            (["--function", "ackley"], "unknown test function"),
            (["--runs", "0"], "--runs"),
            (["--dimension", "1"], "got dimension 1"),
        ):
            result = CliRunner().invoke(app, ["optimisers", *arguments])
            assert result.exit_code == 2
            assert message in result.output

    def test_every_method_is_a_registered_solver(self):
        for name, make in METHODS.items():
            assert make(FUNCTIONS["branin"]).name == name
            assert make_solver(name).kind == "solver"
