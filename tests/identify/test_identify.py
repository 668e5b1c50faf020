"""`cusick-bench identify`: from silhouettes to one page, every part kept."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from identified import made_up_fit
from identify_command import CHEAP, identify, said

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.stats import statistics
from cusick_bench.identify.data import require_same_folder
from cusick_bench.identify.diagnoses import diagnose_fabrics
from cusick_bench.identify.document import IdentifyDocument
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.identify.options import Options
from cusick_bench.identify.words import fit_notes
from cusick_bench.identify.workspace import Workspace

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("identify") / "out"


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
        assert (fabric.diagnosis.p, fabric.diagnosis.closure) == (stored["gap"]["p"], stored["closure"]["fraction"])
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


def test_the_answer_about_another_folder_is_not_replaced(lab, atlas, tmp_path, monkeypatch):
    """By the default --out a laboratory's second folder of photographs took the first one's place, without a word."""
    monkeypatch.chdir(lab.parent)
    other, document = shutil.copytree(lab, tmp_path / "other"), Workspace(tmp_path / "out").document
    document.parent.mkdir()
    document.write_text(json.dumps({"folder": lab.name, "data": str(lab)}))
    refused = identify(other, "--out", tmp_path / "out", "--atlas", atlas, *CHEAP)
    assert refused.exit_code == 2, refused.output
    assert f"holds the identification of {lab.name}, which that of {other} would replace; give another --out" in said(
        refused
    )
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["identify.json"]
    for same in (lab.name, str(lab), f"{lab}/data/.."):
        require_same_folder(same, Workspace(tmp_path / "out"))
    document.write_text(json.dumps({"folder": str(tmp_path / "renamed"), "data": str(tmp_path / "renamed")}))
    require_same_folder(str(other), Workspace(tmp_path / "out"))
    document.write_text(json.dumps({"folder": "synthetic", "data": "elsewhere"}))
    with pytest.raises(IdentifyError, match="holds the identification of synthetic"):
        require_same_folder(str(lab), Workspace(tmp_path / "out"))


def test_the_answer_names_its_folder_wherever_it_is_asked_from(lab, atlas, tmp_path, monkeypatch):
    """Of `photos` another laboratory's `photos` was the same folder, and its answer took the first one's place."""
    monkeypatch.chdir(lab.parent)
    out = tmp_path / "out"
    made = identify(lab.name, "--out", out, "--atlas", atlas, *CHEAP, "--cloth", "fabric_1")
    assert made.exit_code == 0, made.output
    assert IdentifyDocument.read(out / "identify.json").folder == str(lab)
    shutil.copytree(lab, tmp_path / lab.name)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(IdentifyError, match="holds the identification of"):
        require_same_folder(lab.name, Workspace(out))


def test_a_damaged_diagnosis_is_made_anew(lab, atlas, tmp_path):
    words = (lab, "--out", tmp_path / "out", "--atlas", atlas, *CHEAP, "--cloth", "fabric_3")
    assert identify(*words).exit_code == 0
    path = tmp_path / "out/diagnosis/fabric_3/diagnosis.json"
    whole = path.read_bytes()
    path.write_bytes(whole[:100])
    assert identify(*words).exit_code == 0
    assert json.loads(path.read_bytes())["verdict"] == json.loads(whole)["verdict"]


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


@pytest.mark.parametrize(
    ("samples", "turned", "says"),
    [
        (12, 0, "what 12 samples tell of the cloth together"),
        (12, 12, "what both faces of 12 samples tell of the cloth together"),
        (5, 0, "what 5 of 12 samples tell of the cloth together"),
        (5, 5, "what both faces of 5 of 12 samples tell of the cloth together"),
        (12, 3, "what 12 samples and the other face of 3 of them tell of the cloth together"),
        (1, 0, "that of one drape, of sample 1, whose drape coefficient is the median; the interval says how far one"),
        (1, 1, "that of two drapes, both faces, of sample 1, whose drape coefficient is the median; the interval says"),
    ],
)
def test_a_stiffness_is_said_to_be_of_the_drapes_that_it_was_learned_from(samples, turned, says):
    """Other faces of three samples were called both faces of twelve, and two faces of one sample one drape."""
    fit = made_up_fit().model_copy(update={"samples": samples, "faces": 1 + bool(turned), "turned": turned})
    assert says in " ".join(fit_notes(fit, 12, 600))
