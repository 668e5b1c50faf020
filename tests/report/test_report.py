"""The report: valid, self-contained, holding the numbers and pictures, and robust against damaged cells."""

import base64
import io
import json
import re
from itertools import product
from math import nan
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from html_page import Page
from PIL import Image
from shown_cells import radii, write_cell
from typer.testing import CliRunner

from cusick_bench.cli.results.report import report
from cusick_bench.leaderboard import Cells, leaderboards, load_cells
from cusick_bench.leaderboard.bootstrap import Estimate
from cusick_bench.leaderboard.two_runs import Change, MethodChange, TwoRuns
from cusick_bench.metrics.found_stiffness import FoundStiffness, Quantity
from cusick_bench.metrics.stiffness import BENDING, STRETCH
from cusick_bench.report import ReportError, write_report
from cusick_bench.report.cell_view import load_cell_view
from cusick_bench.report.drawing.change_graph import change_graph
from cusick_bench.report.drawing.palette import DASHES, SERIES
from cusick_bench.report.run.comparison import comparison_section
from cusick_bench.report.run.content import Card, ClothSection, numbers
from cusick_bench.report.run.method_curves import method_curves
from cusick_bench.report.run.page import _in_order, _linked
from cusick_bench.solvers.reference.silhouettes import silhouette


@pytest.fixture(autouse=True)
def _coarse_scenes(monkeypatch):
    """Most tests do not look at the drape closely."""
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 300)


def make(folder: Path, **options) -> Page:
    cells = load_cells(folder)
    write_report(cells, leaderboards(cells), folder / "report.html", **options)
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Page:
    folder = tmp_path_factory.mktemp("runs")
    write_cell(folder, "homo")
    write_cell(folder, "homo", seed=1)
    write_cell(folder, "null:random-phase", draws=8)
    write_cell(folder, "homo", "viscose_white")
    (folder / "run.json").write_text(json.dumps({"command": ["cusick-bench", "run", "--data", "lab"], "cores": 2}))
    unseen = {("abc", "cotton_blue", (0, 1)): np.stack([radii(6), radii(9)])}
    return make(folder, unseen=unseen, pictures=folder / "pictures")


def test_page_holds_the_numbers(page):
    for expected in (".0123", ".0568", "31.6 mm", "63.1 %", "real 64.2", "240 drapes", "seed 0 shown, of 2", "real 8"):
        assert expected in page.text, expected
    assert "cusick-bench run --data lab" in page.text


def test_a_fit_is_shown_beside_the_unseen_samples_of_its_own_split(tmp_path):
    """Of two splits of one cloth and seed, as where samples are left out in turn, the first."""
    for number, rows in enumerate(([0, 1, 2], [3, 4])):
        cell = write_cell(tmp_path, "homo", seed=number)
        for name in ("cell.json", "result.json"):
            record = json.loads((cell / name).read_text()) | {"seed": 0, "test": rows}
            (cell / name).write_text(json.dumps(record))
    by_rows = {(0, 1, 2): np.stack([radii(6)] * 3), (3, 4): np.stack([radii(6)] * 2)}
    unseen = {("abc", "cotton_blue", rows): radii_of for rows, radii_of in by_rows.items()}
    unseen |= {("def", "cotton_blue", (0, 1, 2)): np.stack([radii(6)] * 7)}  # of other data with such a cloth
    text = make(tmp_path, unseen=unseen).text
    assert "range of 3 unseen silhouettes" in text  # of several captures each, they are more than the samples
    assert "seed 0 and one of 2 splits shown, of 2 cells" in text


def test_one_unseen_silhouette_is_no_range(tmp_path):
    write_cell(tmp_path, "homo")
    assert "unseen silhouettes" not in make(tmp_path, unseen={("abc", "cotton_blue", (0, 1)): radii(6)[None]}).text


def test_a_name_with_dollars_is_no_formula_in_pictures(tmp_path):
    write_cell(tmp_path, "homo", "$_$silk")
    make(tmp_path, pictures=tmp_path / "pictures")
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["silk_homo.png"]


def test_cloths_whose_names_files_cannot_tell_apart_have_a_picture_each(tmp_path):
    for cloth in ("silk 1", "silk:1"):
        write_cell(tmp_path, "homo", cloth)
    make(tmp_path, pictures=tmp_path / "pictures")
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == ["silk_1_homo.png", "silk_1_homo_2.png"]


