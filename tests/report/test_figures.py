"""The paper's figures on results whose answers are known, and on folders that cannot be drawn."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from finished_cell import CLOTHS, held_out_images, write_cell
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from toy_cloths import write_toy
from typer.testing import CliRunner

from cusick_bench.cli.fit import paper_figures
from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.leaderboard import load_cells
from cusick_bench.metrics import Confusion, ruled_surface
from cusick_bench.report import ReportError
from cusick_bench.report.figures.fold_variability import fold_variability
from cusick_bench.report.figures.predictions import entrants, load_draws
from cusick_bench.report.figures.radius_angle import (
    Group,
    RadiusAngle,
    radius_angle,
    radius_angle_figure,
    save_confusion,
)
from cusick_bench.report.figures.sheet import in_blocks
from cusick_bench.report.figures.side_by_side import Strip, Tile, fitted, held_out, strips_figure
from cusick_bench.solvers.reference.silhouettes import silhouette

app = typer.Typer()
paper_figures.register(app)


@pytest.fixture(autouse=True)
def _coarse_scenes(monkeypatch):
    """What the drapes look like is told by the report's tests."""
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 200)


@pytest.fixture(scope="module")
def run(tmp_path_factory, toy_dataset) -> Path:
    """`right` draws other samples of its cloth, `swapped` those of the other one, `disc` one disc for all."""
    folder = tmp_path_factory.mktemp("run")
    disc = silhouette(np.full(4, 0.13))[None]
    mesh = ruled_surface(np.full(60, 0.12))
    drape = {"vertices": np.asarray(mesh.vertices), "faces": np.asarray(mesh.faces)}
    for cloth, other in (CLOTHS, CLOTHS[::-1]):
        own = held_out_images(toy_dataset, cloth)
        drapes = drape | {"draw_vertices": np.stack([mesh.vertices] * len(own))}
        write_cell(folder, toy_dataset, "right", cloth, own, arrays=drapes)
        write_cell(folder, toy_dataset, "swapped", cloth, held_out_images(toy_dataset, other))
        write_cell(folder, toy_dataset, "null:disc", cloth, disc)
    write_cell(folder, toy_dataset, "right", CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0])[:2], seed=1)
    return folder


def draw(command: str, run: Path, data: Path, out: Path, *options: str) -> dict:
    arguments = [command, str(run), "--data", str(data), "--out", str(out), "--json", *options]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    for file in document["files"]:
        assert Path(file).is_file()
    return document


def pictures(document: dict) -> Iterator[np.ndarray]:
    for file in document["files"]:
        if file.endswith(".png"):
            yield np.asarray(Image.open(file).convert("RGB"), dtype=float)


# -- figure 8


def test_draws_are_taken_for_the_cloth_that_they_look_like(run, toy_data, tmp_path):
    document = draw("figure-8", run, toy_data, tmp_path)
    assert document["chance"] == 0.5
    assert document["real"]["accuracy"] == 1
    assert document["real"]["drapes"] == 8
    assert document["draws"]["right"]["accuracy"] == 1
    assert document["draws"]["right"]["drapes"] == 4 + 4 + 2  # all seeds
    assert document["draws"]["swapped"]["accuracy"] == 0
    assert document["draws"]["swapped"]["taken_for"]["fabric_1"] == {"fabric_1": 0, "fabric_4": 4, "none": 0}
    assert document["draws"]["null:disc"]["none_of_them"] == 1
    assert json.loads((tmp_path / "figure-8.json").read_text())["real"] == document["real"]
    assert all(picture.std() > 5 for picture in pictures(document))
    assert (tmp_path / "figure-8-confusion.png").is_file()


def test_the_share_of_unequal_numbers_of_draws_is_said_to_count_cloths_alike(toy_dataset, toy_data, tmp_path):
    """It was said to be of all draws: 50 % of 6, of which 4 are taken for their own cloth."""
    for cloth, number in zip(CLOTHS, (4, 2), strict=True):
        write_cell(tmp_path / "run", toy_dataset, "one", cloth, held_out_images(toy_dataset, CLOTHS[0])[:number])
    arguments = ["figure-8", str(tmp_path / "run"), "--data", str(toy_data), "--out", str(tmp_path / "figure")]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    said = " ".join(outcome.output.split())
    assert "50.0 % are taken for their own cloth (6 drapes, each cloth counting alike): one" in said


