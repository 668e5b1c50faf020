"""Tables of a results folder as CSV and Parquet."""

import errno
import sys
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.files.table_file import MissingLibrary, table_bytes


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("tables") / "run"
    words = ["run", "--cloth", "fabric_1", "--solver", "null:disc", "--solver", "null:copy", "--vertices", "97"]
    assert CliRunner().invoke(app, [*words, "--out", str(out)]).exit_code == 0
    return out


def test_cells_and_boards_are_the_same_in_both_forms(folder, tmp_path):
    pytest.importorskip("pyarrow")
    files = {name: tmp_path / name for name in ("a.csv", "a.parquet", "b.csv", "b.parquet")}
    words = ["leaderboard", str(folder)]
    for name, path in files.items():
        words += ["--cells" if name.startswith("a") else "--out", str(path)]
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0, found.output
    cells, board = pd.read_parquet(files["a.parquet"]), pd.read_parquet(files["b.parquet"])
    assert set(cells["solver"]) == {"null:disc", "null:copy"}
    assert {"test_mse", "spent_wall_seconds", "settings", "path"} <= set(cells.columns)
    assert (folder / cells["path"][0] / "done").exists()
    assert list(pd.read_csv(files["a.csv"])["test_mse"]) == pytest.approx(list(cells["test_mse"]), rel=1e-12)
    assert list(pd.read_csv(files["b.csv"])["test_mse"]) == pytest.approx(list(board["test_mse"]), rel=1e-12)


def test_without_the_library_the_message_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingLibrary, match=r"cusick-bench\[parquet\]"):
        table_bytes(pd.DataFrame({"a": [1]}), tmp_path / "a.parquet")


def test_without_the_library_a_table_may_be_csv(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    found = CliRunner().invoke(app, ["leaderboard", str(folder), "--out", str(tmp_path / "a.parquet")])
    assert found.exit_code == 2
    assert found.stderr.endswith(", or write .csv\n")


def test_text_that_a_spreadsheet_would_run_is_guarded_in_csv_only(tmp_path):
    pytest.importorskip("pyarrow")
    table = pd.DataFrame({"cloth": ["=1+1"]})
    for name in ("a.csv", "a.parquet"):
        (tmp_path / name).write_bytes(table_bytes(table, tmp_path / name))
    assert pd.read_parquet(tmp_path / "a.parquet")["cloth"][0] == "=1+1"
    assert pd.read_csv(tmp_path / "a.csv")["cloth"][0] == "'=1+1"


def test_other_endings_are_refused(folder, tmp_path):
    found = CliRunner().invoke(app, ["leaderboard", str(folder), "--cells", str(tmp_path / "a.xlsx")])
    assert found.exit_code == 2
    assert ".parquet" in found.stderr


def test_a_disk_that_is_full_leaves_the_files_of_before(folder, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    table, page, verdicts = (tmp_path / name for name in ("table.csv", "page.html", "verdicts.xml"))
    for path in (table, page, verdicts):
        path.write_text("of before")
    monkeypatch.setattr("os.fsync", full)
    for words in (
        ["leaderboard", folder, "--out", table],
        ["report", folder, "--out", page],
        ["check", folder, "--against", folder, "--junit", verdicts],
    ):
        assert CliRunner().invoke(app, list(map(str, words))).exit_code == 2, words
    assert {path.read_text() for path in tmp_path.iterdir()} == {"of before"}
