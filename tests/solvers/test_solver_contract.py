"""The contract that every registered solver keeps, and what its prediction must be."""

import math
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from solver_answers import answer_of, posed
from threadpoolctl import threadpool_info, threadpool_limits
from toy_problem import toy_problem

from cusick_bench.metrics.found_stiffness import find_stiffness
from cusick_bench.problem import Budget
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.solvers.base import Prediction, Solver, SolverError
from cusick_bench.solvers.registry import make_solver, registered

# those that search; one that reads the answer off a mesh has no search to interrupt
SOLVERS = [name for name, solver in registered().items() if solver.kind == "solver" and not solver.needs_mesh]
NULLS = [name for name, solver in registered().items() if solver.kind == "null"]
ORACLES = [name for name, solver in registered().items() if solver.kind == "oracle"]


pytestmark = pytest.mark.usefixtures("one_thread")


@dataclass(frozen=True)
class Summing(Solver):
    """Adds up a million numbers."""

    name: ClassVar[str] = "summing"

    def _solve(self, problem, generator, progress):
        numbers = generator.standard_normal(1_000_003)
        threads = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
        notes = {"sum": float(numbers @ numbers), "threads": threads}
        return Prediction(problem.train_image, problem.train_image[None], notes=notes)


@dataclass(frozen=True)
class Answering(Solver):
    """Makes its answer from the one that copies the training silhouette."""

    name: ClassVar[str] = "answering"
    answer: Any = None

    def _solve(self, problem, generator, progress):
        return self.answer(Prediction(problem.train_image, problem.train_image[None]))


def _blas_threads() -> dict[str, int]:
    return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


