"""What planting an effect does to pictures and labels."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_controls import CLOTH, radii

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.diagnosis.controls.known_answers import SHIFT_DIRECTION, controls_of
from cusick_bench.diagnosis.controls.pictures import (
    GrainTurn,
    Magnification,
    MirroredFace,
    OtherCut,
    PictureChange,
    Shift,
    View,
)
from cusick_bench.diagnosis.controls.planted_data import (
    captures_shuffled,
    halves_as_faces,
    planted,
    rendered,
    two_observations,
)
from cusick_bench.diagnosis.measure.captures import read_captures


def harmonic(profile: np.ndarray, order: int) -> complex:
    """c_m of r = Re sum c_m exp(-i m theta)."""
    return complex(2 * np.conj(np.fft.rfft(profile)[order]) / len(profile))


def row_of(data: DrapeDataset, side: str) -> int:
    return int(np.flatnonzero(data.table["side"] == side)[0])


def seen(data: DrapeDataset, change: PictureChange, row: int) -> np.ndarray:
    return radii(planted(data, change), row)


class TestPictures:
    def test_a_shift_moves_the_middle_of_the_cloth(self, fabric):
        size = np.arange(fabric.protocol.image_size_px)
        moved = planted(fabric, Shift(3.0, SHIFT_DIRECTION))
        for row in (0, 3):
            middles = []
            for data in (fabric, moved):
                image = data.image(row).numpy()
                middles.append(np.array([image.sum(0) @ size, -image.sum(1) @ size]) / image.sum())
            angle = np.deg2rad(SHIFT_DIRECTION)
            assert middles[1] - middles[0] == pytest.approx([3 * np.cos(angle), 3 * np.sin(angle)], abs=0.02)

    @pytest.mark.parametrize("error", [0.03, -0.02])
    def test_a_scale_multiplies_the_radii(self, fabric, error):
        ratio = seen(fabric, Magnification(error), 0) / radii(fabric, 0)
        assert ratio == pytest.approx(1 + error, abs=0.004)
        assert ratio.mean() == pytest.approx(1 + error, abs=3e-4)

    @pytest.mark.parametrize(("side", "sign"), [("up", 1), ("down", -1)])
    def test_a_turn_goes_with_the_cloth(self, fabric, side, sign):
        """Counter-clockwise face up, clockwise face down: the phases of all harmonics turn, their sizes stay."""
        row = row_of(fabric, side)
        before, after = radii(fabric, row), seen(fabric, GrainTurn(5.0), row)
        for order in range(4, 10):
            turned = harmonic(before, order) * np.exp(1j * order * sign * np.deg2rad(5.0))
            assert harmonic(after, order) == pytest.approx(turned, abs=3e-5)

    def test_a_turn_is_the_same_on_both_faces_in_the_cloths_frame(self, fabric):
        plain, turned = read_captures(fabric, CLOTH), read_captures(planted(fabric, GrainTurn(5.0)), CLOTH)
        expected = np.roll(plain.cloth_frame(), 5, axis=1)
        assert np.abs(turned.cloth_frame() - expected).mean() < 1e-4  # a fourteenth of a pixel

    @pytest.mark.parametrize("outwards", [1.0, 2.0, -1.0])
    def test_another_cut_moves_the_edge_of_a_disc(self, fabric, outwards):
        protocol, radius = fabric.protocol, 90.0
        at = np.hypot(*np.meshgrid(*[np.arange(protocol.image_size_px) - protocol.centre_px[0]] * 2))
        disc = np.clip(0.5 + radius - at, 0, 1)
        cut = profile_of(OtherCut(outwards)(disc, View(1, "up", protocol)), protocol).radii * protocol.px_per_m
        assert cut == pytest.approx(radius + outwards, abs=0.15)  # rays cross an edge of pixels
        assert cut.mean() == pytest.approx(radius + outwards - 2**2 / (2 * radius), abs=0.03)  # blur moves a bent edge

    def test_mirroring_one_face_leaves_the_other(self, fabric):
        up, down = row_of(fabric, "up"), row_of(fabric, "down")
        mirrored = planted(fabric, MirroredFace())
        assert (mirrored.image(up) == fabric.image(up)).all()
        assert mirrored.image(down).numpy() == pytest.approx(fabric.image(down).numpy()[:, ::-1], abs=1e-6)
        twice = planted(mirrored, MirroredFace()).image(down)  # a planted set keeps its own change only
        assert twice.numpy() == pytest.approx(mirrored.image(down).numpy())

    @pytest.mark.parametrize(("step", "offset"), [(1, 0), (2, -1), (2, 0)])
    def test_half_of_the_samples_are_mirrored_however_they_are_numbered(self, under_control, step, offset):
        """Of samples 1, 3, 5, ... no number is even, of 2, 4, 6, ... every one."""
        table = under_control.data.table.assign(sample=step * under_control.data.table["sample"] + offset)
        data = replace(under_control.data, table=table)
        controls, _ = controls_of(replace(under_control, data=data), ["mirror"])
        half = next(one for one in controls if one.level == "every second sample")
        changed = {
            int(table["sample"].iloc[row])
            for row in np.flatnonzero(table["side"] == "down")
            if not (half.data.image(row) == data.image(row)).all()
        }
        numbers = sorted(set(table["sample"]))
        assert changed == set(numbers[1::2])

    def test_every_second_sample_is_mirrored(self, fabric):
        halved = planted(fabric, MirroredFace(2))
        changed = {
            int(halved.table["sample"].iloc[row])
            for row in np.flatnonzero(fabric.table["side"] == "down").tolist()
            if not np.allclose(halved.image(row), fabric.image(row))
        }
        assert changed == {2, 4, 6, 8, 10, 12}

    def test_a_picture_whose_y_points_down_is_turned_the_same_way_about_the_cloth(self, fabric):
        flipped = replace(fabric.protocol, image_y="down", centre_px=(127.5, 127.5))
        image = fabric.image(0).numpy()
        for change in (GrainTurn(5.0), Shift(3.0, 70.0)):
            up = change(image, View(1, "up", fabric.protocol))
            down = change(image[::-1], View(1, "up", flipped))
            assert down[::-1] == pytest.approx(up, abs=1e-6)


class TestLabels:
    def test_shuffling_keeps_every_picture_with_its_sample(self, fabric):
        for across in (False, True):
            dealt = captures_shuffled(fabric, np.random.default_rng(0), across_faces=across)
            labels = ["sample", "side", "capture"]
            before, after = (data.table[labels].apply(tuple, axis=1).tolist() for data in (fabric, dealt))
            assert sorted(before) == sorted(after)
            assert before != after
            assert (dealt.table["image"] == fabric.table["image"]).all()
            assert (dealt.table["sample"] == fabric.table["sample"]).all()
            assert bool((dealt.table["side"] == fabric.table["side"]).all()) is not across
        assert np.sort(radii(dealt, 0)) == pytest.approx(np.sort(radii(fabric, 0)))

    def test_halves_are_samples_of_one_face(self, fabric):
        dealt = halves_as_faces(fabric, "down", np.random.default_rng(1)).table
        originals = fabric.table[fabric.table["side"] == "down"]
        assert sorted(dealt["image"]) == sorted(originals["image"])
        faces = dealt.groupby("sample")["side"].nunique()
        assert set(faces) == {1}
        assert dealt.groupby("side")["sample"].nunique().to_dict() == {"up": 6, "down": 6}

    def test_two_observations_of_a_series(self, fabric):
        numbers = np.tile([1, 2, 3, 5], len(fabric) // 4)
        series = replace(fabric, table=fabric.table.assign(observation=numbers))
        assert set(two_observations(series, 1, 5).table["observation"]) == {1, 5}

    def test_meshes_look_as_their_pictures_and_smaller_from_near(self, fabric):
        apparent = [radii(rendered(fabric, inverse), 0) for inverse in (0.0, 1 / 0.7)]
        assert np.abs(apparent[0] - radii(fabric, 0)).mean() < 5e-4
        ratio = apparent[1] / apparent[0]
        assert ratio.max() < 1.0
        assert ratio.min() > 0.7 / (0.7 + 0.06) - 0.01  # the overhang is 6 cm
