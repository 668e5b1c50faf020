"""Skirts of all cloths of a run side by side: the command, its picture and its page."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from identified import made_up_fit
from PIL import Image
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.cli.simulate.garment import _cells_of
from cusick_bench.garment import GarmentError, WaistMotion, cloth_of_numbers
from cusick_bench.garment.measurement import measure
from cusick_bench.garment.page import write_page
from cusick_bench.garment.side_by_side import save_side_by_side
from cusick_bench.garment.skirt import SkirtSize, circular_skirt
from cusick_bench.garment.wearing import Wearing, Worn, wear
from cusick_bench.identify.document import Drapes, FabricIdentity, IdentifyDocument, Made
from cusick_bench.runner import Store

STILL = ["--vertices", "170", "--length", "0.3", "--draws", "2", "--hip", "0", "--static"]
SMALL = [*STILL[:-1], "--duration", "0.4"]
BENDING = {"limp": 3e-6, "stiff": 1e-3}


def _cell(run: Path, solver: str, cloth: str, bending: float | None, seed: int = 0, **unlike: object) -> None:
    folder = run / "cells" / f"{solver}-{cloth}-{seed}".replace(":", "_")
    folder.mkdir(parents=True)
    record = {"solver": solver, "kind": "solver", "cloth": cloth, "seed": seed, "dataset": "lab", "settings": {}}
    record |= {"dataset_hash": "abc", "protocol": "paper", "train": [0], "test": [1]} | unlike
    (folder / "cell.json").write_text(json.dumps(record))
    found = None if bending is None else {"value": bending, "ci90": None}
    stiffness = found and {"stiffness": dict.fromkeys(("warp", "weft", "bias"), found)}
    stretch = found and {"stretch": dict.fromkeys(("warp", "weft", "shear"), found)}
    result = (
        record
        | {"status": "done", "metrics": {"train_mse": 0.01, "test_mse": 0.05}, "spent": {}}
        | (stiffness or {})
        | (stretch or {})
    )
    (folder / "result.json").write_text(json.dumps(result))
    tables = {"stretch": np.tile([150.0, 1.0, 150.0, 30.0], (6, 1)), "bending": np.full((3, 5), bending or 1.0)}
    np.savez(folder / "prediction.npz", density=np.array(0.2), **({} if bending is None else tables))
    (folder / "done").touch()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    for cloth, bending in BENDING.items():
        _cell(tmp_path / "run", "homo", cloth, bending)
        _cell(tmp_path / "run", "null:disc", cloth, None)
    return tmp_path / "run"


def _identified(out: Path) -> None:
    """The document of an identification that states the fits by `homo`."""
    drapes, made = Drapes(samples=1, silhouettes=1, units=1), Made(command="", version="")
    paths = {cloth: f"run/cells/homo-{cloth}-0" for cloth in BENDING}
    fabrics = [FabricIdentity(fabric=cloth, drapes=drapes, fit=made_up_fit(path)) for cloth, path in paths.items()]
    document = IdentifyDocument(
        folder="lab", data="lab", dataset_hash="def", cloth_radius_m=0.15, plate_radius_m=0.09, fabrics=tuple(fabrics),
        made=made,
    )  # fmt: skip
    document.write(out / "identify.json")


def _drapes(page: Path) -> list[dict]:
    """What the viewer of a page can turn."""
    (document,) = (script for script in Page(page.read_text()).scripts if script.startswith("{"))
    return json.loads(document)["drapes"]


def _compare(*arguments: str):
    return CliRunner().invoke(app, ["garment", "compare", *arguments])


def test_the_same_skirt_of_every_cloth_is_compared(run: Path):
    result = _compare(str(run), *SMALL, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    limp, stiff = document["cloths"]
    assert [limp["cloth"], stiff["cloth"]] == ["limp", "stiff"]
    assert limp["hem_radius_m"] < 0.8 * stiff["hem_radius_m"]
    assert limp["draws"] == 2
    assert limp["hem_radius_m"] == pytest.approx(document["skirts"][0]["spread"]["mean"]["hem_radius_m"])
    assert document["skirts"][1]["motion"]["hem_trail_max_m"] > 0
    folder = run / "garments"
    assert json.loads((folder / "garments.json").read_text())["cloths"] == document["cloths"]
    with Image.open(folder / "side_by_side.png") as picture:
        pixels = np.asarray(picture.convert("L"), dtype=float)
    rows, columns = np.array_split(pixels, 4), np.array_split(pixels, 2, axis=1)
    assert all(part.min() < 200 for part in (*rows, *columns))  # at rest and in three moments, both cloths
    drapes = _drapes(folder / "garments.html")
    assert "Skirts in 3D" in Page((folder / "garments.html").read_text()).words
    assert [(one["cloth"], one["method"]) for one in drapes] == [
        (cloth, str(number)) for cloth in BENDING for number in range(2)
    ]


def test_the_page_of_skirts_speaks_of_skirts_and_of_pictures_that_are_there(run: Path):
    """Without scripts or WebGL a reader is sent to pictures."""
    assert _compare(str(run), *STILL).exit_code == 0
    folder = run / "garments"
    text = (folder / "garments.html").read_text()
    words = " ".join(" ".join(Page(text).words).split())
    assert "Drape" not in words
    assert "stand below" not in words
    assert 'data-before="Draw "' in text  # a screen reader says "Draw 0 on limp", not "0 on limp"
    assert "side_by_side.png beside this page has pictures" in words
    assert (folder / "side_by_side.png").exists()


def test_a_motion_is_not_asked_of_skirts_that_stand_still(run: Path):
    result = _compare(str(run), *STILL, "--motion", "turn")
    assert result.exit_code == 2
    assert "--motion is about a waist that moves" in " ".join(result.output.split())


def test_the_cloth_whose_skirt_flies_apart_is_named(run: Path):
    result = _compare(str(run), *SMALL, "--amplitude", "20")
    assert result.exit_code == 2
    assert "error: limp: a skirt flies apart at" in " ".join(result.output.split())


def test_a_run_of_several_solvers_needs_one_of_them(run: Path):
    _cell(run, "heter", "limp", 1e-5)
    result = _compare(str(run), *SMALL)
    assert result.exit_code == 2
    assert "choose one with --solver: heter, homo" in " ".join(result.output.split())
    both = _compare(str(run), *STILL, "--solver", "heter", "--solver", "homo", "--json")
    assert [row["cloth"] for row in json.loads(both.stdout)["cloths"]] == [
        "limp of heter",
        "limp of homo",
        "stiff of homo",
    ]
    result = _compare(str(run), *SMALL, "--solver", "bdp")
    assert "has no cloth of 'bdp'; use --solver with one of heter, homo" in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("unlike", "told"),
    [
        ({"settings": {"budget": {"seconds": 9}}}, "homo (budget.seconds=9)"),
        ({"dataset_hash": "def"}, "lab abc paper; lab def paper"),
    ],
)
def test_fits_with_other_settings_or_of_other_data_are_not_mixed(run: Path, unlike: dict, told: str):
    """Else the order of hashes would decide which fit of a cloth is shown beside which fit of another."""
    _cell(run, "homo", "limp", 1e-5, 1, **unlike)
    result = _compare(str(run), *STILL)
    assert result.exit_code == 2
    words = " ".join(result.output.split())
    assert "fits that cannot be compared" in words
    assert told in words


def test_the_run_of_an_identification_shows_the_fits_that_its_document_states(tmp_path: Path):
    """After a fabric was added or weighed again its folder holds fits of two states of the data: all were refused."""
    run = tmp_path / "run"
    _cell(run, "homo", "limp", 3e-6)
    _cell(run, "homo", "stiff", 1e-5, 1)  # with an earlier weight
    _cell(run, "homo", "stiff", 1e-3, dataset_hash="def", protocol="typical-forced")
    assert "fits that cannot be compared" in " ".join(_compare(str(run), *STILL).output.split())
    _identified(tmp_path)
    result = _compare(str(run), *STILL, "--json")
    assert result.exit_code == 0, result.output
    limp, stiff = json.loads(result.stdout)["cloths"]
    assert [limp["cloth"], stiff["cloth"]] == ["limp", "stiff"]
    assert limp["hem_radius_m"] < 0.8 * stiff["hem_radius_m"], "not the softer fit with the earlier weight"


def test_fits_of_an_earlier_solver_in_the_run_of_an_identification_can_be_asked_for(run: Path):
    """They were said not to be there."""
    for cloth in BENDING:
        _cell(run, "bdp", cloth, 1e-5)
    _identified(run.parent)
    assert set(_cells_of(run, [])) == set(BENDING), "without a name those that the document states"
    assert set(_cells_of(run, ["bdp"])) == set(BENDING)
    both = _cells_of(run, ["homo", "bdp"])
    assert list(both) == ["limp of bdp", "limp of homo", "stiff of bdp", "stiff of homo"]


def test_a_cell_that_was_edited_is_left_out_with_a_note(run: Path):
    Store(run).mark_done("homo-stiff-0")
    assert "Left out" not in _compare(str(run), *SMALL, "--solver", "bdp").stderr
    edited = run / "cells" / "homo-stiff-0" / "result.json"
    edited.write_text(edited.read_text() + " ")
    result = _compare(str(run), *SMALL, "--solver", "bdp")
    assert "Left out, damaged: homo on stiff, seed 0 (homo-stiff-0): result.json is not what" in result.stderr


def test_where_samples_are_left_out_in_turn_the_first_split_of_every_cloth_is_compared(tmp_path: Path):
    """Else the order of hashes would decide which split of a cloth is shown beside which split of another."""
    for cloth, hashes in {"blue": "ab", "red": "dc"}.items():
        for left_out, (name, bending) in enumerate(zip(hashes, (1e-5, 1e-3), strict=True)):
            _cell(tmp_path, "homo", cloth, bending, test=[left_out])
            (tmp_path / "cells" / f"homo-{cloth}-0").rename(tmp_path / "cells" / name)
    blue, red = json.loads(_compare(str(tmp_path), *STILL, "--json").stdout)["cloths"]
    assert red == blue | {"cloth": "red"}


def test_a_cloth_whose_fit_failed_or_has_not_finished_is_left_out_with_a_note(run: Path):
    for cloth, solver in (("torn", "homo"), ("half", "homo"), ("stiff", "heter"), ("torn", "null:disc")):
        _cell(run, solver, cloth, 1e-5)
        folder = run / "cells" / f"{solver}-{cloth}-0".replace(":", "_")
        (folder / "done").unlink()
        if cloth != "half":
            result = json.loads((folder / "result.json").read_text()) | {"status": "failed", "failure": "it tore"}
            (folder / "result.json").write_text(json.dumps(result))
    result = _compare(str(run), *STILL)
    assert result.exit_code == 0, result.output
    notes = [line.partition(" (")[0] for line in result.stderr.splitlines() if line.startswith("Left out")]
    assert notes == ["Left out, unfinished: homo on half, seed 0", "Left out, failed: homo on torn, seed 0"]


def test_an_interrupted_comparison_says_what_it_leaves_and_leaves_nothing_of_an_earlier_one(
    run: Path, monkeypatch: pytest.MonkeyPatch
):
    assert _compare(str(run), *STILL).exit_code == 0
    (run / "garments" / "notes.txt").write_text("mine")

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cusick_bench.garment.side_by_side.save_side_by_side", interrupted)
    result = _compare(str(run), *STILL, "--seed", "1")
    assert result.exit_code == 130
    assert f"interrupted: what was ready is in {run / 'garments'}" in result.stderr
    assert {path.name for path in (run / "garments").iterdir()} == {"garments.json", "notes.txt"}
    assert json.loads((run / "garments" / "garments.json").read_text())["seed"] == 1


def test_a_run_without_any_simulated_cloth_is_refused(tmp_path: Path):
    _cell(tmp_path, "null:disc", "limp", None)
    result = _compare(str(tmp_path), *SMALL)
    assert result.exit_code == 2
    assert "has found any stiffness" in " ".join(result.output.split())


def test_moments_are_a_quarter_a_half_and_three_quarters_through_the_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Not through what is simulated, which goes on until the cloth settles."""
    cloth, motion = cloth_of_numbers(density=0.2, bending=(1e-5, 1e-5, 1e-5)), WaistMotion(seconds=0.8)
    skirt, times = circular_skirt(SkirtSize(length=0.3), 150), 0.04 * np.arange(41)
    frames = skirt.start + times[:, None, None, None] * [0, 0, 1.0]
    still = Worn(cloth, Wearing(), skirt, frames[0], np.ones(1, bool), [measure(skirt, skirt.start)], times, frames)
    heights = []

    def drawn(skirt, positions, *_, **__):
        heights.append(positions[0, 2])
        return np.zeros((8, 8, 4), np.uint8)

    monkeypatch.setattr("cusick_bench.garment.side_by_side.draw_skirt", drawn)
    save_side_by_side([replace(still, wearing=Wearing(motion=motion))], tmp_path / "moving.png")
    assert heights == pytest.approx([0, 0.2, 0.4, 0.6])