class TestContract:
    """Every registered solver; a new one is checked without another line here."""

    @pytest.mark.parametrize("name", registered())
    def test_says_what_it_is(self, name):
        solver = make_solver(name)
        assert solver.name == name
        assert solver.summary
        assert solver.kind in ("solver", "null", "oracle")
        assert isinstance(solver.options, dict)
        assert solver == make_solver(name)

    @pytest.mark.parametrize("name", registered())
    def test_answers_within_its_budget_and_again_the_same(self, name, heldout):
        problem = posed(name, budget=Budget(9))
        first = answer_of(name, problem, heldout, seed=3)
        assert problem.meter.forward_equivalents <= 9
        assert first.draws.shape[1:] == (256, 256)
        again = answer_of(name, posed(name, budget=Budget(9)), heldout, seed=3)
        assert (first.draws == again.draws).all()
        assert (first.train_image == again.train_image).all()

    @pytest.mark.threads
    def test_answers_are_the_same_on_any_number_of_threads(self):
        """A long sum has another last digit on two threads of BLAS, of which a limp cloth makes another drape."""
        problem, found = toy_problem(), []
        for threads in (1, 2):
            with threadpool_limits(limits=threads, user_api="blas"):
                before = _blas_threads()
                found.append(Summing().solve(problem, np.random.default_rng(0)).notes)
                assert before.items() <= _blas_threads().items()  # more of them where it is the first to load a library
        assert found[0] == found[1]
        assert found[1]["threads"] == [1] * len(found[1]["threads"])

    @pytest.mark.threads
    def test_solvers_in_other_threads_share_the_settings_of_the_process_and_put_them_back(self, monkeypatch):
        """The later one found the settings of the earlier one and put those back; in no thread had BLAS one thread."""
        monkeypatch.setattr(sys, "stdout", sys.stdout)  # put back where the test fails
        begun, both, ended = (threading.Event() for _ in range(3))

        def earlier(fit):
            begun.set()
            assert both.wait(60)
            return fit

        def later(fit):
            both.set()
            assert ended.wait(60)
            return replace(fit, notes={"threads": [*_blas_threads().values()], "quiet": sys.stdout is sys.stderr})

        def solve(answer):
            return Answering(answer).solve(toy_problem(), np.random.default_rng(0))

        with threadpool_limits(limits=2, user_api="blas"), ThreadPoolExecutor(2) as pool:
            solve(lambda fit: fit)  # libraries are loaded now
            before, output = _blas_threads(), sys.stdout
            first = pool.submit(solve, earlier)
            assert begun.wait(60)
            second = pool.submit(solve, later)
            first.result()
            ended.set()
            notes = second.result().notes
            assert (_blas_threads(), sys.stdout) == (before, output)
        assert notes == {"threads": [1] * len(before), "quiet": True}

    @pytest.mark.parametrize("name", SOLVERS)
    def test_its_drape_is_that_of_its_parameters(self, name):
        problem = posed(name, budget=Budget(9))
        answer = answer_of(name, problem)
        assert answer.tau is not None
        seen = posed(name).observe(answer.tau)
        assert answer.train_image == pytest.approx(seen.image, abs=1e-9)
        assert answer.vertices == pytest.approx(seen.vertices, abs=1e-12)
        loss = np.square(answer.train_image - problem.train_image).mean()
        assert loss == pytest.approx(problem.meter.best_loss, rel=1e-9), "not the best point it saw"

    @pytest.mark.parametrize("name", SOLVERS)
    def test_the_smallest_budget_buys_the_prior_median(self, name):
        problem = posed(name, budget=Budget(1))
        answer = answer_of(name, problem)
        assert (answer.tau == 0).all()
        assert problem.meter.forward_equivalents == 1

    @pytest.mark.parametrize("name", SOLVERS)
    def test_survives_drapes_that_fail(self, name, fail_drapes):
        problem = posed(name, budget=Budget(12))
        fail_drapes(lambda count: count % 3 == 2)
        try:
            assert math.isfinite(answer_of(name, problem).train_image.sum())
        except DrapeDiverged:
            assert problem.meter.trace[-1].kind == "drape", "only the final drape may fail the solver"
        assert problem.meter.failed > 0

    @pytest.mark.parametrize("name", SOLVERS)
    def test_a_killed_run_ends_with_the_same_numbers(self, name, tmp_path):
        expected = answer_of(name, posed(name, budget=Budget(14), folder=tmp_path / "whole"))
        killed = posed(name, budget=Budget(14), folder=tmp_path / "killed")

        def kill(evaluation):
            if killed.meter.forward == 4:
                raise KeyboardInterrupt

        killed.meter.observers.append(kill)
        with pytest.raises(KeyboardInterrupt):
            answer_of(name, killed)
        resumed = posed(name, budget=Budget(14), folder=tmp_path / "killed")
        answer = answer_of(name, resumed)
        assert (answer.tau == expected.tau).all()
        assert (answer.train_image == expected.train_image).all()
        assert resumed.meter.forward_equivalents <= 14

    @pytest.mark.parametrize("name", NULLS + ORACLES)
    def test_reference_rows_simulate_nothing(self, name, heldout):
        problem = toy_problem()
        answer_of(name, problem, heldout)
        assert problem.meter.forward == 0

    @pytest.mark.parametrize("name", ORACLES)
    def test_oracles_need_what_they_are_shown(self, name):
        with pytest.raises(SolverError, match="needs held-out images"):
            answer_of(name, toy_problem())

    @pytest.mark.parametrize("name", [name for name in SOLVERS if registered()[name].needs_gradient])
    def test_gradients_are_asked_for_where_there_are_some(self, name, monkeypatch):
        problem = posed(name)
        monkeypatch.setattr(type(problem.space), "differentiable", False)
        with pytest.raises(SolverError, match=r"needs gradients.*nlopt:LN_BOBYQA"):
            answer_of(name, problem)
        assert problem.meter.forward == 0


