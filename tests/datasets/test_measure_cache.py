"""Measures are kept by what decides them: the picture's content and the protocol that it is read by."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_cloths import draw, wavy_profile, write_image

from cusick_bench.datasets.files.measure import content_hash, measure_image
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.sim.constants import PIXELS_PER_METRE

PIXEL = 1 / PIXELS_PER_METRE  # [m]


@pytest.fixture
def picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(tmp_path / "cache"))
    write_image(tmp_path / "drape.png", draw(wavy_profile(7)))
    return tmp_path / "drape.png"


def test_a_changed_picture_is_measured_again(picture: Path):
    before, digest = measure_image(picture, Protocol()), content_hash(picture)
    assert before.profile.rms(wavy_profile(7)) < 0.2 * PIXEL
    write_image(picture, draw(wavy_profile(12)))
    assert content_hash(picture) != digest
    assert measure_image(picture, Protocol()).profile.rms(wavy_profile(12)) < 0.2 * PIXEL


def test_another_protocol_measures_the_same_picture_again(picture: Path):
    before = measure_image(picture, Protocol())
    double = replace(Protocol(), px_per_m=2 * PIXELS_PER_METRE, plate_radius_m=0.045, cloth_radius_m=0.075)
    assert measure_image(picture, double).profile.radii == pytest.approx(before.profile.radii / 2, abs=1e-12)


def test_a_camera_at_another_height_measures_the_same_picture_again(picture: Path):
    near, far = (
        measure_image(picture, replace(Protocol(), projection="pinhole", camera_height_m=height)).profile.radii.mean()
        for height in (0.5, 1.0)
    )
    assert near > far > measure_image(picture, Protocol()).profile.radii.mean()


def test_a_second_look_measures_nothing(picture: Path, monkeypatch: pytest.MonkeyPatch):
    before = measure_image(picture, Protocol())
    monkeypatch.setattr("cusick_bench.datasets.files.measure.inspect", None)
    assert np.array_equal(measure_image(picture, Protocol()).profile.radii, before.profile.radii)
