"""The Croissant description of the shipped set."""

import json
from pathlib import Path

import pytest

from cusick_bench.datasets import load
from cusick_bench.datasets.synthetic_set.croissant import croissant
from cusick_bench.datasets.synthetic_set.files import checksums

ROOT = Path(load("synthetic").root)


def test_it_describes_the_files_that_are_shipped():
    files = {name: digest for name, digest in checksums(ROOT).items() if name != "croissant.json"}
    assert json.loads((ROOT / "croissant.json").read_text()) == json.loads(json.dumps(croissant(files)))


def test_it_is_valid_and_its_records_can_be_read():
    library = pytest.importorskip("mlcroissant")
    data = library.Dataset(ROOT / "croissant.json")
    assert not data.metadata.ctx.issues.errors
    fabrics = list(data.records("fabrics"))
    assert [int(row["fabrics/fabric"]) for row in fabrics] == [1, 2, 3, 4, 5]
    assert float(fabrics[0]["fabrics/areal_density_kg_m2"]) == pytest.approx(0.187)