def test_page_is_self_contained_and_runs_its_own_scripts_only(page):
    assert page.asks_for() == []
    assert page.policy().startswith("default-src 'none'")
    assert "http" not in "".join(page.scripts)
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|import|eval|innerHTML)\b", "".join(page.scripts))


@pytest.mark.parametrize(
    "alien",
    [
        '<script src="x.js"></script>',
        "<p onclick='f()'></p>",
        '<img src="https://host/a.png">',
        '<a href="https://host"></a>',
        "<style>p { background: url(a.png) }</style>",
        '<p style="background: url(a.png)"></p>',
        "<style>@import 'a.css'</style>",
    ],
)
def test_what_is_not_self_contained_is_noticed(alien):
    assert Page(f"<body>{alien}</body>").asks_for()
    assert Page('<body><img src="data:image/png;base64,AA"><a href="#top"></a></body>').asks_for() == []


def test_every_picture_is_a_png_with_words_for_those_who_cannot_see_it(page):
    pictures = page.all("img")
    # Two cloths with a real drape each, three cards with four pictures each, one sheet of draws.
    assert len(pictures) == 2 + 3 * 4 + 1
    for picture in pictures:
        assert len(picture["alt"] or "") > 10
        image = Image.open(io.BytesIO(base64.b64decode((picture["src"] or "").split(",", 1)[1])))
        assert image.format == "PNG"
        assert image.getextrema()[3][1] > 0
    graphs = page.all("svg")
    assert len(graphs) == 3 + 2 + 1  # radius over angle, loss over cost, anytime curves
    assert any("7 folds" in (graph["aria-label"] or "") for graph in graphs)


def test_only_a_simulation_is_called_simulated(tmp_path, monkeypatch):
    """In the key of the differences: a null simulates nothing."""
    write_cell(tmp_path, "homo")
    write_cell(tmp_path, "null:disc")
    titles = []

    def saved(figure, path):
        titles.append((Path(path).stem, figure.axes[2].get_title()))

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", saved)
    words = make(tmp_path, pictures=tmp_path / "pictures").text
    assert dict(titles) == {
        "cotton_blue_homo": "blue: only simulated, orange: only real",
        "cotton_blue_null_disc": "blue: only predicted, orange: only real",
    }
    assert words.count("only simulated") == words.count("only predicted") == 1


def test_performance_profiles_say_how_many_problems_count(tmp_path):
    for solver, cloth in product(("homo", "sobol"), ("cotton_blue", "viscose_white")):
        write_cell(tmp_path, solver, cloth)
    write_cell(tmp_path, "homo", seed=1)  # the other solver was not run on it
    cells = load_cells(tmp_path)
    curves = method_curves(cells, leaderboards(cells)[0])
    assert curves is not None
    assert [figure.caption.rpartition("; ")[2] for figure in curves.profiles] == ["problems that count: 2"] * 2


def test_profiles_are_of_errors_or_costs_that_have_a_ratio(tmp_path):
    """Beside a method with an energy distance below 0 all others were said never to come near; seconds are no error."""
    for solver, distance in (("homo", -0.001), ("sobol", 0.0005)):
        path = write_cell(tmp_path, solver) / "result.json"
        result = json.loads(path.read_text())
        result["metrics"]["test_energy_distance"] = distance
        path.write_text(json.dumps(result))
    cells = load_cells(tmp_path)
    captions = {}
    for by in ("test_mse", "test_energy_distance", "spent_wall_seconds"):
        curves = method_curves(cells, leaderboards(cells, by=by)[0])
        assert curves is not None
        captions[by] = [figure.caption.partition(";")[0] for figure in curves.profiles]
    coming_near = "Cost of coming within 10% of the lowest training loss of any method"
    assert captions == {
        "test_mse": ["Error that is left (test_mse)", coming_near],
        "test_energy_distance": [coming_near],
        "spent_wall_seconds": ["Cost (spent_wall_seconds)", coming_near],
    }


def test_a_mark_tells_methods_apart_once_colours_and_dashes_are_used_up(tmp_path, monkeypatch):
    monkeypatch.setattr("cusick_bench.report.drawing.method_graphs.SERIES", SERIES[:1])
    monkeypatch.setattr("cusick_bench.report.drawing.method_graphs.DASHES", DASHES[:1])
    for solver in ("homo", "sobol"):
        write_cell(tmp_path, solver)
    page = make(tmp_path)
    assert page.text.count("○") == 2  # in the keys of curves and of profiles
    assert "shaded the range of the cells" in page.text


