"""The README is short, and its leaderboard says what the committed table says."""

import csv
import importlib
import re
from pathlib import Path

from finished_cell import CLOTHS, held_out_images, write_cell

from cusick_bench.leaderboard.cells.plausible import implausible

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MOST_LINES, MOST_EXAMPLE_LINES = 150, 12


def test_readme_stays_short():
    assert README.count("\n") < MOST_LINES
    for example in re.findall(r"^```python\n(.*?)^```", README, re.M | re.S):
        assert example.count("\n") <= MOST_EXAMPLE_LINES


def test_links_of_the_readme_lead_to_files():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).is_file(), target


def _short(text: str) -> str:
    return f"{float(text):.4f}".replace("0.", ".", 1)


def test_leaderboard_says_what_the_committed_table_says():
    block = re.search(r"<!-- leaderboard:begin -->(.*)<!-- leaderboard:end -->", README, re.S)
    assert block is not None
    lines = [line for line in block[1].splitlines() if line.startswith("|")]
    shown = {cells[2]: cells for line in lines if (cells := [cell.strip() for cell in line.split("|")])}
    with (ROOT / "leaderboards" / "synthetic.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["solver"] for row in rows} == set(shown) - {"solver", ":---", "repeat of the same drape"}
    for row in rows:
        cells = shown[row["solver"]]
        interval = f"[{_short(row['test_mse_low'])}, {_short(row['test_mse_high'])}]"
        scores = [_short(row["train_mse"]), f"{_short(row['test_mse'])} {interval}"]
        assert cells[3:7] == [row["kind"], row["cells"], *scores]


def test_the_block_is_made_of_a_results_folder(toy_dataset, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    maker = importlib.import_module("readme_leaderboard")
    for cloth in CLOTHS:
        write_cell(tmp_path, toy_dataset, "null:copy", cloth, held_out_images(toy_dataset, cloth)[:1])
    block = maker.block(tmp_path)
    assert block.startswith("`make bench`")
    assert "| null:copy | null | 2 |" in block
    changed = maker.BLOCK.sub(lambda _: block, README)
    assert "| null:copy | null | 3 |" not in changed
    assert changed.split("<!-- leaderboard:begin -->")[0] == README.split("<!-- leaderboard:begin -->")[0]
    assert changed.split("<!-- leaderboard:end -->")[1] == README.split("<!-- leaderboard:end -->")[1]


def test_the_limits_of_a_drape_coefficient_are_those_of_the_program():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    (limits,) = re.findall(r"a drape\s+coefficient\s+outside\s+\[(-?[\d.]+), (-?[\d.]+)\]", text)
    low, high = map(float, limits)
    assert [bool(implausible("train_dc", one)) for one in (low, high, low - 0.01, high + 0.01)] == [0, 0, 1, 1]
