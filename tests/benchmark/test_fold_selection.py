"""Fold selection: conditions, what is measured on silhouettes, the command, and its picture."""

import json

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from cusick_bench.benchmark.fold_selection.conditions import FACTORS, Condition, levels
from cusick_bench.benchmark.fold_selection.real_cloth import PUBLISHED, ClothRow, cloth_rows
from cusick_bench.benchmark.fold_selection.responses import MEANS, FoldResponses, fold_responses
from cusick_bench.benchmark.fold_selection.study import FoldRow, drape_images, fold_rows
from cusick_bench.cli import app
from cusick_bench.cli.simulate.fold_selection import FactorName
from cusick_bench.datasets import load
from cusick_bench.report.figures.fold_selection import fold_selection_figure
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render

SMALL = Condition(law="paper", vertices=97, fall_seconds=1.0)


def waved(folds, depth=0.01, sharpness=0.0, turn=0.0):
    """Image of a drape whose radius waves `folds` times; sharp crests are narrower than valleys."""
    angle = np.arange(360) * 2 * np.pi / 360
    wave = np.cos(folds * (angle + turn)) + sharpness * np.cos(2 * folds * (angle + turn))
    radii = 0.125 + depth * wave
    rim = np.column_stack([radii * np.cos(angle), radii * np.sin(angle), np.zeros(360)])
    points = torch.from_numpy(np.vstack([np.zeros(3), rim]))
    faces = np.column_stack([np.zeros(360, int), np.arange(1, 361), np.roll(np.arange(1, 361), -1)])
    return render(points, faces, ParallelCamera()).numpy()


class TestConditions:
    @pytest.mark.parametrize("factor", FACTORS)
    def test_levels_of_a_factor_differ(self, factor):
        conditions = [level.condition for level in levels(Condition(), [factor])]
        assert len(conditions) > 1
        assert len(set(conditions)) == len(conditions)

    @pytest.mark.parametrize("factor", FACTORS)
    def test_the_base_is_a_level_of_every_factor(self, factor):
        assert Condition() in [level.condition for level in levels(Condition(), [factor])]

    def test_a_shorter_step_falls_as_long(self):
        for level in levels(Condition(), ["step"]):
            assert level.condition.steps * level.condition.step_seconds == pytest.approx(
                4.5, abs=level.condition.step_seconds / 2
            )


class TestResponses:
    def test_waves_are_counted_and_measured(self):
        found = fold_responses([waved(7), waved(9)])
        assert found.folds == 8
        assert found.folds_sd == pytest.approx(np.sqrt(2))
        assert found.fold_depth_mm == pytest.approx(10 / np.sqrt(2), rel=0.02)

    def test_narrow_crests_are_positively_skewed(self):
        narrow, wide = (fold_responses([waved(8, sharpness=s)]).fold_skewness for s in (0.3, -0.3))
        assert narrow > 0.4
        assert wide < -0.4

    def test_pairs_differ_by_where_folds_lie(self):
        assert fold_responses([waved(8), waved(8)]).pair_mse == pytest.approx(0, abs=1e-6)
        assert fold_responses([waved(8), waved(8, turn=np.pi / 8)]).pair_mse > 0.02

    def test_no_drapes_have_no_numbers(self):
        found = fold_responses([])
        assert found.drapes == 0
        assert all(np.isnan(getattr(found, name)) for name in MEANS)


class TestStudy:
    def test_draws_repeat_and_differ(self):
        one, other = drape_images(SMALL, 2), drape_images(SMALL, 2)
        assert np.array_equal(one, other)
        assert not np.array_equal(one[0], one[1])

    @pytest.mark.parametrize(
        "changed", [{"stages": 2}, {"slide": 5e-3}, {"rest_height": 2e-3}, {"laying_length": 0.01}, {"shear": 20.0}]
    )
    def test_every_factor_changes_the_drape(self, changed):
        (base,), (other,) = drape_images(SMALL, 1), drape_images(Condition(**{**vars(SMALL), **changed}), 1)
        assert np.abs(base - other).mean() > 1e-4

    def test_a_condition_in_several_factors_is_draped_once(self):
        told = []
        rows = fold_rows(levels(SMALL, ["slide", "rest-shape"]), 1, done=told.append)
        assert len(told) == len(rows)
        same = [row.responses for row in rows if row.condition == SMALL]
        assert len(same) == 2
        assert same[0] is same[1]


class TestRealCloth:
    def test_published_numbers_are_in_order(self):
        for coefficient, sd, folds in PUBLISHED.values():
            assert 0 < sd < coefficient < 1
            assert 7 < folds < 13

    def test_faces_are_measured_apart(self):
        rows = cloth_rows(load("synthetic"))
        assert {row.side for row in rows} == {"up", "down"}
        assert all(row.responses.drapes >= 3 for row in rows)

    @pytest.mark.slow
    def test_published_numbers_are_those_of_the_release(self, real_data):
        found = {(row.cloth, row.side): row.responses for row in cloth_rows(load(real_data))}
        assert found["fabric_2", "up"].drape_coefficient == pytest.approx(PUBLISHED["cotton_blue"][0], abs=0.02)
        assert found["fabric_2", "up"].folds == pytest.approx(PUBLISHED["cotton_blue"][2], abs=0.3)


def row(factor, label, condition):
    return FoldRow(factor, label, condition, 0, FoldResponses(3, 0.5, 8, 7, 0.1, 9, 0.02, 0.8, 0.7, 0.1, 0.5, 0.05))


class TestPicture:
    def test_it_shows_every_level_and_cloth(self):
        rows = [row(level.factor, level.label, level.condition) for level in levels(Condition())]
        figure = fold_selection_figure("title", rows, [ClothRow("a", "up", rows[0].responses)])
        texts = [tick.get_text() for part in figure.subfigs for axis in part.axes for tick in axis.get_yticklabels()]
        assert sum(":" in text for text in texts) >= len(rows) - 9
        labels = [text.get_text() for text in figure.subfigs[0].axes[0].get_legend().get_texts()]
        assert "real cloths" in labels


class TestCommand:
    def test_every_factor_can_be_asked_for(self):
        assert {one.value for one in FactorName} == set(FACTORS)

    def test_json_is_one_document(self, tmp_path):
        picture = tmp_path / "folder" / "folds.png"
        asked = ["--factor", "slide", "--law", "paper", "--vertices", "97", "--draws", "2", "--picture", str(picture)]
        found = CliRunner().invoke(app, ["fold-selection", *asked, "--json"])
        assert found.exit_code == 0, found.output
        document = json.loads(found.stdout)
        assert [one["label"] for one in document["rows"]] == ["0 mm", "3 mm", "10 mm"]
        assert picture.read_bytes().startswith(b"\x89PNG")

    def test_data_of_too_few_samples_are_refused(self, make_lab, tmp_path):
        lab, picture = make_lab([1e-5], samples=2), tmp_path / "folder" / "folds.png"
        asked = ["--factor", "slide", "--law", "paper", "--vertices", "97", "--draws", "2", "--picture", str(picture)]
        found = CliRunner().invoke(app, ["fold-selection", *asked, "--data", str(lab)], env={"COLUMNS": "400"})
        assert found.exit_code == 2
        assert "has no fabric of which one face is shown by three samples or more" in found.stderr
        assert not picture.parent.exists()

    def test_a_law_without_rests_is_refused(self):
        found = CliRunner().invoke(app, ["fold-selection", "--law", "published"])
        assert found.exit_code == 2
        assert "release" in found.output
