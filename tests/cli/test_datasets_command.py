"""`cusick-bench datasets`: the registered sets, what of them is here, and how to get the rest."""

import json
import shutil

import pytest
from toy_cloths import write_toy
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets.published import CITATION, HOME
from cusick_bench.datasets.registry import REGISTRY

COUNTS = ("fabrics", "samples", "silhouettes", "meshes")


@pytest.fixture
def release(tmp_path, monkeypatch):
    """A toy in the place of the public release: two fabrics, a series over time, a named set of copies."""
    root = write_toy(tmp_path / "release", fabrics=(7, 8), samples=3, captures=4)
    next((root / "data/Fabric 7/meshes").iterdir()).unlink()
    series = root / "data/Fabric 7 Observations/Sample 1/silhouettes"
    series.mkdir(parents=True)
    first = root / "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_1.png"
    shutil.copy(first, series / "Fabric_7_Sample_1_Obs_1.png")
    named = root / "bnn_image_gt/cotton_green"
    named.mkdir(parents=True)
    shutil.copy(first, named / "cotton_green_sample_1_Upward_Drape_1.png")
    monkeypatch.setenv("CUSICK_DATA", str(root))
    return root


def _rows():
    found = CliRunner().invoke(app, ["datasets", "--json"])
    assert found.exit_code == 0, found.output
    return {row["name"]: row for row in json.loads(found.stdout)["datasets"]}


def test_every_registered_set_says_what_it_holds(release):
    rows = _rows()
    assert set(rows) == set(REGISTRY)
    assert [rows["synthetic"][name] for name in COUNTS] == [5, 60, 240, 240]  # as its Croissant description says
    assert [rows["cusick"][name] for name in COUNTS] == [2, 7, 25, 23]  # the copy in the named set does not count
    assert rows["cusick"]["folder"] == str(release)
    assert not rows["cusick"]["missing"]
    assert rows["cusick"]["reference"] == CITATION
    assert "Apache-2.0" in rows["synthetic"]["licence"]


@pytest.mark.parametrize("folder", ["", "nowhere"])
def test_a_set_that_is_not_here_says_how_to_get_it(monkeypatch, tmp_path, folder):
    monkeypatch.setenv("CUSICK_DATA", folder and str(tmp_path / folder))
    row = _rows()["cusick"]
    assert [row[name] for name in (*COUNTS, "folder")] == [None] * 5
    assert ("no such folder" if folder else "set CUSICK_DATA") in row["missing"]
    assert HOME in row["source"]


def test_the_table_reads_on_a_narrow_terminal(release):
    text = " ".join(CliRunner().invoke(app, ["datasets"], env={"COLUMNS": "80"}).stdout.replace("│", " ").split())
    assert "…" not in text  # nothing is cut off
    assert "5 fabrics, 60 samples, 240 silhouettes, 240 meshes" in text
    assert "licence: none stated" in text
    assert CITATION in text
