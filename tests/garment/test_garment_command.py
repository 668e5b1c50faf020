"""The command `garment skirt`."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence
from typer.testing import CliRunner
from worn_skirts import learned_posterior, skirt_cell

from cusick_bench.cli import app
from cusick_bench.garment import Body, WaistMotion
from cusick_bench.garment.measurement import seen_from_above, seen_from_front
from cusick_bench.garment.output import write_motion, write_rest
from cusick_bench.garment.pictures import draw_skirt, reach
from cusick_bench.garment.skirt import SkirtSize, circular_skirt
from cusick_bench.sim.cloth.obj import read_obj

NUMBERS = ["--density", "0.2", "--bending", "1e-5"]
SMALL = ["--vertices", "160", "--length", "0.3", "--hip", "0.13"]


def _run(*arguments: str):
    return CliRunner().invoke(app, ["garment", "skirt", *arguments])


def test_command_writes_meshes_pictures_motion_and_numbers(tmp_path: Path):
    result = _run(
        *NUMBERS, *SMALL, "--kind", "a-line", "--hem", "0.2", "--draws", "2", "--dynamic", "--duration", "0.4", "--out",
        str(tmp_path / "out"), "--json",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    folder = tmp_path / "out"
    assert json.loads((folder / "summary.json").read_text())["spread"] == document["spread"]
    assert [draw["draw"] for draw in document["draws"]] == [0, 1]
    assert 0.1 < document["spread"]["mean"]["hem_radius_m"] < 0.2
    assert document["spread"]["vertex_sd_rms_m"] > 0
    positions, faces = read_obj(folder / "draw_0001.obj")
    assert len(positions) == document["vertices"]
    assert len(faces) == document["faces"]
    with np.load(folder / "motion.npz") as motion:
        assert motion["positions"].shape == (document["motion"]["frames"], 2, document["vertices"], 3)
        np.testing.assert_allclose(motion["positions"][0, 1], positions, atol=1e-5)
        assert motion["times"][[0, -1]] == pytest.approx([0, 0.4 + 0.8])  # of the motion, and until it settles
    for name in ("draw_0000.png", "draw_0000_above.png", "draw_0000_front.png", "turntable.png", "motion.png"):
        with Image.open(folder / name) as picture:
            assert np.asarray(picture.convert("L")).min() < 200  # not empty
    with Image.open(folder / "turntable.gif") as animation:
        assert sum(1 for _ in ImageSequence.Iterator(animation)) == 18


@pytest.mark.parametrize(
    ("kind", "measures"), [("circular", {"waist", "length"}), ("a-line", {"waist", "length", "hem"})]
)
def test_sizes_are_those_that_the_cut_uses(kind: str, measures: set[str]):
    result = _run(*NUMBERS, *SMALL, "--kind", kind, "--draws", "1", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["size"].keys() == measures


def test_command_gives_the_same_numbers_for_the_same_seed_and_others_for_another(tmp_path: Path):
    cell = str(skirt_cell(tmp_path / "a", **learned_posterior()))
    same, again, other = (
        json.loads(_run("--from", cell, *SMALL, "--draws", "2", "--seed", seed, "--json").stdout)
        for seed in ("3", "3", "4")
    )
    assert same["draws"] == again["draws"] != other["draws"]
    assert same["draws"][0] != dict(same["draws"][1], draw=0)
    assert same["stiffness_from"] == "posterior"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give either --from RESULT"),
        (["--from", "nowhere", *NUMBERS], "give either --from RESULT"),
        (["--from", "nowhere"], "no result at nowhere"),
        (["--density", "0.2"], "both --density and --bending"),
        (["--density", "-1", "--bending", "1e-5"], "areal density must be from 0.005 to 5.0 kg/m2, got -1"),
        (["--density", "0.2", "--bending", "1,2"], "one number or three"),
        ([*NUMBERS, "--law", "plate"], "skirts hang by law paper"),
        ([*NUMBERS, "--law", "published"], "tables are for law paper"),
        ([*NUMBERS, "--draws", "0"], "number of draws must be at least 1"),
        ([*NUMBERS, "--kind", "a-line", "--hem", "0.1"], "wider than its waist"),
        ([*NUMBERS, "--hem", "0.3"], "--hem is about an A-line skirt, and a circular one is waist + length wide"),
        ([*NUMBERS, "--length", "-1"], "length must be > 0"),
        ([*NUMBERS, "--kind", "a-line", "--hip", "0.4"], "must fit into the skirt"),
        ([*NUMBERS, "--hip", "0.05"], "waist <= hip"),
        ([*NUMBERS, "--vertices", "20"], "at least 150 vertices"),
        ([*NUMBERS, "--waist", "0.001"], "too coarse for a waist of 0.001 m in radius"),
        ([*NUMBERS, "--kind", "a-line", "--waist", "0.001"], "too coarse for a waist"),
        (
            [*NUMBERS, "--kind", "a-line", "--hem", "0.12", "--length", "1.2", "--vertices", "200"],
            "too coarse for so long and narrow a skirt",
        ),
        ([*NUMBERS, "--heterogeneity", "-0.1"], "spread of log stiffness"),
        ([*NUMBERS, "--motion", "sway"], "--motion is about a waist that moves; leave it out, or give --dynamic"),
        ([*NUMBERS, "--amplitude", "0.1"], "--amplitude is about a waist that moves"),
        ([*NUMBERS, "--period", "1.2"], "--period is about a waist that moves"),
        ([*NUMBERS, "--duration", "2.4"], "--duration is about a waist that moves"),
        (["--from", "nowhere", "--stretch", "300"], "--stretch is about a cloth given by numbers; leave it out"),
        (["--from", "nowhere", "--shear", "60"], "--shear is about a cloth given by numbers"),
        ([*NUMBERS, "--dynamic", "--period", "0"], "period and duration > 0"),
        ([*NUMBERS, "--dynamic", "--period", "0.04"], "period of the waist's motion must be at least 0.2 s"),
        ([*NUMBERS, "--dynamic", "--duration", "0.02"], "duration of the waist's motion must be at least 0.1 s, five"),
        ([*NUMBERS, "--laying-height", "5"], "the laying height must be from 0 to 0.1 m, got 5"),
        ([*NUMBERS, "--laying-height", "-0.01"], "the laying height must be from 0 to 0.1 m, got -0.01"),
        (
            [*NUMBERS, *SMALL, "--draws", "1", "--dynamic", "--amplitude", "20", "--duration", "0.5"],
            "a skirt flies apart at 0.14 s; move the waist less or slower",
        ),
    ],
)
def test_command_refuses_bad_input(arguments: list[str], message: str):
    result = _run(*arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())


@pytest.mark.slow
def test_nothing_of_an_earlier_skirt_stays_beside_a_new_one(tmp_path: Path):
    folder = tmp_path / "out"
    arguments = [*NUMBERS, *SMALL, "--out", str(folder)]
    assert _run(*arguments, "--draws", "2", "--dynamic", "--duration", "0.1").exit_code == 0
    (folder / "notes.txt").write_text("mine")
    result = _run(*arguments, "--draws", "1")
    assert result.exit_code == 0, result.output
    left = {path.name for path in folder.iterdir()}
    assert {"draw_0000.obj", "summary.json", "notes.txt"} <= left
    assert not [name for name in left if name.startswith(("draw_0001", "motion"))]


@pytest.mark.parametrize(("pictures", "in_strip"), [(1, 1), (4, 4), (6, 6), (18, 6)])
def test_the_turntable_may_have_few_pictures(tmp_path: Path, pictures: int, in_strip: int):
    skirt = circular_skirt(SkirtSize(length=0.3), 150)
    write_rest(tmp_path, skirt, skirt.start[None], "blue", None, pictures=pictures)
    with Image.open(tmp_path / "turntable.png") as strip, Image.open(tmp_path / "draw_0000.png") as one:
        assert strip.size == (in_strip * one.width, one.height)


def test_silhouettes_are_dark_cloth_on_white_and_lie_under_their_own_names(tmp_path: Path):
    skirt = circular_skirt(SkirtSize(length=0.3), 150)
    x = skirt.start * [0.9, 0.6, 1] + [0, 0, -0.1]
    write_rest(tmp_path, skirt, x[None], "blue", None, pictures=1)
    for name, seen in (("above", seen_from_above(skirt, x)), ("front", seen_from_front(skirt, x))):
        with Image.open(tmp_path / f"draw_0000_{name}.png") as picture:
            np.testing.assert_array_equal(np.asarray(picture), np.round(255 * (1 - seen)))
    assert seen_from_above(skirt, x).sum() > 2 * seen_from_front(skirt, x).sum()


@pytest.mark.parametrize(("frames", "shown"), [(5, 5), (10, 5)])
def test_an_animation_lasts_as_long_as_the_motion(frames: int, shown: int, tmp_path: Path):
    skirt, motion = circular_skirt(SkirtSize(length=0.3), 150), WaistMotion(sway=0.1)
    times = 0.08 * np.arange(frames)
    x = np.stack([skirt.start + motion.pose(time)[1] for time in times])[:, None]
    write_motion(tmp_path, skirt, times, x, motion, "blue", None, most_pictures=5)
    with Image.open(tmp_path / "motion.gif") as animation:
        seconds = [image.info["duration"] / 1000 for image in ImageSequence.Iterator(animation)]
    assert len(seconds) == shown
    assert sum(seconds) == pytest.approx(0.08 * frames)


@pytest.mark.parametrize(
    ("size", "hip", "sway"),
    [(SkirtSize(0.11, 0.1), 0.13, 0.0), (SkirtSize(0.4, 0.3), 0.0, 0.0), (SkirtSize(0.11, 0.3), 0.6, 0.0),
     (SkirtSize(0.11, 0.3), 0.13, 0.5)],
)  # fmt: skip
def test_a_skirt_that_is_wide_or_sways_far_stands_whole_in_its_picture(size: SkirtSize, hip: float, sway: float):
    skirt = circular_skirt(size, 200)
    shift = np.array([sway, 0.0, 0.0])
    body = Body(size.waist, hip) if hip else None
    picture = draw_skirt(skirt, skirt.start + shift, "blue", body, pose=(np.eye(3), shift))
    opaque = picture[..., 3] == 255
    assert opaque.any()
    assert not opaque[[0, -1]].any()
    assert not opaque[:, [0, -1]].any()


def test_skirts_that_are_drawn_together_have_one_scale():
    skirt = circular_skirt(SkirtSize(length=0.3), 200)
    narrow = skirt.start * [0.5, 0.5, 1]
    alone, beside_wide, beside_farthest = (
        (draw_skirt(skirt, narrow, "blue", farthest=farthest)[..., 3] == 255).any(0).sum()
        for farthest in (None, reach(skirt.start), 2 * reach(skirt.start))
    )
    assert alone > beside_wide > 1.5 * beside_farthest
