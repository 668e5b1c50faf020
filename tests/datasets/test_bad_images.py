"""Damaged, odd and hostile images: a clear error that says what, where and what to do."""

import pickle
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from bad_images import BAD_IMAGES, DRAPE, Exploit, with_blob, write_any
from PIL import Image
from toy_cloths import write_image

from cusick_bench.datasets.errors import BadImage
from cusick_bench.datasets.files.image import read_silhouette
from cusick_bench.datasets.files.protocol import MAXIMUM_SIZE, Protocol


@pytest.mark.parametrize("kind", BAD_IMAGES)
def test_bad_images_are_refused(tmp_path, kind):
    path = tmp_path / "drape.png"
    write_any(path, BAD_IMAGES[kind])
    with pytest.raises(BadImage) as caught:
        read_silhouette(path)
    assert caught.value.kind == kind
    assert str(path) in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(("foreground", "kind"), [("dark", "full-image"), ("light", "empty-image")])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_a_mask_of_0_and_1_is_told_its_levels(tmp_path, foreground, kind, depth):
    path = tmp_path / "mask.png"
    Image.fromarray((DRAPE >= 0.5).astype(depth)).save(path)
    with pytest.raises(BadImage, match="levels reach only 1 of 255; save the mask as 0 and 255") as caught:
        read_silhouette(path, Protocol(foreground=foreground))
    assert caught.value.kind == kind


@pytest.mark.parametrize("content", [b"", pickle.dumps(Exploit()), b"\x89PNG\r\n\x1a\n", b"GIF89a" + b"\0" * 50])
def test_hostile_images_are_only_unreadable(tmp_path, monkeypatch, content):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "drape.jpg"
    path.write_bytes(content)
    with pytest.raises(BadImage, match="cannot be decoded"):
        read_silhouette(path)
    assert not (tmp_path / "exploited").exists()


def test_the_largest_size_of_a_protocol_is_read(tmp_path):
    scale = MAXIMUM_SIZE / 256
    centre = ((MAXIMUM_SIZE - 1) / 2, (MAXIMUM_SIZE - 1) / 2)
    protocol = Protocol(image_size_px=MAXIMUM_SIZE, px_per_m=723 * scale, centre_px=centre)
    image = Image.fromarray(np.round(255 * (1 - DRAPE)).astype(np.uint8))
    image.resize((MAXIMUM_SIZE, MAXIMUM_SIZE), Image.Resampling.NEAREST).save(tmp_path / "large.png")
    assert read_silhouette(tmp_path / "large.png", protocol).shape == (MAXIMUM_SIZE, MAXIMUM_SIZE)
    with pytest.raises(ValueError, match=f"from 16 to {MAXIMUM_SIZE}"):
        Protocol(image_size_px=MAXIMUM_SIZE + 1, px_per_m=723 * scale, centre_px=centre)


