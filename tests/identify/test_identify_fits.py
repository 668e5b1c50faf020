"""Which drapes a stiffness is learned from."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify_command import SOLVER
from PIL import Image

from cusick_bench.datasets import load
from cusick_bench.datasets.stats import statistics
from cusick_bench.identify.document import Fit
from cusick_bench.identify.earlier_fits import keys_of_fits
from cusick_bench.identify.fits import plan_fits, typical_rows
from cusick_bench.identify.identify import begin
from cusick_bench.identify.options import Options
from cusick_bench.identify.words import left_out_notes
from cusick_bench.identify.workspace import Workspace
from cusick_bench.runner import Store


def test_a_weight_that_is_added_counts_in_the_same_process(lab, tmp_path):
    copy = shutil.copytree(lab, tmp_path / "lab")

    def planned() -> tuple[list[str], list[str]]:
        plan = plan_fits(begin(str(copy), tmp_path / "out", Options()).dataset, ["fabric_3"], Options())
        return list(plan.cells), list(plan.missing)

    assert planned() == ([], ["fabric_3"])
    with (copy / "fabrics.csv").open("a") as table:
        table.write("fabric_3,0.18,\n")
    assert planned() == (["fabric_3"], [])


def test_the_drape_with_the_median_coefficient_is_typical(lab):
    dataset = load(lab)
    row, *others = typical_rows(dataset, "fabric_1")
    coefficients = [statistics(dataset.select(cloth="fabric_1", sample=s))[0].drape_coefficient for s in (1, 2, 3)]
    assert coefficients.index(sorted(coefficients)[1]) == row
    assert sorted([row, *others]) == [0, 1, 2]


@pytest.mark.parametrize("spoilt", [1, 2, 3])
def test_a_picture_that_shows_no_cloth_on_its_plate_is_left_out_whichever_it_is(lab, tmp_path, spoilt):
    """Where it was the median there was no fit at all, and elsewhere it was left out without a word."""
    root = tmp_path / "lab"
    shutil.copytree(lab, root)
    picture = root / f"data/Fabric 1/silhouettes/Fabric_1_Sample_{spoilt}_Capture_1.jpg"
    profile = load(lab).sample(spoilt - 1).profile  # a hole in its highest fold: the plate stays covered
    angle, radius = profile.angles[profile.radii.argmax()], 723 * (profile.radii.max() + 0.09) / 2
    column, row = (int(127.5 + radius * np.cos(angle)), int(127.5 - radius * np.sin(angle)))
    pixels = np.array(Image.open(picture).convert("L"))
    pixels[row - 3 : row + 4, column - 3 : column + 4] = 255
    Image.fromarray(pixels).save(picture, quality=95)
    dataset, options = load(root), Options(solver=SOLVER)
    others = sorted({0, 1, 2} - {spoilt - 1})
    assert sorted(plan_fits(dataset, ["fabric_1"], options).cells["fabric_1"].train) == others
    forced = plan_fits(dataset, ["fabric_1"], replace(options, force=True))
    assert sorted(forced.cells["fabric_1"].train) == [0, 1, 2]
    planned = (forced, plan_fits(dataset, ["fabric_1"], options))
    assert [plan.cells["fabric_1"].protocol for plan in planned] == ["typical-forced", "typical"], (
        "no cells of one split"
    )
    (note,) = left_out_notes(dataset, "fabric_1")
    assert "1 picture shows no cloth on its plate, and no stiffness is learned from it" in note
    assert f"Fabric_1_Sample_{spoilt}_Capture_1.jpg: a hole of" in note
    assert left_out_notes(load(lab), "fabric_1") == []


@pytest.mark.parametrize(("solver", "samples"), [("bdp-field", 3), ("bdp-field,samples=2", 2), ("homo", 1)])
def test_solvers_that_can_learn_from_all_samples(lab, solver, samples):
    dataset = load(lab)
    cell = plan_fits(dataset, ["fabric_1"], Options(solver=solver)).cells["fabric_1"]
    assert len(cell.train) == samples
    assert cell.train[0] == typical_rows(dataset, "fabric_1")[0]


@pytest.mark.usefixtures("one_thread")
def test_a_fit_is_kept_where_only_other_fabrics_have_changed(lab, tmp_path):
    copy = shutil.copytree(lab, tmp_path / "lab")
    weights = copy / "fabrics.csv"
    options = Options(solver="sobol", vertices=97, steps=10, budget=3)

    def fitted() -> dict[str, Fit]:
        return begin(str(copy), tmp_path / "out", options).fit()[0]

    def finished() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in tmp_path.glob("out/run/cells/*/done")}

    first, cells = fitted(), finished()
    assert (list(first), len(cells)) == (["fabric_1", "fabric_2"], 2)
    shutil.rmtree(copy / "data/Fabric 1")  # rows of the index move up
    weights.write_text(weights.read_text() + "fabric_3,0.18,\n")
    second = fitted()
    assert list(second) == ["fabric_2", "fabric_3"]
    assert second["fabric_2"] == first["fabric_2"]
    assert {path: finished()[path] for path in cells} == cells
    assert len(finished()) == 3, "of fabric 3 only"
    weights.write_text(weights.read_text().replace("fabric_2,0.2,", "fabric_2,0.3,"))
    third = fitted()
    assert third["fabric_3"] == second["fabric_3"]
    assert third["fabric_2"].path != second["fabric_2"].path
    assert third["fabric_2"].stiffness["warp"].value > second["fabric_2"].stiffness["warp"].value
    (tmp_path / "out/fits.json").write_text("no JSON")
    assert fitted()["fabric_3"].stiffness == third["fabric_3"].stiffness, "made again"


def test_a_fit_is_kept_where_the_folder_of_the_data_is_renamed(lab, tmp_path, monkeypatch):
    workspace, options, keys = Workspace(tmp_path), Options(solver="sobol", vertices=97, steps=10, budget=3), []
    for name in ("my lab", "mein Labor, Süd"):
        dataset = load(shutil.copytree(lab, tmp_path / name))
        keys.append(keys_of_fits(dataset, plan_fits(dataset, ["fabric_1"], options).cells, workspace))
        monkeypatch.setattr(Store, "is_done", lambda store, key: key in keys[0].values())
    assert keys[0] == keys[1]
