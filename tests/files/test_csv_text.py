"""CSV that we write: no spreadsheet runs a cell of it, and what is read back is what was written."""

import pandas as pd
import pytest

from cusick_bench.files import BadFile, read_csv
from cusick_bench.files.csv_text import csv_text
from cusick_bench.leaderboard.gate.baseline import read_cells, write_baseline

FORMULAS = ['=HYPERLINK("http://x")', "+1+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "'=1"]
HARMLESS = ["cotton", "fabric_1", "-0.25", "+3", "-1e-5", "-inf", "1-2", "a=b", "'quoted'", ""]


@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_is_no_formula_any_more(text):
    written = csv_text(pd.DataFrame({"cloth": [text], "mse": [-0.5]}))
    assert written.splitlines()[1].lstrip('"')[0] == "'"
    assert written.rstrip().endswith(",-0.5")


@pytest.mark.parametrize("text", HARMLESS)
def test_numbers_and_names_stay(text):
    table = pd.DataFrame({"cloth": [text], "mse": [-0.5]})
    assert csv_text(table) == table.to_csv(index=False, lineterminator="\n")


def test_heads_are_guarded_too():
    assert csv_text(pd.DataFrame({"=1+1": [1]})) == "'=1+1\n1\n"


def test_numbers_are_written_as_pandas_writes_them():
    table = pd.DataFrame({"a": [0.1, 1e-20, None], "b": [-1, 2, 3], "c": [True, None, False], "d": [1, None, "x"]})
    assert csv_text(table, float_format="%.3g") == table.to_csv(index=False, lineterminator="\n", float_format="%.3g")


def test_what_is_read_is_what_was_written(tmp_path):
    names = [text for text in (*FORMULAS, *HARMLESS) if text.strip() == text != ""]
    (tmp_path / "t.csv").write_text(csv_text(pd.DataFrame({"cloth": names})))
    assert [row["cloth"] for _, row in read_csv(tmp_path / "t.csv", remedy="").rows] == names


@pytest.mark.parametrize(
    "name",
    [
        "two\nlines",
        "two\r\nlines",
        "two\rlines",
        "x\r=1+1",
        "fabric\n# 2",
        "a\x0bb",
        "a\x0cb",
        "a\x1eb",
        "a\x85b",
        "a\u2028b",
    ],
)
def test_a_cell_with_a_line_break_is_one_cell(tmp_path, name):
    path = tmp_path / "t.csv"
    table = pd.DataFrame({"cloth": [name, "next"], "mse": [0.5, 0.25]})
    path.write_bytes(csv_text(table).encode())
    read = [(row["cloth"], row["mse"]) for _, row in read_csv(path, remedy="", comment="#").rows]
    assert read == [(name, "0.5"), ("next", "0.25")]


def test_a_cell_of_blanks_is_read_as_empty(tmp_path):
    """The guard of a tab stayed, as an apostrophe in a cell of its own."""
    path = tmp_path / "t.csv"
    path.write_bytes(csv_text(pd.DataFrame({"cloth": ["\t", "\r", " "], "mse": [1, 2, 3]})).encode())
    assert [row["cloth"] for _, row in read_csv(path, remedy="").rows] == ["", "", ""]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_may_end_as_on_any_system(tmp_path, end):
    path = tmp_path / "t.csv"
    path.write_bytes(end.join(["# made by hand", "cloth,mse", "", "blue,.5", "red"]).encode())
    rows = read_csv(path, remedy="", comment="#").rows
    assert rows == ((4, {"cloth": "blue", "mse": ".5"}), (5, {"cloth": "red", "mse": ""}))


@pytest.mark.parametrize(("mark", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_other_marks_between_cells_are_named(tmp_path, mark, name):
    path = tmp_path / "t.csv"
    path.write_text(f"fabric{mark}areal_density_kg_m2\n1{mark}0,2\n")
    with pytest.raises(BadFile, match=f"must have commas between cells, got {name}; write it with commas"):
        read_csv(path, remedy="", required=("fabric",))


def test_a_baseline_of_hostile_cloths_is_read_back(tmp_path):
    cells = {
        "solver": "homo",
        "cloth": ["=1+1", "-x", "blue"],
        "seed": 0,
        "status": "done",
        "test_mse": [0.1, 0.2, 0.3],
    }
    write_baseline(pd.DataFrame(cells), tmp_path / "b.csv", ["made by a test"])
    assert "\nhomo,'=1+1," in (tmp_path / "b.csv").read_text()
    assert sorted(read_cells(tmp_path / "b.csv")["cloth"]) == sorted(["=1+1", "-x", "blue"])
