"""`cusick-bench identify`: from silhouettes or photographs to one page, every part kept."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from PIL import Image
from toy_atlas import toy_emulator
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.stats import statistics
from cusick_bench.diagnosis.atlas.store import Calibration, save
from cusick_bench.identify import data as data_of_folder
from cusick_bench.identify.data import as_data_set, holds_photographs
from cusick_bench.identify.diagnoses import diagnose_fabrics
from cusick_bench.identify.document import Drapes, IdentifyDocument
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.identify.fits import plan_fits, typical_rows
from cusick_bench.identify.identify import begin
from cusick_bench.identify.options import Options
from cusick_bench.identify.words import fabric_next, fit_notes, laboratory_next, left_out_notes
from cusick_bench.identify.workspace import Workspace, digests
from cusick_bench.photographs.preparation.setting_text import SettingText
from cusick_bench.photographs.studio.folder import write_photographs
from cusick_bench.photographs.studio.scene import make_laboratory

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

SOLVER = "bdp-field,draws=2,first=4,rounds=1,cloths=2,refinement=0"
CHEAP = ["--vertices", "97", "--steps", "10", "--budget", "30", "--samples", "0", "--solver", SOLVER]


@pytest.fixture(scope="module")
def atlas(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("atlas") / "atlas.npz"
    save(path, toy_emulator(), Calibration())
    return path


@pytest.fixture(scope="module")
def lab(make_lab) -> Path:
    """Fabric 1 has three samples, fabric 2 has one, fabric 3 was not weighed."""
    root = make_lab([1e-5, 3e-5, 1e-5], samples=3, weighed=2)
    for sample in (2, 3):
        (root / f"data/Fabric 2/silhouettes/Fabric_2_Sample_{sample}_Capture_1.jpg").unlink()
    return root


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_photographs(make_laboratory(8), folder, 1)  # calibrated by its bare plate: the fewest pictures
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("identify") / "out"


def identify(*words: object):
    return CliRunner().invoke(app, ["identify", *map(str, words)])


def said(result) -> str:
    return " ".join(re.sub(r"\x1b\[[0-9;]*m", "", result.output).split())


@pytest.fixture(scope="module")
def answer(lab, out, atlas) -> IdentifyDocument:
    result = identify(lab, "--out", out, "--atlas", atlas, *CHEAP, "--json")
    assert result.exit_code == 0, result.output
    printed = json.loads(result.stdout)
    document = IdentifyDocument.read(out / "identify.json")
    assert printed == document.content() | {"path": str(out / "identify.json"), "page": str(out / "identify.html")}
    return document


def test_drape_coefficient_and_folds_are_those_of_stats(answer, lab):
    for one, known in zip(answer.fabrics, statistics(load(lab)), strict=True):
        assert one.fabric == known.cloth
        assert one.drapes.drape_coefficient is not None
        assert one.drapes.folds is not None
        assert one.drapes.drape_coefficient.value == known.drape_coefficient
        assert one.drapes.folds.value == known.folds
        assert (one.drapes.drape_coefficient.sd is None) == (known.samples == 1)


def test_a_weighed_fabric_has_stiffness_with_an_interval_whatever_its_samples(answer):
    for fabric in answer.fabrics[:2]:
        assert fabric.fit is not None
        assert set(fabric.fit.stiffness) == {"warp", "weft", "bias"}
        for one in fabric.fit.stiffness.values():
            assert one.ci90 is not None
            assert one.ci90[0] < one.value < one.ci90[1]
        assert fabric.fit.drapes <= 30
        assert fabric.fit_missing == ""


def test_what_is_missing_is_said_with_the_remedy(answer):
    single, unweighed = answer.fabrics[1:]
    assert "one sample" in single.diagnosis_missing
    assert any(step.startswith("Cut 2 more samples") for step in single.next)
    assert unweighed.fit is None
    assert "weight is not known" in unweighed.fit_missing
    assert any("fabric_3,0.18" in step for step in unweighed.next)


@pytest.mark.parametrize(
    ("missing", "advice"),
    [
        (
            "the fit failed: the cloth flies apart: net force 3.2 of the weight",
            "Repeat the command with another",
        ),
        (
            "null:disc has no physics and finds no stiffness; see `cusick-bench solvers`",
            "Repeat the command with a s",
        ),
        ("Fabric 2/1-1.png: the cloth is smaller than the plate", "Mend what the reason above names"),
    ],
)
def test_advice_fits_the_reason(lab, missing, advice):
    drapes = Drapes(samples=12, silhouettes=48, units=24)
    first = fabric_next(load(lab), "fabric_2", drapes, missing, None, 0)[0]
    assert first.startswith(advice)


def test_another_seed_fits_all_fabrics_again_as_the_advice_on_a_failed_fit_says(lab):
    dataset, options = load(lab), Options(solver=SOLVER)
    (advice,) = fabric_next(
        dataset, "fabric_1", Drapes(samples=3, silhouettes=3, units=3), "the fit failed: x", None, 0
    )[:1]
    assert "all fabrics are fitted again" in advice
    assert "--cloth fabric_1 and an --out of its own" in advice
    keys = [
        {cell.key for cell in plan_fits(dataset, dataset.cloths, one).cells.values()}
        for one in (options, replace(options, seed=1), replace(options, vertices=options.vertices + 100))
    ]
    assert len(set.union(*keys)) == sum(map(len, keys))


@pytest.mark.parametrize(("cloth", "advised"), [(0.15, False), (0.12, True), (0.18, True)])
def test_samples_for_a_diagnosis_are_of_the_size_that_it_knows(lab, cloth, advised):
    dataset = load(lab)
    dataset = replace(dataset, protocol=replace(dataset.protocol, cloth_radius_m=cloth))
    steps = [step for step in laboratory_next(dataset, None) if "ratio" in step]
    assert len(steps) == advised
    assert all(step.startswith("For a diagnosis drape samples of 300 mm over this plate") for step in steps)
    more = fabric_next(dataset, "fabric_2", Drapes(samples=1, silhouettes=4, units=2), "", None, 0)
    assert any(step.startswith("Cut 2 more samples") for step in more) != advised


def test_pictures_that_cannot_be_used_are_not_forced(lab):
    missing = "none of its pictures can be used; `cusick-bench data audit` says why"
    steps = fabric_next(load(lab), "fabric_2", Drapes(samples=3, silhouettes=3, units=0, unusable=3), missing, None, 0)
    assert steps[0].startswith("Look at 3 unusable pictures")
    assert not any("--force" in step for step in steps)


def test_samples_whose_pictures_cannot_be_used_are_not_to_be_cut_again(lab):
    for fabric, cut in (("fabric_1", False), ("fabric_2", True)):
        steps = fabric_next(load(lab), fabric, Drapes(samples=1, silhouettes=3, units=1, unusable=2), "", None, 0)
        assert any(step.startswith("Cut 2 more samples") for step in steps) is cut


def test_captures_without_a_number_are_to_be_numbered(lab, tmp_path):
    """Their face cannot be told by `captures` in protocol.json, which goes by the number."""
    for path in (lab / "data/Fabric 1/silhouettes").iterdir():
        (tmp_path / path.name.replace("_Capture_1", "")).write_bytes(path.read_bytes())
    steps = fabric_next(load(tmp_path), "fabric_1", Drapes(samples=3, silhouettes=3, units=3), "", None, 0)
    assert any(step.startswith("Number the captures in the names of the pictures") for step in steps)
    assert not any("protocol.json" in step for step in steps)


@pytest.fixture
def named_sets(lab, tmp_path) -> Path:
    """Two named sets, whose cloths have no number."""
    for name, fabric in (("cotton_green", 1), ("wool red", 3)):
        folder = tmp_path / "bnn_image_gt" / name
        folder.mkdir(parents=True)
        picture = lab / f"data/Fabric {fabric}/silhouettes/Fabric_{fabric}_Sample_1_Capture_1.jpg"
        shutil.copy(picture, folder / f"{name}_sample_1_Upward_Drape_1.jpg")
    return tmp_path


def test_a_named_set_is_weighed_by_its_name(named_sets):
    """Photographs have numbers: `--weight "0=180 g/m2"` would be refused."""
    missing = "its weight is not known, and a drape shows stiffness over weight only"
    (step, *_) = fabric_next(load(named_sets), "wool red", Drapes(samples=1, silhouettes=1, units=1), missing, None, 0)
    assert "with the weight: a line wool red,0.18, in fabrics.csv." in step
    (named_sets / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\nwool red,0.18,\n")
    dataset = load(named_sets)
    assert dataset.select(cloth="wool red").table["areal_density"].tolist() == [0.18]


def test_named_sets_are_as_many_fabrics_as_their_names(named_sets):
    def other_fabrics() -> bool:
        return any(step.startswith("Picture other fabrics") for step in laboratory_next(load(named_sets), None))

    assert not other_fabrics()
    shutil.rmtree(named_sets / "bnn_image_gt/wool red")
    assert other_fabrics()


def test_commands_in_advice_can_be_pasted(named_sets):
    spaced = named_sets / "my lab"
    spaced.mkdir()
    (named_sets / "bnn_image_gt").rename(spaced / "bnn_image_gt")
    drapes = Drapes(samples=1, silhouettes=1, units=1, unusable=1)
    look, again, *_ = fabric_next(load(spaced), "wool red", drapes, "the fit failed: x", None, 0)
    assert shlex.split(look)[-4:] == ["cusick-bench", "data", "audit", str(spaced)]
    assert "--cloth 'wool red' and" in again


def test_samples_whose_pictures_cannot_be_used_do_not_count_for_a_diagnosis(lab, tmp_path):
    spoilt = shutil.copytree(lab, tmp_path / "lab")
    (spoilt / "data/Fabric 1/silhouettes/Fabric_1_Sample_3_Capture_1.jpg").write_bytes(b"no picture")
    unread = tmp_path / "atlas.npz"  # is not there, and not asked for
    documents, missing = diagnose_fabrics(
        str(spoilt), load(spoilt), ["fabric_1"], Workspace(tmp_path), Options(), atlas=unread
    )
    assert not documents
    assert missing["fabric_1"].startswith("there are 2 samples of 3 whose pictures can be used")


def test_pictures_of_too_few_samples_are_not_read_for_a_diagnosis(lab, tmp_path, monkeypatch):
    monkeypatch.setattr(DrapeDataset, "sample", lambda dataset, row: pytest.fail("a picture was read"))
    documents, missing = diagnose_fabrics(str(lab), load(lab), ["fabric_2"], Workspace(tmp_path), Options())
    assert not documents
    assert missing["fabric_2"].startswith("there is one sample; ")


def test_a_fabric_of_several_samples_is_diagnosed_whether_weighed_or_not(answer, out):
    for fabric in (answer.fabrics[0], answer.fabrics[2]):
        assert fabric.diagnosis is not None
        assert fabric.diagnosis_missing == ""
        stored = json.loads((out / fabric.diagnosis.path).read_text())
        assert stored["verdict"] == fabric.diagnosis.verdict
        if fabric.areal_density is None:
            assert fabric.diagnosis.bending is None
        else:
            weight = fabric.areal_density * stored["data"]["gravity_m_s2"] * answer.cloth_radius_m**3
            assert fabric.diagnosis.bending == pytest.approx(weight * np.exp(stored["base"]["bending"]))
        assert fabric.fabric in (out / fabric.diagnosis.page).read_text()


def test_the_page_stands_alone_and_shows_every_fabric(answer, out):
    text = (out / "identify.html").read_text()
    assert Page(text).scripts == []  # well-formed, or it raises
    assert "http-equiv" in text
    assert not re.search(r'(src|href)="(https?:)?//', text)
    for fabric in answer.fabrics:
        assert f">{fabric.fabric}</a>" in text
        assert f'id="fabric-{answer.fabrics.index(fabric)}"' in text
    assert text.count("data:image/png;base64,") == 2 * 4 + 1  # three silhouettes and a drape of each fit, one alone
    assert "No stiffness: its weight is not known" in text
    assert "No diagnosis: there is one sample" in text


def test_what_is_finished_is_not_made_again(answer, lab, out, atlas):
    def written() -> dict[str, int]:
        kept = [*out.glob("run/cells/*/done"), *out.glob("diagnosis/*/diagnosis.json")]
        return {str(path): path.stat().st_mtime_ns for path in kept}

    before = written()
    assert len(before) == 4
    again = identify(lab, "--out", out, "--atlas", atlas, *CHEAP)
    assert again.exit_code == 0, again.output
    assert written() == before
    assert IdentifyDocument.read(out / "identify.json").fabrics == answer.fabrics
    other = identify(lab, "--out", out, "--atlas", atlas, *CHEAP, "--seed", "1", "--cloth", "fabric_2")
    assert other.exit_code == 0, other.output
    assert len([*out.glob("run/cells/*/done")]) == 3


def test_a_weight_that_is_added_counts_in_the_same_process(lab, tmp_path):
    copy = shutil.copytree(lab, tmp_path / "lab")

    def planned() -> tuple[list[str], list[str]]:
        plan = plan_fits(begin(str(copy), tmp_path / "out", Options()).dataset, ["fabric_3"], Options())
        return list(plan.cells), list(plan.missing)

    assert planned() == ([], ["fabric_3"])
    with (copy / "fabrics.csv").open("a") as table:
        table.write("fabric_3,0.18,\n")
    assert planned() == (["fabric_3"], [])


def test_a_damaged_diagnosis_is_made_anew(lab, atlas, tmp_path):
    words = (lab, "--out", tmp_path / "out", "--atlas", atlas, *CHEAP, "--cloth", "fabric_3")
    assert identify(*words).exit_code == 0
    path = tmp_path / "out/diagnosis/fabric_3/diagnosis.json"
    whole = path.read_bytes()
    path.write_bytes(whole[:100])
    assert identify(*words).exit_code == 0
    assert json.loads(path.read_bytes())["verdict"] == json.loads(whole)["verdict"]


def test_one_photograph_gets_its_stiffness_and_the_reason_why_no_diagnosis(photographs, tmp_path):
    result = identify(photographs, "--out", tmp_path / "out", "--weight", "180 g/m2", *CHEAP, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    (fabric,) = document["fabrics"]
    assert document["preparation"]["photographs"] == 1
    assert document["preparation"]["calibration"] == "the bare plate"
    assert fabric["areal_density"] == pytest.approx(0.18)
    assert 0 < fabric["drapes"]["drape_coefficient"]["value"] < 1
    assert fabric["fit"]["stiffness"]["warp"]["ci90"] is not None
    assert fabric["diagnosis"] is None
    assert "one sample" in fabric["diagnosis_missing"]
    assert any("board" in step for step in document["next"])


def test_photographs_are_prepared_again_only_where_they_options_or_the_code_changed(photographs, tmp_path, monkeypatch):
    workspace = Workspace(tmp_path / "out")
    workspace.prepare()
    read: list[str] = []

    def prepared(weight: str) -> str:
        data, preparation = as_data_set(
            str(photographs), workspace, SettingText(weight=(weight,)), 256, done=read.append
        )
        assert preparation is not None
        return (Path(data) / "fabrics.csv").read_text()

    assert "0.18" in prepared("180 g/m2")
    assert len(read) == 1
    prepared("180 g/m2")
    assert len(read) == 1
    assert "0.2," in prepared("200 g/m2")
    assert len(read) == 2
    monkeypatch.setattr(data_of_folder, "NUMERICS_VERSION", data_of_folder.NUMERICS_VERSION + 1)
    prepared("200 g/m2")
    assert len(read) == 3


def test_photographs_whose_folder_is_renamed_become_another_fabric(photographs, tmp_path):
    folder, workspace = tmp_path / "photos", Workspace(tmp_path / "out")
    workspace.prepare()
    (folder / "Fabric 1").mkdir(parents=True)
    shutil.copy(photographs / "plate.jpg", folder)
    shutil.copy(photographs / "Fabric_1_Sample_1_Capture_1.jpg", folder / "Fabric 1" / "Sample_1.jpg")
    as_data_set(str(folder), workspace, SettingText(), 256)
    (folder / "Fabric 1").rename(folder / "Fabric 3")
    data, _ = as_data_set(str(folder), workspace, SettingText(), 256)
    assert [path.name for path in Path(data).rglob("*.png")] == ["Fabric_3_Sample_1_Capture_1.png"]


@pytest.mark.parametrize("edit", ["change", "add", "remove"])
def test_edits_in_a_data_set_that_was_prepared_are_not_lost(photographs, tmp_path, edit):
    """It was made again over them, without a word, as soon as an option changed."""
    workspace = Workspace(tmp_path / "out")
    workspace.prepare()

    def prepared(weight: str) -> None:
        as_data_set(str(photographs), workspace, SettingText(weight=(weight,)), 256)

    prepared("180 g/m2")
    (workspace.data / ".hidden").write_text("of a file manager")
    prepared("190 g/m2")
    path = workspace.data / ("notes.txt" if edit == "add" else "fabrics.csv")
    path.unlink(missing_ok=True) if edit == "remove" else path.write_text("fabric,areal_density_kg_m2\n1,0.21\n")
    before = digests(workspace.data)
    prepared("190 g/m2")  # nothing else has changed: used as it is
    with pytest.raises(IdentifyError, match=rf"edited after it had been made \({path.name}\); move it away"):
        prepared("200 g/m2")
    assert digests(workspace.data) == before
    workspace.data.rename(tmp_path / "mine")
    prepared("200 g/m2")
    assert "0.2," in (workspace.data / "fabrics.csv").read_text()


def test_a_data_set_of_somebody_else_in_the_workspace_is_left_alone(photographs, lab, tmp_path):
    """However often the command is repeated: a record of its own would make the data set its own to remove."""
    out = tmp_path / "out"
    shutil.copytree(lab, out)
    before = sorted(out.rglob("*"))
    for _ in range(2):
        result = identify(photographs, "--out", out, *CHEAP)
        assert result.exit_code == 2, result.output
        assert "data: is not empty; give a new folder, or remove it" in said(result)
        assert sorted(out.rglob("*")) == before
    (out / "data.json").write_text("{}")
    result = identify(photographs, "--out", out, *CHEAP)
    assert result.exit_code == 2, result.output
    assert "data.json was not written by an identification; choose another --out" in said(result)
    assert sorted(out.rglob("*")) == sorted([*before, out / "data.json"])


def test_a_photograph_that_is_refused_is_named(photographs, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for path in photographs.glob("*.jpg"):
        (folder / path.name).write_bytes(path.read_bytes())
    for name in ("Fabric_1_Sample_2_Capture_1.jpg", "Fabric_7_Sample_1_Capture_1.jpg"):
        (folder / name).write_bytes(b"no picture")
    result = identify(folder, "--out", tmp_path / "out", *CHEAP, "--json")
    assert result.exit_code == 1, result.output
    document = json.loads(result.stdout)
    refused = document["preparation"]["refused"]
    assert [(Path(one["path"]).name, one["fabric"]) for one in refused] == [
        ("Fabric_1_Sample_2_Capture_1.jpg", 1),
        ("Fabric_7_Sample_1_Capture_1.jpg", 7),
    ]
    assert any(step.startswith("Take 1 photograph again") for step in document["fabrics"][0]["next"])
    assert any(step.startswith("Take all photographs of fabric 7 again") for step in document["next"])


def test_photographs_without_a_sure_outline_are_refused_together(photographs, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "plate.jpg").write_bytes((photographs / "plate.jpg").read_bytes())
    (folder / "Fabric_1_Sample_1_Capture_1.jpg").write_bytes(b"no picture")
    result = identify(folder, "--out", tmp_path / "out", *CHEAP)
    assert result.exit_code == 2
    assert "none of 1 photographs has a sure outline" in said(result)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere"], "nowhere: no such folder; give a folder of photographs, or a data set"),
        (["synthetic", "--plate-diameter", "150 mm"], "--plate-diameter is about photographs"),
        (["synthetic", "--image-size", "300"], "--image-size is about photographs"),
        (["synthetic", "--solver", "homo", "--solver", "heter"], "identify fits with one solver, got 2: homo, heter"),
        (["synthetic", "--cloth", "silk"], "unknown cloth silk: use one of fabric_1"),
        (["synthetic", "--cloth", "fabric_1", "--solver", "homoo"], "did you mean 'homo'?"),
        (["synthetic", "--vertices", "10"], "at least 60 vertices"),
        (["synthetic", "--atlas", "/none/atlas.npz"], "the atlas /none/atlas.npz cannot be used"),
    ],
)
def test_bad_words_end_with_a_line(words, says, tmp_path):
    result = identify(*words, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert says.replace(": use", "; use") in said(result).replace(": use", "; use")
    assert not (tmp_path / "out").exists()


def test_a_folder_of_nothing_says_what_was_expected(tmp_path):
    (tmp_path / "empty").mkdir()
    result = identify(tmp_path / "empty", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "holds no pictures; give photographs such as Fabric_1_Sample_2_Capture_1.jpg" in said(result)


def test_photographs_without_a_ruler_are_told_so(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    Image.fromarray(np.zeros((30, 40), dtype=np.uint8)).save(folder / "Fabric_1_Sample_1_Capture_1.jpg")
    result = identify(folder, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "holds no ruler" in said(result)


def test_square_pictures_without_a_ruler_are_silhouettes(lab, photographs, tmp_path):
    source = lab / "data/Fabric 2/silhouettes/Fabric_2_Sample_1_Capture_1.jpg"
    (tmp_path / source.name).write_bytes(source.read_bytes())
    assert not holds_photographs(tmp_path)
    assert not holds_photographs(lab)
    assert holds_photographs(photographs)


@pytest.mark.parametrize("hidden", ["._{}", "@eaDir/{}", ".thumbnails/{}"])
def test_hidden_files_do_not_make_photographs_of_silhouettes(lab, tmp_path, hidden):
    """macOS puts ._NAME before NAME: the data set was refused for want of a ruler."""
    name = "Fabric_2_Sample_1_Capture_1.jpg"
    (tmp_path / name).write_bytes((lab / "data/Fabric 2/silhouettes" / name).read_bytes())
    other = tmp_path / hidden.format(name)
    other.parent.mkdir(exist_ok=True)
    other.write_bytes(b"no square picture")
    assert not holds_photographs(tmp_path)


def test_photographs_of_silk_are_photographs(photographs, tmp_path):
    (tmp_path / "silk").mkdir()
    for path in photographs.glob("*.jpg"):
        (tmp_path / ("silk" if path.stem.startswith("Fabric") else ".") / path.name).write_bytes(path.read_bytes())
    assert holds_photographs(tmp_path)


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


def test_a_damaged_document_names_what_is_wrong(answer, tmp_path):
    path = tmp_path / "identify.json"
    answer.write(path)
    assert IdentifyDocument.read(path) == answer
    content = json.loads(path.read_text())
    content["fabrics"][0]["drapes"]["samples"] = "many"
    path.write_text(json.dumps(content))
    with pytest.raises(IdentifyError, match=r"fabrics\.0\.drapes\.samples"):
        IdentifyDocument.read(path)
    with pytest.raises(IdentifyError, match="no-such"):
        IdentifyDocument.read(tmp_path / "no-such.json")


@pytest.mark.parametrize(
    ("coefficient", "vertices", "warned"), [(0.3, 300, True), (0.9, 300, False), (0.3, 600, False)]
)
def test_limp_cloth_on_a_coarse_mesh_is_said_to_be_found_too_limp(answer, coefficient, vertices, warned):
    fit = answer.fabrics[0].fit.model_copy(
        update={"drape_coefficient": coefficient, "simulated_drape_coefficient": coefficient}
    )
    notes = " ".join(fit_notes(fit, 3, vertices))
    assert ("found too limp" in notes) is warned
