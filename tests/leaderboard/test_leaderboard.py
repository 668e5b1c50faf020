"""Leaderboards on synthetic results whose truth is known, and on damaged folders."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from cusick_bench.cli.results.leaderboard import leaderboard
from cusick_bench.leaderboard import (
    LeaderboardError,
    csv,
    difference,
    estimate,
    html_table,
    interquartile_mean,
    latex,
    leaderboards,
    load_cells,
    markdown,
    text_table,
)
from cusick_bench.leaderboard.bootstrap import beside, cell_values, geometric_mean, mean
from cusick_bench.leaderboard.cells.cell_number import SEEDS
from cusick_bench.leaderboard.verification.submit import append, rows_of
from cusick_bench.metrics.distributions.proper_scores import variogram_score
from cusick_bench.runner import Store

app = typer.Typer()
app.command()(leaderboard)

CLOTHS = ("blue", "pink", "white", "viscose", "red")
DIFFICULTY = dict(zip(CLOTHS, (0.03, 0.04, 0.05, 0.06, 0.07), strict=True))


def write_cell(folder: Path, solver: str, cloth: str, seed: int = 0, **changes) -> Path:
    cell = folder / "cells" / f"{solver}-{cloth}-{seed}".replace(":", "_")
    cell.mkdir(parents=True)
    metrics = {"train_mse": 0.01, "test_mse": 0.05, "test_mse_best": 0.05, "draws": 1, "floor_mse": 0.0064}
    metrics |= {"test_hausdorff_m": 0.0316, "test_dc_error": 0.02, "test_folds_error": 0.5}
    record = {
        "solver": solver,
        "kind": solver.split(":")[0] if ":" in solver else "solver",
        "cloth": cloth,
        "seed": seed,
        "space": "homo",
        "vertices": 2699,
        "dataset": "cusick",
        "dataset_hash": "abc",
        "protocol": "paper",
        "code_version": "1",
        "settings": {"loss": "mse", "drape": {"steps": 100}},
    }
    record |= {key: value for key, value in changes.items() if key in (*record, "status", "failure")}
    metrics |= {key: value for key, value in changes.items() if key not in (*record, "status", "failure", "done")}
    (cell / "cell.json").write_text(json.dumps(record))
    spent = {"forward_equivalents": 240, "wall_seconds": 61.5}
    (cell / "result.json").write_text(json.dumps({"status": "done"} | record | {"spent": spent, "metrics": metrics}))
    if changes.get("done", True) and record.get("status") != "failed":
        (cell / "done").touch()
    return cell


def write_solver(folder: Path, solver: str, value: Callable[[str, int], float], seeds: int = 4, **changes) -> None:
    for cloth in CLOTHS:
        for seed in range(seeds):
            write_cell(folder, solver, cloth, seed, test_mse=value(cloth, seed), **changes)


@pytest.fixture
def noise() -> np.random.Generator:
    return np.random.default_rng(0)


def only(folder: Path, **options):
    (board,) = leaderboards(load_cells(folder), **options)
    return board


def ranks(board) -> dict[str, int | None]:
    return {row.label: row.rank for row in board.rows}


# -- statistics


def test_interquartile_mean_drops_the_outer_quarters():
    assert interquartile_mean(np.array([0.0, 1, 2, 3, 4, 5, 6, 1000])) == pytest.approx(3.5)
    assert interquartile_mean(np.array([1.0, 2, 6])) == pytest.approx(3)


def test_stratified_interval_holds_the_true_mean_as_often_as_it_says():
    """Cloths differ tenfold in level, seeds by 0.01: only seeds are resampled, so the interval is narrow, and right."""
    truth, hits, widths = 0.55, 0, []
    for trial in range(100):
        generator = np.random.default_rng(trial)
        values = {(c, s): level + generator.normal(0, 0.01) for c, level in (("a", 0.1), ("b", 1.0)) for s in range(20)}
        interval = estimate(values, mean, generator)
        hits += interval.low <= truth <= interval.high
        widths.append(interval.high - interval.low)
    assert 88 <= hits <= 100
    assert np.mean(widths) == pytest.approx(2 * 1.96 * 0.01 / np.sqrt(40), rel=0.1)


@pytest.mark.parametrize(("cloths", "seeds"), [(3, 1), (5, 1), (12, 1), (3, 3)])
def test_intervals_of_few_units_hold_the_true_mean_as_often_as_they_say(cloths, seeds):
    """Normal values; percentile intervals would hold it in 75, 84, 91 and 83 % of cases."""
    generator, hits, trials = np.random.default_rng(cloths + seeds), 0, 400
    for _ in range(trials):
        drawn = generator.normal(0, 1, (cloths, seeds))
        interval = estimate({(str(c), s): drawn[c, s] for c, s in np.ndindex(cloths, seeds)}, mean, generator)
        hits += interval.low <= 0 <= interval.high
    assert hits / trials == pytest.approx(0.95, abs=0.03)


def test_a_mean_of_values_that_are_never_negative_is_not_negative(noise):
    errors = {("blue", 0): 0.001, ("red", 0): 0.001, ("white", 0): 0.1}
    assert estimate(errors, mean, noise).low == 0
    assert difference(errors, {cell: 0.0 for cell in errors}, mean, noise).low < 0


def test_the_interval_of_a_geometric_mean_knows_no_unit_and_no_direction():
    """Stretch stiffnesses in N/m and kN/m, and ratios to the one run or to the other."""

    def interval(numbers) -> np.ndarray:
        logarithms = {(str(place), 0): float(np.log(number)) for place, number in enumerate(numbers)}
        found = geometric_mean(logarithms, np.random.default_rng(0))
        return np.array([found.low, found.value, found.high])

    numbers = np.array([1.5, 20.0, 100.0])
    low, value, high = interval(numbers)
    assert value == pytest.approx(3000 ** (1 / 3))
    assert low < 1 < value < high
    assert 1000 * interval(numbers / 1000) == pytest.approx(np.array([low, value, high]))
    assert interval(1 / numbers)[1] == pytest.approx(1 / value)
    assert interval(1 / numbers)[2] > 1


def test_cloths_are_resampled_where_seeds_change_nothing(noise):
    single = {(cloth, 0): level for cloth, level in DIFFICULTY.items()}
    repeated = {(cloth, seed): level for cloth, level in DIFFICULTY.items() for seed in range(3)}
    for values in (single, repeated):
        interval = estimate(values, mean, np.random.default_rng(1))
        spread = np.std(list(DIFFICULTY.values()), ddof=1) / np.sqrt(5)
        assert interval.value == pytest.approx(0.05)
        assert interval.high - interval.low == pytest.approx(2 * 2.776 * spread, rel=0.1)  # Student's t of 4 degrees


def test_pairing_cancels_what_a_cloth_does_to_both(noise):
    first = {(cloth, 0): level + 0.002 + noise.normal(0, 1e-4) for cloth, level in DIFFICULTY.items()}
    second = {(cloth, 0): level for cloth, level in DIFFICULTY.items()}
    paired = difference(first, second, mean, noise)
    assert paired.value == pytest.approx(0.002, abs=2e-4)
    assert paired.high - paired.low < 5e-4 < estimate(first, mean, noise).high - estimate(first, mean, noise).low
    assert paired.decided


def test_difference_uses_shared_cells_and_stretches_a_single_seed(noise):
    first = {("blue", 0): 1.0, ("blue", 1): 3.0, ("red", 0): 9.0, ("white", 5): 1.0}
    second = {("blue", 0): 1.0, ("white", 5): 0.0, ("pink", 0): 7.0}
    assert difference(first, second, mean, noise).value == pytest.approx((1 + 1) / 2)


def test_too_few_cells_have_no_interval_and_decide_nothing(noise):
    lonely = estimate({("blue", 0): 0.1}, mean, noise)
    assert lonely.value == 0.1
    assert np.isnan(lonely.low)
    assert not lonely.decided


# -- ranks


def test_ties_are_grouped_and_real_differences_are_not(tmp_path, noise):
    write_solver(tmp_path, "best", lambda cloth, seed: DIFFICULTY[cloth] - 0.010 + noise.normal(0, 0.001))
    write_solver(tmp_path, "twin-a", lambda cloth, seed: DIFFICULTY[cloth] + noise.normal(0, 0.001))
    write_solver(tmp_path, "twin-b", lambda cloth, seed: DIFFICULTY[cloth] + noise.normal(0, 0.001))
    write_solver(tmp_path, "worst", lambda cloth, seed: DIFFICULTY[cloth] + 0.005 + noise.normal(0, 0.001))
    assert ranks(only(tmp_path)) == {
        "repeat of the same drape": None,
        "best": 1,
        "twin-a": 2,
        "twin-b": 2,
        "worst": 4,
    }


def test_equal_solvers_share_a_rank_nineteen_times_in_twenty():
    apart = 0
    for trial in range(100):
        generator = np.random.default_rng(1000 + trial)
        one, other = (
            {(c, s): DIFFICULTY[c] + generator.normal(0, 0.01) for c in CLOTHS for s in range(8)} for _ in "ab"
        )
        apart += difference(one, other, mean, generator).decided
    assert apart <= 14


def test_null_rows_are_ranked_and_oracles_and_the_floor_are_not(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: DIFFICULTY[cloth] + 1e-3 * seed)
    write_solver(tmp_path, "null:disc", lambda cloth, seed: DIFFICULTY[cloth] - 0.01, seeds=1)
    write_solver(tmp_path, "oracle:mean", lambda cloth, seed: 0.02, seeds=1)
    board = only(tmp_path)
    assert ranks(board) == {"repeat of the same drape": None, "oracle:mean": None, "null:disc": 1, "homo": 2}
    assert [row.kind for row in board.rows] == ["floor", "oracle", "null", "solver"]
    assert board.rows[0].value("test_mse") == pytest.approx(0.0064)


def test_a_row_that_lacks_a_cloth_is_shown_without_rank(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05 + 1e-4 * seed)
    for cloth in CLOTHS[:3]:
        write_cell(tmp_path, "easy", cloth, test_mse=0.001)
    board = only(tmp_path)
    assert ranks(board)["easy"] is None
    assert ranks(board)["homo"] == 1
    assert any("easy has no rank" in note and "viscose" in note for note in board.notes)


def test_a_row_that_lacks_the_metric_of_a_cloth_has_no_rank_by_it(tmp_path):
    """It is the worse one of every cloth that it has the metric of; its mean is small for want of the hard cloth."""
    for cloth, error in zip(CLOTHS, (0.02, 0.02, 0.02, 0.02, 0.2), strict=True):
        write_cell(tmp_path, "homo", cloth, test_hausdorff_m=None if cloth == "red" else 1.3 * error)
        write_cell(tmp_path, "heter", cloth, test_hausdorff_m=error)
    board = only(tmp_path, by="test_hausdorff_m")
    assert {row.label: row.rank for row in board.rows if row.kind == "solver"} == {"homo": None, "heter": 1}
    assert "homo has no rank: its cells on red have no test_hausdorff_m." in board.notes
    by_another = only(tmp_path)  # by test_mse, which all cells have
    assert set(ranks(by_another).values()) == {None, 1}
    said = "homo: its cells on red have no test_hausdorff_m; means of these are over other cloths"
    assert [note.startswith(said) for note in by_another.notes].count(True) == 1
    assert not any(note.startswith("heter") for note in by_another.notes)


def test_a_row_that_is_better_on_shared_cells_is_not_ranked_below(tmp_path, noise):
    """Two of four cells on the hard cloth have failed, so that the worse solver has the smaller mean."""
    for cloth, error in zip(CLOTHS, (0.02, 0.02, 0.02, 0.02, 0.2), strict=True):
        for seed in range(4):
            failed = {"status": "failed", "failure": "boom"} if (cloth, seed // 2) == ("red", 0) else {}
            write_cell(tmp_path, "homo", cloth, seed, test_mse=error * (1.1 + noise.normal(0, 0.01)), **failed)
            write_cell(tmp_path, "heter", cloth, seed, test_mse=error * (1 + noise.normal(0, 0.01)))
    board = only(tmp_path)
    assert [row.label for row in board.rows if row.kind == "solver"] == ["homo", "heter"]
    assert {row.rank for row in board.rows if row.kind == "solver"} == {1}
    assert any(note.startswith("homo has failed in 2 cells") for note in board.notes)


def test_rows_of_other_seeds_are_told(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05 + 1e-4 * seed)
    write_solver(tmp_path, "heter", lambda cloth, seed: 0.04 + 1e-4 * seed)
    assert not any("same seeds" in note for note in only(tmp_path).notes)
    write_cell(tmp_path, "heter", "red", 4, status="failed", failure="boom")
    write_cell(tmp_path, "homo", "red", 4)
    write_solver(tmp_path, "null:disc", lambda cloth, seed: 0.06, seeds=1)
    write_cell(tmp_path, "oracle:mean", "red", 9)
    said = [note for note in only(tmp_path).notes if "same seeds" in note]
    assert said == [
        "null:disc lacks 16 cells that other rows have (seed 1 on blue, seed 2 on blue, seed 3 on blue, ...); its mean "
        "is over other cells than theirs. Run all solvers with the same seeds (--seeds)."
    ]  # failed cells, cloths that a row lacks, and oracles have notes of their own


@pytest.mark.parametrize(
    ("by", "values", "order"),
    [
        ("test_dc_cover_90", {"sure": 0.35, "wide": 0.99, "right": 0.88}, ["right", "wide", "sure"]),
        ("test_dc_cover_50", {"sure": 0.45, "wide": 0.8, "right": 0.52}, ["right", "sure", "wide"]),
        ("test_fold_p", {"alike": 0.6, "rejected": 0.01, "near": 0.2}, ["alike", "near", "rejected"]),
        ("test_iou", {"alike": 0.95, "far": 0.7, "near": 0.9}, ["alike", "near", "far"]),
        ("test_energy_distance", {"alike": -0.1, "far": 2.0, "near": 0.9}, ["alike", "near", "far"]),
    ],
)
def test_best_comes_first_whichever_way_a_metric_is_better(tmp_path, noise, by, values, order):
    for name, value in values.items():
        for cloth in CLOTHS:
            write_cell(tmp_path, name, cloth, draws=50, **{by: value + noise.normal(0, 1e-3)})
    board = only(tmp_path, by=by)
    assert [row.solver for row in board.rows if row.rank] == order
    assert [row.rank for row in board.rows if row.rank] == [1, 2, 3]


def test_coverage_is_judged_by_its_mean_over_cells(tmp_path):
    """Half of the cells at 80 % and half at 100 % cover 90 %; all of them at 84 % do not."""
    for seed in range(8):
        for cloth in CLOTHS:
            write_cell(tmp_path, "either", cloth, seed, draws=50, test_dc_cover_90=0.8 + 0.2 * (seed % 2))
            write_cell(tmp_path, "low", cloth, seed, draws=50, test_dc_cover_90=0.84)
    assert ranks(only(tmp_path, by="test_dc_cover_90")) == {"either": 1, "low": 2, "repeat of the same drape": None}
    assert "ranked by test_dc_cover_90, nearest 90 % first" in text_table(only(tmp_path, by="test_dc_cover_90")).title


def test_what_is_neither_better_nor_worse_ranks_nobody(tmp_path):
    write_cell(tmp_path, "homo", "blue", train_dc=0.4)
    with pytest.raises(LeaderboardError, match="nobody is better or worse by 'train_dc'"):
        only(tmp_path, by="train_dc")


def test_mean_and_interquartile_mean_differ_by_an_outlier(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 1.0 if (cloth, seed) == ("red", 0) else 0.05)
    assert only(tmp_path).rows[-1].value("test_mse") == pytest.approx(0.05 + 0.95 / 20)
    assert only(tmp_path, statistic="iqm").rows[-1].value("test_mse") == pytest.approx(0.05)


def _leave_out(folder: Path, solver: str, seed: int, test_mse: dict[int, float]) -> None:
    """Cells of one cloth and seed, one for each sample that is left out."""
    for sample, value in test_mse.items():
        cell = write_cell(folder, solver, "red", 100 * sample + seed, test_mse=value)
        result = json.loads((cell / "result.json").read_text()) | {"seed": seed, "test": [sample]}
        (cell / "result.json").write_text(json.dumps(result))


def test_every_sample_that_is_left_out_in_turn_counts(tmp_path):
    for seed in (0, 1):
        _leave_out(tmp_path, "homo", seed, {4: 0.03, 5: 0.05, 7: 0.1})
    _leave_out(tmp_path, "heter", 0, {5: 0.06, 7: 0.11})
    (board,) = leaderboards(load_cells(tmp_path))
    assert {row.label: row.value("test_mse") for row in board.rows if row.label in ("homo", "heter")} == {
        "homo": pytest.approx(0.06), "heter": pytest.approx(0.085)
    }  # fmt: skip
    table = load_cells(tmp_path).table
    homo, heter = (cell_values(table[table["solver"] == solver], "test_mse") for solver in ("homo", "heter"))
    assert len(homo) == 6
    assert [homo[cell] - value for cell, value in heter.items()] == pytest.approx([-0.01, -0.01])  # of the same samples
    assert "by bootstrap, of the samples that are left out within each cloth, and" in board.notes[0]
    assert board.notes[1].startswith(
        "heter lacks 4 cells that other rows have (seed 0 on red split 1, seed 1 on red split 1, seed 1 on red split 2"
    )


def test_seeds_of_a_left_out_sample_are_no_samples_of_their_own(tmp_path):
    """All of them are scored on one sample: ten seeds that change nothing know no more than one."""
    intervals = []
    for seeds in (1, 10):
        for seed in range(seeds):
            _leave_out(tmp_path / str(seeds), "homo", seed, {4: 0.03, 5: 0.05, 7: 0.1, 8: 0.02})
        intervals.append(only(tmp_path / str(seeds)).rows[-1].estimates["test_mse"])
    assert intervals[0].value == pytest.approx(0.05)
    assert (intervals[1].low, intervals[1].high) == pytest.approx((intervals[0].low, intervals[0].high))


def test_one_seed_of_a_left_out_sample_stands_for_all_seeds_of_it(noise):
    first = {("red", split * SEEDS): 1.0 + split for split in range(3)}
    second = {("red", split * SEEDS + seed): 1.0 for split in range(3) for seed in range(4)}
    assert difference(first, second, mean, noise).value == pytest.approx(1.0)


def test_the_same_seed_gives_the_same_board(tmp_path, noise):
    write_solver(tmp_path, "homo", lambda cloth, seed: noise.normal(0.05, 0.01))
    assert csv([only(tmp_path, seed=3)]) == csv([only(tmp_path, seed=3)])
    assert csv([only(tmp_path, seed=3)]) != csv([only(tmp_path, seed=4)])


def test_best_of_n_stands_beside_as_many_random_phase_draws(tmp_path):
    write_solver(tmp_path, "bdp", lambda c, s: 0.06, draws=100, test_mse_best=0.038)
    write_solver(
        tmp_path,
        "null:random-phase",
        lambda c, s: 0.06,
        1,
        draws=1000,
        test_mse_best=0.035,
        test_mse_best_of_100=0.0395,
    )
    write_solver(tmp_path, "homo", lambda c, s: 0.07)
    rows = {row.solver: row for row in only(tmp_path).rows}
    assert rows["bdp"].matched_null == pytest.approx(0.0395)
    assert rows["null:random-phase"].matched_null == pytest.approx(0.035)
    assert np.isnan(rows["homo"].matched_null)
    assert "| .0380 /100 | .0395 |" in markdown(only(tmp_path))


def test_values_beside_a_solver_whose_seeds_change_nothing_count_by_cloth_as_its_own_do():
    """Cloths of 2, 5 and 3 seeds: the others differ from the solver's by .001 at most, and so do the means."""
    own = {(cloth, seed): value for cloth, value, seeds in (("a", 1.0, 2), ("b", 2.0, 5), ("c", 3.0, 3))
           for seed in range(seeds)}  # fmt: skip
    others = {(cloth, seed): value + 1e-3 * (seed % 2) for (cloth, seed), value in own.items()}
    assert estimate(own, mean, np.random.default_rng(0)).value == pytest.approx(2.0)
    assert beside(own, others, mean) == pytest.approx(2.0, abs=1e-3)


