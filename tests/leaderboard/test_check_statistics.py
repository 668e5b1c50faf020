"""The regression check sees a planted 5 % degradation, and cries wolf no more often than it says."""

import numpy as np
import pandas as pd
import pytest
from made_up_runs import METRICS, SOLVERS, cells, verdicts

from cusick_bench.leaderboard.cells.cell_number import SEEDS
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.gate import paired
from cusick_bench.leaderboard.gate.check import Gate, check
from cusick_bench.leaderboard.gate.paired import compare, holm

pytestmark = pytest.mark.usefixtures("fewer_permutations")


class TestStatistics:
    def test_the_interval_of_a_ratio_may_hold_1_whichever_way_all_cloths_went(self):
        generator = np.random.default_rng(0)
        before = {(cloth, 0): 1.0 for cloth in "abc"}
        after = {("a", 0): 1.05, ("b", 0): 3.0, ("c", 0): 1.1}
        worse = compare(before, after, level=0.05, generator=generator).ratio
        better = compare(after, before, level=0.05, generator=generator).ratio
        assert worse.low < 0.9
        assert better.high > 1.1

    def test_the_ratio_is_a_mean_over_cloths_however_many_seeds_each_has(self):
        changes = {("a", seed): 1 + 1e-3 * seed for seed in range(2)} | {
            ("b", seed): 2 + 1e-3 * seed for seed in range(6)
        }
        ratio = compare(dict.fromkeys(changes, 1.0), changes, level=0.05, generator=np.random.default_rng(0)).ratio
        assert ratio.value == pytest.approx(2**0.5, rel=2e-3)
        assert ratio.low < ratio.value < ratio.high

    def test_seeds_of_a_left_out_sample_do_not_narrow_the_interval_of_the_ratio(self):
        def width(seeds: int) -> float:
            factors = (
                (split * SEEDS + seed, one + 1e-4 * seed)
                for split, one in enumerate((1.0, 1.2, 1.5))
                for seed in range(seeds)
            )
            after = {("a", number): factor for number, factor in factors}
            found = compare(dict.fromkeys(after, 1.0), after, level=0.05, generator=np.random.default_rng(0))
            return found.ratio.high / found.ratio.low

        assert width(8) == pytest.approx(width(1), rel=0.02)

    def test_the_values_of_a_cloth_are_put_together_no_more_often_for_more_seeds(self, monkeypatch):
        """For every seed anew they took minutes of a thousand seeds."""
        calls, scale = [], paired._scale
        monkeypatch.setattr(paired, "_scale", lambda cloth: calls.append(len(cloth)) or scale(cloth))
        for seeds in (10, 40):
            before = {("a", seed): 1 + 1e-3 * seed for seed in range(seeds)}
            after = {cell: 1.01 * value for cell, value in before.items()}
            compare(before, after, level=0.05, generator=np.random.default_rng(0))
        assert calls.count(10) == calls.count(40) > 0

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ((0, 1, 2), (10, 11, 12)),
            pytest.param((0, 1), (0, 1), marks=pytest.mark.slow),
            pytest.param((0,), (7,), marks=pytest.mark.slow),
        ],
    )
    def test_reruns_pass_as_often_as_promised(self, old, new):
        """120 reruns of the same code: at 5 % more than 13 alarms would come by chance once in 250 trials."""
        generator = np.random.default_rng([1, len(old)])
        alarms = sum(
            bool(check(cells(new, generator), cells(old, generator), Gate(METRICS)).regressions) for _ in range(120)
        )
        assert alarms <= 13

    @pytest.mark.parametrize("new", [(0, 1, 2), (10, 11, 12)])
    def test_five_per_cent_are_seen_through_three_per_cent_of_noise(self, new):
        generator = np.random.default_rng(2)
        seen = 0
        for _ in range(20):
            outcome = check(cells(new, generator, {"sampler": 1.05}), cells((0, 1, 2), generator), Gate(METRICS))
            seen += any(finding.solver == "sampler" for finding in outcome.regressions)
        assert seen >= 18

    def test_what_seeds_do_not_move_is_seen_at_once_and_blamed_alone(self):
        generator = np.random.default_rng(3)
        before, after = cells((0,), generator), cells((5,), generator, {"exact": 1.05})
        found = check(after, before, Gate(METRICS)).regressions
        assert {finding.solver for finding in found} == {"exact"}
        assert {finding.metric for finding in found} == set(METRICS)
        assert found[0].ratio.value == pytest.approx(1.05)

    @pytest.mark.parametrize(("factor", "expected"), [(1.015, "unchanged"), (0.9, "unchanged"), (1.03, "regression")])
    def test_small_changes_and_better_ones_are_none(self, factor, expected):
        generator = np.random.default_rng(4)
        outcome = check(cells((0,), generator, {"exact": factor}), cells((0,), generator), Gate(METRICS))
        assert verdicts(outcome)["exact", "test_mse"] == expected

    @pytest.mark.parametrize("least", [0.0, -0.001])
    def test_one_value_at_0_or_below_does_not_outweigh_all_others(self, least):
        """As an energy distance may be, whose geometric mean over cloths one such value decides."""
        cell = {"solver": "s", "seed": 0, "status": "done"}
        before = pd.DataFrame([cell | {"cloth": f"{place:02}", "test_energy_distance": 0.01} for place in range(20)])
        after = before.assign(test_energy_distance=[least] + 19 * [0.02])
        (finding,) = check(after, before, Gate(("test_energy_distance",))).findings
        assert (finding.verdict, finding.ratio.value < 1) == ("regression", True)
        assert "x 1.7" in finding.detail
        assert not check(before, after, Gate(("test_energy_distance",))).regressions

    def test_repeated_seeds_that_change_nothing_count_once(self):
        before = {("a", seed): 1.0 for seed in range(9)} | {("b", seed): 2.0 for seed in range(9)}
        after = {(cloth, seed): value for cloth, value in (("a", 1.1), ("b", 1.9)) for seed in range(9)}
        found = compare(before, after, level=0.01, generator=np.random.default_rng(0))
        assert (found.units, found.test) == (2, "t")
        assert found.p > 0.1

    def test_seeds_of_a_left_out_sample_that_change_nothing_count_once(self):
        changes = dict(enumerate((1.1, 1.02, 1.05, 0.99)))
        before = {("a", split * SEEDS + seed): 1.0 + split for split in changes for seed in range(9)}
        after = {(cloth, number): value * changes[number // SEEDS] for (cloth, number), value in before.items()}
        found = compare(before, after, level=0.01, generator=np.random.default_rng(0))
        assert (found.units, found.test) == (4, "t")
        assert found.p > 0.05

    def test_students_t_is_about_the_mean_over_cloths_however_many_seeds_each_has(self):
        """One cloth half as bad again, four seeds of the other a seventh better: worse in the mean over cloths."""
        after = {("a", 0): 1.5} | {("b", seed): 0.86 + 0.005 * seed for seed in range(4)}
        before = dict.fromkeys(after, 1.0)
        worse, better = (
            compare(*pair, level=0.01, generator=np.random.default_rng(0))
            for pair in ((before, after), (after, before))
        )
        assert (worse.test, worse.units) == ("t", 5)
        assert worse.ratio.value > 1.1
        assert worse.p < 0.25
        assert worse.p + better.p == pytest.approx(1.0)

    def test_permutations_are_exact_where_all_can_be_counted(self):
        """Fourteen cloths all worse: one arrangement of 2^14 is as extreme."""
        generator = np.random.default_rng(5)
        before = {(str(cloth), 0): 1.0 for cloth in range(14)}
        after = {(str(cloth), 0): 1.0 + generator.uniform(0.01, 0.1) for cloth in range(14)}
        paired_p = compare(before, after, level=0.05, generator=generator).p
        mixed = {cell: value if int(cell[0]) % 2 else 2 - value for cell, value in after.items()}
        assert paired_p <= 2 / 2001
        assert 0.05 < compare(before, mixed, level=0.05, generator=generator).p < 0.95

    def test_a_level_that_random_permutations_cannot_reach_hides_no_regression(self):
        """Of 2000 the least p is 1 / 2001, six times that over six tests, so that nothing could be found at 1e-3."""
        before = cells(range(6), np.random.default_rng(12))
        outcome = check(cells(range(6), np.random.default_rng(13), {"noisy": 10}), before, Gate(METRICS, level=1e-3))
        assert {(one.solver, one.comparison.test) for one in outcome.regressions if one.comparison} == {("noisy", "t")}
        assert len(outcome.regressions) == len(METRICS)

    @pytest.mark.parametrize(
        ("cloths", "level", "test"), [(6, 0.05, "t"), (30, 0.05, "permutation"), (12, 0.02, "permutation")]
    )
    def test_a_detectable_change_is_found_in_four_of_five_cases(self, cloths, level, test, monkeypatch):
        """Student's t of six cloths finds it in .83; at the level alone it would be found in half of them.

        With quantiles of the normal distribution twelve cloths would find it in .64.
        """
        monkeypatch.setattr("cusick_bench.leaderboard.bootstrap.RESAMPLES", 20)  # of an interval that nobody reads
        generator, before = np.random.default_rng(9), {(str(cloth), 0): 1.0 for cloth in range(cloths)}

        def compared(factor: float):
            after = {cell: factor * np.exp(generator.normal(0, 0.03)) for cell in before}
            return compare(before, after, level=level, generator=generator)

        alike = [compared(1.0) for _ in range(100)]
        assert {one.test for one in alike} == {test}
        detectable = float(np.mean([one.detectable for one in alike]))
        found = np.mean([compared(detectable).p <= level for _ in range(200)])
        assert found == pytest.approx(0.8, abs=0.1)

    def test_a_solver_of_which_no_change_would_be_found_is_not_called_unchanged(self):
        """Twice and six times the values of two cloths: Student's t with one degree of freedom finds nothing."""
        before = pd.DataFrame({"solver": "mine", "cloth": ["one", "two"], "seed": 0, "status": "done", "test_mse": 1.0})
        after = before.assign(test_mse=[2.0, 6.0])
        outcome = check(after, before, Gate(("test_mse",)))
        (finding,) = outcome.findings
        assert (finding.verdict, outcome.decided) == ("undecided", False)
        assert "values scatter too much" in finding.detail
        same = check(before, before, Gate(("test_mse",)))
        assert ([one.verdict for one in same.findings], same.decided) == (["unchanged"], True)
        (worse,) = check(before.assign(test_mse=2.0), before, Gate(("test_mse",))).regressions
        assert worse.detail == ""

    def test_solvers_whose_changes_could_be_missed_are_named(self):
        """Of five cloths with 10 % of noise between seeds; a solver that seeds do not move hides nothing."""
        before, after = (cells((0,), np.random.default_rng(seed)) for seed in (10, 11))
        (note,) = [one for one in check(after, before, Gate(METRICS)).notes if "could have been missed" in one]
        assert note.startswith("A change of 5 % could have been missed in noisy, sampler: add cloths or seeds")

    def test_holm_multiplies_by_what_is_left(self):
        assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
        adjusted = holm([0.01, float("nan")])
        assert adjusted[0] == pytest.approx(0.01)
        assert np.isnan(adjusted[1])

    def test_one_cell_decides_nothing_and_says_so(self):
        before = pd.DataFrame([{"solver": "s", "cloth": "a", "seed": 0, "status": "done", "train_mse": 0.01}])
        outcome = check(before.assign(train_mse=0.02), before, Gate(("train_mse",)))
        assert verdicts(outcome) == {("s", "train_mse"): "undecided"}
        assert any("Too few cells" in note for note in outcome.notes)
        assert "(Holm over 0 tests," in outcome.notes[0]


class TestCells:
    @pytest.fixture
    def run(self) -> pd.DataFrame:
        return cells((0, 1), np.random.default_rng(6))

    def test_a_solver_that_is_gone_is_a_regression_and_a_new_one_is_none(self, run):
        renamed = run.replace({"solver": {"exact": "exact2"}})
        found = verdicts(check(renamed, run, Gate(METRICS)))
        assert found["exact", "cells"] == "regression"
        assert found["exact2", "cells"] == "new"

    def test_a_missing_cloth_is_a_regression(self, run):
        lost = run.loc[~((run["solver"] == "noisy") & (run["cloth"] == "c"))]
        assert [finding.detail for finding in check(lost, run, Gate(METRICS)).regressions] == ["lacks c"]

    def test_failures_are_a_regression_unless_they_were_as_common_before(self, run):
        failed = run.copy()
        failed.loc[0, ["status", *METRICS]] = ["failed", None, None]
        (finding,) = check(failed, run, Gate(METRICS)).regressions
        assert "1 of 10 cells failed, 0 of 10 in the baseline" in finding.detail
        elsewhere = run.copy()
        elsewhere.loc[1, ["status", *METRICS]] = ["failed", None, None]
        outcome = check(failed, elsewhere, Gate(METRICS))
        assert not outcome.regressions
        assert f"(Holm over {len(SOLVERS) * len(METRICS) + 1} tests," in outcome.notes[0]  # Fisher's is one of them

    def test_new_cloths_and_seeds_are_told_but_not_judged(self, run):
        cell = run[(run["solver"] == "noisy") & (run["cloth"] == "c")].head(1)
        for status, told in (
            ("done", ["new; 0 of 1"]),
            ("failed", ["new; 1 of 1", "seeds not in the baseline; 1 of 1"]),
        ):
            new = [cell.assign(cloth="new", status=status), cell.assign(seed=99, status=status)]
            outcome = check(pd.concat([run, *new], ignore_index=True), run, Gate(METRICS))
            assert outcome.regressions == []
            found = [finding.detail for finding in outcome.findings if finding.verdict == "new"]
            assert len(found) == len(told)
            assert all(words in detail for words, detail in zip(told, sorted(found), strict=True))

    def test_a_cloth_without_shared_seeds_is_judged_as_a_whole(self, run):
        """If other cloths shared theirs, it was said to be none of the baseline's, and its failures did not count."""
        later = run.assign(seed=run["seed"] + 10 * (run["cloth"] == "c"))
        assert not [finding for finding in check(later, run, Gate(METRICS)).findings if finding.metric == "cells"]
        failed = (later["solver"] == "noisy") & (later["seed"] == 10)
        later.loc[failed, ["status", *METRICS]] = ["failed", None, None]
        (finding,) = check(later, run, Gate(METRICS)).regressions
        assert "1 of 10 cells failed, 0 of 10 in the baseline" in finding.detail

    def test_other_data_or_settings_cannot_be_compared(self, run):
        old = run.assign(dataset_hash="abc", settings="one")
        with pytest.raises(LeaderboardError, match="dataset hash abc, got xyz"):
            check(old.assign(dataset_hash="xyz"), old, Gate(METRICS))
        with pytest.raises(LeaderboardError, match=r"settings one, got two.*--write"):
            check(old.assign(settings="two"), old, Gate(METRICS))
        with pytest.raises(LeaderboardError, match=r"protocol first-1, got first-8.*--protocol"):
            check(old.assign(protocol="first-8"), old.assign(protocol="first-1"), Gate(METRICS))

    def test_means_are_of_the_cells_that_are_compared(self):
        before, after = cells((0, 1, 2), np.random.default_rng(1)), cells((1,), np.random.default_rng(2))
        (found,) = (one for one in check(after, before, Gate(("test_mse",))).findings if one.solver == "noisy")
        same = (before["solver"] == "noisy") & (before["seed"] == 1)
        assert found.before == pytest.approx(before.loc[same, "test_mse"].mean())

    @pytest.mark.parametrize("metric", ["test_iou", "test_dc_cover_90", "train_dc_target", "test_fold_p", "draws"])
    def test_metrics_of_which_more_may_be_better_are_refused(self, metric):
        with pytest.raises(LeaderboardError, match=r"smaller is not better|nobody is better or worse"):
            Gate((metric,))
