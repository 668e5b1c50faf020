"""Tables beside the data: densities, protocol, checksums; right ones are used, wrong ones are refused by line."""

import hashlib
import json
import math
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from other_laboratory import LARGE_IMAGES, NEAR_CAMERA, SMALL_CLOTH
from toy_cloths import draw, toy_profile, write_image, write_toy

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.errors import BadTable
from cusick_bench.datasets.files.checksums import verify_checksums
from cusick_bench.datasets.files.fabrics import fabric_key, read_fabrics
from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.protocol import Protocol, read_protocol
from cusick_bench.datasets.registry import REGISTRY


@pytest.mark.parametrize(
    "key", ["7", "7.0", "Fabric 7", "fabric_7", "Fabric 07", "fabric-007", "Fabric\u00a07", "Fabric\u202f7"]
)
def test_densities_come_from_the_users_table(toy, key):
    text = f"fabric,areal_density_kg_m2,thickness_m,maker\n{key},0.21,0.0004,Mill\n"
    (toy / "fabrics.csv").write_text(text, encoding="utf-8")
    dataset = load(toy)
    assert (dataset.index["areal_density"] == 0.21).all()
    assert (dataset.index["thickness"] == 0.0004).all()
    assert dataset.require_density(3) == 0.21
    other = toy / "other.csv"
    other.write_text(f"fabric,areal_density_kg_m2\n{key},0.3\n", encoding="utf-8")
    assert load(toy, fabrics_csv=other).require_density(0) == 0.3


def test_names_of_fabrics_have_one_spelling():
    assert fabric_key("Fabric 01 Observations") == "fabric_1_observations"
    assert [fabric_key(name) for name in ("Cotton Blue", "fabric_x", "fabric")] == ["cotton_blue", "fabric_x", "fabric"]
    assert fabric_key("7.5") == "7.5"


def test_a_fabric_is_its_number_or_its_name_where_it_has_none(tmp_path):
    elsewhere = toy_profile(3, 1, 1)  # of no fabric that is there
    for path, profile in {
        "data/Fabric 7 Observations/Sample 1/silhouettes/Fabric_7_Sample_1_Obs_1.png": toy_profile(7, 4, 1),
        "bnn_image_gt/cotton_blue/cotton_blue_sample_1_Upward_Drape_1.png": toy_profile(7, 1, 1),
        "bnn_image_gt/wool_red/wool_red_sample_1_Upward_Drape_1.png": elsewhere,
    }.items():
        write_image(tmp_path / path, draw(profile))
    assert load(write_toy(tmp_path)).fabrics == {
        "fabric_7": "fabric_7",
        "fabric_7_observations": "fabric_7",
        "cotton_blue": "fabric_7",
        "wool_red": "wool_red",
    }


def test_a_fabric_under_two_spellings_is_given_twice(tmp_path):
    table = tmp_path / "fabrics.csv"
    table.write_text("fabric,areal_density_kg_m2\n7,0.2\n7.0,0.3\n")
    with pytest.raises(BadTable, match=r"line 3: fabric '7\.0' is empty or given twice"):
        read_fabrics(table)


def test_published_densities_are_not_given_to_another_labs_fabric(tmp_path):
    dataset = load(write_toy(tmp_path, fabrics=(2,)))
    assert math.isnan(dataset.index.loc[0, "areal_density"])
    with pytest.raises(DataError, match=r"areal density of fabric_2 must be > 0 kg/m2, got nan; .*fabrics\.csv"):
        dataset.require_density(0)


def test_protocol_changes_what_images_mean(toy):
    profile = toy_profile(7, 1, 1)
    image = draw(profile, size=128, centre=(60.0, 66.0), scale=360.0)
    for path in (toy / "data" / "Fabric 7" / "silhouettes").iterdir():
        write_image(path, 1 - image[::-1])  # light cloth, y down
    (toy / "protocol.json").write_text(
        json.dumps(
            {
                "image_size_px": 128,
                "centre_px": [60, 127 - 66],
                "px_per_m": 360,
                "foreground": "light",
                "image_y": "down",
                "captures": {"1": "down", "2": "up"},
                "operator": "A. N. Other",
                "notes": {"humidity": 0.65},
            }
        )
    )
    dataset = load(toy)
    assert dataset.protocol.extra == {"operator": "A. N. Other", "notes": {"humidity": 0.65}}
    assert list(dataset.index["side"][:4]) == ["down", "up", "", ""]
    sample = dataset.sample(0)
    assert sample.image.shape == (128, 128)
    assert sample.profile.rms(profile) < 0.2 / 360


