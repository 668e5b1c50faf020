"""Leaderboards as text, Markdown, HTML, LaTeX, CSV and JSON, and the command."""

import json

import pytest
from made_up_cells import only, shown_by_command, write_cell, write_solver
from rich.markdown import Markdown

from cusick_bench.leaderboard import (
    csv,
    html_table,
    latex,
    markdown,
    text_table,
)
from cusick_bench.leaderboard.text import Column, TextTable


def test_table_fits_the_terminal_and_drops_rare_columns(tmp_path, noise):
    write_solver(tmp_path, "homo", lambda cloth, seed: noise.normal(0.05, 0.01), draws=1000)
    write_solver(tmp_path, "null:random-phase,draws=1000", lambda cloth, seed: 0.06, 1, draws=1000)
    text = text_table(only(tmp_path))
    assert text.within(120).columns == text.columns
    narrow = text.within(70)
    assert {"solver", "train", "test", "H", "DC err"} <= {column.head for column in narrow.columns}
    assert len(narrow.columns) < len(text.columns)
    assert narrow.within(70).columns == narrow.columns, "it fits"


def test_scores_of_distributions_have_columns_where_rows_have_them(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05)
    assert not {"energy", "CRPS", "cover"} & {column.head for column in text_table(only(tmp_path)).columns}
    scores = {"test_energy_distance": 0.9123, "test_dc_crps": 0.0234, "test_dc_cover_90": 0.8}
    write_solver(tmp_path, "bdp", lambda cloth, seed: 0.06, draws=100, **scores)
    write_solver(tmp_path, "null:disc", lambda cloth, seed: 0.07, **(scores | {"test_dc_cover_90": 0.0}))
    lines = {line.split("|")[2].strip(): line for line in markdown(only(tmp_path)).splitlines() if "|" in line}
    assert "| energy dist. | CRPS points | cover 90 % |" in lines["solver"]
    assert "| .91 | 2.3 | 80 |" in lines["bdp"]
    assert "| .91 | 2.3 |  |" in lines["null:disc"], "one draw has no interval"
    assert "|  |  |  |" in lines["homo"]


def test_forms_escape_what_a_name_may_hold(tmp_path):
    write_cell(tmp_path, "<b>&|_[red]", "blue")
    board = only(tmp_path)
    assert "&lt;b&gt;&amp;" in html_table(board)
    assert "<b>" not in html_table(board) + markdown(board)
    assert r"\|_" in markdown(board)
    assert r"\&" in latex(board)


def test_markdown_shows_every_letter_of_a_name(tmp_path):
    """Stars and outer underscores became emphasis: `lacks *silk*` lost its stars."""
    (tmp_path / "run.json").write_text(json.dumps({"command": ["run", "--cloth", "*silk*"]}))
    write_cell(tmp_path, "fit_one,file=[a](b)", "*silk*")
    write_cell(tmp_path, "__fit__", "_b\\_")
    text = markdown(only(tmp_path))
    parts = [part for block in Markdown(text).parsed for part in block.children or ()]
    assert not {"em_open", "link_open", "s_open"} & {part.type for part in parts}
    shown = " ".join(part.content for part in parts)
    for words in ("lacks *silk*.", "lacks _b\\_.", "'*silk*'", "fit_one,file=[a](b)", "__fit__"):
        assert words in shown, words
    assert "fit_one," in text, "underscores within a word stay as they are"
    assert "ranked by test_mse" in text


def test_tex_shows_every_letter_of_a_name():
    """`<`, `>` and `|` are other characters in TeX's fonts, and `[` and `*` at the beginning of a row an option."""
    column = Column("cloth", "", "", lambda row: "", left=True)
    names = ("<a>|b", "[red]", "*silk", "blue [.1]")
    rows = latex(TextTable("names", (column,), ("",) * 4, tuple((name,) for name in names), ())).splitlines()
    assert rows[5:9] == [
        r"\textless{}a\textgreater{}\textbar{}b \\",
        r"{}[red] \\",
        r"{}*silk \\",
        r"blue [.1] \\",
    ]