def test_random_phases_count_as_the_cells_beside_them_do(tmp_path):
    """Of one cloth four samples are left out in turn, of the other two: who is as good as chance is shown to be so."""
    for cloth, left_out, level in (("blue", 4, 0.05), ("red", 2, 0.02)):
        for sample in range(left_out):
            values = {"draws": 10, "test_mse_best": level + 1e-3 * sample, "test_mse": 0.06}
            for solver in ("null:random-phase", "sampler"):
                cell = write_cell(tmp_path, solver, cloth, sample, **values)
                result = json.loads((cell / "result.json").read_text()) | {"seed": 0, "test": [sample]}
                (cell / "result.json").write_text(json.dumps(result))
    (row,) = (row for row in only(tmp_path).rows if row.kind == "solver")
    assert row.matched_null == pytest.approx(row.value("test_mse_best"), rel=1e-12)
    (row,) = (row for row in only(tmp_path, statistic="iqm").rows if row.kind == "solver")
    assert row.matched_null == pytest.approx(row.value("test_mse_best"), rel=1e-12)


def test_settings_that_differ_make_rows_of_their_own(tmp_path):
    write_cell(tmp_path, "homo", "blue", 0)
    write_cell(tmp_path, "homo", "blue", 1, vertices=1205, settings={"loss": "mse", "drape": {"steps": 20}})
    assert set(ranks(only(tmp_path))) == {
        "repeat of the same drape",
        "homo (vertices=2699, drape.steps=100)",
        "homo (vertices=1205, drape.steps=20)",
    }


