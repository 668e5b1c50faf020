"""The problem: evaluation, metering, budgets, and memory that survives a kill."""

import json
import math
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.problem import (
    Budget,
    BudgetExceeded,
    DrapeProblem,
    Journal,
    ProblemError,
)
from cusick_bench.sim import outcome

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(7)


def clock_of_drapes(monkeypatch: pytest.MonkeyPatch, seconds: float) -> list[float]:
    """A clock that stands still but for drapes, each of which takes so long; its only entry is the time [s]."""
    clock, simulate = [0.0], DrapeProblem.simulate

    def slow(self, taus, warm=None):
        clock[0] += seconds * len(taus)
        return simulate(self, taus, warm)

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(DrapeProblem, "simulate", slow)
    return clock


class TestEvaluation:
    def test_gradient_is_the_derivative(self, generator):
        problem = toy_problem(budget=Budget())
        tau = problem.space.bending_level(2.0)
        direction = generator.standard_normal(problem.dimension)
        direction /= np.linalg.norm(direction)
        loss, gradient = problem.evaluate_and_gradient(tau)
        step = 1e-5 * direction
        numeric = (problem.evaluate(tau + step) - problem.evaluate(tau - step)) / 2e-5
        assert gradient @ direction == pytest.approx(numeric, rel=1e-4)
        assert loss == pytest.approx(problem.evaluate(tau), rel=1e-12)

    def test_truth_fits_best(self):
        problem = toy_problem(bending=3.0, budget=Budget())
        losses = [problem.evaluate(problem.space.bending_level(factor)) for factor in (0.5, 1.0, 3.0, 9.0)]
        assert np.argmin(losses) == 2

    def test_observation_is_what_the_loss_is_of(self):
        problem = toy_problem()
        tau = problem.space.bending_level(2.0)
        seen = problem.observe(tau)
        assert np.square(seen.image - problem.train_image).mean() == pytest.approx(seen.loss, rel=1e-12)
        assert seen.vertices.shape == (problem.simulator.mesh.vertices, 3)
        assert problem.evaluate(tau) == seen.loss
        assert (problem.image(tau) == seen.image).all()
        assert (problem.drape(tau) == seen.vertices).all()

    def test_equilibrium_follows_its_branch(self, monkeypatch):
        problem = toy_problem(mode="equilibrium", budget=Budget())
        problem.evaluate(problem.space.bending_level(2.0))
        near = torch.as_tensor(problem.space.bending_level(2.05))[None]
        cold = replace(problem, follow=False).simulate(near)
        monkeypatch.setattr(outcome, "drop_batch", None)  # a warm start drops nothing
        warm = problem.simulate(near)
        assert warm.iterations[0] <= max(cold.iterations[0], 8)
        assert warm.vertices == pytest.approx(cold.vertices, abs=1e-6)

    def test_draws_of_a_prediction_do_not_follow_the_branch_of_the_fit(self, monkeypatch):
        """A draw is of another specimen, which is laid down by itself; it was sought from the fit's own folds."""
        dropped, drop = [], outcome.drop_batch
        monkeypatch.setattr(outcome, "drop_batch", lambda *words, **named: dropped.append(1) or drop(*words, **named))
        problem = toy_problem(mode="equilibrium", budget=Budget())
        tau = problem.space.bending_level(2.0)
        problem.evaluate(tau)
        fit = len(dropped)
        problem.evaluate(tau)
        assert len(dropped) == fit, "a fit goes on from the best drape"
        problem.draw_batch(tau[None])
        assert len(dropped) == fit + 1
        assert not problem.meter.trace[-1].jumped

    def test_a_specimen_may_be_laid_down_whatever_was_followed(self):
        """Its own folds count, and as the best drape so far it is followed from then on."""
        problem = toy_problem(space="field", mode="equilibrium", bending=0.3, vertices=150)
        flat = problem.space.bending_level(0.3)
        folded = flat.copy()
        folded[problem.space.weights("laying")] = np.random.default_rng(6).standard_normal(300)
        followed, own = problem.evaluate(flat), replace(problem, follow=False).evaluate(folded)
        assert own < 0.9 * followed
        assert problem.evaluate(folded) == pytest.approx(followed, rel=1e-9)
        assert problem.evaluate_as_laid(folded) == own
        assert problem.evaluate(flat) == pytest.approx(own, rel=1e-6)

    def test_drapes_of_meshes_of_any_size_are_journalled(self, monkeypatch, tmp_path):
        """A resumed run is fed with them; gradients that are too long are their solver's matter."""
        monkeypatch.setattr("cusick_bench.problem.metering.journal.LONGEST", 10)
        tau, again = np.zeros(39), {}
        for _ in range(2):
            problem = replace(toy_problem(budget=Budget()), journal=Journal(tmp_path, "key"))
            again[len(again)] = problem.observe(tau)
            problem.journal.close()
        assert (again[0].vertices == again[1].vertices).all()