class TestPrediction:
    @pytest.mark.parametrize(
        ("train", "draws", "message"),
        [
            (np.zeros((2, 2)), np.zeros((1, 256, 256)), "at least one image of 2 x 2 pixels"),
            (np.zeros((256, 256)), np.zeros((0, 256, 256)), "at least one image"),
            (np.zeros((256, 256)), np.full((1, 256, 256), np.nan), r"must lie in \[0, 1\]"),
            (np.full((256, 256), 255.0), np.zeros((1, 256, 256)), r"must lie in \[0, 1\]"),
            (np.ones((256, 256), np.uint8), np.zeros((1, 256, 256)), r"train_image must hold floats .* got uint8"),
        ],
    )
    @pytest.mark.unchecked_arrays
    def test_nonsense_is_refused(self, train, draws, message):
        with pytest.raises(SolverError, match=message):
            Prediction(train, draws)

    @pytest.mark.unchecked_arrays
    def test_a_list_of_images_and_tensors_are_one_array(self):
        image = np.eye(4)
        for train, draws in ((image, [image, image]), (torch.eye(4), torch.eye(4).expand(2, 4, 4))):
            answer = Prediction(train, draws)  # pyright: ignore[reportArgumentType]
            assert np.array_equal(answer.train_image, image)
            assert np.array_equal(answer.draws, np.stack([image, image]))
        with pytest.raises(SolverError, match="draws must be one array of images"):
            Prediction(image, [image, np.eye(3)])  # pyright: ignore[reportArgumentType]

    @pytest.mark.parametrize(
        ("parts", "message"),
        [
            ({"draw_vertices": np.zeros((1, 3, 3))}, "a drape for each of 2 draws, got 1"),
            ({"posterior": {"names": np.array(["a", None])}}, "array of numbers or text, got one of objects"),
            ({"notes": {"optimiser": object()}}, "notes must hold numbers, arrays and text"),
        ],
    )
    @pytest.mark.unchecked_arrays
    def test_parts_that_could_not_be_kept_are_refused(self, parts, message):
        with pytest.raises(SolverError, match=message):
            Prediction(np.zeros((256, 256)), np.zeros((2, 256, 256)), **parts)

    @pytest.mark.parametrize(
        ("answer", "message"),
        [
            (lambda fit: None, "answering must answer with a Prediction, got None"),
            (lambda fit: replace(fit, tau=np.zeros(40)), r"a tau of 39 numbers, got shape \(40,\)"),
        ],
    )
    def test_an_answer_to_another_problem_is_refused(self, answer, message):
        problem = toy_problem()
        with pytest.raises(SolverError, match=message):
            Answering(answer).solve(problem, np.random.default_rng(0))

    @pytest.mark.parametrize("given", [np.full(39, 0.5, np.float32), [0.5] * 39, np.ones(39, int)])
    @pytest.mark.unchecked_arrays
    def test_parameters_of_any_numbers_are_read_in_double_precision(self, given):
        problem = toy_problem()
        answer = Answering(lambda fit: replace(fit, tau=given)).solve(problem, np.random.default_rng(0))
        assert isinstance(answer.tau, np.ndarray)
        assert answer.tau.dtype == np.float64
        found, _ = find_stiffness(Answering(), problem, answer)
        assert found is not None

    def test_its_time_begins_with_it_and_not_with_the_problem(self, monkeypatch):
        """Problems that are posed together are solved one after the other; pauses between two answers cost nothing."""
        clock = [0.0]
        monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
        problem = toy_problem(budget=Budget(seconds=60))
        problem.meter._clock_zero = clock[0]

        def working(fit):
            began = problem.meter.wall_seconds
            clock[0] += 10
            problem.evaluate(np.zeros(39))
            return replace(fit, notes={"began": began})

        found = []
        for _ in range(2):
            clock[0] += 3600
            found.append(Answering(working).solve(problem, np.random.default_rng(0)).notes["began"])
        assert found == [0, 10]

    def test_what_a_solver_prints_is_no_result(self, capfd):
        problem = toy_problem()

        def telling(fit):
            print("step 1")
            return fit

        Answering(telling).solve(problem, np.random.default_rng(0))
        assert capfd.readouterr() == ("", "step 1\n")
