"""What more samples of a cloth are worth: nested training samples, the same unseen ones, one row a number."""

import inspect
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.cli.fit.learning_curve import learning_curve_command
from cusick_bench.datasets import load
from cusick_bench.leaderboard import LeaderboardError, leaderboards, load_cells
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.learning_curve import (
    USUAL_UNSEEN,
    learning_curve,
    learning_splits,
    numbers_without_more,
    samples_of_split,
    split_name,
)
from cusick_bench.metrics.found_stiffness import FoundStiffness, Quantity
from cusick_bench.solvers.registry import make_solver

TRUTH = {"weft": 1e-6, "bias": 2e-6, "warp": 4e-6}


def test_training_samples_are_nested_and_unseen_ones_stay_the_same() -> None:
    dataset = load("synthetic")
    found = learning_splits(dataset, ["fabric_1", "fabric_2"], [4, 1, 2, 2], 3)
    assert list(found) == [1, 2, 4]
    for cloth in (0, 1):
        splits = [of_count[cloth] for of_count in found.values()]
        assert [len(split.train) for split in splits] == [1, 2, 4]
        assert all(split.train == splits[-1].train[: len(split.train)] for split in splits)
        assert len({split.test for split in splits}) == 1
        assert len(splits[0].test) == 3
        rows = dataset.index.loc[[*splits[-1].train, *splits[-1].test]]
        assert rows["sample"].is_unique, "one silhouette a sample, and none is both"
        (whole,) = dataset.split("paper", [splits[0].cloth])
        assert splits[0].train == whole.train[:1]
        order = (*whole.train, *whole.test)
        assert np.diff([order.index(row) for row in splits[0].test]).tolist() == [4, 4], (
            "spread over the cloth's samples"
        )


def test_too_few_samples_are_refused() -> None:
    message = "fabric_1 has 12 samples, of which 7 show the face that is fitted and are none of the 5 unseen"
    with pytest.raises(LeaderboardError, match=message):
        learning_splits(load("synthetic"), ["fabric_1"], [1, 8], 5)


def test_fewer_unseen_samples_than_were_asked_for_are_refused() -> None:
    """Eleven of twelve would be unseen, and the table would say fourteen."""
    dataset = load("synthetic")
    (split,) = learning_splits(dataset, ["fabric_1"], [1], 11)[1]
    assert len(split.test) == 11
    with pytest.raises(LeaderboardError, match=r"fabric_1 has 12 samples, of which one trains .* for 14 unseen"):
        learning_splits(dataset, ["fabric_1"], [1], 14)
    with pytest.raises(LeaderboardError, match=r"fabric_1 has 12 samples, of which one trains .* for 12 unseen"):
        learning_splits(dataset, ["fabric_1"], [1, 2], 12)  # not that one sample is left, which is none


