"""The audit: every kind of irregularity is named where it is planted, and nowhere else."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from toy_cloths import draw, surface, toy_profile, write_image, write_mesh, write_toy
from typer.testing import CliRunner

from cusick_bench.cli.data.data import app
from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.irregularity import KINDS

FABRIC = "data/Fabric 7"


@pytest.fixture
def lab(tmp_path) -> Path:
    root = write_toy(tmp_path)
    (root / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n7,0.2,0.0004\n")
    return root


def image(root: Path, sample: int, capture: int) -> Path:
    return root / FABRIC / "silhouettes" / f"Fabric_7_Sample_{sample}_Capture_{capture}.png"


def mesh(root: Path, sample: int, capture: int) -> Path:
    return root / FABRIC / "meshes" / f"Fabric_7_Sample_{sample}_Capture_{capture}.obj"


def write_checksums(root: Path) -> None:
    files = [path for path in root.rglob("*") if path.is_file()]
    digests = {path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    (root / "sha256.json").write_text(json.dumps(digests))


def found(root: Path, kind: str) -> list[str]:
    return [item.path for item in audit(root).irregularities if item.kind == kind]


def test_clean_folder_has_none(lab):
    result = audit(lab)
    assert (result.fabrics, result.samples, result.silhouettes, result.meshes) == (1, 3, 12, 12)
    assert result.kinds == {}


def _misspell(root: Path) -> str:
    (root / FABRIC / "silhouettes").rename(root / FABRIC / "silouettes")
    return f"{FABRIC}/silouettes"


def _misname_fabric(root: Path) -> str:
    mesh(root, 1, 1).rename(root / FABRIC / "meshes" / "Fabric_13_Sample_1_Capture_1.obj")
    return f"{FABRIC}/meshes/Fabric_13_Sample_1_Capture_1.obj"


def _misname_sample(root: Path) -> str:
    home = root / FABRIC / "Sample 4" / "silhouettes"
    home.mkdir(parents=True)
    shutil.copy(image(root, 3, 1), home / "Fabric_7_Sample_5_Capture_1.png")
    return f"{FABRIC}/Sample 4/silhouettes/Fabric_7_Sample_5_Capture_1.png"


def _no_number(root: Path) -> str:
    image(root, 1, 4).rename(root / FABRIC / "silhouettes" / "Fabric_7_Sample_1.png")
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_1.png"


def _zero(root: Path) -> str:
    image(root, 1, 1).rename(image(root, 0, 1))
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_0_Capture_1.png"


def _twice(root: Path) -> str:
    Image.open(image(root, 1, 1)).convert("RGB").save(image(root, 1, 1).with_suffix(".bmp"))
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_1_Capture_1.png"  # the later name


def _unused(root: Path) -> str:
    (root / "notes").mkdir()
    (root / "notes" / "diary.txt").write_text("it rained")
    return "notes"


def _missing_capture(root: Path) -> str:
    image(root, 2, 4).unlink()
    mesh(root, 2, 4).unlink()
    return FABRIC


def _extra_capture(root: Path) -> str:
    write_image(image(root, 2, 5), draw(toy_profile(7, 2, 5)))
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_2_Capture_5.png"


def _draw(sample: int, capture: int, change) -> "callable":  # pyright: ignore[reportGeneralTypeIssues]
    def plant(root: Path) -> str:
        write_image(image(root, sample, capture), change(draw(toy_profile(7, sample, capture))))
        return f"{FABRIC}/silhouettes/Fabric_7_Sample_{sample}_Capture_{capture}.png"

    return plant


def _with(pixels: np.ndarray, rows: slice, columns: slice, value: float) -> np.ndarray:
    changed = pixels.copy()
    changed[rows, columns] = value
    return changed


def _colour(root: Path) -> str:
    grey = np.asarray(Image.open(image(root, 1, 2)))
    Image.fromarray(np.dstack([np.maximum(grey, 60), grey, grey])).save(image(root, 1, 2))
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_1_Capture_2.png"


def _duplicate_image(root: Path) -> str:
    shutil.copy(image(root, 1, 1), image(root, 1, 2))
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_1_Capture_2.png"


def _shrink(pixels: np.ndarray) -> np.ndarray:
    grey = Image.fromarray(np.round(255 * (1 - pixels)).astype(np.uint8))
    small = np.asarray(grey.resize((150, 150)))
    large = np.full((256, 256), 255, dtype=np.uint8)
    large[53:203, 53:203] = small
    return 1 - large / 255


def _unlink_mesh(root: Path) -> str:
    mesh(root, 3, 2).unlink()
    return f"{FABRIC}/silhouettes/Fabric_7_Sample_3_Capture_2.png"


def _lone_mesh(root: Path) -> str:
    write_mesh(mesh(root, 3, 9), *surface(toy_profile(7, 3, 1)))
    return f"{FABRIC}/meshes/Fabric_7_Sample_3_Capture_9.obj"


def _topology(root: Path) -> str:
    vertices, faces = surface(toy_profile(7, 2, 2))
    write_mesh(mesh(root, 2, 2), np.vstack([vertices, vertices[-1]]), faces)
    return f"{FABRIC}/meshes/Fabric_7_Sample_2_Capture_2.obj"


def _millimetres(root: Path) -> str:
    vertices, faces = surface(toy_profile(7, 2, 2))
    write_mesh(mesh(root, 2, 2), 1000 * vertices, faces)
    return f"{FABRIC}/meshes/Fabric_7_Sample_2_Capture_2.obj"


def _turn(root: Path) -> str:
    vertices, faces = surface(toy_profile(7, 2, 2))
    write_mesh(mesh(root, 2, 2), vertices * [-1, -1, 1], faces)
    return f"{FABRIC}/meshes/Fabric_7_Sample_2_Capture_2.obj"


def _swap(root: Path) -> str:
    mesh(root, 1, 3).write_bytes(mesh(root, 1, 1).read_bytes())
    return f"{FABRIC}/meshes/Fabric_7_Sample_1_Capture_3.obj"


def _foreign_mesh(root: Path) -> str:
    write_mesh(mesh(root, 1, 1), *surface(toy_profile(9, 9, 1)))
    return f"{FABRIC}/meshes/Fabric_7_Sample_1_Capture_1.obj"


def _no_table(root: Path) -> str:
    (root / "fabrics.csv").unlink()
    return FABRIC


def _table(line: str):
    def plant(root: Path) -> str:
        with (root / "fabrics.csv").open("a") as file:
            file.write(line)
        return "fabrics.csv"

    return plant


def _protocol(document: dict) -> Callable[[Path], str]:
    def plant(root: Path) -> str:
        (root / "protocol.json").write_text(json.dumps(document))
        return "protocol.json"

    return plant


def _checksum(root: Path) -> str:
    write_checksums(root)
    (root / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n7,0.3,0.0004\n")
    return "fabrics.csv"


PLANTED = {
    "folder-misspelt": _misspell,
    "fabric-misnamed": _misname_fabric,
    "sample-misnamed": _misname_sample,
    "no-capture-number": _no_number,
    "number-zero": _zero,
    "duplicate-name": _twice,
    "unused-file": _unused,
    "missing-capture": _missing_capture,
    "extra-capture": _extra_capture,
    "image-colour": _colour,
    "specks": _draw(1, 2, lambda pixels: _with(pixels, slice(3, 6), slice(3, 6), 1)),
    "hole": _draw(1, 2, lambda pixels: _with(pixels, slice(120, 124), slice(90, 94), 0)),
    "touches-border": _draw(1, 2, lambda pixels: _with(pixels, slice(0, 128), slice(120, 136), 1)),
    "image-grey": _draw(1, 2, lambda pixels: 0.8 * pixels),
    "far-off-centre": _draw(1, 2, lambda pixels: np.roll(pixels, 30, axis=1)),
    "off-centre": _draw(1, 2, lambda pixels: np.roll(pixels, 22, axis=0)),
    "shrunken-image": _draw(1, 2, _shrink),
    "radius-beyond-cloth": _draw(1, 2, lambda pixels: _with(pixels, slice(10, 128), slice(120, 136), 1)),
    "duplicate-image": _duplicate_image,
    "no-mesh": _unlink_mesh,
    "no-silhouette": _lone_mesh,
    "mesh-topology": _topology,
    "mesh-units": _millimetres,
    "mesh-rotated": _turn,
    "mesh-other-capture": _swap,
    "duplicate-mesh": _swap,
    "mesh-matches-none": _foreign_mesh,
    "density-missing": _no_table,
    "thickness-missing": _no_table,
    "fabrics-invalid": _table("8,-1,\n"),
    "fabrics-unused": _table("8,0.3,\n"),
    "protocol-unknown-key": _protocol({"weather": "fine"}),
    "protocol-centre": _protocol({"centre_px": [132, 122]}),
    "protocol-scale": _protocol({"px_per_m": 560}),
    "checksum": _checksum,
}


@pytest.mark.parametrize("kind", PLANTED)
def test_planted_irregularity_is_named_where_it_is(lab, kind):
    path = PLANTED[kind](lab)
    assert found(lab, kind) == [path]


def test_a_scale_that_is_too_large_is_told_by_the_plate(lab):
    (lab / "protocol.json").write_text('{"px_per_m": 1000, "cloth_radius_m": 0.12}')
    (fault,) = [item for item in audit(lab).irregularities if item.kind == "protocol-scale"]
    assert "the scale may be too large" in fault.detail


def test_series_named_in_two_ways(tmp_path):
    home = tmp_path / "data" / "Fabric 1 Observations"
    for folder, image_word, numbers in (
        ("Sample 1", "Obs", (1, 2)),
        ("Sample_2", "Observation", (1, 2, 3)),
        ("Sample_3", "Obs", (1, 2)),
    ):
        sample = int(folder[-1])
        for number in numbers:
            profile = toy_profile(1, sample, 1)
            write_image(
                home / folder / "silhouettes" / f"Fabric_1_Sample_{sample}_{image_word}_{number}.png", draw(profile)
            )
            write_mesh(home / folder / "meshes" / f"Fabric_1_Sample_{sample}_Obs_{number}.obj", *surface(profile))
    assert found(tmp_path, "folder-inconsistent") == ["data/Fabric 1 Observations"]
    assert found(tmp_path, "space-in-path") == ["data/Fabric 1 Observations/Sample 1"]
    assert found(tmp_path, "file-inconsistent") == [
        "data/Fabric 1 Observations",
        "data/Fabric 1 Observations/Sample_2",
    ]
    assert len(found(tmp_path, "extra-capture")) == 1
    assert found(tmp_path, "side-unknown") == []


def test_a_capture_that_every_sample_has_is_not_called_unusual(tmp_path):
    """Their faces are what is not known; every sample was said to have captures beyond the usual ones."""
    root = write_toy(tmp_path, fabrics=(7,))
    for sample in (1, 2, 3):
        write_image(image(root, sample, 5), draw(toy_profile(7, sample, 5)))
    write_image(image(root, 2, 6), draw(toy_profile(7, 2, 6)))
    told = {one.path[-len("1_Capture_5.png") :]: one.detail for one in audit(root).irregularities
            if one.kind == "extra-capture"}  # fmt: skip
    unknown = "no face is known of capture 5; `captures` in protocol.json says that of 1, 2, 3, 4"
    assert told == {f"{sample}_Capture_5.png": unknown for sample in (1, 2, 3)} | {
        "2_Capture_6.png": "most other samples have no capture 6"
    }


def test_fabric_without_capture_numbers(tmp_path):
    for sample in (1, 2):
        write_image(
            tmp_path / "data/Fabric 21/silhouettes" / f"Fabric_21_Sample_{sample}.png", draw(toy_profile(1, sample, 1))
        )
    assert found(tmp_path, "no-capture-number") == ["data/Fabric 21"]
    assert found(tmp_path, "side-unknown") == ["data/Fabric 21"]
    assert found(tmp_path, "no-mesh") == ["data/Fabric 21"]  # once, not per image
    index = load(tmp_path).index
    assert list(index["capture"]) == [1, 1]
    assert list(index["side"]) == ["", ""]


def test_a_malformed_protocol_blames_no_picture(lab):
    """All were held against the release's values, and said to be of another size, or inverted."""
    for path in (lab / FABRIC / "silhouettes").iterdir():
        write_image(path, 1 - (1 - np.asarray(Image.open(path)) / 255))  # light cloth
    write_image(image(lab, 1, 5), draw(toy_profile(7, 1, 5)))
    mesh(lab, 1, 1).unlink()
    (lab / "protocol.json").write_text('{"foreground": "light", "captures": {"5": "up"}, "humidity": 0.65}')
    result = audit(lab)
    assert result.kinds == {"no-mesh": 2, "extra-capture": 1, "protocol-invalid": 1}
    assert result.impossible == ()
    (told,) = [item.detail for item in result.irregularities if item.kind == "protocol-invalid"]
    assert told.endswith("; until it is mended no picture and no mesh is measured")


