"""Photographs become a data set whose silhouettes lie where the truth is."""

import json
import shutil

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.files.hanging_line import with_perspective

TOLERANCE = 0.5e-3  # [m] root-mean-square


def _truth(photographs):
    return json.loads((photographs / "truth.json").read_text())


def test_silhouettes_load_and_lie_where_the_truth_is(photographs, prepared):
    assert not prepared.doubtful
    dataset, truth = load(prepared.out), _truth(photographs)["radii_m"]
    assert len(dataset) == len(truth) == 2
    for row in range(len(dataset)):
        name = dataset.table["image"].iloc[row].rpartition("/")[2].removesuffix(".png")
        seen = with_perspective(dataset.sample(row).profile.radii, dataset.protocol)
        assert np.sqrt(np.mean((seen - truth[name]) ** 2)) < TOLERANCE
    assert dataset.table["areal_density"].iloc[0] == pytest.approx(0.18)


def test_the_protocol_tells_the_camera_and_how_sure_it_is(photographs, prepared):
    document = json.loads((prepared.out / "protocol.json").read_text())
    truth, found = _truth(photographs), document["notes"]["calibration"]
    assert document["projection"] == "pinhole"
    assert document["camera_height_m"] == pytest.approx(truth["camera_height_m"], abs=3e-3)
    assert found["camera_off_axis_m"] == pytest.approx(truth["eye_m"][:2], abs=4e-3)
    assert prepared.view.knows_lens
    assert found["lens_k1"] == pytest.approx(truth["k1"], abs=0.02)
    assert 0 < found["scale_sd_relative"] < 0.01
    assert 0 < found["centre_sd_m"] < 1e-3


def test_the_audit_finds_nothing_odd_about_the_pictures(prepared):
    kinds = {item.kind for item in audit(prepared.out).irregularities}
    assert kinds <= {"no-mesh", "thickness-missing", "protocol-remark"}


def test_there_is_a_picture_to_check(prepared):
    drawn = cv2.imread(str(prepared.out / "check" / "check_Fabric_1_Sample_1_Capture_1.jpg"))
    assert drawn is not None
    assert drawn.shape == (960, 1280, 3)


@pytest.mark.parametrize("change", ["hidden", "bare", "damaged"])
def test_a_doubtful_picture_is_named_and_not_written(photographs, tmp_path, change):
    folder = tmp_path / "photographs"
    shutil.copytree(photographs, folder, ignore=shutil.ignore_patterns("board-[1-9]*", "*Sample_2*"))
    spoilt = folder / "Fabric_1_Sample_2_Capture_1.jpg"
    levels = cv2.imread(str(folder / "Fabric_1_Sample_1_Capture_1.jpg"))
    if change == "hidden":
        levels[:, : levels.shape[1] // 2] = (90, 120, 180)  # a hand's colour over half of the cloth
    else:
        levels[:] = np.median(levels[:100], axis=(0, 1))
    cv2.imwrite(str(spoilt), levels)
    if change == "damaged":
        spoilt.write_bytes(spoilt.read_bytes()[:300])
    out = tmp_path / "set"
    result = CliRunner().invoke(app, ["data", "prepare", str(folder), "--out", str(out), "--json"])
    assert result.exit_code == 1, result.output
    document = json.loads(result.stdout)
    rows = {row["name"]: row for row in document["images"]}
    assert rows["Fabric_1_Sample_1_Capture_1"]["written"]
    doubtful = rows["Fabric_1_Sample_2_Capture_1"]
    assert not doubtful["written"]
    assert doubtful["warnings"]
    assert doubtful["path"] == str(spoilt)
    assert document["protocol"] == {
        name: value for name, value in json.loads((out / "protocol.json").read_text()).items() if name != "notes"
    }
    silhouettes = [path.name for path in out.rglob("*.png")]
    assert silhouettes == ["Fabric_1_Sample_1_Capture_1.png"]