@pytest.mark.parametrize(("suffix", "channels", "depth"), [("bmp", 3, np.uint8), ("tif", 1, np.uint16)])
def test_the_largest_size_of_a_protocol_is_read_without_compression(tmp_path, suffix, channels, depth):
    """Colours of 8 bits, or grey of 16, were said to be no silhouette from 3345 or 4096 pixels on."""
    centre = ((MAXIMUM_SIZE - 1) / 2, (MAXIMUM_SIZE - 1) / 2)
    protocol = Protocol(image_size_px=MAXIMUM_SIZE, px_per_m=723 * MAXIMUM_SIZE / 256, centre_px=centre)
    levels = np.full((MAXIMUM_SIZE, MAXIMUM_SIZE), np.iinfo(depth).max, depth)
    levels[MAXIMUM_SIZE // 4 : -MAXIMUM_SIZE // 4, MAXIMUM_SIZE // 4 : -MAXIMUM_SIZE // 4] = 0
    path = tmp_path / f"large.{suffix}"
    Image.fromarray(levels if channels == 1 else np.repeat(levels[..., None], channels, axis=2)).save(path)
    assert path.stat().st_size > 32 << 20  # or the test tries nothing
    assert read_silhouette(path, protocol).mean() == pytest.approx(0.25)
    with path.open("ab") as file:
        file.truncate((64 << 20) + 1)
    with pytest.raises(BadImage, match=r"has 67108865 bytes; at most 67108864 are read; save it as PNG") as caught:
        read_silhouette(path, protocol)
    assert caught.value.kind == "image-too-large"


@pytest.mark.parametrize("suffix", ["jpg", "png", "bmp", "tif"])
def test_files_that_are_cut_short_are_unreadable(tmp_path, suffix):
    path = tmp_path / f"drape.{suffix}"
    write_image(path, DRAPE)
    whole = path.read_bytes()
    for length in (len(whole) - 200, len(whole) // 2):
        path.write_bytes(whole[:length])
        with pytest.raises(BadImage) as caught:
            read_silhouette(path)
        assert caught.value.kind == "unreadable-image"


def test_transparency_that_would_be_lost_is_refused(tmp_path):
    grey = Image.fromarray(np.round(255 * (1 - DRAPE)).astype(np.uint8))
    opaque = Image.new("L", grey.size, 255)
    for mode in ("LA", "RGBA"):
        image = grey.convert(mode)
        image.putalpha(opaque)
        image.save(tmp_path / f"{mode}.png")
        assert np.abs(read_silhouette(tmp_path / f"{mode}.png") - DRAPE).max() < 0.004, mode
        image.save(tmp_path / f"{mode}.tif")
        with pytest.raises(BadImage, match=f"TIFF of mode {mode} with transparency.* save it as a grey or RGB image"):
            read_silhouette(tmp_path / f"{mode}.tif")


def test_images_that_threads_read_leave_the_warnings_of_the_process_as_they_were(tmp_path, monkeypatch):
    """The second began before the first ended, took its silence for the process's and put that back."""
    write_image(tmp_path / "drape.png", DRAPE)
    first, second, done = (threading.Event() for _ in range(3))
    opened = Image.open

    def slowly(*words, **named):
        if first.is_set():
            second.set()
            done.wait(60)
        else:
            first.set()
            second.wait(0.5)  # in vain where the second waits for its turn
        return opened(*words, **named)

    monkeypatch.setattr(Image, "open", slowly)
    with warnings.catch_warnings(), ThreadPoolExecutor(2) as pool:
        filters = list(warnings.filters)
        earlier = pool.submit(read_silhouette, tmp_path / "drape.png")
        assert first.wait(60)
        later = pool.submit(read_silhouette, tmp_path / "drape.png")
        earlier.result()
        done.set()
        later.result()
        assert warnings.filters == filters


def test_pixels_are_read_as_they_are_stored(tmp_path):
    """Colours in their order, whatever a camera's note on its orientation says."""
    colours = np.full((256, 256, 3), 255, dtype=np.uint8)
    colours[60:200, 60:180] = 0, 40, 90
    note = Image.Exif()
    note[0x112] = 6  # turned by 90 deg
    Image.fromarray(colours).save(tmp_path / "drape.png", exif=note.tobytes())
    expected = 1 - colours @ np.array([0.299, 0.587, 0.114]) / 255
    np.testing.assert_allclose(read_silhouette(tmp_path / "drape.png"), expected, atol=1e-12)


@pytest.mark.parametrize("level", [np.nan, np.inf])
def test_levels_that_are_no_numbers_are_refused(tmp_path, level):
    """ImageJ marks background as NaN: the drape coefficient of the whole fabric was NaN, without a word."""
    levels = np.where(DRAPE >= 0.5, 0, 255).astype(np.float32)
    levels[:3, :3] = level
    Image.fromarray(levels).save(tmp_path / "drape.tif")
    with pytest.raises(BadImage, match="holds levels that are no numbers; save it as a grey or RGB image"):
        read_silhouette(tmp_path / "drape.tif")


@pytest.mark.parametrize("white", [1.0, 255.0, 65535.0])
@pytest.mark.parametrize("overshoot", [0.0, 0.004, 0.2])
def test_floating_point_levels_of_any_usual_scale_are_read(tmp_path, white, overshoot):
    """Sharp filters carry levels a little beyond white and black when they scale an image."""
    levels = (1 - DRAPE) * white
    levels[:4] += overshoot * white
    levels[levels == 0] -= overshoot * white
    Image.fromarray(levels.astype(np.float32)).save(tmp_path / "drape.tif")
    np.testing.assert_allclose(read_silhouette(tmp_path / "drape.tif"), DRAPE, atol=1e-6)


def test_whole_levels_that_slightly_exceed_255_are_no_16_bit(tmp_path):
    levels = np.round(255 * (1 - DRAPE)).astype(np.int32)
    levels[:4] += 9
    Image.fromarray(levels).save(tmp_path / "drape.tif")
    assert np.abs(read_silhouette(tmp_path / "drape.tif") - DRAPE).max() < 0.004


@pytest.mark.parametrize("white", [100_000, 2**31 - 1])
def test_levels_beyond_16_bits_are_refused(tmp_path, white):
    """All above 65535 was taken for white, and every rim lay half a pixel too far in."""
    Image.fromarray(np.round(white * (1 - DRAPE)).astype(np.int32)).save(tmp_path / "drape.tif")
    with pytest.raises(BadImage, match=rf"levels up to {white}, of which none is known to be white; .* 8 or 16 bits"):
        read_silhouette(tmp_path / "drape.tif")


@pytest.mark.parametrize("turn", [3, 6])
def test_a_tiff_file_that_is_to_be_turned_is_refused(tmp_path, turn):
    """OpenCV turns it, and only it: the same picture as JPEG had another warp."""
    grey = Image.fromarray(np.round(255 * (1 - DRAPE)).astype(np.uint8))
    grey.save(tmp_path / "upright.tif", tiffinfo={0x112: 1})
    assert np.abs(read_silhouette(tmp_path / "upright.tif") - DRAPE).max() < 0.004
    grey.save(tmp_path / "turned.tif", tiffinfo={0x112: turn})
    with pytest.raises(BadImage, match=rf"\(orientation {turn}\); turn the pixels themselves"):
        read_silhouette(tmp_path / "turned.tif")


@pytest.mark.parametrize(("foreground", "level"), [("dark", 0), ("light", 255)])
def test_transparent_parts_are_background(tmp_path, foreground, level):
    """A light cloth on nothing was said to be all cloth."""
    opacity = np.round(255 * DRAPE).astype(np.uint8)
    Image.fromarray(np.dstack([np.full_like(opacity, level)] * 3 + [opacity])).save(tmp_path / "drape.png")
    image = read_silhouette(tmp_path / "drape.png", Protocol(foreground=foreground))
    assert np.abs(image - DRAPE).max() < 0.004


def test_a_frame_is_told_as_an_object_and_not_as_an_inverted_image(tmp_path):
    """The advice to set `foreground` made a cloth of what lies between frame and cloth."""
    framed = DRAPE.copy()
    framed[[0, -1]] = framed[:, [0, -1]] = 1
    write_image(tmp_path / "framed.png", framed)
    with pytest.raises(BadImage, match=r"2 separate objects .* erase what is not the cloth") as caught:
        read_silhouette(tmp_path / "framed.png")
    assert caught.value.kind == "two-blobs"


def test_specks_are_forgiven_and_grey_colour_and_alpha_are_read_alike(tmp_path):
    grey = np.round(255 * (1 - DRAPE)).astype(np.uint8)
    plain = Image.fromarray(grey)
    alpha = Image.fromarray(np.dstack([np.zeros_like(grey)] * 3 + [255 - grey]))  # black cloth on nothing
    wide = Image.fromarray(grey.astype(np.uint16) * 257)
    for name, image in (("grey", plain), ("rgb", plain.convert("RGB")), ("alpha", alpha), ("wide", wide)):
        path = tmp_path / f"{name}.png"
        image.save(path)
        assert np.abs(read_silhouette(path) - DRAPE).max() < 0.004, name
    write_image(tmp_path / "speck.png", with_blob(3))
    assert read_silhouette(tmp_path / "speck.png")[5, 5] == 1