def test_ranges_are_told_only_where_there_are_few_enough_to_be_drawn(tmp_path):
    for number in range(5):
        write_cell(tmp_path, f"solver-{number}")
    cells = load_cells(tmp_path)
    curves = method_curves(cells, leaderboards(cells)[0])
    assert curves is not None
    assert not curves.has_ranges


def test_solvers_stand_before_rows_without_physics_however_they_are_ranked(tmp_path):
    for solver, error in (("homo", 0.05), ("sobol", 0.03), ("null:disc", 0.01)):
        path = write_cell(tmp_path, solver) / "result.json"
        result = json.loads(path.read_text())
        result["metrics"]["test_mse"] = error
        path.write_text(json.dumps(result))
    cells = load_cells(tmp_path)
    boards = leaderboards(cells)
    assert [row.label for row in boards[0].rows] == ["null:disc", "sobol", "homo"]
    assert [label for label, _ in _in_order(cells.table, boards)] == ["sobol", "homo", "null:disc"]


def test_of_many_draws_the_first_are_shown(tmp_path):
    cell = write_cell(tmp_path, "bdp", draws=8)
    with np.load(cell / "prediction.npz") as archive:
        arrays = dict(archive)
    arrays["draws"] = np.arange(8, dtype=np.uint8)[:, None, None] * np.ones_like(arrays["draws"])
    np.savez_compressed(cell / "prediction.npz", **arrays)
    assert (255 * load_cell_view(cell).draws.max((1, 2))).round().tolist() == [0, 1, 2, 3, 4, 5]


def test_rows_of_one_solver_are_counted_as_methods(tmp_path):
    """The leaderboard below had two."""
    for seed, vertices in enumerate((700, 2699)):
        cell = write_cell(tmp_path, "homo", seed=seed)
        for name in ("cell.json", "result.json"):
            of_mesh = {"seed": 0, "vertices": vertices}
            (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | of_mesh))
    assert "2 methods on 1 cloth, 2 finished cells" in make(tmp_path).text


def test_rows_of_several_leaderboards_are_one_method_where_they_have_one_name(tmp_path):
    """Of two data sets with a mesh each, `homo` alone was two methods, and one on either leaderboard."""
    for seed, own in enumerate(({"vertices": 700}, {"vertices": 2699, "dataset": "other", "dataset_hash": "def"})):
        cell = write_cell(tmp_path, "homo", seed=seed)
        for name in ("cell.json", "result.json"):
            (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | {"seed": 0} | own))
    assert "1 method on 1 cloth, 2 finished cells" in make(tmp_path).text


def test_what_is_shown_of_several_splits_is_told_apart(tmp_path):
    """Fits of the second split have another training sample, whose surface was not on the page."""
    for solver, seed in product(("homo", "sobol"), (0, 1)):
        cell = write_cell(tmp_path, solver, seed=seed)
        split = {"seed": 0, "protocol": ("paper", "first-8")[seed]}
        for name in ("cell.json", "result.json"):
            (cell / name).write_text(json.dumps(json.loads((cell / name).read_text()) | split))
        with np.load(cell / "prediction.npz") as archive:
            arrays = dict(archive) | {"train_target": silhouette(radii(7 + seed)).astype(np.float32)}
        np.savez_compressed(cell / "prediction.npz", **arrays)
    page = make(tmp_path)
    (document,) = [json.loads(text) for text in page.scripts if text.startswith("{")]
    reals = [one["method"] for one in document["drapes"] if not one["anchor"]]
    assert reals == ["real silhouette of homo, split first-8", "real silhouette of homo, split paper"]
    assert "Some of the fits below are to other samples" in page.text
    for split in ("paper", "first-8"):
        assert f"lab, split {split}, 1 cloth, mean over cells" in page.text
    links = [(link["href"] or "").lstrip("#") for link in page.all("a")]
    cards = [attributes["id"] for name, attributes in page.tags if name == "article"]
    assert len(cards) == 4
    assert all(links.count(card) == 1 for card in cards), "from its row of its own leaderboard"
    assert page.text.count("lab (sha256 abc)") == 1
    for title in ("Anytime curves", "Performance profiles"):
        assert f"{title} (split paper)" in page.text
        assert f"{title} (split first-8)" in page.text


