"""`cusick-bench diagnose`: what it makes of the fabrics that are named, and the table of its answers."""

import csv
from pathlib import Path
from types import SimpleNamespace

import pytest
from made_up_diagnosis import NO_PROFILES, causes, document, parsed
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis import data_set


@pytest.fixture
def diagnosed(monkeypatch) -> list[str]:
    """Fabrics in the order in which they are diagnosed, in no time."""
    done = []

    def made(name: str, **asked):
        done.append(name)
        several = document(NO_PROFILES) | {"verdict": "several", "fabric": name, "effects": ["creep", "off-centre"]}
        several["causes"] = causes(off_centre=0.9, creep=0.05)  # by what accounts for most
        for cause, acting in zip(several["causes"], (0.8, 0.97), strict=True):
            cause |= {"acting": acting, "named": True}
        return parsed(several)

    def fabrics(captures, *asked):
        return SimpleNamespace(shared=None, together=lambda name: list(captures), document=made)

    monkeypatch.setattr(data_set, "data_set_diagnosis", fabrics)
    return done


def run(folder: Path, *fabrics: str) -> list[dict[str, str]]:
    """Rows of the table."""
    named = [word for fabric in fabrics for word in ("--fabric", fabric)]
    asked = ["diagnose", "synthetic", *named, "--out", str(folder), "--table", str(folder / "table.csv")]
    finished = CliRunner().invoke(app, asked)
    assert finished.exit_code == 0, finished.output
    with (folder / "table.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_fabric_that_is_named_twice_is_diagnosed_once(diagnosed, tmp_path):
    rows = run(tmp_path, "fabric_2", "fabric_1", "fabric_2")
    assert diagnosed == ["fabric_2", "fabric_1"]
    assert [row["fabric"] for row in rows] == diagnosed


def test_probabilities_of_the_table_stand_in_the_order_of_the_effects(diagnosed, tmp_path):
    (row,) = run(tmp_path, "fabric_1")
    assert dict(zip(row["effects"].split(" + "), row["probability"].split(), strict=True)) == {
        "creep": "0.97",
        "off-centre": "0.80",
    }
    assert [part.split(":")[0] for part in row["parameters"].split("; ")] == ["creep", "off-centre"]