def test_a_malformed_table_takes_no_weight_from_other_fabrics(lab):
    """One bad line, and all fabrics were said to have no weight."""
    with (lab / "fabrics.csv").open("a") as file:
        file.write("8,180,\n")
    (told,) = audit(lab).irregularities
    assert told.kind == "fabrics-invalid"
    assert told.detail.startswith("line 3: areal density must be at most 5.0 kg/m2, got 180; until it is mended ")


def test_silk_and_mesh_are_cloths_too(lab):
    """Their folders were said to be misspelt, and what silk lacks to be lacking in the folder above."""
    for cloth in ("silk", "mesh polyester"):
        for sample in (1, 2):
            name = f"sample_{sample}_Upward_Drape_1.png"
            write_image(lab / "bnn_image_gt" / cloth / name, draw(toy_profile(8, sample, 1)))
    (lab / "data").rename(lab / "silk mill")
    assert found(lab, "folder-misspelt") == []
    assert found(lab, "density-missing") == ["bnn_image_gt/mesh polyester", "bnn_image_gt/silk"]


def test_meshes_that_all_differ_have_no_usual_size(lab):
    """All but one were told what most meshes have, which one of twelve had."""
    for place, path in enumerate(sorted((lab / FABRIC / "meshes").iterdir())):
        path.write_text(path.read_text() + place * "v 0 0 0\n")
    assert found(lab, "mesh-topology") == []