def test_where_a_page_has_no_room_for_all_draws_it_shows_some_of_each_cloth(tmp_path: Path, monkeypatch):
    """The draws of the first cloth took all of it."""
    skirt, numbers = circular_skirt(SkirtSize(length=0.3), 150), np.zeros(0)
    positions, measures = np.stack([skirt.start] * 6), [measure(skirt, skirt.start)] * 6
    worn = [
        Worn(
            replace(cloth_of_numbers(density=0.2, bending=(1e-5, 1e-5, 1e-5)), name=name), Wearing(draws=6), skirt,
            positions, np.ones(6, bool), measures, numbers, np.zeros((0, *positions.shape)),
        )
        for name in ("linen", "silk")
    ]  # fmt: skip
    write_page(worn, tmp_path / "all.html")
    assert len(_drapes(tmp_path / "all.html")) == 12
    half = len(json.dumps(_drapes(tmp_path / "all.html"))) // 2
    monkeypatch.setattr("cusick_bench.report.run.drape_models.MOST_BYTES", half)
    write_page(worn, tmp_path / "half.html")
    shown = [drape["cloth"] for drape in _drapes(tmp_path / "half.html")]
    assert 4 <= len(shown) < 10
    assert abs(shown.count("linen") - shown.count("silk")) <= 1


def test_a_single_draw_at_rest_has_no_spread_and_no_motion(tmp_path: Path):
    cloth = cloth_of_numbers(density=0.2, bending=(1e-5, 1e-5, 1e-5))
    still = wear(cloth, Wearing(size=SkirtSize(length=0.3), vertices=170, draws=1))
    assert len(still.frames) == 0
    assert "motion" not in still.document()
    save_side_by_side([still], tmp_path / "still.png")
    moving = wear(cloth, Wearing(size=SkirtSize(length=0.3), vertices=170, draws=1, motion=WaistMotion(seconds=0.2)))
    save_side_by_side([moving], tmp_path / "moving.png")
    with Image.open(tmp_path / "still.png") as still_picture, Image.open(tmp_path / "moving.png") as moving_picture:
        assert still_picture.height < 0.5 * moving_picture.height
    write_page([still], tmp_path / "page.html")
    assert "nan" not in (tmp_path / "page.html").read_text().split("<script")[0]
    assert _drapes(tmp_path / "page.html")[0]["colourings"] == {}
    with pytest.raises(GarmentError, match="no cloth to show"):
        save_side_by_side([], tmp_path / "none.png")