def test_shipped_set_is_checked_file_by_file(tmp_path):
    layout = Layout(tmp_path, (), (), (), (), ())
    (tmp_path / "a.txt").write_text("drape")
    digest = "11c6c2f7d2ca5ea4a1b9f5dd11cf27f5"  # not even a SHA-256
    (tmp_path / "sha256.json").write_text(json.dumps({"a.txt": digest}))
    with pytest.raises(DataError, match="bad entry"):
        verify_checksums(layout)
    right = hashlib.sha256(b"drape").hexdigest()
    (tmp_path / "sha256.json").write_text(json.dumps({"a.txt": right}))
    verify_checksums(layout)
    for name in ("../a.txt", "/etc/passwd", "..\\a.txt"):
        (tmp_path / "sha256.json").write_text(json.dumps({name: right}))
        with pytest.raises(DataError, match="bad entry"):
            verify_checksums(layout)
    (tmp_path / "sha256.json").write_text(json.dumps({"a.txt": right, "gone.txt": right}))
    with pytest.raises(DataError, match=r"gone\.txt: is missing; reinstall"):
        verify_checksums(layout)
    (tmp_path / "sha256.json").write_text(json.dumps({"a.txt": right}))
    (tmp_path / "a.txt").write_text("changed")
    with pytest.raises(DataError, match="differs from its SHA-256"):
        verify_checksums(layout)


@pytest.mark.parametrize("folder", ["silhouettes", "meshes"])
@pytest.mark.parametrize("by_name", [True, False])
def test_a_file_that_is_added_to_the_shipped_set_is_refused(folder, by_name, tmp_path, monkeypatch):
    """It was used, and not even looked at, since the shipped set is known by its checksums."""
    root = tmp_path / "synthetic"
    shutil.copytree(load("synthetic").root, root)
    monkeypatch.setitem(REGISTRY, "synthetic", replace(REGISTRY["synthetic"], folder=lambda: root))
    wanted = "synthetic" if by_name else root
    assert len(load(wanted, correct=False)) == 240
    (first,) = (root / f"data/Fabric 2/{folder}").glob("Fabric_2_Sample_1_Capture_1.*")
    added = Path(shutil.copy(first, first.with_name(first.name.replace("Sample_1_", "Sample_13_"))))
    with pytest.raises(DataError, match=r"is not listed in sha256\.json; remove it") as caught:
        load(wanted, correct=False)
    assert (caught.value.where, caught.value.kind) == (str(added), "checksum")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("fabric,areal_density_kg_m2\n7,-0.1\n", r"line 2: areal density must be a number > 0 kg/m2, got -0.1"),
        ("fabric,areal_density_kg_m2\n6,0.2\n7,0\n", r"line 3: .*got 0"),
        ("fabric,areal_density_kg_m2\n7,nan\n", r"line 2: .*got nan"),
        ("fabric,areal_density_kg_m2\n7,inf\n", r"line 2: .*must be a number"),
        ("fabric,areal_density_kg_m2\n7,light\n", r"line 2: .*got light"),
        ("fabric,areal_density_kg_m2\n7,192\n", r"at most 5.0 kg/m2, got 192; give it in kg/m2"),
        ("fabric,areal_density_kg_m2,thickness_m\n7,0.2,0.4\n", r"thickness must be at most 0.02 m"),
        ("fabric,areal_density_kg_m2\n7,0.2\nFabric 7,0.3\n", r"line 3: .*given twice"),
        ("fabric,areal_density_kg_m2\n7,0.2,0.3,0.4\n", r"4 fields for 2 columns"),
        ("cloth,weight\n7,0.2\n", r"needs the columns fabric and areal_density_kg_m2"),
        ("", r"needs the columns"),
        ("\0\0\0", r"fabrics"),
    ],
)
def test_bad_fabric_tables(tmp_path, text, complaint):
    root = write_toy(tmp_path, samples=1)
    (root / "fabrics.csv").write_text(text)
    with pytest.raises(BadTable, match=complaint) as caught:
        load(root)
    assert "fabrics.csv" in str(caught.value)
    assert audit(root).kinds["fabrics-invalid"] == 1  # reported, and the rest is looked at
    assert audit(root).silhouettes == 4