def test_named_sets(tmp_path):
    root = write_toy(tmp_path, fabrics=(2,))
    named = root / "bnn_image_gt" / "cotton_blue"
    named.mkdir(parents=True)
    home = root / "data/Fabric 2/silhouettes"
    shutil.copy(home / "Fabric_2_Sample_1_Capture_1.png", named / "cotton_blue_sample_1_Upward_Drape_1.png")
    Image.open(home / "Fabric_2_Sample_2_Capture_3.png").save(
        named / "cotton_blue_sample_2_Downward_Drape_1.jpg", quality=90
    )
    write_image(named / "cotton_blue_sample_3_Upward_Drape_1_Obs_4.png", draw(toy_profile(9, 9, 1)))
    assert found(root, "named-copy") == ["bnn_image_gt/cotton_blue/cotton_blue_sample_1_Upward_Drape_1.png"]
    assert found(root, "named-near-copy") == ["bnn_image_gt/cotton_blue/cotton_blue_sample_2_Downward_Drape_1.jpg"]
    assert found(root, "named-unmatched") == ["bnn_image_gt/cotton_blue/cotton_blue_sample_3_Upward_Drape_1_Obs_4.png"]
    assert found(root, "mixed-faces") == found(root, "mixed-observations") == ["bnn_image_gt/cotton_blue"]
    assert audit(root).silhouettes == 12  # copies are not counted
    assert audit(root / "bnn_image_gt").silhouettes == 3