def test_no_name_runs_in_a_spreadsheet_or_in_tex(tmp_path):
    run = {"command": ["run", "a\n\\input{/etc/passwd}"]}
    (tmp_path / "run.json").write_text(json.dumps(run))
    write_cell(tmp_path, "=1+1", "@blue")
    board = only(tmp_path)
    rows = [line for line in csv([board]).splitlines()[1:] if "1+1" in line]
    assert rows
    assert not [cell for line in rows for cell in line.split(",") if cell.startswith(("=", "@"))]
    outside = [line for line in latex(board).splitlines() if not line.startswith("%")]
    assert not [line for line in outside if "input{" in line]


def test_command_prints_json_and_writes_files(tmp_path, noise):
    write_solver(tmp_path / "runs", "homo", lambda cloth, seed: noise.normal(0.05, 0.001))
    command = ["/opt/bin/cusick-bench", "run", "--cloth", "blue twill", "--solver", "bdp,draws=5"]
    (tmp_path / "runs" / "run.json").write_text(json.dumps({"command": command, "cores": 2}))
    files = [tmp_path / "out" / name for name in ("board.csv", "board.md", "board.tex", "board.html")]
    arguments = [str(tmp_path / "runs"), "--json"]
    outcome = shown_by_command(arguments + [part for file in files for part in ("--out", str(file))])
    assert outcome.exit_code == 0, outcome.output
    rows = json.loads(outcome.stdout)["rows"]
    assert rows[1]["solver"] == "homo"
    assert rows[1]["test_mse"] == pytest.approx(0.05, abs=1e-3)
    assert rows[1]["command"] == "cusick-bench run --cloth 'blue twill' --solver bdp,draws=5"  # can be typed again
    assert rows[1]["dataset_hash"] == "abc"
    assert all("homo" in file.read_text() for file in files)
    plain = shown_by_command([str(tmp_path / "runs")])
    assert "61.5" in plain.stdout
    assert "homo" in plain.stdout


def test_command_refuses_with_status_2(tmp_path):
    assert shown_by_command([str(tmp_path / "nothing")]).exit_code == 2
    write_cell(tmp_path, "homo", "blue")
    assert shown_by_command([str(tmp_path), "--out", str(tmp_path / "x.doc")]).exit_code == 2


def test_draws_that_no_sample_was_held_out_for_have_no_best(tmp_path):
    """A lone `/100` stood in the column."""
    write_cell(tmp_path, "bdp", "blue", draws=100, test_mse_best=None)
    text = text_table(only(tmp_path))
    (line,) = [entries for entries in text.entries if "bdp" in entries]
    assert dict(zip((column.head for column in text.columns), line, strict=True))["best"] == ""


def test_every_column_shows_its_own_metric_in_its_unit(tmp_path):
    metrics = {"train_mse": 0.0123, "test_mse": 0.0456, "test_mse_best": 0.0345, "test_hausdorff_m": 0.0316}
    metrics |= {"test_dc_error": 0.021, "test_folds_error": 1.3, "test_energy_distance": 0.912, "test_dc_crps": 0.0234}
    write_cell(tmp_path, "bdp", "blue", draws=100, test_dc_cover_90=0.8, **metrics)
    write_cell(tmp_path, "null:random-phase", "blue", draws=100, test_mse=0.06, test_mse_best=0.0333)
    text = text_table(only(tmp_path))
    (line,) = [entries for entries in text.entries if "bdp" in entries]
    shown = {f"{column.head} {column.unit}".strip(): entry for column, entry in zip(text.columns, line, strict=True)}
    assert shown == {
        "#": "1", "solver": "bdp", "kind": "solver", "cells": "1", "train MSE": ".0123", "test MSE [95 %]": ".0456",
        "best MSE /N": ".0345 /100", "random MSE /N": ".0333", "H mm": "31.6", "DC err points": "2.1",
        "folds err": "1.3", "energy dist.": ".91", "CRPS points": "2.3", "cover 90 %": "80", "cost drapes": "240",
        "time s": "61.5",
    }  # fmt: skip
