"""`truth.json` beside the data: read where it is there, refused where it is damaged."""

import json

import numpy as np
import pytest

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.synthetic_set import recipe
from cusick_bench.datasets.truth import true_tables


def test_truth_of_the_shipped_set_is_what_it_was_simulated_with():
    dataset = load("synthetic")
    for cloth in recipe.cloths():
        tables = true_tables(dataset, f"fabric_{cloth.number}")
        assert tables is not None
        assert tables.bending.numpy() == pytest.approx(cloth.material.bending.numpy(), rel=1e-12)
        assert tables.stretch.numpy() == pytest.approx(cloth.material.stretch.numpy(), rel=1e-12)


@pytest.fixture
def lab(make_lab):
    return make_lab((2.0,), samples=2)


TABLES = {"bending_N_m": np.full((3, 5), 1e-6).tolist(), "stretch_N_m": np.full((6, 4), 100.0).tolist()}


def test_a_laboratory_without_truth_has_none_and_one_that_measured_has(lab):
    assert true_tables(load(lab), "fabric_1") is None
    (lab / "truth.json").write_text(json.dumps({"fabrics": {"2": TABLES}}))
    assert true_tables(load(lab), "fabric_1") is None
    (lab / "truth.json").write_text(json.dumps({"fabrics": {"1": TABLES}}))
    tables = true_tables(load(lab), "fabric_1")
    assert tables is not None
    assert float(tables.bending[2, 0]) == 1e-6


@pytest.mark.parametrize("name", ["1", "fabric_1", "Fabric 1", "01"])
def test_a_fabric_is_named_as_in_fabrics_csv(lab, name):
    (lab / "truth.json").write_text(json.dumps({"fabrics": {name: TABLES}}))
    assert true_tables(load(lab), "fabric_1") is not None


@pytest.mark.parametrize(("place", "given"), [("", "data"), ("", "data/Fabric 1"), ("data", "")])
def test_truth_is_looked_for_where_fabrics_csv_is(lab, place, given):
    (lab / place / "truth.json").write_text(json.dumps({"fabrics": {"1": TABLES}}))
    dataset = load(lab / given)
    assert dataset.require_density(0) > 0
    assert true_tables(dataset, "fabric_1") is not None


def test_a_truth_of_law_plate_has_its_poissons_ratio(lab):
    (lab / "truth.json").write_text(json.dumps({"law": "plate", "fabrics": {"1": TABLES | {"poisson": 0.2}}}))
    tables = true_tables(load(lab), "fabric_1")
    assert tables is not None
    assert (tables.law, tables.poisson) == ("plate", 0.2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[]", "object"),
        ("{", "truth.json"),
        ("{}", "fabrics"),
        ('{"fabrics": {"1": 3}}', "stretch_N_m"),
        (json.dumps({"fabrics": {"1": TABLES, "fabric_1": TABLES}}), "twice"),
        (json.dumps({"law": "published", "fabrics": {"1": TABLES}}), "published"),
        (json.dumps({"fabrics": {"1": TABLES | {"poisson": 1.0}}}), "between -1 and 1"),
        (json.dumps({"fabrics": {"1": TABLES | {"poisson": "0.2"}}}), "between -1 and 1"),
        (json.dumps({"fabrics": {"1": TABLES | {"bending_N_m": [[1e-6] * 5] * 2}}}), "3 rows of 5"),
        (json.dumps({"fabrics": {"1": TABLES | {"bending_N_m": [[0.0] * 5] * 3}}}), "> 0"),
        (json.dumps({"fabrics": {"1": TABLES | {"bending_N_m": [["1e-6x"] * 5] * 3}}}), "3 rows of 5"),
    ],
)
def test_a_damaged_truth_is_refused_with_its_path(lab, text, said):
    (lab / "truth.json").write_text(text)
    with pytest.raises(DataError, match=said) as caught:
        true_tables(load(lab), "fabric_1")
    assert "truth.json" in str(caught.value)