class TestBudget:
    def test_meter_counts(self):
        problem = toy_problem(budget=Budget())
        tau = np.zeros(39)
        problem.evaluate(tau)
        problem.evaluate_and_gradient(tau)
        problem.image(tau)
        meter = problem.meter
        assert (meter.forward, meter.gradient, meter.forward_equivalents) == (3, 1, 4)
        assert meter.simulated_seconds == pytest.approx(3 * 20 * 0.05)
        assert [entry.kind for entry in meter.trace] == ["loss", "gradient", "drape"]
        assert 0 < meter.trace[0].wall_seconds <= meter.trace[-1].wall_seconds <= meter.wall_seconds

    @pytest.mark.parametrize("limit", [1, 2, 3, 4, 7])
    def test_forward_equivalents_are_never_exceeded(self, limit, generator):
        problem = toy_problem(budget=Budget(limit))
        calls = [problem.evaluate, problem.evaluate_and_gradient, problem.image]

        def spend() -> None:
            for _ in range(100):
                calls[generator.integers(3)](np.zeros(39))

        with pytest.raises(BudgetExceeded, match="raise --budget"):
            spend()
        assert limit - 1 <= problem.meter.forward_equivalents <= limit

    def test_time_is_kept_from_experience(self, monkeypatch):
        """Of 100 s each evaluation takes 30 s: the fourth would end at 120 s and is not begun."""
        clock = clock_of_drapes(monkeypatch, 30.0)
        problem = toy_problem(budget=Budget(seconds=100))
        problem.meter._clock_zero = clock[0]

        def spend() -> None:
            for _ in range(9):
                problem.evaluate(np.zeros(39))

        with pytest.raises(BudgetExceeded, match=r"90\.0 of 100 s .* takes about 30\.0 s; raise --seconds"):
            spend()
        assert [entry.wall_seconds for entry in problem.meter.trace] == [30, 60, 90]

    def test_reserve_is_kept_back_and_given_free(self):
        problem = toy_problem(budget=Budget(3))
        with problem.meter.reserve(1):
            problem.evaluate(np.zeros(39))
            problem.evaluate(np.zeros(39))
            with pytest.raises(BudgetExceeded):
                problem.evaluate(np.zeros(39))
        problem.image(np.zeros(39))
        assert problem.meter.forward_equivalents == 3

    def test_a_drape_kept_back_is_granted_however_late_it_is(self):
        problem = toy_problem(budget=Budget(seconds=0.05))
        with problem.meter.reserve(1), suppress(BudgetExceeded):
            while True:
                problem.evaluate(np.zeros(39))
        time.sleep(0.05)
        problem.observe(np.zeros(39))
        with pytest.raises(BudgetExceeded):
            problem.observe(np.zeros(39))

    def test_the_time_of_a_drape_kept_back_is_kept_back_too(self, monkeypatch):
        """Of 100 s each drape takes 30 s: after two there is time for one more, and that is the one kept back."""
        clock = clock_of_drapes(monkeypatch, 30.0)
        problem = toy_problem(budget=Budget(seconds=100))
        problem.meter._clock_zero = clock[0]
        with problem.meter.reserve(1):
            for _ in range(2):
                problem.evaluate(np.zeros(39))
            with pytest.raises(BudgetExceeded, match=r"60\.0 of 100 s .* takes about 60\.0 s; raise --seconds"):
                problem.evaluate(np.zeros(39))
        problem.observe(np.zeros(39))
        assert problem.meter.wall_seconds == 90

    def test_the_share_that_is_done_counts_the_prediction_too(self):
        problem = toy_problem(budget=Budget(6))
        tau = np.zeros(problem.dimension)
        for _ in range(3):
            problem.evaluate(tau)
        assert problem.meter.share == pytest.approx(3 / 6)
        problem.meter.draws = 2
        assert problem.meter.share == pytest.approx(3 / 8)
        problem.draw_batch(tau[None])  # the search is over, whatever it has spent
        assert problem.meter.share == pytest.approx(7 / 8)
        problem.draw_batch(tau[None])
        assert problem.meter.share == 1

    def test_without_a_limit_no_share_is_known_before_the_prediction(self):
        problem = toy_problem(budget=Budget())
        tau = np.zeros(problem.dimension)
        problem.meter.draws = 2
        problem.evaluate(tau)
        assert math.isnan(problem.meter.share)
        problem.draw_batch(tau[None])
        assert problem.meter.share == pytest.approx(1 / 2)

    @pytest.mark.parametrize("drapes", [None, 100])
    def test_the_share_of_a_search_that_its_time_ends_does_not_fall_at_the_first_draw(self, monkeypatch, drapes):
        """There is time for three drapes, and the prediction takes two: it fell from 1 to 1/2, and rose again."""
        clock = clock_of_drapes(monkeypatch, 30.0)
        problem, shares = toy_problem(budget=Budget(drapes, seconds=90)), []
        problem.meter._clock_zero, problem.meter.draws = clock[0], 2
        tau = np.zeros(problem.dimension)
        for _ in range(3):
            problem.evaluate(tau)
            shares.append(problem.meter.share)
        for _ in range(2):
            problem.draw_batch(tau[None])
            shares.append(problem.meter.share)
        assert shares == pytest.approx([1 / 5, 2 / 5, 3 / 5, 4 / 5, 1])

    @pytest.mark.parametrize("options", [{"forward_equivalents": 0}, {"seconds": -1.0}, {"seconds": math.nan}])
    def test_budget_must_be_positive(self, options):
        with pytest.raises(ProblemError, match="must be > 0"):
            Budget(**options)

    @pytest.mark.parametrize("name", ["forward_equivalents", "seconds"])
    def test_a_budget_without_limit_is_left_out_and_not_infinite(self, name):
        """Solvers plan with the number of drapes that they may make."""
        with pytest.raises(ProblemError, match="finite, got inf; leave it out for no limit"):
            Budget(**{name: math.inf})

    def test_best_loss_never_rises(self, generator):
        problem = toy_problem(budget=Budget(8))
        for _ in range(8):
            problem.evaluate(problem.sample_prior(generator))
        best = [entry.best_loss for entry in problem.meter.trace]
        assert best == list(np.minimum.accumulate([entry.loss for entry in problem.meter.trace]))