def test_samples_of_the_other_face_are_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cloth whose second sample was photographed on its other face only."""
    dataset = load("synthetic")
    (before,) = learning_splits(dataset, ["fabric_1"], [8], 4)[8]
    table = dataset.table.copy()
    second = (table["cloth"] == "fabric_1") & (table["sample"] == table.loc[before.train[1], "sample"])
    table.loc[second, "side"] = "down" if table.loc[before.train[0], "side"] == "up" else "up"
    turned = replace(dataset, table=table)
    (after,) = learning_splits(turned, ["fabric_1"], [8], 4)[8]
    assert before.train[1] in after.test
    assert len(after.test) == 4
    assert turned.index.loc[list(after.train), "side"].nunique() == 1
    with pytest.raises(LeaderboardError, match="of which 8 show the face"):
        learning_splits(turned, ["fabric_1"], [9], 4)


@pytest.mark.parametrize(
    ("solver", "same"),
    [("heter", [2, 4]), ("bdp-field", []), ("bdp-field,samples=2", [4]), ("null:copy", [2, 4]), ("oracle:mean", [])],
)
def test_solvers_that_use_no_more_samples_fit_the_same_again(solver: str, same: list[int]) -> None:
    assert numbers_without_more(make_solver(solver), [4, 1, 2, 2]) == same


def cells_of(rows: list[dict[str, Any]]) -> Cells:
    return Cells(Path(), {}, pd.DataFrame(rows), ())


def cell(samples: int, cloth: str, crps: float, factor: float, width: float) -> dict[str, Any]:
    """A fit that is off by a factor, with an interval of a half width."""
    found = {name: factor * value for name, value in TRUTH.items()}
    bending = {name: Quantity(value, (value / width, value * width)) for name, value in found.items()}
    stiffness = FoundStiffness(bending, {}, {}, {}, TRUTH)
    identity = {"solver": "bdp-field", "cloth": cloth, "seed": 0, "protocol": f"first-{samples}"}
    return identity | {"test_dc_crps": crps, "stiffness": stiffness}


def test_steps_are_means_over_cloths() -> None:
    rows = [cell(1, cloth, crps, 2.0, 3.0) for cloth, crps in zip("abc", (0.01, 0.02, 0.03), strict=True)]
    rows += [cell(8, cloth, 0.01, 1.5, 1.2) for cloth in "abc"]
    one, eight = learning_curve(cells_of(rows))
    assert (one.samples, eight.samples, one.cells) == (1, 8, 3)
    assert one.metrics["test_dc_crps"].value == pytest.approx(0.02)
    assert one.metrics["test_dc_crps"].low < 0.01 < 0.03 < one.metrics["test_dc_crps"].high, "of three cloths only"
    assert np.isnan(one.metrics["test_mse"].value), "not measured"
    assert (one.error_factor, eight.error_factor) == pytest.approx((2.0, 1.5))
    assert (one.interval_factor, eight.interval_factor) == pytest.approx((3.0, 1.2))
    assert (one.coverage, eight.coverage) == (1.0, 0.0)


def test_the_interval_of_a_share_ends_at_all_of_them() -> None:
    """Four unseen samples of each of five cloths: 85 % held, and the interval went to 109 %."""
    held = (1.0, 1.0, 1.0, 1.0, 0.25)
    rows = [
        cell(1, cloth, 0.01, 2.0, 3.0) | {"test_dc_cover_90": one} for cloth, one in zip("abcde", held, strict=True)
    ]
    (step,) = learning_curve(cells_of(rows))
    share = step.metrics["test_dc_cover_90"]
    assert share.value == pytest.approx(0.85)
    assert (0 < share.low < share.value, share.high) == (True, 1)


def test_one_cloth_has_a_step_too() -> None:
    (step,) = learning_curve(cells_of([cell(2, "a", 0.01, 2.0, 3.0)]))
    assert (step.samples, step.error_factor, step.coverage) == (2, pytest.approx(2.0), 1.0)


def test_cells_of_another_protocol_are_refused() -> None:
    with pytest.raises(LeaderboardError, match="'paper' are no learning curve"):
        learning_curve(cells_of([cell(1, "a", 0.01, 2.0, 3.0) | {"protocol": "paper"}]))


def test_another_number_of_unseen_samples_is_another_split(tmp_path: Path) -> None:
    """Scores on two unseen samples are no seeds of those on three."""
    assert inspect.signature(learning_curve_command).parameters["unseen"].default == USUAL_UNSEEN
    assert (split_name(2), split_name(2, 3)) == ("first-2", "first-2-unseen-3")
    assert [samples_of_split(name) for name in ("first-2", "first-2-unseen-3", "paper")] == [2, 2, None]
    for unseen in (3, 2):
        arguments = ["learning-curve", "--out", tmp_path, "--cloth", "fabric_1", "--learn-from", 1, "--workers", 1]
        arguments += ["--unseen", unseen, "--vertices", 97, "--solver", "null:disc"]
        assert CliRunner().invoke(app, [str(one) for one in arguments]).exit_code == 0
    boards = leaderboards(load_cells(tmp_path))
    counts = {board.protocol: [row.cells for row in board.rows if row.solver == "null:disc"] for board in boards}
    assert counts == {"first-1-unseen-2": [1], "first-1-unseen-3": [1]}


def test_the_command_goes_on_and_writes_a_row_for_each_number(tmp_path: Path, one_thread: None) -> None:
    arguments = ["learning-curve", "--out", tmp_path, "--cloth", "fabric_1", "--learn-from", 1, "--learn-from", 2]
    arguments += ["--unseen", 3, "--vertices", 97, "--budget", 3, "--workers", 1]
    arguments += ["--solver", "null:random-phase,draws=3", "--solver", "sobol", "--json"]
    found = CliRunner().invoke(app, [str(one) for one in arguments])
    assert found.exit_code == 0, found.output
    assert "sobol uses no more of 2 samples than of fewer" in found.stderr
    steps = json.loads(found.stdout)["steps"]
    assert sorted((step["solver"], step["samples"]) for step in steps) == [
        ("null:random-phase,draws=3", 1), ("null:random-phase,draws=3", 2), ("sobol", 1), ("sobol", 2)
    ]  # fmt: skip
    assert all(step["metrics"]["test_mse"]["value"] > 0 for step in steps)
    table = pd.read_csv(tmp_path / "learning-curve.csv")
    assert list(table["samples"]) == [1, 2, 1, 2]
    finished = {path: path.stat().st_mtime_ns for path in tmp_path.glob("cells/*/done")}
    assert len(finished) == 4
    assert CliRunner().invoke(app, [str(one) for one in arguments]).exit_code == 0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("cells/*/done")} == finished


def test_a_grid_of_failures_ends_with_status_1_as_a_failed_cell_does(tmp_path, monkeypatch) -> None:
    def fails(*_: object) -> None:
        raise LeaderboardError("planted")

    monkeypatch.setattr("cusick_bench.runner.cell.solve_cell", fails)
    words = ["learning-curve", "--cloth", "fabric_1", "--solver", "null:disc", "--vertices", "150", "--workers", "1"]
    found = CliRunner().invoke(app, [*words, "--learn-from", "1", "--out", str(tmp_path)])
    assert found.exit_code == 1
    assert "every cell failed" in found.stderr
    assert "planted" in found.stderr
