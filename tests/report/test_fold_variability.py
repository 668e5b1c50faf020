"""The spread of draws beside that of samples, on draws whose spread is known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from finished_cell import CLOTHS, held_out_images, write_cell
from other_laboratory import write_protocol
from PIL import Image
from toy_cloths import write_image
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.cli.fit import paper
from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.leaderboard import load_cells
from cusick_bench.report.figures.fold_variability import ALL, SAMPLES, fold_variability, variability_table


@pytest.fixture
def run(tmp_path, toy_dataset) -> Path:
    """A solver whose draws are the samples turned by 90 degrees, one whose draws are all alike, and some with few."""
    for cloth in CLOTHS:
        samples = held_out_images(toy_dataset, cloth)
        write_cell(tmp_path, toy_dataset, "turned", cloth, np.rot90(samples, axes=(1, 2)))
        write_cell(tmp_path, toy_dataset, "still", cloth, np.repeat(samples[:1], 5, axis=0))
        write_cell(tmp_path, toy_dataset, "single", cloth, samples[:1])
        write_cell(tmp_path, toy_dataset, "oracle:best-other", cloth, samples)
    return tmp_path


class TestFoldVariability:
    def rows(self, run: Path, toy_dataset: DrapeDataset) -> dict[tuple[str, str], dict]:
        return {(row["cloth"], row["drapes_of"]): row for row in fold_variability(load_cells(run), toy_dataset)}

    def test_draws_that_vary_as_samples_do_have_their_spread_and_others_do_not(self, run, toy_dataset):
        rows = self.rows(run, toy_dataset)
        assert {name for _, name in rows} == {SAMPLES, "turned", "still"}, "no oracle, nobody with a single draw"
        for cloth in (*CLOTHS, ALL):
            turned, still, samples = rows[cloth, "turned"], rows[cloth, "still"], rows[cloth, SAMPLES]
            assert turned["pair_mse"] == pytest.approx(samples["pair_mse"], rel=1e-9)
            assert turned["pair_mse_ratio"] == pytest.approx(1, rel=1e-9)
            assert turned["dc_sd_ratio"] == pytest.approx(1, rel=1e-6)
            assert 0 < turned["pair_mse_ratio_error"] < 1
            assert still["pair_mse_ratio"] == pytest.approx(0, abs=1e-12)

    def test_each_cloth_that_is_looked_at_is_told(self, run, toy_dataset):
        told: list[None] = []
        fold_variability(load_cells(run), toy_dataset, done=lambda: told.append(None))
        assert len(told) == len(CLOTHS)

    def test_the_ratio_of_all_cloths_is_that_of_the_means(self, run, toy_dataset):
        rows = self.rows(run, toy_dataset)
        one, other = (rows[cloth, SAMPLES] for cloth in CLOTHS)
        mean = rows[ALL, SAMPLES]
        assert mean["pair_mse"] == pytest.approx((one["pair_mse"] + other["pair_mse"]) / 2)
        assert mean["pair_mse_error"] == pytest.approx(np.hypot(one["pair_mse_error"], other["pair_mse_error"]) / 2)

    def test_the_mean_number_of_folds_is_compared_with_that_of_the_samples(self, run, toy_dataset):
        other = held_out_images(toy_dataset, CLOTHS[1])
        write_cell(run, toy_dataset, "swapped", CLOTHS[0], other)
        write_cell(run, toy_dataset, "swapped", CLOTHS[1], held_out_images(toy_dataset, CLOTHS[0]))
        rows = self.rows(run, toy_dataset)
        folds = [rows[cloth, SAMPLES]["folds"] for cloth in CLOTHS]
        assert folds == pytest.approx([7, 10], abs=0.5)
        for cloth, mean in zip(CLOTHS, reversed(folds), strict=True):
            assert rows[cloth, "turned"]["folds_off"] == pytest.approx(0, abs=1e-9)
            assert rows[cloth, "swapped"]["folds"] == pytest.approx(mean)
            assert rows[cloth, "swapped"]["folds_off"] == pytest.approx(folds[1] - folds[0])
        swapped = rows[ALL, "swapped"]
        assert swapped["folds"] == pytest.approx(np.mean(folds)), "on average they are right"
        assert swapped["folds_off"] == pytest.approx(folds[1] - folds[0]), "but not in either cloth"
        table = variability_table(list(rows.values()))
        off = [column.head for column in table.columns].index("off by")
        shown = {entry[:2]: entry[off] for entry in table.entries}
        assert shown[ALL, SAMPLES] == ""
        assert shown[ALL, "swapped"].startswith(f"{folds[1] - folds[0]:.1f}")

    def test_a_solver_that_lacks_a_cloth_is_read_against_the_cloths_that_it_has(self, run, toy_dataset):
        samples = held_out_images(toy_dataset, CLOTHS[1])
        write_cell(run, toy_dataset, "half", CLOTHS[1], np.rot90(samples, axes=(1, 2)))
        row = self.rows(run, toy_dataset)[ALL, "half"]
        assert row["pair_mse_ratio"] == pytest.approx(1, rel=1e-9)

    def test_the_same_drapes_in_twice_as_many_pixels_have_the_same_rows(self, run, toy_dataset, toy_data, tmp_path):
        data, finer = tmp_path / "finer", tmp_path / "finer-run"
        for path in sorted(toy_data.rglob("*.png")):
            write_image(data / path.relative_to(toy_data), _twice(1 - np.asarray(Image.open(path)) / 255))
        centre = tuple(2 * place + 0.5 for place in RELEASE.centre_px)
        write_protocol(data, replace(RELEASE, image_size_px=512, px_per_m=2 * RELEASE.px_per_m, centre_px=centre))
        dataset = load(data)
        for cloth in CLOTHS:
            write_cell(finer, dataset, "still", cloth, np.repeat(held_out_images(dataset, cloth)[:1], 5, axis=0))
        rows = self.rows(run, toy_dataset)
        for key, row in self.rows(finer, dataset).items():
            for measure in ("pair_mse", "dc_sd", "folds_sd"):
                assert row[measure] == pytest.approx(rows[key][measure], rel=0.02, abs=1e-12), (key, measure)

    def test_the_table_begins_with_the_means(self, run, toy_dataset):
        table = variability_table(fold_variability(load_cells(run), toy_dataset))
        assert [entry[:2] for entry in table.entries[:3]] == [(ALL, SAMPLES), (ALL, "still"), (ALL, "turned")]
        ratio = [column.head for column in table.columns].index("ratio")
        assert table.entries[0][ratio] == ""
        assert table.entries[2][ratio].startswith("1.00 ±")


def _twice(image: np.ndarray) -> np.ndarray:
    return image.repeat(2, axis=0).repeat(2, axis=1)


def test_table_1_writes_the_variability_of_its_draws(toy_data, tmp_path, monkeypatch):
    steps: list[float | None] = []
    shown = paper.progress_bar

    def bar(what: str, total: float | None = None):
        steps.append(total)
        return shown(what, total)

    monkeypatch.setattr(paper, "progress_bar", bar)
    words = ["--vertices", "100", "--steps", "20", "--budget", "4", "--draws", "8", "--solver", "null:random-phase"]
    words += ["--solver", "null:disc", "--cloth", CLOTHS[0], "--json"]
    result = CliRunner().invoke(app, ["paper", "table-1", "--data", str(toy_data), "--out", str(tmp_path), *words])
    assert result.exit_code == 0, result.output
    rows = json.loads((tmp_path / "table-1-variability.json").read_text())["rows"]
    assert {row["drapes_of"] for row in rows} == {SAMPLES, "null:random-phase,draws=8"}
    assert json.loads(result.stdout)["variability"] == rows
    assert len((tmp_path / "table-1-variability.csv").read_text().splitlines()) == 1 + len(rows)
    assert "| samples |" in (tmp_path / "table-1-variability.md").read_text()
    assert steps == [1], "one cloth, so that the time left can be told"