def test_data_sets_are_never_mixed(tmp_path):
    write_cell(tmp_path, "homo", "blue", 0)
    write_cell(tmp_path, "homo", "fabric_9", 0, dataset="lab", dataset_hash="def")
    assert [board.dataset for board in leaderboards(load_cells(tmp_path))] == ["cusick", "lab"]


# -- damaged folders


def test_failed_unfinished_and_damaged_cells_are_named_and_not_fatal(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05)
    write_cell(tmp_path, "heter", "blue", status="failed", failure="DrapeDiverged: residual 0.3")
    write_cell(tmp_path, "heter", "red", done=False)
    (tmp_path / "cells" / "empty").mkdir()
    (write_cell(tmp_path, "heter", "pink") / "result.json").write_text('{"solver": "heter", "ki')
    (write_cell(tmp_path, "heter", "white") / "result.json").write_text("[1, 2]")
    write_cell(tmp_path, "heter", "viscose", train_mse="good")
    cells = load_cells(tmp_path)
    assert sorted(cell.status for cell in cells.skipped) == ["damaged"] * 3 + ["failed"] + ["unfinished"] * 2
    assert set(cells.table["solver"]) == {"homo"}
    notes = " ".join(only(tmp_path).notes)
    assert "residual 0.3" in notes
    assert "heter on pink" in notes


