"""Which drapes a stiffness is learned from."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified import made_up_fit
from identify_command import SOLVER
from PIL import Image

from cusick_bench.datasets import load
from cusick_bench.datasets.stats import statistics
from cusick_bench.diagnosis.options import Options as DiagnosisOptions
from cusick_bench.identify.diagnoses import diagnose_fabrics
from cusick_bench.identify.document import Fit
from cusick_bench.identify.earlier_fits import keys_of_fits
from cusick_bench.identify.fits import plan_fits, run_fits, typical_rows
from cusick_bench.identify.identify import begin
from cusick_bench.identify.options import Options
from cusick_bench.identify.words import fit_notes, left_out_notes
from cusick_bench.identify.workspace import Workspace
from cusick_bench.metrics.stiffness import BENDING
from cusick_bench.problem import Budget
from cusick_bench.runner import Source, Store
from cusick_bench.sim.constants import DEFAULT_LAW
from cusick_bench.sim.engine.settings import DrapeSettings

FOUND = ("stiffness", "stretch")


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


def test_fits_and_diagnoses_are_as_the_options_say(lab, atlas, tmp_path, monkeypatch):
    options = Options(solver="sobol", vertices=97, steps=10, budget=3, samples=5, seed=7)
    (cell,) = plan_fits(load(lab), ["fabric_2"], options).cells.values()
    settings = cell.settings
    assert (cell.solver, cell.seed, settings.vertices, settings.budget) == ("sobol", 7, 97, Budget(3))
    assert settings.drape == DrapeSettings(law=DEFAULT_LAW, steps=10)
    asked = []

    def stopped(captures, emulator, calibration, options, progress):
        asked.append(options)
        raise KeyboardInterrupt

    monkeypatch.setattr("cusick_bench.identify.diagnoses.data_set_diagnosis", stopped)
    with pytest.raises(KeyboardInterrupt):
        diagnose_fabrics(str(lab), load(lab), ["fabric_1"], Workspace(tmp_path), options, atlas=atlas)
    assert asked == [DiagnosisOptions(samples=5, seed=7)]


def test_a_fit_states_the_numbers_of_its_result(lab, tmp_path, monkeypatch):
    known, options, workspace = made_up_fit(), Options(solver="sobol", vertices=97), Workspace(tmp_path)
    metrics = {"train_dc_target": 0.631, "train_dc": 0.642, "train_mse": 0.012, "test_mse": 0.5, "test_dc_error": 0.1}
    result = {"status": "done", "metrics": metrics, "spent": {"forward_equivalents": 400, "wall_seconds": 7}}
    result |= {name: {key: one.model_dump(mode="json") for key, one in getattr(known, name).items()} for name in FOUND}
    result |= {"stiffness_curve": dict.fromkeys(BENDING, [1e-5] * 5), "stiffness_spread": dict.fromkeys(BENDING, 0.0)}
    monkeypatch.setattr("cusick_bench.identify.fits.run", lambda *_, **__: [])
    monkeypatch.setattr(Store, "result", lambda store, key: result)
    dataset = load(lab)
    fits, missing = run_fits(Source(str(lab)), dataset, plan_fits(dataset, ["fabric_2"], options), workspace, options)
    assert not missing
    for name in (*FOUND, "drape_coefficient", "simulated_drape_coefficient", "mse", "drapes"):
        assert getattr(fits["fabric_2"], name) == getattr(known, name), name
    assert fits["fabric_2"].image.endswith("Fabric_2_Sample_1_Capture_1.jpg")


@pytest.mark.parametrize(("simulated", "told"), [(0.9, True), (0.52, False), (0.1, True)])
def test_a_rough_fit_is_told_with_both_drape_coefficients(simulated, told):
    fit = made_up_fit().model_copy(update={"drape_coefficient": 0.5, "simulated_drape_coefficient": simulated})
    words = f"The fitted drape covers {100 * simulated:.0f} % of the overhang, the measured one 50 %: the fit is rough."
    notes = " ".join(fit_notes(fit, 3, 600))
    assert (words in notes) == ("rough" in notes) == told


@pytest.mark.parametrize(
    ("solver", "drapes", "says"),
    [
        ("bdp-field,draws=8", 399, "may fit the drape shown more closely; the interval stays."),
        ("bdp-field,draws=8", 312, "312 drapes; a larger --budget may sharpen interval and fit."),
        ("bdp-field,draws=8,rounds=0", 121, "may fit the drape shown more closely; the interval stays."),
        ("bdp", 399, "399 drapes; a larger --budget may sharpen interval and fit."),
    ],
)
def test_a_larger_budget_is_advised_for_what_it_may_change(solver, drapes, says):
    """By default each page advised it for the interval, which had been found long before the budget was used up."""
    fit = made_up_fit().model_copy(update={"solver": solver, "drapes": float(drapes), "finished": False})
    assert says in " ".join(fit_notes(fit, 3, 600))
    assert "--budget" not in " ".join(fit_notes(fit.model_copy(update={"finished": True}), 3, 600))
