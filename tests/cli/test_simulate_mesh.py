"""A cloth of one's own in `simulate`: seen whole and measured by its own size, as the standard's 24 and 36 cm are."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets.files.image import read_silhouette
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import drape_coefficient_of, profile_of
from cusick_bench.datasets.profile import drape_coefficient
from cusick_bench.sim.cloth.obj import write_obj
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import IMAGE_SIZE
from cusick_bench.sim.render.camera import PinholeCamera

pytestmark = pytest.mark.usefixtures("one_thread")


def _simulate(folder: Path, radius: float, *words: str) -> dict:
    mesh = ring_mesh(120, radius=radius)
    write_obj(folder / "disc.obj", mesh.flat, mesh.faces)
    command = ["simulate", "--density", "0.2", "--steps", "3", "--mesh", str(folder / "disc.obj"), "--out", str(folder)]
    result = CliRunner().invoke(app, [*command, "--json", *words])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.parametrize("law", ["plate", "paper"])
@pytest.mark.parametrize("radius", [0.12, 0.15, 0.18])
def test_a_board_of_any_size_has_a_drape_coefficient_of_one(radius: float, law: str, tmp_path: Path):
    found = _simulate(tmp_path, radius, "--bending", "0.1", "--law", law)
    assert found["drape_coefficient"] == pytest.approx(1, abs=0.03)  # the rim is a polygon
    assert found["draws"][0]["mean_radius_m"] == pytest.approx(radius, rel=0.01)


def test_a_board_that_a_pinhole_camera_sees_has_a_drape_coefficient_of_one(tmp_path: Path):
    found = _simulate(tmp_path, 0.15, "--bending", "0.1", "--camera", "pinhole")
    assert found["draws"][0]["mean_radius_m"] == pytest.approx(0.15, rel=0.005)
    assert found["drape_coefficient"] == pytest.approx(1, abs=0.03)


def test_a_pinhole_camera_measures_the_drape_that_a_parallel_one_does(tmp_path: Path):
    found = {}
    for camera in ("parallel", "pinhole"):
        command = ["simulate", "--density", "0.2", "--bending", "1e-5", "--vertices", "150", "--steps", "60", "--json"]
        result = CliRunner().invoke(app, [*command, "--camera", camera, "--out", str(tmp_path / camera)])
        assert result.exit_code == 0, result.output
        found[camera] = json.loads(result.stdout)
    parallel, pinhole = found["parallel"], found["pinhole"]
    assert pinhole["drape_coefficient"] == pytest.approx(parallel["drape_coefficient"], abs=0.02)
    assert pinhole["folds"] == parallel["folds"]
    radii = [one["draws"][0]["mean_radius_m"] for one in (parallel, pinhole)]
    assert radii[0] == pytest.approx(radii[1], abs=1e-3)

    camera = PinholeCamera()
    scale = camera.focal_px / camera.eye_height_m
    protocol = Protocol(projection="pinhole", camera_height_m=camera.eye_height_m, px_per_m=scale)
    picture = read_silhouette(tmp_path / "pinhole" / "drape_0000.png", protocol)
    assert drape_coefficient(picture, pixels_per_metre=scale) < parallel["drape_coefficient"] - 0.05  # as it appears
    assert drape_coefficient_of(picture, protocol) == pytest.approx(pinhole["drape_coefficient"], abs=1e-3)
    table = np.loadtxt(tmp_path / "pinhole" / "drape_0000_profile.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(profile_of(picture, protocol).radii, table[:, 1], atol=1e-3)


def test_pictures_are_the_releases_unless_the_cloth_is_too_large_for_them(tmp_path: Path):
    for radius, larger in ((0.15, False), (0.18, True)):
        _simulate(tmp_path, radius, "--bending", "0.1")
        with Image.open(tmp_path / "drape_0000.png") as picture:
            assert (picture.size[0] > IMAGE_SIZE) == larger
            assert picture.getpixel((0, picture.size[1] // 2)) == 255


@pytest.mark.parametrize(
    ("effects", "radius"),
    [
        (["camera-scale:error=0.2"], 0.18),
        (["camera-scale:error=0.2", "camera-offset:shift=0.03,direction=200"], 0.18),
        (["plate-slip:slide=0.02", "camera-scale:error=0.1"], 0.165),
    ],
)
def test_pictures_hold_all_that_effects_show(effects: list[str], radius: float, tmp_path: Path):
    words = [word for effect in effects for word in ("--with-effect", effect)]
    found = _simulate(tmp_path, 0.15, "--bending", "0.1", "--draws", "2", *words)
    share = (radius**2 - 0.09**2) / (0.15**2 - 0.09**2)
    assert found["drape_coefficient"] == pytest.approx(share, abs=0.04)  # the rim is a polygon
    for name in ("drape_0000.png", "drape_0001.png"):
        with Image.open(tmp_path / name) as picture:
            shades = np.asarray(picture)
            rim = {*shades[0].tolist(), *shades[:, 0].tolist(), *shades[-1].tolist(), *shades[:, -1].tolist()}
            assert rim == {255}, "nothing is cut off"


@pytest.mark.parametrize("words", [["--mode", "drop"], ["--self-contact", "0.002"]])
def test_two_ways_to_ask_for_self_contact_do_not_hide_each_other(words: list[str]):
    command = ["simulate", "--density", "0.2", "--bending", "1e-4", "--vertices", "100", *words]
    result = CliRunner().invoke(app, [*command, "--with-effect", "self-contact:thickness=0.001"])
    assert result.exit_code == 2
    assert words[0] in result.output


def test_fewer_draws_leave_no_files_of_an_earlier_run_and_touch_no_others(tmp_path: Path):
    (tmp_path / "drape_0001.txt").write_text("mine")
    for draws, names in (("3", ["drape_0000", "drape_0001", "drape_0002"]), ("1", ["drape_0000"])):
        _simulate(tmp_path, 0.15, "--bending", "0.1", "--draws", draws)
        for ending in (".obj", ".png", "_profile.csv"):
            assert sorted(path.name for path in tmp_path.glob(f"drape_*{ending}")) == [name + ending for name in names]
    assert (tmp_path / "drape_0001.txt").read_text() == "mine"