def test_fabric_table_forgives_blanks(tmp_path):
    path = tmp_path / "fabrics.csv"
    path.write_text("﻿fabric, areal_density_kg_m2 ,thickness_m\n\n7, 0.2 ,\n8,,0.0003\n", encoding="utf-8")
    table = read_fabrics(path)
    assert table["fabric_7"].areal_density == 0.2
    assert np.isnan(table["fabric_7"].thickness)
    assert np.isnan(table["fabric_8"].areal_density)


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ({"px_per_m": -1}, "px_per_m must be > 0, got -1"),
        ({"px_per_m": "723"}, "px_per_m must be a finite number"),
        ({"px_per_m": True}, "finite number"),
        ({"image_size_px": 10**9}, "image_size_px must be one whole number of pixels from 16 to 4096"),
        ({"image_size_px": [256, 128]}, "images are square"),
        ({"centre_px": [1]}, r"centre_px must be \[column, row\]"),
        ({"projection": "fisheye"}, "projection must be one of parallel, pinhole"),
        ({"captures": {"1": "left"}}, "captures must map"),
        ({"captures": ["up"]}, "captures must map"),
        ({"captures": {"0": "up", "1": "down"}}, "captures must map .* and numbers begin at 1"),
        ({"captures": {"1": "up", "01": "down"}}, "captures must map .* each number once"),
        ({"plate_radius_m": 0.2}, "plate_radius_m must be below cloth_radius_m"),
        ([1, 2], "must hold one JSON object"),
        ({"plate_radius_m": 90}, r"plate_radius_m must be from 0.01 to 0.4 m \(90 mm are 0.09 m\), got 90"),
        ({"cloth_radius_m": 15}, r"cloth_radius_m must be from 0.02 to 0.5 m \(15 cm are 0.15 m\), got 15"),
        ({"gravity_m_s2": 980}, r"gravity_m_s2 must be from 1 to 30 m/s2 \(980 cm/s2 are 9.8 m/s2\), got 980"),
        ({"px_per_m": 7230}, r"px_per_m must suit images of 256 px: from centre_px to the border are 128 px, but"),
        ({"px_per_m": 0.723}, r"the plate would be 0.13 px wide, at least 25.6 are plausible, got 0.723 px/m"),
        ({"centre_px": [300, 4]}, r"centre_px must lie in the image, from 0 to 255, got \[300, 4\]"),
        ({"centre_px": [60, 60]}, r"from centre_px to the border are 60.5 px, but the plate's radius is 65.07 px"),
        ({"camera_height_m": 0.7}, "camera_height_m needs projection, of which only pinhole uses it, got 0.7 alone"),
        ({"image_size_px": 512}, "image_size_px 512 needs px_per_m and centre_px of these images too"),
        ({"image_size_px": 512, "px_per_m": 1446}, "image_size_px 512 needs centre_px of these images too"),
        ({"plate_radius": 0.09}, "unknown key 'plate_radius', which holds 0.09; did you mean 'plate_radius_m'"),
        ({"scale": 723}, "did you mean 'px_per_m'"),
        ({"px_per_mm": 0.723}, "did you mean 'px_per_m'"),
        ({"Centre": [1, 2]}, "did you mean 'centre_px'"),
        ({"foregroud": "light"}, "did you mean 'foreground'"),
        ({"background": "dark"}, "did you mean 'foreground'"),
        ({"diameter": "30 cm"}, "did you mean 'cloth_radius_m'"),
        ({"cloth_diameter_m": 0.3}, r"did you mean 'cloth_radius_m', half of a diameter\? "),
        ({"plate_diameter": 0.18}, r"did you mean 'plate_radius_m', half of a diameter\? "),
        (
            {"humidity": 0.65},
            "unknown key 'humidity', which holds 0.65; known keys are camera.* go into 'notes'",
        ),
        ({"lamp": ["left", "right"]}, "unknown key 'lamp'"),
    ],
)
def test_bad_protocols(tmp_path, document, complaint):
    root = write_toy(tmp_path, samples=1)
    (root / "protocol.json").write_text(json.dumps(document))
    with pytest.raises(BadTable, match=complaint):
        load(root)
    assert audit(root).kinds["protocol-invalid"] == 1


@pytest.mark.parametrize(
    "remark",
    [
        {"samples": 12}, {"faces": 2}, {"n_captures": 4}, {"Number of samples": 12}, {"captures_per_face": 2},
        {"case_id": 7}, {"seed": 3}, {"format_version": 1.1}, {"operator": None},
    ],
)  # fmt: skip
def test_counts_versions_and_what_is_null_are_remarks(tmp_path, remark):
    """Nothing in a picture is measured by them, so no folder of another program's is refused for their sake."""
    root = write_toy(tmp_path, samples=1)
    (root / "protocol.json").write_text(json.dumps(remark))
    assert load(root).protocol.extra == remark
    found = audit(root).kinds
    assert "protocol-invalid" not in found
    assert found["protocol-unknown-key"] == 1


@pytest.mark.parametrize(
    "measure",
    [{"samples": 0.15}, {"faces": True}, {"n_pixels": 256}, {"plate_id": 180}, {"scale": None}, {"flip": True}],
)
def test_what_may_be_a_measure_is_no_count(tmp_path, measure):
    path = tmp_path / "protocol.json"
    path.write_text(json.dumps(measure))
    with pytest.raises(BadTable, match="unknown key"):
        read_protocol(path)


