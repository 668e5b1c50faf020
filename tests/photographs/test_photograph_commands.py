"""Commands that print the board, draw photographs and measure errors on them."""

import json

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app

LABORATORY = "3"  # calibrated by its bare plate: the fewest pictures


def _data(*words: str):
    return CliRunner().invoke(app, ["data", *words])


def test_the_board_is_printed_for_either_paper(tmp_path):
    for paper in ("a4", "letter"):
        out = tmp_path / "new" / f"{paper}.pdf"
        assert _data("board", "--out", str(out), "--paper", paper).exit_code == 0
        assert out.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--out", "board.png"], "--out must end in .pdf"),
        (["--out", "board.pdf", "--plate-diameter", "300 mm"], "from 100 to 200 mm"),
        (["--out", "board.pdf", "--plate-diameter", "90 mm"], "from 100 to 200 mm"),
    ],
)
def test_a_board_that_cannot_be_printed_is_refused(words, says):
    found = _data("board", *words)
    assert found.exit_code == 2
    assert says in " ".join(found.output.split())


def test_photographs_are_drawn_with_their_truth_into_a_new_folder(tmp_path):
    words = ("photographs", "--out", str(tmp_path / "photos"), "--drapes", "1", "--laboratory", LABORATORY)
    found = _data(*words, "--json")
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["calibration"] == "plate"
    names = {path.name for path in (tmp_path / "photos").iterdir()}
    assert names == {"plate.jpg", "Fabric_1_Sample_1_Capture_1.jpg", "truth.json"}
    assert _data(*words).exit_code == 2


def test_errors_of_outlines_are_measured(tmp_path):
    words = ("photograph-errors", "--photographs", "1", "--laboratory", LABORATORY, "--json")
    found = _data(*words, "--minimum-share", "0")
    assert found.exit_code == 0, found.output
    measured = json.loads(found.stdout)
    (row,) = measured["rows"]
    assert measured["photographs"] == 1
    assert measured["within"] == float(row["rms_mm"] <= 0.5)
    assert row["largest_mm"] >= row["rms_mm"] > 0