def test_a_cell_that_was_edited_is_left_out_with_a_note(tmp_path):
    kept, edited = (write_cell(tmp_path, "homo", cloth) for cloth in ("blue", "red"))
    for cell in (kept, edited):
        Store(tmp_path).mark_done(cell.name)
    text = (edited / "result.json").read_text()
    (edited / "result.json").write_text(text.replace('"test_mse": 0.05,', '"test_mse": 0.01,'))
    assert load_cells(tmp_path).table["cloth"].tolist() == ["blue"]
    (note,) = [note for note in only(tmp_path).notes if note.startswith("Left out")]
    assert "damaged: homo on red, seed 0" in note
    assert "result.json is not what the cell was finished with; repeat the run command, which runs the cell" in note
    assert load_cells(tmp_path, changed=True).table["cloth"].tolist() == ["blue", "red"]  # for `verify`
    with pytest.raises(LeaderboardError, match="is not what the cell was finished with"):
        load_cells(tmp_path).require_sound()


def test_failed_cells_of_a_row_are_counted(tmp_path):
    write_cell(tmp_path, "homo", "blue")
    write_cell(tmp_path, "homo", "red", status="failed", failure="diverged")
    assert "| 1+1✗ |" in markdown(only(tmp_path))


def test_one_method_in_several_spellings_is_one_row(tmp_path):
    """Options in another order, with a space, or named though they have their defaults."""
    options = {"draws": 5, "steps": 4, "rate": 0.15}
    spellings = ("bdp,steps=4,draws=5", "bdp,draws=5, steps = 4", "bdp,draws=5,rate=0.15,steps=4")
    for solver, cloth in zip(spellings, CLOTHS[:3], strict=True):
        _with_options(write_cell(tmp_path, solver, cloth), options)
    _with_options(write_cell(tmp_path, "bdp,draws=5,steps=4", "pink"), options)
    failed = write_cell(tmp_path, "bdp, steps=4, draws=5", "red", status="failed", failure="diverged")
    _with_options(failed, options)
    _with_options(write_cell(tmp_path, "bdp,draws=6,steps=4", "blue"), options | {"draws": 6})
    rows = {row.solver: (row.cells, row.failed) for row in only(tmp_path).rows if row.kind == "solver"}
    assert rows == {"bdp,draws=5,steps=4": (3, 1), "bdp,draws=6,steps=4": (1, 0)}