def test_files_that_the_checksums_do_not_list_are_named(lab):
    write_checksums(lab)
    assert audit(lab).kinds == {}
    added = [write(lab, 4, 1) for write in (image, mesh)]
    write_image(added[0], draw(toy_profile(7, 4, 1)))
    write_mesh(added[1], *surface(toy_profile(7, 4, 1)))
    assert sorted(found(lab, "checksum")) == sorted(path.relative_to(lab).as_posix() for path in added)


def test_a_file_that_cannot_be_compared_hides_no_other_one(lab):
    """Its fault was told of sha256.json, and no changed or missing file was; a long name ended in an OSError."""
    write_checksums(lab)
    listed = json.loads((lab / "sha256.json").read_text())
    (lab / "sha256.json").write_text(json.dumps({"a" * 300: "0" * 64} | listed))
    with image(lab, 1, 1).open("wb") as file:
        file.truncate((64 << 20) + 1)  # more than is read
    image(lab, 1, 2).unlink()
    shutil.copy(image(lab, 2, 2), image(lab, 2, 1))
    told = {item.path: item.detail for item in audit(lab).irregularities if item.kind == "checksum"}
    large, gone, changed = (image(lab, *numbers).relative_to(lab).as_posix() for numbers in ((1, 1), (1, 2), (2, 1)))
    assert set(told) == {"a" * 300, large, gone, changed}
    assert told["a" * 300].startswith("cannot be read (")
    assert "far more than any silhouette" in told[large]
    assert (told[gone], told[changed]) == ("is missing", "differs from its SHA-256")