def _walk(problem: DrapeProblem, steps: int) -> list[float]:
    """A small deterministic optimiser that uses every kind of call."""
    tau, numbers = problem.space.bending_level(1.5), []
    for _ in range(steps):
        loss, gradient = problem.evaluate_and_gradient(tau)
        tau = tau - 2.0 * gradient
        numbers += [loss, problem.evaluate(tau), float(problem.image(tau).sum())]
    return numbers


class TestJournal:
    @pytest.mark.parametrize("mode", ["drop", "equilibrium"])
    def test_resumed_numbers_are_those_of_an_undisturbed_run(self, tmp_path, mode):
        def make(folder):
            return toy_problem(mode=mode, budget=Budget(100), folder=folder)

        expected = _walk(make(tmp_path / "whole"), 3)
        _walk(make(tmp_path / "killed"), 1)
        resumed = make(tmp_path / "killed")
        assert _walk(resumed, 3) == expected
        whole = make(tmp_path / "whole")
        _walk(whole, 3)
        assert whole.meter.forward_equivalents == resumed.meter.forward_equivalents

    def test_replay_computes_nothing(self, tmp_path, monkeypatch):
        expected = _walk(toy_problem(folder=tmp_path), 2)
        again = toy_problem(folder=tmp_path)
        monkeypatch.setattr(type(again.simulator), "drape_batch", None)
        assert _walk(again, 2) == expected

    @pytest.mark.parametrize("cut", [1, 40, 300, 3000])
    def test_a_torn_end_is_dropped(self, tmp_path, cut):
        problem = toy_problem(folder=tmp_path)
        expected = _walk(problem, 2)
        problem.journal.close()
        for name in ("trace.jsonl", "state.bin"):
            lines = (tmp_path / "trace.jsonl").read_bytes().splitlines(keepends=True)
            arrays = [8 * sum(map(math.prod, json.loads(line)["arrays"].values())) for line in lines]
            path = tmp_path / name
            path.write_bytes(path.read_bytes()[:-cut])
            left = path.stat().st_size
            sound = int((np.cumsum(arrays if name == "state.bin" else list(map(len, lines))) <= left).sum())
            assert _walk(toy_problem(folder=tmp_path), 2) == expected, f"after {name} lost {cut} bytes"
            again = (tmp_path / "trace.jsonl").read_bytes().splitlines(keepends=True)
            assert again[:sound] == lines[:sound], "what is sound is not computed again"

    def test_another_runs_journal_is_refused(self, tmp_path):
        toy_problem(folder=tmp_path).evaluate(np.zeros(39))
        with pytest.raises(ProblemError, match="begin anew without what is kept there"):
            toy_problem(folder=tmp_path).evaluate(np.ones(39))

    def test_wall_clock_goes_on_where_it_stopped(self, tmp_path):
        first = toy_problem(folder=tmp_path)
        first.evaluate(np.zeros(39))
        second = toy_problem(folder=tmp_path)
        second.evaluate(np.zeros(39))
        assert second.meter.trace == first.meter.trace
        assert second.meter.wall_seconds >= first.meter.trace[-1].wall_seconds

    def test_what_an_earlier_run_had_time_for_is_not_refused(self, tmp_path):
        toy_problem(folder=tmp_path).evaluate(np.zeros(39))
        late = toy_problem(folder=tmp_path, budget=Budget(seconds=1e-9))
        late.evaluate(np.zeros(39))
        with pytest.raises(BudgetExceeded):
            late.evaluate(np.ones(39))

    def test_what_an_earlier_run_had_no_time_for_is_refused_again(self, tmp_path):
        """It was killed after its search had run out of time: the search ends there again, and nothing is lost."""
        first = toy_problem(folder=tmp_path, budget=Budget(seconds=1e9))
        taus = np.random.default_rng(0).normal(size=(4, 39))
        first.evaluate(taus[0])
        first.observe_batch(taus[:2])  # as many of a larger batch as there was time for
        first.observe(taus[0])
        late = toy_problem(folder=tmp_path, budget=Budget(seconds=1e9))
        with late.meter.reserve(1):
            late.evaluate(taus[0])
            assert len(late.observe_batch(taus)) == 2
            for ask in (late.evaluate, late.evaluate_and_gradient, late.image):
                with pytest.raises(BudgetExceeded, match=r"no time for 1 x .* before the run was killed"):
                    ask(taus[3])
            with pytest.raises(BudgetExceeded):
                late.observe_batch(taus[2:])
        late.observe(taus[0])
        assert late.meter.trace == first.meter.trace

    def test_a_batch_cut_short_by_time_stays_so_where_the_run_is_stopped_after_it(self, tmp_path, monkeypatch):
        """Of a batch of 12 drapes of 10 s there is time for 9 of 100 s, whether or not the run is then stopped."""
        clock = clock_of_drapes(monkeypatch, 10.0)
        taus = np.random.default_rng(0).normal(size=(12, 39))
        for _ in range(2):
            problem = toy_problem(folder=tmp_path, budget=Budget(seconds=100))
            problem.meter._clock_zero = clock[0]
            problem.observe(taus[0])
            assert len(problem.observe_batch(taus)) == 9
            with pytest.raises(BudgetExceeded):
                problem.observe_batch(taus[9:])
            assert problem.meter.forward == 10
            clock[0] += 1000.0

    def test_failures_are_replayed(self, tmp_path, fail_drapes):
        fail_drapes(lambda count: count == 1)
        assert toy_problem(folder=tmp_path).evaluate(np.zeros(39)) == math.inf
        assert toy_problem(folder=tmp_path).evaluate(np.zeros(39)) == math.inf
        assert toy_problem().evaluate(np.zeros(39)) < 1

    def test_own_state_restores_meter_and_branch(self, tmp_path):
        first = toy_problem(mode="equilibrium", folder=tmp_path)
        tau = first.space.bending_level(2.0)
        first.evaluate(tau)
        first.save(step=np.array(1))
        first.evaluate(0.9 * tau)  # lost: the kill comes before the next save
        second = toy_problem(mode="equilibrium", folder=tmp_path)
        state = second.restore()
        assert state is not None
        assert state["step"] == 1
        assert second.meter.trace == first.meter.trace[:1]
        assert second.evaluate(0.9 * tau) == first.meter.trace[1].loss
        assert len(Journal(tmp_path)._past) == 2

    def test_drapes_before_the_first_saved_state_are_not_made_again(self, tmp_path, monkeypatch):
        """Those by which a solver looks for its start; gradients, which may be too long to be kept, are asked anew."""
        first, tau = toy_problem(folder=tmp_path), np.zeros(39)
        seen = [first.observe(tau), first.observe(tau + 0.1)]
        first.evaluate_and_gradient(tau)
        second, simulate, simulated = toy_problem(folder=tmp_path), DrapeProblem.simulate, []
        monkeypatch.setattr(
            DrapeProblem, "simulate", lambda self, taus, **how: simulated.append(1) or simulate(self, taus, **how)
        )
        assert second.restore() is None
        assert second.meter.forward == 0
        again = [second.observe(tau), second.observe(tau + 0.1)]
        assert not simulated
        assert [one.loss for one in again] == [one.loss for one in seen]
        second.evaluate_and_gradient(tau)
        assert simulated == [1]
        assert second.meter.forward_equivalents == first.meter.forward_equivalents == 4

    def test_without_saved_state_a_solver_starts_afresh(self, tmp_path):
        toy_problem(folder=tmp_path).evaluate(np.zeros(39))
        problem = toy_problem(folder=tmp_path)
        assert problem.restore() is None
        problem.evaluate(np.ones(39))
        assert problem.meter.forward == 1