def _with_options(cell: Path, options: dict[str, float]) -> None:
    for path in cell.glob("*.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"solver_options": options}))


def test_cells_of_one_code_make_one_row_whatever_their_samples_need(tmp_path):
    plain, both = "engine 1, metrics 1", "both faces 1, engine 1, metrics 1"
    for cloth, code in (("blue", plain), ("red", both), ("white", f"{both}, repeats 1")):
        write_cell(tmp_path, "homo", cloth, code_version=code)
    write_cell(tmp_path, "homo", "pink", code_version=plain, status="failed", failure="diverged")
    assert [(row.variant, row.cells, row.failed) for row in only(tmp_path).rows[1:]] == [("", 3, 1)]
    write_cell(tmp_path, "homo", "viscose", code_version=f"{both}, repeats 2")
    assert sorted(row.cells for row in only(tmp_path).rows[1:]) == [1, 1, 1, 1]


def test_cells_of_two_splits_stand_apart(tmp_path):
    """Each board counts, and submits, its own finished and failed cells."""
    for split, code in (("paper", "1"), ("all", "2")):
        for cloth in ("blue", "red"):
            cell = write_cell(tmp_path, "homo", cloth, protocol=split, code_version=code)
            cell.rename(cell.with_name(f"{cell.name}-{split}"))
    write_cell(tmp_path, "homo", "pink", protocol="all", code_version="2", status="failed", failure="diverged")
    cells = load_cells(tmp_path)
    counts = {board.protocol: [(row.cells, row.failed) for row in board.rows[1:]] for board in leaderboards(cells)}
    assert counts == {"all": [(2, 1)], "paper": [(2, 0)]}
    lines = rows_of(cells, "own-track")
    assert [(line["protocol"], line["cells"]) for line in lines] == [("all", 2), ("paper", 2)]
    assert len({line["row"] for line in lines}) == 2
    assert append(tmp_path / "own.csv", lines)["added"] == 2


@pytest.mark.parametrize("make", [lambda f: None, lambda f: f.mkdir(), lambda f: (f / "cells").mkdir(parents=True)])
def test_a_missing_or_empty_folder_gets_one_clear_error(tmp_path, make):
    make(tmp_path / "runs")
    with pytest.raises(LeaderboardError, match="cusick-bench run"):
        load_cells(tmp_path / "runs")


def test_a_folder_without_finished_cells_says_why(tmp_path):
    write_cell(tmp_path, "homo", "blue", status="failed", failure="no density")
    with pytest.raises(LeaderboardError, match="no density"):
        load_cells(tmp_path)


def test_unknown_metric_or_statistic_is_refused(tmp_path):
    write_cell(tmp_path, "homo", "blue")
    with pytest.raises(LeaderboardError, match="test_mse"):
        only(tmp_path, by="beauty")
    with pytest.raises(LeaderboardError, match="iqm"):
        only(tmp_path, statistic="mode")


# -- forms


def test_table_fits_the_terminal_and_drops_rare_columns(tmp_path, noise):
    write_solver(tmp_path, "homo", lambda cloth, seed: noise.normal(0.05, 0.01), draws=1000)
    write_solver(tmp_path, "null:random-phase,draws=1000", lambda cloth, seed: 0.06, 1, draws=1000)
    text = text_table(only(tmp_path))
    assert text.within(120).columns == text.columns
    narrow = text.within(70)
    assert {"solver", "train", "test", "H", "DC err"} <= {column.head for column in narrow.columns}
    assert len(narrow.columns) < len(text.columns)


def test_scores_of_distributions_have_columns_where_rows_have_them(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05)
    assert not {"energy", "CRPS", "cover"} & {column.head for column in text_table(only(tmp_path)).columns}
    scores = {"test_energy_distance": 0.9123, "test_dc_crps": 0.0234, "test_dc_cover_90": 0.8}
    write_solver(tmp_path, "bdp", lambda cloth, seed: 0.06, draws=100, **scores)
    write_solver(tmp_path, "null:disc", lambda cloth, seed: 0.07, **(scores | {"test_dc_cover_90": 0.0}))
    lines = {line.split("|")[2].strip(): line for line in markdown(only(tmp_path)).splitlines() if "|" in line}
    assert "| energy dist. | CRPS points | cover 90 % |" in lines["solver"]
    assert "| .91 | 2.3 | 80 |" in lines["bdp"]
    assert "| .91 | 2.3 |  |" in lines["null:disc"], "one draw has no interval"
    assert "|  |  |  |" in lines["homo"]


def test_forms_escape_what_a_name_may_hold(tmp_path):
    write_cell(tmp_path, "<b>&|_[red]", "blue")
    board = only(tmp_path)
    assert "&lt;b&gt;&amp;" in html_table(board)
    assert "<b>" not in html_table(board) + markdown(board)
    assert r"\|_" in markdown(board)
    assert r"\&" in latex(board)


def test_no_name_runs_in_a_spreadsheet_or_in_tex(tmp_path):
    run = {"command": ["run", "a\n\\input{/etc/passwd}"]}
    (tmp_path / "run.json").write_text(json.dumps(run))
    write_cell(tmp_path, "=1+1", "@blue")
    board = only(tmp_path)
    rows = [line for line in csv([board]).splitlines()[1:] if "1+1" in line]
    assert rows
    assert not [cell for line in rows for cell in line.split(",") if cell.startswith(("=", "@"))]
    outside = [line for line in latex(board).splitlines() if not line.startswith("%")]
    assert not [line for line in outside if "input{" in line]


def test_command_prints_json_and_writes_files(tmp_path, noise):
    write_solver(tmp_path / "runs", "homo", lambda cloth, seed: noise.normal(0.05, 0.001))
    command = ["/opt/bin/cusick-bench", "run", "--cloth", "blue twill", "--solver", "bdp,draws=5"]
    (tmp_path / "runs" / "run.json").write_text(json.dumps({"command": command, "cores": 2}))
    files = [tmp_path / "out" / name for name in ("board.csv", "board.md", "board.tex", "board.html")]
    arguments = [str(tmp_path / "runs"), "--json"]
    outcome = CliRunner().invoke(app, arguments + [part for file in files for part in ("--out", str(file))])
    assert outcome.exit_code == 0, outcome.output
    rows = json.loads(outcome.stdout)["rows"]
    assert rows[1]["solver"] == "homo"
    assert rows[1]["test_mse"] == pytest.approx(0.05, abs=1e-3)
    assert rows[1]["command"] == "cusick-bench run --cloth 'blue twill' --solver bdp,draws=5"  # can be typed again
    assert rows[1]["dataset_hash"] == "abc"
    assert all("homo" in file.read_text() for file in files)
    plain = CliRunner().invoke(app, [str(tmp_path / "runs")])
    assert "61.5" in plain.stdout
    assert "homo" in plain.stdout


def test_command_refuses_with_status_2(tmp_path):
    assert CliRunner().invoke(app, [str(tmp_path / "nothing")]).exit_code == 2
    write_cell(tmp_path, "homo", "blue")
    assert CliRunner().invoke(app, [str(tmp_path), "--out", str(tmp_path / "x.doc")]).exit_code == 2


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"test_mse": -1e9}, "test_mse must lie in [0, 1], got -1e+09"),
        ({"test_mse": 1.5}, "test_mse must lie in [0, 1], got 1.5"),
        ({"train_mse": None}, "no finite train_mse"),
        ({"test_mse": "0.01x"}, "test_mse must be a number"),
        ({"test_mse": True}, "test_mse must be a number"),
        ({"test_mse": float("nan")}, "NaN"),
        ({"test_mse": float("inf")}, "Infinity"),
        ({"test_hausdorff_m": -0.01}, "test_hausdorff_m must lie in [0, 10], got -0.01"),
        ({"train_dc": 3.0}, "train_dc must lie in [-0.1, 1.1], got 3"),
        ({"test_iou": 1.01}, "test_iou must lie in [0, 1]"),
        ({"seed": -1}, "seed must be a whole number"),
    ],
)
def test_a_cell_that_says_what_no_cell_can_say_is_no_row(tmp_path, noise, changes, reason):
    write_solver(tmp_path, "homo", lambda cloth, seed: DIFFICULTY[cloth])
    seed = changes.pop("seed", 9)
    folder = write_cell(tmp_path, "liar", "blue", seed, **changes)
    result = CliRunner().invoke(app, [str(tmp_path), "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert {row["solver"] for row in document["rows"]} == {"homo", "repeat of the same drape"}
    (skipped,) = document["skipped"]
    assert (skipped["path"], skipped["status"]) == (str(folder), "damaged")
    assert reason in skipped["reason"]


def test_a_fair_score_below_zero_is_one(tmp_path):
    """The variance of the draws' mean is taken off: of two draws and a sample between them more than there is."""
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    shallow, middle, deep = (0.12 + depth * np.cos(6 * angle)[None] for depth in (1e-3, 8e-3, 2e-2))
    score = variogram_score(np.concatenate([shallow, deep]), middle)
    assert score < -1e-3
    write_cell(tmp_path, "bdp", "blue", test_variogram_score=score)
    cells = load_cells(tmp_path)
    assert cells.table["test_variogram_score"].tolist() == [score]
    cells.require_sound()


@pytest.mark.parametrize("name", [None, "", "null", "None", "nan", 7, ["homo"]])
@pytest.mark.parametrize("field", ["solver", "cloth"])
def test_a_cell_without_a_name_is_no_row(tmp_path, name, field):
    write_solver(tmp_path, "null:disc", lambda cloth, seed: DIFFICULTY[cloth])
    folder = write_cell(tmp_path, "homo", "blue")
    result = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps(result | {field: name}))
    cells = load_cells(tmp_path)
    assert set(cells.table["solver"]) == {"null:disc"}
    assert f"{field} must be a name" in cells.skipped[0].reason
    with pytest.raises(LeaderboardError, match=rf"result\.json: {field} must be a name"):
        cells.require_sound()
