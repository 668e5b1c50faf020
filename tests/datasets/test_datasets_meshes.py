"""Meshes beside silhouettes: turned, stray, of another capture or in another unit."""

from itertools import product

import pytest
from toy_cloths import (
    draw,
    image_path,
    mesh_path,
    misfit_px,
    surface,
    toy_profile,
    write_image,
    write_mesh,
    write_turned,
)

from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.profile import Profile


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turned_mesh_is_turned_back_and_noted(toy, turns):
    write_turned(mesh_path(toy, 2, 1), toy_profile(7, 2, 1), turns)
    corrected, plain = load(toy), load(toy, correct=False)
    row = 4
    assert corrected.index.loc[row, "mesh_rotation_deg"] == 360 - 90 * turns
    assert "turned" in corrected.index.loc[row, "notes"]
    assert misfit_px(corrected.sample(row)) < 0.5 < 4 < misfit_px(plain.sample(row))
    assert (plain.index["mesh_rotation_deg"] == 0).all()
    assert (corrected.index["mesh_rotation_deg"] != 0).sum() == 1
    assert corrected.content_hash != plain.content_hash


def test_meshes_of_another_capture_are_paired_again(toy):
    up, down = mesh_path(toy, 1, 1), mesh_path(toy, 1, 3)
    up_mesh = up.read_bytes()
    up.write_bytes(down.read_bytes())
    down.write_bytes(up_mesh)
    corrected = load(toy)
    assert corrected.index.loc[0, "mesh"].endswith("Sample_1_Capture_3.obj")
    assert corrected.index.loc[2, "mesh"].endswith("Sample_1_Capture_1.obj")
    assert "re-paired" in corrected.index.loc[0, "notes"]
    assert all(misfit_px(corrected.sample(row)) < 0.5 for row in range(12))
    assert load(toy, correct=False).index.loc[0, "mesh"].endswith("Sample_1_Capture_1.obj")
    assert (corrected.index["side"] == load(toy, correct=False).index["side"]).all()  # one sample is no majority


def test_a_mesh_of_another_drape_leaves_its_capture_without(toy):
    down = mesh_path(toy, 1, 3)
    down.write_bytes(mesh_path(toy, 1, 1).read_bytes())
    index = load(toy).index
    assert index.loc[2, "mesh"] == ""
    assert "fits" in index.loc[2, "notes"]
    assert index.loc[0, "mesh"].endswith("Sample_1_Capture_1.obj")


def test_a_stray_mesh_is_given_once(toy):
    mesh_path(toy, 1, 3).write_bytes(mesh_path(toy, 1, 1).read_bytes())
    for capture in (1, 2):  # it fits both, which are alike
        mesh_path(toy, 1, capture).unlink()
    meshes = list(load(toy).index["mesh"][:3])
    assert sorted(bool(mesh) for mesh in meshes) == [False, False, True]
    assert meshes[2] == ""


@pytest.mark.parametrize(("unit", "radius"), [(1e3, r"1[12]\d"), (1 / 0.0254, r"4\.\d+")])
def test_meshes_in_another_unit_are_left_out(toy, unit, radius):
    for path in toy.rglob("*.obj"):
        mesh = read_mesh(path)
        write_mesh(path, unit * mesh.vertices, mesh.faces)
    index = load(toy).index
    assert (index["mesh"] == "").all()
    assert index["notes"].str.contains(rf"^mesh left out: mean radius {radius} m, not in metres; scale it$").all()
    assert (index["side"] != "").all()
    assert (load(toy, correct=False).index["mesh"] != "").all()


def test_faces_are_unknown_where_meshes_contradict_the_numbers(toy):
    for sample in (1, 2, 3):
        for low, high in ((1, 3), (2, 4)):
            first, second = mesh_path(toy, sample, low), mesh_path(toy, sample, high)
            content = first.read_bytes()
            first.write_bytes(second.read_bytes())
            second.write_bytes(content)
    assert (load(toy).index["side"] == "").all()
    assert (load(toy, correct=("pairing", "rotation")).index["side"] != "").all()


def test_faces_stay_known_where_meshes_fit_pictures_of_unknown_face_best(toy):
    """A cloth that had settled before it was scanned: all faces became unknown, as if meshes contradicted them."""
    for sample, capture in product((1, 2, 3), (1, 2, 3, 4)):
        settled = Profile(toy_profile(7, sample, capture).radii - 8e-4)
        write_mesh(mesh_path(toy, sample, capture), *surface(settled))
        write_image(image_path(toy, sample, capture + 4), draw(settled))
    assert list(load(toy).index["side"]) == ["up", "up", "down", "down", "", "", "", ""] * 3
    assert "side-unknown" not in audit(toy).kinds


def test_off_centre_image_is_moved_only_if_asked(toy):
    path = image_path(toy, 1, 1)
    write_image(path, draw(toy_profile(7, 1, 1), centre=(129.5, 105.5)))
    plain, moved = load(toy), load(toy, correct=True)
    assert "off-centre" in plain.index.loc[0, "notes"]
    assert (plain.index["image_shift_rows_px"] == 0).all()
    assert moved.index.loc[0, "image_shift_rows_px"] == pytest.approx(22, abs=3)
    assert misfit_px(moved.sample(0)) < 3 < 8 < misfit_px(plain.sample(0))
    assert plain.index.loc[0, "mesh"] != ""  # its mesh is recognised although the image is off-centre
