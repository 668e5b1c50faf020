"""Rows and ranks of leaderboards, of made-up cells whose truth is known."""

import json
from pathlib import Path

import numpy as np
import pytest
from made_up_cells import CLOTHS, DIFFICULTY, only, ranks, write_cell, write_solver

from cusick_bench.leaderboard import (
    LeaderboardError,
    csv,
    difference,
    leaderboards,
    load_cells,
    markdown,
    text_table,
)
from cusick_bench.leaderboard.bootstrap import cell_values, mean
from cusick_bench.leaderboard.verification.submit import append, rows_of


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


def test_a_rank_is_shared_with_its_first_row_and_not_from_row_to_row(tmp_path):
    """The middle one cannot be told from the best nor from the last, which is worse than the best on every cloth."""
    middle = dict(zip(CLOTHS, (0.003, -0.001, 0.001, 0.002, 0.0), strict=True))
    for cloth, error in DIFFICULTY.items():
        write_cell(tmp_path, "best", cloth, test_mse=error)
        write_cell(tmp_path, "middle", cloth, test_mse=error + middle[cloth])
        write_cell(tmp_path, "last", cloth, test_mse=error + 0.002)
    assert ranks(only(tmp_path)) == {"repeat of the same drape": None, "best": 1, "middle": 1, "last": 3}


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


def test_an_overlap_is_known_to_be_no_more_than_all(tmp_path):
    for place, cloth in enumerate(CLOTHS):
        write_cell(tmp_path, "homo", cloth, test_iou=1.0 if place else 0.5)
    (row,) = (row for row in only(tmp_path).rows if row.solver == "homo")
    assert row.estimates["test_iou"].high == 1


def test_a_row_that_lacks_a_cloth_is_shown_without_rank(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05 + 1e-4 * seed)
    for cloth in CLOTHS[:3]:
        write_cell(tmp_path, "easy", cloth, test_mse=0.001)
    board = only(tmp_path)
    assert ranks(board)["easy"] is None
    assert ranks(board)["homo"] == 1
    assert any("easy has no rank" in note and "viscose" in note for note in board.notes)
    assert not any(note.startswith("easy: its cells on") for note in board.notes), "it has none there"


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


def test_of_a_left_out_sample_all_seeds_count(tmp_path):
    for seed in (0, 1, 2):
        _leave_out(tmp_path, "homo", seed, {sample: 0.05 + 0.01 * seed for sample in (4, 5, 7)})
    assert only(tmp_path).rows[-1].value("test_mse") == pytest.approx(0.06)


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


def test_leaderboards_of_one_folder_say_what_each_is_of_and_what_it_lacks(tmp_path):
    """All had one title, and each the notes of all cells that were left out of any."""
    for split in ("first-1", "first-8"):
        for status in ("done", "failed"):
            seed = {"done": 0, "failed": 1}[status]
            cell = write_cell(tmp_path, "homo", "blue", seed, protocol=split, status=status, failure=f"no {split}")
            cell.rename(cell.with_name(f"{cell.name}-{split}"))
    write_cell(tmp_path, "homo", "red", protocol="first-4", status="failed", failure="no first-4")
    (write_cell(tmp_path, "homo", "pink") / "cell.json").unlink()
    (tmp_path / "cells" / "homo-pink-0" / "result.json").unlink()  # nothing is known of it
    boards = leaderboards(load_cells(tmp_path))
    assert [text_table(board).title for board in boards] == [
        f"cusick, split {split}, 1 cloth, mean over cells, ranked by test_mse" for split in ("first-1", "first-8")
    ]
    for board, split in zip(boards, ("first-1", "first-8"), strict=True):
        left_out = [note for note in board.notes if note.startswith("Left out")]
        assert [note.rpartition("no ")[2] for note in left_out if "failed" in note] == [split, "first-4"]
        assert sum("unfinished" in note for note in left_out) == 1


def test_one_leaderboard_alone_is_told_apart_from_nothing(tmp_path):
    write_cell(tmp_path, "homo", "blue")
    write_cell(tmp_path, "homo", "red")
    assert text_table(only(tmp_path)).title == "cusick, 2 cloths, mean over cells, ranked by test_mse"


def test_rows_without_any_interval_are_told(tmp_path):
    """Twenty cells a row, all ranked first, and nothing said why."""
    for solver, error in (("homo", 0.05), ("heter", 0.09)):
        for seed in range(10):
            for cloth in ("blue", "red"):
                write_cell(tmp_path, solver, cloth, seed, test_mse=error)
    board = only(tmp_path)
    assert {row.rank for row in board.rows if row.kind == "solver"} == {1}
    assert any(note.startswith("No row has an interval") for note in board.notes)
    for seed in range(10, 12):
        for cloth in ("blue", "red"):
            write_cell(tmp_path, "homo", cloth, seed, test_mse=0.05 + 1e-3 * seed)
    assert not any("has an interval" in note for note in only(tmp_path).notes)


def test_numbers_of_draws_that_differ_between_cells_are_told(tmp_path):
    """The column of the best of N was empty, and nothing said why."""
    for cloth, draws in zip(CLOTHS, (100, 100, 97, 100, 100), strict=True):
        write_cell(tmp_path, "bdp", cloth, draws=draws, test_mse_best=0.04)
        write_cell(tmp_path, "homo", cloth)
    (note,) = (note for note in only(tmp_path).notes if "draws a cell" in note)
    assert note.startswith("bdp offers 97 to 100 draws a cell; a best of N is shown only where")


def test_unknown_metric_or_statistic_is_refused(tmp_path):
    write_cell(tmp_path, "homo", "blue")
    with pytest.raises(LeaderboardError, match="test_mse"):
        only(tmp_path, by="beauty")
    with pytest.raises(LeaderboardError, match="iqm"):
        only(tmp_path, statistic="mode")
