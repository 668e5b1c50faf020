"""Two runs side by side: ratios, what only one of them has, and runs that cannot be compared."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from shown_cells import write_cell

from cusick_bench.leaderboard import LeaderboardError, load_cells
from cusick_bench.leaderboard.two_runs import compare_runs


def _run(folder: Path, errors: dict[str, float], **record: object) -> Path:
    """A run on three cloths with two seeds each; errors grow from cloth to cloth."""
    for solver, error in errors.items():
        for place, cloth in enumerate(("a", "b", "c")):
            for seed in (0, 1):
                cell = write_cell(folder, solver, cloth, seed)
                result = json.loads((cell / "result.json").read_text()) | record
                result["metrics"]["test_mse"] = error * (1 + place) * (1 + 0.01 * seed)
                (cell / "result.json").write_text(json.dumps(result))
    return folder


def test_ratio_is_this_run_over_the_other(tmp_path):
    here = load_cells(_run(tmp_path / "here", {"homo": 0.03, "sobol": 0.1, "null:disc": 0.05, "heter": 0.1}))
    settings = {"settings": {"budget": 40}}
    there = load_cells(
        _run(tmp_path / "there", {"homo": 0.06, "sobol": 0.05, "null:disc": 0.05, "bdp": 0.1}, **settings)
    )
    there = replace(there, run={"processor": "another chip"})
    both = compare_runs(here, there)
    assert [one.label for one in both.methods] == ["homo", "sobol", "null:disc"]
    homo, sobol, disc = (one.changes["test_mse"] for one in both.methods)
    assert homo.ratio.value == pytest.approx(0.5)
    assert (homo.before, homo.after) == pytest.approx((0.06 * 2 * 1.005, 0.03 * 2 * 1.005))
    assert sobol.ratio.value == pytest.approx(2)
    assert [one.verdict for one in (homo, sobol, disc)] == ["better", "worse", "same"]
    assert (both.only_here, both.only_there) == (["heter"], ["bdp"])
    assert ("budget", "40", "None") in both.differences
    assert ("processor", "another chip", "") in both.differences


def test_splits_of_a_learning_curve_are_compared_each_with_itself(tmp_path):
    """Fits of one sample were held against fits of eight, by the order of folders."""
    folders = [tmp_path / "here", tmp_path / "there"]
    for folder, order in zip(folders, (("first-1", "first-8"), ("first-8", "first-1")), strict=True):
        for place, split in enumerate(order):
            _run(folder, {"homo": 0.08 if split == "first-1" else 0.01}, protocol=split)
            for cell in folder.glob("cells/homo-*"):
                cell.rename(cell.with_name(f"{place}-{cell.name}"))
    both = compare_runs(*map(load_cells, folders))
    assert [one.label for one in both.methods] == ["homo, split first-1", "homo, split first-8"]
    changes = [one.changes["test_mse"] for one in both.methods]
    assert [(one.before, one.after, one.verdict) for one in changes] == [
        (pytest.approx(0.1608), pytest.approx(0.1608), "same"),
        (pytest.approx(0.0201), pytest.approx(0.0201), "same"),
    ]


def test_cloths_of_one_run_only_do_not_count(tmp_path):
    here, there = (_run(tmp_path / name, {"homo": 0.03}) for name in ("here", "there"))
    extra = write_cell(here, "homo", "d")
    result = json.loads((extra / "result.json").read_text())
    result["metrics"]["test_mse"] = 0.9
    (extra / "result.json").write_text(json.dumps(result))
    (only,) = compare_runs(load_cells(here), load_cells(there)).methods
    assert only.cells == 6
    assert only.changes["test_mse"].ratio.value == pytest.approx(1)


def test_means_and_ratio_are_over_the_same_pairs(tmp_path):
    """A seed that one run has of its own, ten times worse, changes nothing."""
    here, there = (_run(tmp_path / name, {"homo": error}) for name, error in (("here", 0.03), ("there", 0.06)))
    before = compare_runs(load_cells(here), load_cells(there)).methods[0]
    extra = write_cell(here, "homo", "a", 2)
    result = json.loads((extra / "result.json").read_text())
    result["metrics"]["test_mse"] = 0.3
    (extra / "result.json").write_text(json.dumps(result))
    after = compare_runs(load_cells(here), load_cells(there)).methods[0]
    assert after.cells == before.cells == 6
    assert after.changes["test_mse"] == before.changes["test_mse"]
    assert before.changes["test_mse"].after == pytest.approx(0.03 * 2 * 1.005)


def test_a_cloth_without_shared_seeds_is_compared_as_a_whole(tmp_path):
    here, there = (_run(tmp_path / name, {"homo": 0.03}) for name in ("here", "there"))
    for place, run in enumerate((here, there)):
        cell = write_cell(run, "homo", "d", seed=10 + place)
        result = json.loads((cell / "result.json").read_text())
        result["metrics"]["test_mse"] = 0.1
        (cell / "result.json").write_text(json.dumps(result))
    (homo,) = compare_runs(load_cells(here), load_cells(there)).methods
    assert homo.cells == 7
    assert homo.changes["test_mse"].after == pytest.approx((6 * 0.06 * 1.005 + 0.1) / 7)


def test_other_data_are_refused(tmp_path):
    here = load_cells(_run(tmp_path / "here", {"homo": 0.03}))
    there = load_cells(_run(tmp_path / "there", {"homo": 0.03}, dataset_hash="xyz"))
    with pytest.raises(LeaderboardError, match=r"same data, got abc in .* and xyz in"):
        compare_runs(here, there)


def test_splits_are_named_in_full(tmp_path):
    here = load_cells(_run(tmp_path / "here", {"homo": 0.03}, protocol="leave-one-sample-out"))
    there = load_cells(_run(tmp_path / "there", {"homo": 0.03}, protocol="paper"))
    with pytest.raises(LeaderboardError, match=r"same split, got leave-one-sample-out in .* and paper in"):
        compare_runs(here, there)


@pytest.mark.parametrize("several_here", [True, False])
@pytest.mark.parametrize(
    ("record", "name"),
    [({"settings": {"budget": 40}}, "homo (budget=40)"), ({"code_version": "old"}, "homo (code_version=old)")],
)
def test_a_method_that_one_run_has_in_two_ways_is_compared_in_both(tmp_path, several_here, record, name):
    """Its folder also held cells of older code, and the two runs were said to share no method."""
    two = _run(tmp_path / "two", {"homo": 0.06}, **record)
    for cell in list(two.glob("cells/*")):
        cell.rename(cell.with_name(f"old-{cell.name}"))
    two = load_cells(_run(two, {"homo": 0.03}))
    one = load_cells(_run(tmp_path / "one", {"homo": 0.03}, dataset="the same folder by another name"))
    both = compare_runs(two, one) if several_here else compare_runs(one, two)
    ratios = {change.label: change.changes["test_mse"].ratio.value for change in both.methods}
    assert len(ratios) == 2
    assert ratios[name] == pytest.approx(2 if several_here else 0.5)
    assert sorted(ratios.values()) == pytest.approx(sorted([1, ratios[name]]))
    assert (both.only_here, both.only_there) == ([], [])


def test_runs_without_a_method_in_common_are_refused(tmp_path):
    here = load_cells(_run(tmp_path / "here", {"homo": 0.03}))
    with pytest.raises(LeaderboardError, match="share no method"):
        compare_runs(here, load_cells(_run(tmp_path / "there", {"sobol": 0.03})))


def test_samples_that_are_left_out_are_compared_each_with_itself(tmp_path):
    """The other run has more seeds, and lacks a sample: a sample's number among those of its run is another one."""

    def run(folder: Path, seeds: int, samples: tuple[int, ...], error: float) -> Path:
        for seed in range(seeds):
            for sample in samples:
                cell = write_cell(folder, "homo", f"a{sample}", seed)
                record = {"cloth": "a", "protocol": "leave-one-sample-out", "test": [sample]}
                result = json.loads((cell / "result.json").read_text()) | record
                result["metrics"]["test_mse"] = error * (1 + sample)
                (cell / "result.json").write_text(json.dumps(result))
        return folder

    here, there = run(tmp_path / "here", 2, (0, 1, 2), 0.03), run(tmp_path / "there", 3, (1, 2), 0.06)
    (homo,) = compare_runs(load_cells(here), load_cells(there)).methods
    assert homo.cells == 4
    change = homo.changes["test_mse"]
    assert (change.before, change.after, change.ratio.value) == pytest.approx((0.15, 0.075, 0.5))