@pytest.mark.parametrize(
    "text", ["{", "[" * 100_000, '{"px_per_m": NaN}', '{"px_per_m": 1e999}', "{}" + " " * (2 << 20)]
)
def test_hostile_protocols(tmp_path, text):
    path = tmp_path / "protocol.json"
    path.write_text(text)
    with pytest.raises(BadTable):
        read_protocol(path)


@pytest.mark.parametrize("text", ['{"px_per_m": 723, "px_per_m": 720}', '{"notes": {"a": 1, "a": 1}}'])
def test_a_key_is_given_once(tmp_path, text):
    path = tmp_path / "protocol.json"
    path.write_text(text)
    with pytest.raises(BadTable, match="stands twice"):
        read_protocol(path)


def test_remarks_are_kept(tmp_path):
    path = tmp_path / "protocol.json"
    remarks = {"sample": "cut with scissors", "camera": "Nikon", "effect": "perspective", "notes": [1, {"scale": 2}]}
    path.write_text(json.dumps(remarks))
    assert read_protocol(path).extra == remarks
    root = write_toy(tmp_path / "lab", samples=1, captures=1)
    (root / "protocol.json").write_text(json.dumps(remarks))
    unknown = [item.detail for item in audit(root).irregularities if item.kind == "protocol-unknown-key"]
    assert unknown == [f"{key} is kept but not used" for key in ("camera", "effect", "sample")]
    (root / "protocol.json").rename(root / "data" / "protocol.json")
    places = {item.path for item in audit(root).irregularities if item.kind == "protocol-unknown-key"}
    assert places == {"data/protocol.json"}


def test_the_documented_file_and_table_are_the_protocols(tmp_path):
    """The example of docs/drape-meter.md has every key and is read; so are the table's keys and defaults."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "drape-meter.md").read_text()
    path = tmp_path / "protocol.json"
    path.write_text(page.split("```json\n")[1].split("```")[0])
    known = {item.name for item in fields(Protocol)} - {"extra"} | {"notes"}
    assert json.loads(path.read_text()).keys() == known
    protocol = read_protocol(path)
    assert (protocol.projection, protocol.camera_height_m, protocol.image_y) == ("pinhole", 0.9, "down")
    assert protocol.extra["notes"]["humidity"] == 0.65
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| `") and line.count("|") == 6]
    table = {row[1].strip(" `"): row[3].strip() for row in rows}
    assert table.keys() == known
    shown = {name: json.loads(table[name]) for name in table if name != "captures" and table[name][0] in "0123456789["}
    assert len(shown) == 7
    for name, default in shown.items():
        assert json.loads(json.dumps(getattr(Protocol(), name))) == default, name
    assert (table["projection"], table["image_y"], table["foreground"]) == ("parallel", "up", "dark")


@pytest.mark.parametrize("protocol", [Protocol(), LARGE_IMAGES, SMALL_CLOTH, NEAR_CAMERA])
def test_a_protocol_is_written_as_it_is_read(tmp_path, protocol):
    (tmp_path / "protocol.json").write_text(json.dumps(protocol.document()))
    assert read_protocol(tmp_path / "protocol.json") == protocol


def test_protocol_defaults_and_spellings(tmp_path):
    path = tmp_path / "protocol.json"
    path.write_text('{"foreground": "1 - grey/255", "projection": "Perspective", "order": ["up"], "room": "3 b"}')
    protocol = read_protocol(path)
    assert (protocol.foreground, protocol.projection) == ("dark", "pinhole")
    assert protocol.extra == {"room": "3 b"}
    assert protocol.order == '["up"]'
    assert Protocol().px_per_m == 723
    assert Protocol().captures == {1: "up", 2: "up", 3: "down", 4: "down"}


def test_a_protocol_is_checked_whoever_makes_it():
    with pytest.raises(ValueError, match=r"px_per_m\n.*must be > 0"):
        Protocol(px_per_m=-1)
    with pytest.raises(ValueError, match="px_per_metre"):
        Protocol(**{"px_per_metre": 723})
    with pytest.raises(ValueError, match=r"must be below cloth_radius_m, got 0\.15 >= 0\.12"):
        replace(Protocol(), plate_radius_m=0.15, cloth_radius_m=0.12)
    assert replace(Protocol(), centre_px=(np.float64(120.0), 131.0)).centre_px == (120.0, 131.0)


def test_a_wrong_value_is_named_with_its_key_rule_and_file(tmp_path):
    path = tmp_path / "protocol.json"
    path.write_text('{"order": "1 first", "centre_px": [1, "2"]}')
    with pytest.raises(BadTable) as caught:
        read_protocol(path)
    assert str(caught.value) == f'{path}: centre_px must be a finite number, got [1, "2"]; correct it'