def test_ranks_of_held_out_coefficients_are_given_for_each_cloth(run, toy_dataset):
    document = radius_angle(load_cells(run), toy_dataset).document()
    found = document["dc_ranks"]["right"]["fabric_4"]
    assert np.sort(found) == pytest.approx((np.arange(4) + 1) / 5)  # draws and samples are the same four
    assert set(document["dc_ranks"]["null:disc"]["fabric_1"]) == {0.25}  # a disc larger than all of them


def test_the_number_of_draws_looked_at_is_bounded(run, toy_dataset):
    study = radius_angle(load_cells(run), toy_dataset, ["right"], draws=2)
    assert study.drawn[0].radii["fabric_4"].shape == (2, 720)


def test_one_cloth_alone_cannot_be_told_apart(toy_dataset, toy_data, tmp_path):
    write_cell(tmp_path / "run", toy_dataset, "right", CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0]))
    outcome = CliRunner().invoke(
        app, ["figure-8", str(tmp_path / "run"), "--data", str(toy_data), "--out", str(tmp_path / "figure")]
    )
    assert outcome.exit_code == 2
    assert "at least 2 cloths" in " ".join(outcome.output.split())


def test_draws_are_not_judged_beside_what_they_were_fitted_to(toy_dataset, tmp_path):
    """Samples are left out in turn: each trains the other fits, and a copy of one would be at home."""
    for cloth in CLOTHS:
        for number, split in enumerate(toy_dataset.split("leave-one-sample-out", [cloth])):
            copied = np.asarray(toy_dataset.image(split.train[0]))[None]
            cell = write_cell(tmp_path, toy_dataset, "null:copy", cloth, copied, seed=number)
            for name in ("cell.json", "result.json"):
                of_split = {"seed": 0, "train": list(split.train), "test": list(split.test)}
                (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | of_split))
    with pytest.raises(ReportError, match=r"every sample of fabric_1 trains some fit .*; give a run of --protocol"):
        radius_angle(load_cells(tmp_path), toy_dataset)


def test_fits_of_several_splits_stand_apart(toy_dataset, tmp_path):
    """Fits of one and of two samples of a learning curve were one solver of twice as many draws."""
    for samples in (1, 2):
        for cloth in CLOTHS:
            own = held_out_images(toy_dataset, cloth)[:samples]
            cell = write_cell(tmp_path, toy_dataset, "right", cloth, own, seed=samples)
            for name in ("cell.json", "result.json"):
                of_split = {"seed": 0, "protocol": f"first-{samples}"}
                (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | of_split))
    cells, labels = load_cells(tmp_path), [f"right, split first-{samples}" for samples in (1, 2)]
    study = radius_angle(cells, toy_dataset)
    assert [group.label for group in study.drawn] == labels
    assert [group.confusion.counts.sum() for group in study.drawn] == [2, 4]
    assert all(list(strip.predicted) == labels for strip in held_out(cells, toy_dataset, ["right"]))


def test_draws_of_either_face_are_as_many_as_samples_of_it(tmp_path):
    """They are stored in turn, and every second one was taken: all of one face, for samples of both."""
    dataset = load(write_toy(tmp_path / "data", fabrics=(1, 4), samples=4, captures=4, meshes=False))
    table, run, turned = dataset.table, tmp_path / "run", {"draw_turned": np.arange(24) % 2 == 1}
    for cloth in CLOTHS:
        rows = table.index[(table["cloth"] == cloth) & table["capture"].isin([1, 3])].tolist()  # up and down in turn
        pairs = np.stack([dataset.image(row).numpy() for row in rows[2:]]).reshape(3, 2, 256, 256)
        draws = pairs.repeat(4, axis=0).reshape(24, 256, 256)
        cell = write_cell(run, dataset, "both", cloth, draws, arrays=turned)
        for name in ("cell.json", "result.json"):
            of_split = {"train": rows[:2], "test": rows[2:]}
            (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | of_split))
    study = radius_angle(load_cells(run), dataset, draws=12)
    (drawn,) = study.drawn
    for cloth in CLOTHS:
        assert sorted(drawn.sides[cloth]) == ["down"] * 6 + ["up"] * 6
        own = np.sort(study.document()["dc_ranks"]["both"][cloth])
        assert own == pytest.approx(np.repeat([1.5, 3.5, 5.5], 2) / 7)  # each face among its own draws, twice each
    rows = {row["drapes_of"]: row for row in fold_variability(load_cells(run), dataset, draws=12)}
    assert rows["both"]["dc_sd_ratio"] == pytest.approx(np.sqrt((12 / 11) / (6 / 5)), rel=1e-3)  # the samples, twice