def test_every_kind_is_documented_and_tested():
    elsewhere = {
        "space-in-path", "folder-inconsistent", "file-inconsistent", "outside-link", "no-permission", "side-unknown",
        "mixed-faces", "mixed-observations", "unreadable-image", "image-too-large", "image-size", "empty-image",
        "full-image", "inverted-image", "two-blobs", "named-copy", "named-near-copy", "named-unmatched",
        "unreadable-mesh", "mesh-too-large", "protocol-invalid",
    }  # fmt: skip
    assert set(PLANTED) | elsewhere == set(KINDS)


def test_command_prints_the_documented_keys(lab):
    result = CliRunner().invoke(app, ["audit", str(lab), "--json"])
    document = json.loads(result.stdout)
    assert result.exit_code == 0
    assert list(document) == ["fabrics", "samples", "silhouettes", "meshes", "irregularities", "impossible"]
    assert document["irregularities"] == []
    (lab / "protocol.json").write_text('{"weather": "fine"}')
    again = json.loads(CliRunner().invoke(app, ["audit", str(lab), "--json"]).stdout)
    assert again["irregularities"] == [
        {"path": "protocol.json", "kind": "protocol-unknown-key", "detail": "weather is kept but not used"}
    ]
    shown = CliRunner().invoke(app, ["audit", str(lab)])
    assert "12 silhouettes" in shown.stdout
    assert "protocol-unknown-key" in shown.stdout
    missing = CliRunner().invoke(app, ["audit", str(lab / "nowhere")])
    assert missing.exit_code == 2


def test_command_shortens_long_lists_unless_asked(lab):
    for sample in (1, 2, 3):
        for capture in (1, 2, 3, 4):
            mesh(lab, sample, capture).unlink()
    write_mesh(mesh(lab, 1, 1), *surface(toy_profile(7, 1, 1)))
    short, full = (CliRunner().invoke(app, ["audit", str(lab), *more]).stdout for more in ([], ["--all"]))
    assert "8 more" in short
    assert "more" not in full
    assert full.count("silhouette without mesh") == 11