@pytest.mark.parametrize(
    ("ratio", "shown"),
    [
        (Estimate(0.5, 0.4, 0.6), "× 0.50 [0.40, 0.60]"),
        (Estimate(0.003, 0.002, 0.004), "× 0.003 [0.002, 0.004]"),
        (Estimate(1.002, 1.001, 1.003), "× 1.002 [1.001, 1.003]"),
        (Estimate(0.998, 0.997, 0.9996), "× 0.9980 [0.9970, 0.9996]"),
        (Estimate(1.002, 0.999, 1.003), "× 1.00 [1.00, 1.00]"),
        (Estimate(0.0, 0.0, 0.0), "× 0.00 [0.00, 0.00]"),
        (Estimate(1e-9, nan, nan), "× 0.000000"),
    ],
)
def test_a_change_is_not_rounded_to_none(ratio, shown, monkeypatch):
    change = Change(1.0, ratio.value, ratio)
    both = TwoRuns([MethodChange("homo", "solver", 1, {"train_mse": change})], [], [], [])
    monkeypatch.setattr("cusick_bench.report.run.comparison.compare_runs", lambda *_, **__: both)
    cells = Cells(Path("run"), {}, pd.DataFrame(), ())
    ((entry,),) = (row.changes for row in comparison_section(cells, cells).rows)
    assert entry.text == shown


def test_every_number_of_a_fit_stands_under_its_own_name():
    metrics = {"train_mse": 0.0111, "test_mse": 0.0222, "test_mse_best": 0.0333, "floor_mse": 0.0044, "draws": 8}
    metrics |= {"train_hausdorff_m": 0.0055, "test_hausdorff_m": 0.0066, "train_dc": 0.631, "train_dc_target": 0.642}
    metrics |= {"train_folds": 7.0, "train_folds_target": 9.0}
    spent = {"spent_forward_equivalents": 240.0, "spent_wall_seconds": 61.0}
    assert [(one.name, one.value, one.of) for one in numbers(pd.Series(metrics | spent))] == [
        ("MSE, training sample", ".0111", "floor .0044"),
        ("MSE, unseen samples", ".0222", "best of 8: .0333"),
        ("Hausdorff, training", "5.5 mm", ""),
        ("Hausdorff, unseen", "6.6 mm", ""),
        ("drape coefficient", "63.1 %", "real 64.2"),
        ("folds", "7", "real 9"),
        ("cost", "240 drapes", ""),
        ("time", "61 s", ""),
    ]


def test_the_other_run_is_before_and_this_one_after(monkeypatch):
    change = Change(0.04, 0.02, Estimate(0.5, 0.4, 0.6))
    both = TwoRuns([MethodChange("homo", "solver", 1, {"test_mse": change})], [], [], [])
    monkeypatch.setattr("cusick_bench.report.run.comparison.compare_runs", lambda *_, **__: both)
    cells = Cells(Path("run"), {}, pd.DataFrame(), ())
    section = comparison_section(cells, cells)
    assert [(row.before, row.after) for row in section.rows] == [(".0400", ".0200")]
    assert section.graph is not None
    assert "homo from 0.0400 to 0.0200" in section.graph
    filled = [line for line in change_graph(both.methods, "test_mse").axes[0].lines if line.get_marker() == "o"]
    assert [np.asarray(line.get_xdata()).tolist() for line in filled] == [[0.04], [0.02]]  # hollow, then full
    assert [line.get_markerfacecolor() == "none" for line in filled] == [True, False]


def test_links_lead_to_sections(page):
    anchors = {attributes.get("id") for _, attributes in page.tags}
    assert {(link["href"] or "").lstrip("#") for link in page.all("a")} <= anchors


def test_page_is_small(tmp_path):
    write_cell(tmp_path, "homo")
    make(tmp_path)
    assert (tmp_path / "report.html").stat().st_size < 5e6 / 15


def test_names_are_escaped(tmp_path):
    write_cell(tmp_path, "<script>alert(1)</script>".replace("/", ""), "<img>")
    page = make(tmp_path)
    assert page.asks_for() == []
    assert not any("alert" in text for text in page.unknown_scripts())
    assert "<img>" in page.text


