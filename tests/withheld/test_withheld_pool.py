"""Figures of several suites together are those of all their cases."""

import json
from math import isnan
from pathlib import Path

import pandas as pd
import pytest
from scored_answers import answer, label, perfect, revealed, score, suite
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.files import BadFile
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.scoring.calibration import wilson_interval
from cusick_bench.withheld.scoring.pool import pooled, pooled_lines, read_score_table
from cusick_bench.withheld.scoring.table import rows
from cusick_bench.withheld.suite.design import KINDS, plan_suite
from cusick_bench.withheld.suite.labels import label_of

_COLUMNS = ("row", "method", "name", "subset", "value", "cases", "command", "labels_sha256")


def _table(path: Path, digest: str, *figures: tuple[str, str, float, int], command: str = "score") -> Path:
    rows = [("figure", "answers", *figure, command, digest) for figure in figures]
    rows += [("figure", "chance", name, subset, 0.9, 7, command, digest) for name, subset, *_ in figures]
    pd.DataFrame(rows, columns=_COLUMNS).to_csv(path, index=False)
    return path


def test_shares_and_means_weigh_every_case_alike(tmp_path):
    first = _table(tmp_path / "a.csv", "a", ("power", ">= 2x", 0.5, 4), ("90 % set size", ">= 2x", 2.0, 4))
    other = _table(tmp_path / "b.csv", "b", ("power", ">= 2x", 1.0, 12), ("90 % set size", ">= 2x", 1.0, 12))
    power, size = pooled([read_score_table(first), read_score_table(other)])
    assert (power.figure.value, power.figure.cases) == (14 / 16, 16)
    assert (power.figure.low, power.figure.high) == wilson_interval(14, 16)
    assert power.parts == (0.5, 1.0)
    assert size.figure.value == (4 * 2 + 12) / 16
    assert isnan(size.figure.low)  # the single cases are not known


def test_a_suite_without_cases_of_a_figure_adds_none(tmp_path):
    first = _table(tmp_path / "a.csv", "a", ("false positives", "all", 0.0, 50), ("power", "1x", float("nan"), 0))
    other = _table(tmp_path / "b.csv", "b", ("false positives", "all", 0.1, 10))
    (found,) = pooled([read_score_table(first), read_score_table(other)])
    assert found.figure.value == pytest.approx(1 / 60)
    assert found.figure.reached == "no"  # the bound of Wilson's interval is above .08
    more = _table(tmp_path / "c.csv", "c", ("false positives", "all", 0.0, 90))
    (found,) = pooled([read_score_table(path) for path in (first, other, more)])
    assert found.figure.reached == "yes"


def test_no_case_counts_twice_and_severities_are_of_one_kind(tmp_path):
    figure = ("power", ">= 2x", 0.5, 4)
    first, same = _table(tmp_path / "a.csv", "a", figure), _table(tmp_path / "b.csv", "a", figure)
    with pytest.raises(WithheldError, match=r"a\.csv and .*b\.csv are of the same cases; give one of them"):
        pooled([read_score_table(first), read_score_table(same)])
    measured = _table(tmp_path / "c.csv", "c", figure, command="score --twins twins.json")
    with pytest.raises(WithheldError, match=r"not measured in .*a\.csv, but in others; score it with --twins"):
        pooled([read_score_table(measured), read_score_table(first)])
    nulls = _table(tmp_path / "d.csv", "d", ("false positives", "all", 0.0, 9))
    assert len(pooled([read_score_table(measured), read_score_table(nulls)])) == 2


def test_suites_of_one_seed_have_the_same_labels_in_all_worlds_and_are_pooled(tmp_path):
    labels = [
        [label_of(plan).content() for plan in plan_suite(7, dict.fromkeys(KINDS, 6), world_name=world)]
        for world in ("paper", "published", "polar")
    ]
    assert labels[0] == labels[1] == labels[2]
    tables = []
    for name, cases in (("a", "1"), ("b", "2"), ("c", "1"), ("d", "")):
        table = pd.read_csv(_table(tmp_path / f"{name}.csv", "same", ("power", ">= 2x", 0.5, 4)))
        table.assign(cases_sha256=cases).to_csv(tmp_path / f"{name}.csv", index=False)
        tables.append(read_score_table(tmp_path / f"{name}.csv"))
    assert pooled(tables[:2])[0].figure.cases == 8
    for other in tables[2:]:
        with pytest.raises(WithheldError, match="are of the same cases"):
            pooled([tables[0], other])


