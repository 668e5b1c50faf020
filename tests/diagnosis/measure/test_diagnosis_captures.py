"""Captures of a diagnosis: read with their labels, turned into the cloth's frame, slips left out and said."""

from math import pi

import numpy as np
import pytest
from jaxtyping import TypeCheckError
from toy_cloths import draw, toy_profile, write_image, write_toy

from cusick_bench.datasets import load
from cusick_bench.datasets.profile import drape_coefficient
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import ANGLES, captures_from_profiles, read_captures
from cusick_bench.diagnosis.measure.statistics import (
    NAMES,
    capture_statistics,
)

THETA = np.arange(ANGLES) * (2 * pi / ANGLES)


def statistic(values, name):
    return values[..., NAMES.index(name)]


def fabric(radii, sample, side, capture, **known):
    return captures_from_profiles(
        radii, sample=np.array(sample), side=np.array(side, dtype=str), capture=np.array(capture), **known
    )


def test_profiles_of_more_angles_are_taken_at_whole_degrees():
    fine = 0.12 + 0.004 * np.cos(np.arange(720) * pi / 360 - 0.3)
    captures = fabric(fine[None], [1], ["up"], [1])
    assert captures.radii[0] == pytest.approx(0.12 + 0.004 * np.cos(THETA - 0.3), abs=1e-15)
    assert captures.area[0] == pytest.approx(pi * (0.12**2 + 0.004**2 / 2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radii": np.full((2, 100), 0.1)}, "multiple of 360"),
        ({"radii": np.zeros((2, ANGLES))}, "> 0 m"),
        ({"radii": np.full((2, ANGLES), np.nan)}, "finite"),
        ({"side": ["up", "front"]}, "front"),
        ({"sample": np.array([1])}, "sample"),
    ],
)
def test_captures_that_cannot_be(change, message):
    usual = {"radii": np.full((2, ANGLES), 0.1), "sample": np.array([1, 2]), "side": ["up", "up"]}
    with pytest.raises((DiagnosisError, TypeCheckError), match=message):  # whichever looks first
        captures_from_profiles(**{**usual, "capture": np.array([1, 1]), **change})


def toy_folder(tmp_path, **shape):
    root = write_toy(tmp_path / "toy", meshes=False, **shape)
    return root, root / "data" / "Fabric 7" / "silhouettes"


def test_captures_are_read_with_their_labels(tmp_path):
    root, _ = toy_folder(tmp_path, samples=3)
    dataset = load(root)
    captures = read_captures(dataset, "fabric_7")
    assert (len(captures), captures.notes) == (12, ())
    assert captures.sample.tolist() == [1] * 4 + [2] * 4 + [3] * 4
    assert captures.side.tolist() == ["up", "up", "down", "down"] * 3
    assert captures.capture.tolist() == [1, 2, 3, 4] * 3
    truth = toy_profile(7, 2, 3).radii[::2]
    assert captures.radii[6] == pytest.approx(truth, abs=5e-4)
    image = dataset.image(6).numpy()
    assert captures.area[6] == pytest.approx(pi * 0.09**2 + drape_coefficient(image) * pi * (0.15**2 - 0.09**2))
    # What the profile says of the area is what the image says.
    assert statistic(capture_statistics(captures.radii), "area_dc")[6] == pytest.approx(
        drape_coefficient(image), abs=1e-3
    )


def test_observations_over_time_are_in_the_order_in_which_they_were_made(tmp_path):
    home = tmp_path / "data/Fabric 1 Observations"
    for number in (1, 2, 10):
        path = home / "Sample 1" / "silhouettes" / f"Fabric_1_Sample_1_Obs_{number}.png"
        write_image(path, draw(toy_profile(1, 1, number)))
    captures = read_captures(load(tmp_path), "fabric_1_observations")
    assert captures.capture.tolist() == [1, 2, 10]
    assert set(captures.side.tolist()) == {"up"}


def test_single_slips_are_left_out_and_said(tmp_path):
    root, folder = toy_folder(tmp_path, samples=4)
    (folder / "Fabric_7_Sample_1_Capture_1.png").write_bytes(b"no image")
    write_image(folder / "Fabric_7_Sample_2_Capture_4.png", draw(toy_profile(7, 2, 4), centre=(90.0, 127.5)))
    captures = read_captures(load(root), "fabric_7")
    assert len(captures) == 14
    assert not ((captures.sample == 2) & (captures.capture == 4)).any()
    notes = "\n".join(captures.notes)
    assert "Sample_1_Capture_1.png" in notes
    assert "Sample_2_Capture_4.png: off-centre" in notes


def test_what_all_images_share_is_no_slip(tmp_path):
    root, folder = toy_folder(tmp_path, samples=3)
    for path in sorted(folder.iterdir()):
        sample, capture = int(path.stem.split("_")[3]), int(path.stem.split("_")[5])
        write_image(path, draw(toy_profile(7, sample, capture), centre=(102.0, 127.5)))
    captures = read_captures(load(root), "fabric_7")
    assert len(captures) == 12
    assert captures.notes == ("12 of 12 images are off-centre, but like the others; kept",)


def test_the_tail_of_a_wide_spread_is_no_slip(tmp_path):
    root, folder = toy_folder(tmp_path, samples=5)
    for sample, column in zip(range(1, 6), (105.0, 115.0, 127.5, 140.0, 150.0), strict=True):  # 127.5 is the axis
        for capture in range(1, 5):
            path = folder / f"Fabric_7_Sample_{sample}_Capture_{capture}.png"
            write_image(path, draw(toy_profile(7, sample, capture), centre=(column, 127.5)))
    captures = read_captures(load(root), "fabric_7")
    assert len(captures) == 20
    assert "off-centre, but like the others" in captures.notes[0]


def test_a_fabric_without_a_usable_image_is_refused(tmp_path):
    root, folder = toy_folder(tmp_path, samples=2)
    dataset = load(root)
    for path in folder.iterdir():
        path.write_bytes(b"no image")
    with pytest.raises(DiagnosisError, match="no silhouette of fabric_7 can be used"):
        read_captures(dataset, "fabric_7")


def test_unknown_faces_are_said(tmp_path):
    root, folder = toy_folder(tmp_path, samples=2)
    (root / "protocol.json").write_text('{"captures": {"1": "up", "2": "up", "3": "", "4": ""}}')
    assert any("face of 4 of 8 images is unknown" in note for note in read_captures(load(root), "fabric_7").notes)
    assert folder.is_dir()