# -- figures 6 and 7


def test_fits_stand_beside_their_training_sample(run, toy_data, toy_dataset, tmp_path):
    strips = fitted(load_cells(run), toy_dataset)
    assert [strip.cloth for strip in strips] == list(CLOTHS)
    assert list(strips[0].predicted) == ["right", "swapped"]  # what does not simulate, fits nothing
    assert not strips[0].real.ruled
    assert not strips[0].predicted["right"].ruled
    assert strips[0].predicted["swapped"].ruled
    document = draw("figure-6", run, toy_data, tmp_path)
    assert document["strips"][1]["mse"] == pytest.approx({"right": 0, "swapped": 0})  # fits are copies
    asked = draw("figure-6", run, toy_data, tmp_path, "--solver", "null:disc")
    assert set(asked["strips"][0]["mse"]) == {"null:disc"}
    (picture,) = pictures(document)
    assert picture.std() > 5


def test_the_best_draw_is_shown_for_every_held_out_sample(run, toy_data, toy_dataset, tmp_path):
    strips = held_out(load_cells(run), toy_dataset, samples=2)
    assert len(strips) == 4
    for strip in strips:
        assert strip.predicted["right"].mse == pytest.approx(0, abs=1e-5)  # the sample itself is among the draws
        assert np.abs(strip.predicted["right"].image - strip.real.image).max() < 0.01
        assert strip.predicted["right"].mse < strip.predicted["swapped"].mse
    document = draw("figure-7", run, toy_data, tmp_path, "--samples", "1", "--solver", "swapped")
    assert [set(strip["mse"]) for strip in document["strips"]] == [{"swapped"}] * 2
    assert {Path(file).name for file in document["files"]} == {
        "figure-7-fabric_1.png",
        "figure-7-fabric_4.png",
        "figure-7.json",
    }


def test_where_samples_are_left_out_in_turn_one_split_is_shown(toy_dataset, tmp_path):
    """All samples are held out of some fit, that which the shown one was trained on too."""
    splits = toy_dataset.split("leave-one-sample-out", [CLOTHS[0]])
    for solver, order in (("right", splits), ("null:disc", splits[::-1])):
        for number, split in enumerate(order):
            cell = write_cell(
                tmp_path, toy_dataset, solver, CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0]), seed=number
            )
            for name in ("cell.json", "result.json"):
                of_split = {"seed": 0, "train": list(split.train), "test": list(split.test)}
                (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | of_split))
    cells, first = load_cells(tmp_path), min(splits, key=lambda split: split.test)
    strips = held_out(cells, toy_dataset, samples=9)
    samples = toy_dataset.table["sample"]
    assert [strip.sample for strip in strips] == samples.iloc[sorted(first.test)].tolist()
    assert all(set(strip.predicted) == {"right", "null:disc"} for strip in strips)
    (fit,) = fitted(cells, toy_dataset, ["right", "null:disc"])
    assert fit.sample == samples.iloc[first.train[0]]
    assert set(fit.predicted) == {"right", "null:disc"}


def test_a_sample_is_compared_with_draws_of_its_own_face(toy_dataset, tmp_path):
    """As scores are: the best draw of the other face is no prediction of this sample."""
    own = held_out_images(toy_dataset, CLOTHS[0])
    draws = np.concatenate([own[:1] * 0.9, own])
    turned = {"draw_turned": np.arange(len(draws)) > 0}
    write_cell(tmp_path, toy_dataset, "null:rotation", CLOTHS[0], draws, arrays=turned)
    (strip,) = held_out(load_cells(tmp_path), toy_dataset, samples=1)
    shown = strip.predicted["null:rotation"]
    assert shown.remark == "its only draw"
    assert shown.mse > 1e-3


def test_an_oracle_shows_the_draw_that_it_made_for_the_sample(toy_dataset, tmp_path):
    """Its draws are the held-out samples in another order: the best one is not the one made for the sample."""
    own = held_out_images(toy_dataset, CLOTHS[0])
    write_cell(tmp_path, toy_dataset, "oracle:shifted", CLOTHS[0], np.roll(own, 1, axis=0))
    strips = held_out(load_cells(tmp_path), toy_dataset, samples=3)
    for place, strip in enumerate(strips):
        shown = strip.predicted["oracle:shifted"]
        assert np.abs(shown.image - own[place - 1]).max() < 0.01
        assert shown.mse == pytest.approx(np.mean((own[place] - own[place - 1]) ** 2), abs=1e-3)
        assert shown.remark == ""


