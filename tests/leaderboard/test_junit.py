"""Verdicts of the regression gate as JUnit XML."""

from xml.etree import ElementTree

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard.gate.check import Finding, Outcome
from cusick_bench.leaderboard.gate.junit import junit


def _cells(scale: float) -> pd.DataFrame:
    generator = np.random.default_rng(0)
    rows = [
        {"solver": solver, "cloth": f"fabric_{cloth}", "seed": seed, "test_mse": value}
        for solver in ("homo", "null:disc")
        for cloth in range(1, 6)
        for seed in range(4)
        for value in [0.02 * (1 + 0.02 * generator.random()) * (scale if solver == "homo" else 1)]
    ]
    return pd.DataFrame(rows)


def test_a_regression_is_a_failure_of_its_solver_and_metric(tmp_path):
    for name, scale in (("before", 1.0), ("now", 1.5)):
        _cells(scale).to_csv(tmp_path / f"{name}.csv", index=False)
    words = ["check", str(tmp_path / "now.csv"), "--against", str(tmp_path / "before.csv"), "--metric", "test_mse"]
    found = CliRunner().invoke(app, [*words, "--junit", str(tmp_path / "reports" / "check.xml")])
    assert found.exit_code == 1, found.output
    suite = ElementTree.parse(tmp_path / "reports" / "check.xml").getroot()[0]
    assert (suite.attrib["tests"], suite.attrib["failures"]) == ("2", "1")
    failed = [case for case in suite.iter("testcase") if case.find("failure") is not None]
    assert [(case.attrib["classname"], case.attrib["name"]) for case in failed] == [("homo", "test_mse")]
    assert "ratio 1.5" in failed[0].find("failure").attrib["message"]


def test_what_is_undecided_is_skipped_and_odd_characters_are_replaced():
    outcome = Outcome((Finding("a\x1b<b>", "cells", "undecided", "no cells in common"),), ("a note & more",))
    suite = ElementTree.fromstring(junit(outcome))[0]
    (case,) = suite.iter("testcase")
    assert case.attrib["classname"] == "a\ufffd<b>"
    assert case.find("skipped").attrib["message"] == "undecided: no cells in common"
    assert suite.attrib["skipped"] == "1"
    assert suite.find("system-out").text == "a note & more"