class TestBatches:
    """Several vectors at once are the same as one by one."""

    TAUS = np.random.default_rng(0).normal(size=(5, 39))

    @pytest.mark.parametrize("mode", ["drop", "equilibrium"])
    def test_same_numbers_and_costs_as_one_by_one(self, mode):
        together, alone = (toy_problem(budget=Budget(), mode=mode) for _ in range(2))
        if mode == "equilibrium":  # a batch starts from one branch; one by one, each improvement moves it
            together, alone = replace(together, follow=False), replace(alone, follow=False)
        losses, gradients = together.evaluate_and_gradient_batch(self.TAUS)
        singles = [alone.evaluate_and_gradient(tau) for tau in self.TAUS]
        assert (losses == [loss for loss, _ in singles]).all()
        assert gradients == pytest.approx(np.stack([gradient for _, gradient in singles]), rel=1e-12)
        assert together.meter.forward_equivalents == alone.meter.forward_equivalents == 10
        assert [entry.best_loss for entry in together.meter.trace] == [entry.best_loss for entry in alone.meter.trace]

    def test_a_batch_beyond_the_budget_is_refused_whole(self):
        problem = toy_problem(budget=Budget(9))
        with pytest.raises(BudgetExceeded, match=r"5 evaluations \(gradient\) cost 10"):
            problem.evaluate_and_gradient_batch(self.TAUS)
        assert problem.meter.forward == 0

    def test_draws_are_counted_and_free(self):
        problem = toy_problem(budget=Budget(1))
        seen = problem.draw_batch(self.TAUS)
        assert problem.meter.forward == 5
        assert problem.meter.forward_equivalents == 0
        assert seen[2] is not None
        assert (seen[2].image == toy_problem().image(self.TAUS[2])).all()

    def test_a_batch_that_was_killed_half_way_goes_on(self, tmp_path):
        whole = toy_problem(budget=Budget()).evaluate_batch(self.TAUS)
        killed = toy_problem(budget=Budget(), folder=tmp_path)

        def kill(evaluation):
            if killed.meter.forward == 2:
                raise KeyboardInterrupt

        killed.meter.observers.append(kill)
        with pytest.raises(KeyboardInterrupt):
            killed.evaluate_batch(self.TAUS)
        resumed = toy_problem(budget=Budget(), folder=tmp_path)
        assert (resumed.evaluate_batch(self.TAUS) == whole).all()
        assert resumed.meter.forward == 5

    def test_jumps_to_other_folds_are_counted(self):
        problem = toy_problem(mode="equilibrium", budget=Budget(), vertices=200)
        for level in (0.2, 0.21, 1.0, 5.0, 30.0):
            problem.evaluate(problem.space.bending_level(level))
        assert 0 < problem.meter.jumped < 5
        assert not problem.meter.trace[1].jumped