def test_oracles_are_shown_on_demand_or_where_there_is_nothing_else(run, toy_dataset, tmp_path):
    for cloth in CLOTHS:
        write_cell(tmp_path, toy_dataset, "oracle:shifted", cloth, held_out_images(toy_dataset, cloth))
    alone = load_cells(tmp_path)
    assert [one.label for one in entrants(alone, kinds=("solver", "null"))] == ["oracle:shifted"]
    for cloth in CLOTHS:
        write_cell(tmp_path, toy_dataset, "null:copy", cloth, held_out_images(toy_dataset, cloth)[:1])
    both = load_cells(tmp_path)
    assert [one.label for one in entrants(both, kinds=("solver", "null"))] == ["null:copy"]
    assert [one.label for one in entrants(both)] == ["null:copy", "oracle:shifted"]
    assert [one.label for one in entrants(both, ["oracle:shifted"], kinds=("null",))] == ["oracle:shifted"]
    assert [group.label for group in radius_angle(both, toy_dataset).drawn] == ["null:copy"]
    assert set(held_out(both, toy_dataset, samples=1)[0].predicted) == {"null:copy"}


@pytest.mark.parametrize(("count", "lengths"), [(0, [0]), (1, [1]), (5, [5]), (6, [3, 3]), (11, [3, 4, 4])])
def test_many_methods_stand_in_even_blocks(count, lengths):
    blocks = in_blocks(range(count), 5)
    assert [len(block) for block in blocks] == lengths
    assert [item for block in blocks for item in block] == list(range(count))


METHODS = [f"method-{letter}" for letter in "abcdefg"]


def strip(cloth: str, methods: list[str]) -> Strip:
    tile = Tile(np.full((256, 256), 0.5), ruled_surface(np.full(12, 0.12)), ruled=True, mse=0.1)
    return Strip(cloth, 1, tile, dict.fromkeys(methods, tile))


def test_silhouettes_that_fill_their_picture_are_shown_whole():
    """Of every picture a sixteenth was cut off, as suits the release: a cloth of another laboratory lost its rim."""
    protocol = Protocol(px_per_m=800.0, centre_px=(122.0, 131.0))  # the flat cloth fills the picture
    shown = replace(strip(CLOTHS[0], METHODS[:1]), protocol=protocol)
    column, row = protocol.centre_px
    reach = protocol.cloth_radius_m * protocol.px_per_m
    silhouettes = [axes for axes in strips_figure([shown], "title").axes if axes.images][:2]
    for axes in silhouettes:
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert left < column - reach < column + reach < right
        assert high < row - reach < row + reach < low


def study(methods: list[str]) -> RadiusAngle:
    confusion = Confusion(CLOTHS, np.array([[3, 1, 0], [0, 4, 0]]))
    radii = {cloth: np.full((4, 36), 0.12) for cloth in CLOTHS}
    real, *drawn = (Group(name, radii, {}, confusion) for name in ("real samples", *methods))
    return RadiusAngle(real, tuple(drawn))


def drawn_axes(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.images or axes.lines]


@pytest.mark.parametrize(
    "sheet",
    [  # both with two axes for each method: from above and from the side, or two cloths
        lambda methods: strips_figure([strip(CLOTHS[0], methods)], "title"),
        lambda methods: radius_angle_figure(study(methods)),
    ],
    ids=["side by side", "radius over angle"],
)
def test_a_sheet_of_many_methods_is_higher_not_wider(sheet):
    few, many = sheet(METHODS[:4]), sheet(METHODS)
    (width, height), (many_width, many_height) = few.get_size_inches(), many.get_size_inches()
    assert many_width == width
    assert 1.6 * height < many_height < 2.2 * height
    for figure, methods, blocks in ((few, 4, 1), (many, 7, 2)):
        assert len(drawn_axes(figure)) == 2 * (methods + blocks)  # real ones in each block
        headings = [axes.get_title().split("\n")[0] for axes in figure.axes if axes.get_title()]
        assert sorted(headings)[:methods] == METHODS[:methods]
        assert sum(words.startswith("real") for words in headings) == blocks