def test_a_damaged_prediction_gets_its_card_without_pictures(tmp_path):
    write_cell(tmp_path, "homo")
    (write_cell(tmp_path, "heter") / "prediction.npz").write_bytes(b"not a zip")
    (write_cell(tmp_path, "bdp") / "prediction.npz").unlink()
    with np.load(write_cell(tmp_path, "hesbo") / "prediction.npz") as archive:
        arrays = dict(archive) | {"vertices": np.array([{"pickled": 1}], dtype=object)}
    np.savez(tmp_path / "cells" / "hesbo-cotton_blue-0" / "prediction.npz", **arrays)
    page = make(tmp_path)
    assert sum("cannot read" in words for words in page.words) == 3
    assert len(page.all("img")) == 1 + 4


def test_pictures_are_written_as_files(tmp_path):
    write_cell(tmp_path, "homo")
    make(tmp_path, pictures=tmp_path / "pictures")
    (file,) = (tmp_path / "pictures").iterdir()
    assert file.name == "cotton_blue_homo.png"
    width, height = Image.open(file).size
    assert width > 3 * height


def test_command_writes_the_page_and_says_where(tmp_path):
    app = typer.Typer()
    app.command()(report)
    write_cell(tmp_path, "homo")
    outcome = CliRunner().invoke(app, [str(tmp_path), "--json"])
    assert outcome.exit_code == 0, outcome.output
    assert json.loads(outcome.stdout)["report"] == str(tmp_path / "report.html")
    assert "no band" in outcome.stderr
    assert CliRunner().invoke(app, [str(tmp_path), "--out", str(tmp_path / "page.pdf")]).exit_code == 2
    assert CliRunner().invoke(app, [str(tmp_path / "nothing")]).exit_code == 2


@pytest.mark.parametrize("option", ["--out", "--pictures"])
def test_a_place_that_is_none_is_told_before_anything_is_drawn(option, tmp_path, monkeypatch):
    write_cell(tmp_path, "homo")
    (tmp_path / "file").touch()
    monkeypatch.setattr("cusick_bench.report.write_report", lambda *_, **__: pytest.fail("drawn"))
    app = typer.Typer()
    app.command()(report)
    result = CliRunner().invoke(app, [str(tmp_path), option, str(tmp_path / "file" / "page.html")])
    assert result.exit_code == 2, result.output
    assert "choose another folder" in " ".join(result.output.split())


def test_command_compares_with_another_run(tmp_path):
    app = typer.Typer()
    app.command()(report)
    here, other = tmp_path / "here", tmp_path / "other"
    for folder, solvers in ((here, ("homo", "sobol")), (other, ("homo", "heter"))):
        for solver in solvers:
            write_cell(folder, solver)
    result = json.loads((cell := next(other.glob("cells/homo*")) / "result.json").read_text())
    result["metrics"]["test_mse"] *= 2
    cell.write_text(json.dumps(result))
    outcome = CliRunner().invoke(app, [str(here), "--compare", str(other)])
    assert outcome.exit_code == 0, outcome.output
    page = Page((here / "report.html").read_text())
    assert "Change from the other run to this one" in page.text
    assert "× 0.50" in page.text
    assert "Only in this run: sobol" in page.text
    assert "Only in the other run: heter" in page.text
    assert page.asks_for() == []
    assert CliRunner().invoke(app, [str(here), "--compare", str(tmp_path / "nothing")]).exit_code == 2


@pytest.mark.parametrize("odd", ["[]", '{"fo', "[" * 100_000])
def test_a_trace_is_shown_up_to_what_cannot_be_read(tmp_path, odd):
    cell = write_cell(tmp_path, "homo")
    path = cell / "trace.jsonl"
    path.write_text(
        f'{{"forward_equivalents": 1, "best_loss": null}}\n{{"forward_equivalents": 2, "best_loss": 0.5}}\n{odd}\n'
    )
    np.testing.assert_array_equal(load_cell_view(cell).trace, [[2, 0.5]])
    path.unlink()
    assert load_cell_view(cell).trace.shape == (0, 2)


def test_a_prediction_without_mesh_is_shown_as_ruled_surface(tmp_path):
    view = load_cell_view(write_cell(tmp_path, "null:disc"))
    assert not view.simulated
    assert np.hypot(*view.vertices[:, :2].T).max() == pytest.approx(0.132, abs=1e-3)
    assert load_cell_view(write_cell(tmp_path, "homo")).simulated