@pytest.mark.parametrize("severities", [("", "detectable shift"), ("typical severity",) * 2])
def test_suites_of_one_unit_are_pooled(tmp_path, severities):
    tables = [read_score_table(_with_unit(tmp_path / f"{n}.csv", unit)) for n, unit in enumerate(severities)]
    assert pooled(tables)[0].figure.cases == 8


def test_levels_of_two_units_are_never_mixed(tmp_path):
    units = ("typical severity", "detectable shift")
    tables = [read_score_table(_with_unit(tmp_path / f"{n}.csv", unit)) for n, unit in enumerate(units)]
    with pytest.raises(
        WithheldError, match=r"multiples of the typical severity in .*0\.csv, of the detectable shift in"
    ):
        pooled(tables)


def _with_unit(path: Path, unit: str) -> Path:
    table = pd.read_csv(_table(path, path.name, ("power", ">= 2x", 0.5, 4)))
    table.assign(severities=unit).to_csv(path, index=False)
    return path


def test_files_of_one_name_in_two_folders_are_two_suites(tmp_path):
    paths = []
    for folder, value, cases in (("paper", 0.5, 4), ("polar", 1.0, 12)):
        (tmp_path / folder).mkdir()
        paths.append(_table(tmp_path / folder / "scores.csv", folder, ("power", ">= 2x", value, cases)))
    out = tmp_path / "pooled.csv"
    command = ["withheld", "pool", *map(str, paths), "--out", str(out)]
    found = CliRunner().invoke(app, [*command, "--json"])
    assert found.exit_code == 0, found.output
    document = json.loads(found.stdout)
    assert document["figures"][0]["suites"] == {"paper/scores.csv": 0.5, "polar/scores.csv": 1.0}
    assert document["command"].endswith("pool paper/scores.csv polar/scores.csv")
    (row,) = pd.read_csv(out).to_dict("records")
    assert (row["paper/scores.csv"], row["polar/scores.csv"]) == (0.5, 1.0)
    lines = pooled_lines(pooled(tables := [read_score_table(path) for path in paths]), tables)
    assert lines[0][-2:] == ["paper/scores", "polar/scores"]


@pytest.mark.parametrize(
    ("figure", "message"),
    [
        (("power", "all", "much", 4), "line 2: could not convert string to float: 'much'"),
        (("power", "all", float("nan"), 4), "line 2: has the value '' of 4 cases"),
        (("power", "all", 0.5, -4), "line 2: has the value '0.5' of -4 cases"),
        (("strength", "all", 0.5, 4), "has no shares or means of answers"),
    ],
)
def test_a_table_of_something_else_is_refused(tmp_path, figure, message):
    with pytest.raises(BadFile, match=message):
        read_score_table(_table(tmp_path / "a.csv", "a", figure))


def test_pooled_tables_of_scored_answers_count_all_cases(tmp_path):
    paths = []
    for name, wrong in (("first", 2), ("other", 0)):
        labels = suite()
        answers = {case: perfect(truth) for case, truth in labels.items()}
        answers |= {f"null_{number}": answer("effect", ("creep", 0.8), p=0.01) for number in range(wrong)}
        if name == "other":
            labels["one_more"], answers["one_more"] = label("none"), perfect(label("none"))
        folder = tmp_path / name
        folder.mkdir()
        both = revealed(folder, labels, answers)
        facts = {"command": "cusick-bench withheld score answers.json labels.json", "labels_sha256": name}
        rows(score(both), [], facts).to_csv(folder / f"{name}.csv", index=False, float_format="%.6g")
        paths.append(str(folder / f"{name}.csv"))
    nulls = sum(name.startswith("null") for name in suite())
    out = tmp_path / "pooled.csv"
    found = CliRunner().invoke(app, ["withheld", "pool", *paths, "--json", "--out", str(out)])
    assert found.exit_code == 0, found.output
    (alarms,) = (one for one in json.loads(found.stdout)["figures"] if one["name"] == "false positives")
    assert (alarms["cases"], alarms["value"]) == (2 * nulls + 1, pytest.approx(2 / (2 * nulls + 1), rel=1e-5))
    assert alarms["suites"] == {"first.csv": pytest.approx(2 / nulls, rel=1e-5), "other.csv": 0}
    table = pd.read_csv(out)
    (row,) = table.loc[table["name"] == "false positives"].to_dict("records")
    assert (row["cases"], row["first.csv"], row["other.csv"]) == (2 * nulls + 1, pytest.approx(2 / nulls, rel=1e-5), 0)