def test_a_name_with_dollars_is_no_formula_in_sheets(tmp_path):
    """The command ended with an error of matplotlib."""
    methods = ["fit,file=$_$x"]
    strips_figure([strip(CLOTHS[0], methods)], "title").savefig(tmp_path / "strips.png", dpi=20)
    radius_angle_figure(study(methods)).savefig(tmp_path / "lines.png", dpi=20)
    save_confusion(study(methods), tmp_path / "confusion.png")


def test_a_solver_that_lacks_a_cloth_leaves_its_place_empty(toy_dataset, toy_data, tmp_path):
    for cloth in CLOTHS:
        write_cell(tmp_path / "run", toy_dataset, "right", cloth, held_out_images(toy_dataset, cloth))
    write_cell(tmp_path / "run", toy_dataset, "late", CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0]))
    strips = draw("figure-6", tmp_path / "run", toy_data, tmp_path / "figure")["strips"]
    assert [set(strip["mse"]) for strip in strips] == [{"late", "right"}, {"right"}]
    assert draw("figure-8", tmp_path / "run", toy_data, tmp_path / "figure")["draws"]["late"]["accuracy"] == 1


# -- what cannot be drawn


def test_other_data_than_the_run_are_refused(run, tmp_path):
    other = write_toy(tmp_path / "other", fabrics=(1, 4), samples=4, captures=1, meshes=False)
    outcome = CliRunner().invoke(app, ["figure-6", str(run), "--data", str(other), "--out", str(tmp_path / "figure")])
    assert outcome.exit_code == 2
    assert "must be those of the run" in " ".join(outcome.output.split())
    assert not (tmp_path / "figure").exists()


def test_a_folder_that_cannot_be_made_is_told_before_anything_is_drawn(run, toy_data, tmp_path, monkeypatch):
    def drawn(*_: object, **__: object) -> None:
        raise AssertionError("drawn for nothing")

    for place in ("side_by_side.fitted", "side_by_side.held_out", "radius_angle.radius_angle"):
        monkeypatch.setattr(f"cusick_bench.report.figures.{place}", drawn)
    (tmp_path / "file").write_text("")
    for command in ("figure-6", "figure-7", "figure-8"):
        words = [command, str(run), "--data", str(toy_data), "--out", str(tmp_path / "file")]
        outcome = CliRunner().invoke(app, words)
        assert outcome.exit_code == 2, outcome.output
        assert "File exists" in outcome.output


def test_a_name_without_options_stands_for_all_that_it_has(toy_dataset, tmp_path):
    for name in ("draws,count=2", "draws,count=3", "drawn"):
        write_cell(tmp_path, toy_dataset, name, CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0]))
    cells = load_cells(tmp_path)
    assert [one.label for one in entrants(cells, ["draws"])] == ["draws,count=2", "draws,count=3"]
    assert [one.label for one in entrants(cells, ["draws,count=3"])] == ["draws,count=3"]


def test_an_unknown_solver_is_named_with_those_there_are(run):
    with pytest.raises(ReportError, match=r"no heter in .*null:disc, right, swapped"):
        entrants(load_cells(run), ["heter"])


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"draws": np.zeros((0, 256, 256), dtype=np.uint8)}, "shapes"),
        ({"draws": np.zeros((2, 256, 256))}, "float64"),
        ({"vertices": np.full((3, 3), np.nan), "faces": np.array([[0, 1, 2]])}, "mesh is damaged"),
        ({"vertices": np.zeros((3, 3)), "faces": np.array([[0, 1, 3]])}, "mesh is damaged"),
        ({"draw_vertices": np.zeros((3, 3, 3)), "faces": np.array([[0, 1, 2]])}, "3 drapes stand behind 2 draws"),
    ],
)
def test_a_damaged_prediction_is_refused_with_its_path(toy_dataset, tmp_path, arrays, reason):
    folder = write_cell(
        tmp_path, toy_dataset, "bad", CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0])[:2], arrays=arrays
    )
    with pytest.raises(ReportError, match=reason) as caught:
        load_draws(folder)
    assert str(folder) in str(caught.value)


def test_a_missing_prediction_is_refused(toy_dataset, tmp_path):
    folder = write_cell(tmp_path, toy_dataset, "bad", CLOTHS[0], held_out_images(toy_dataset, CLOTHS[0]))
    (folder / "prediction.npz").write_bytes(b"PK")
    with pytest.raises(ReportError, match="run it again"):
        load_draws(folder)
    (folder / "prediction.npz").unlink()
    with pytest.raises(ReportError, match="run it again"):
        load_draws(folder)