def _with_stiffness(cell: Path, factor: float, draws: np.ndarray | None) -> None:
    """Adds what was found to a cell: `factor` times a truth of 2 uN m, with or without a posterior."""
    value = factor * 2e-6
    one = Quantity(value, None if draws is None else (value / 2, value * 2))
    found = FoundStiffness(
        dict.fromkeys(BENDING, one),
        dict.fromkeys(STRETCH, Quantity(100.0)),
        dict.fromkeys(BENDING, (value,) * 5),
        dict.fromkeys(BENDING, 0.0),
        dict.fromkeys(BENDING, 2e-6),
        dict.fromkeys(STRETCH, 100.0),
    )
    result = json.loads((cell / "result.json").read_text())
    (cell / "result.json").write_text(json.dumps(result | found.document()))
    if draws is not None:
        with np.load(cell / "prediction.npz") as archive:
            arrays = dict(archive)
        np.savez_compressed(cell / "prediction.npz", **arrays, bending_draws=draws)


@pytest.fixture(scope="module")
def stiffness_page(tmp_path_factory) -> Page:
    folder = tmp_path_factory.mktemp("stiffness")
    drawn = 3e-6 * np.exp(np.random.default_rng(0).normal(0, 0.4, (60, 3)))
    for cloth in ("cotton_blue", "viscose_white"):
        _with_stiffness(write_cell(folder, "bdp", cloth), 1.5, drawn)
    _with_stiffness(write_cell(folder, "homo"), 0.5, None)
    write_cell(folder, "null:disc")
    return make(folder)


def test_page_shows_the_stiffness_in_both_units_and_against_the_truth(stiffness_page):
    for expected in ("3.00 µN m", "0.0306 gf cm²/cm", "90 %: 1.50 to 6.00", "0.500 times the truth", "stiffness found"):
        assert expected in stiffness_page.text, expected
    graphs = [one["aria-label"] or "" for one in stiffness_page.all("svg")]
    (blue,) = [words for words in graphs if words.startswith("Bending stiffness of cotton_blue")]
    assert "homo warp 1.00" in blue
    assert "true warp 2.00" in blue
    assert "null" not in blue


def test_a_row_leads_to_its_fits_and_they_to_each_other(stiffness_page):
    anchors = {attributes.get("id") for _, attributes in stiffness_page.tags}
    links = [(link["href"] or "").lstrip("#") for link in stiffness_page.all("a")]
    assert set(links) <= anchors
    cards = [attributes["id"] for name, attributes in stiffness_page.tags if name == "article"]
    assert len(cards) == len(set(cards)) == 4
    assert set(cards) <= set(links)
    assert links.count("fit-1-0") == 2  # of bdp on the second cloth: from its row of stiffness, and its other card


def test_columns_have_a_legend(stiffness_page):
    for meaning in ("against the best of N draws", "half width of the posterior", "symmetric Hausdorff distance"):
        assert meaning in stiffness_page.text, meaning
    assert len(stiffness_page.all("details")) == 2


def test_damaged_draws_of_stiffness_are_told(tmp_path):
    cell = write_cell(tmp_path, "bdp")
    _with_stiffness(cell, 1.0, np.full((4, 3), -1.0))
    with pytest.raises(ReportError, match="bending stiffness"):
        load_cell_view(cell)


def test_a_card_of_many_cloths_leads_to_those_beside_it():
    """Links of all cards to all others were 70 MB of a page of 500 cloths."""
    cards = [Card("homo", "solver", "", [], anchor=f"fit-{number}") for number in range(60)]
    sections = [ClothSection(f"silk {number}", f"cloth-{number}", [card]) for number, card in enumerate(cards)]
    numbers = [[int(cloth[5:]) for cloth, _ in section.cards[0].others] for section in _linked(sections)]
    assert numbers[30] == [*range(18, 30), *range(31, 43)]
    assert (numbers[0], numbers[59]) == ([*range(1, 25)], [*range(35, 59)])
    few = [[int(cloth[5:]) for cloth, _ in section.cards[0].others] for section in _linked(sections[:25])]
    assert few == [[other for other in range(25) if other != number] for number in range(25)]
