"""Damaged, odd and hostile files: a clear error that says what, where and what to do; nothing else is lost."""

import errno
import gzip
import os
import pickle
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from toy_cloths import draw, toy_profile, wavy_profile, write_image, write_toy

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.errors import BadImage, BadMesh, DataNotFound
from cusick_bench.datasets.files.image import read_silhouette
from cusick_bench.datasets.files.layout import inside_root, scan
from cusick_bench.datasets.files.measure import measure_mesh
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import MAXIMUM_SIZE, Protocol
from cusick_bench.datasets.profile import Profile

DRAPE = draw(wavy_profile(7))


class Exploit:
    """Unpickling this would leave a trace."""

    def __reduce__(self):
        return (os.mkdir, ("exploited",))


def huge_png() -> bytes:
    """A few hundred bytes that claim 30000 x 30000 pixels."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", 30000, 30000, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")
    )


def with_blob(pixels: int) -> np.ndarray:
    image = DRAPE.copy()
    image[4 : 4 + pixels, 4 : 4 + pixels] = 1
    return image


BAD_IMAGES = {
    "unreadable-image": b"this is no image",
    "image-too-large": huge_png(),
    "image-size": np.zeros((128, 128)),
    "empty-image": np.zeros((256, 256)),
    "full-image": np.ones((256, 256)),
    "inverted-image": 1 - DRAPE,
    "two-blobs": with_blob(20),
}


def write_any(path: Path, content: bytes | np.ndarray) -> None:
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        write_image(path, content)


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


BAD_MESHES = {
    "no text": b"\x00\xff\xfe binary",
    "no faces": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "two corners": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n",
    "missing vertex": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
    "vertex zero": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
    "word": b"v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "two coordinates": b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n",
    "not finite": b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "pickle": pickle.dumps(Exploit()),
}


@pytest.mark.parametrize("fault", BAD_MESHES)
def test_bad_meshes_are_refused(tmp_path, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "drape.obj"
    path.write_bytes(BAD_MESHES[fault])
    with pytest.raises(BadMesh) as caught:
        read_mesh(path)
    assert caught.value.kind == "unreadable-mesh"
    assert str(path) in str(caught.value)
    assert not (tmp_path / "exploited").exists()


def test_huge_meshes_are_not_read(tmp_path, monkeypatch):
    bomb = tmp_path / "drape.obj.gz"
    bomb.write_bytes(gzip.compress(b"v 0 0 0\n" * 10_000_000))
    assert bomb.stat().st_size < 1 << 20
    with pytest.raises(BadMesh) as caught:
        read_mesh(bomb)
    assert caught.value.kind == "mesh-too-large"
    (tmp_path / "broken.obj.gz").write_bytes(b"no gzip")
    with pytest.raises(BadMesh, match="cannot be read"):
        read_mesh(tmp_path / "broken.obj.gz")
    sparse = tmp_path / "drape.obj"
    with sparse.open("wb") as file:
        file.truncate(1 << 33)
    with pytest.raises(BadMesh, match="64 MiB"):
        read_mesh(sparse)


def test_obj_variants(tmp_path):
    path = tmp_path / "square.obj"
    path.write_text(
        "# quad\no cloth\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nf 1/1 2/1 3/1 4//1\n"
    )
    mesh = read_mesh(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.vertices[2].tolist() == [1, 1, 0]
    path.write_text("v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nf -3 -2 -1\r\n")
    assert read_mesh(path).faces.tolist() == [[0, 1, 2]]


def test_one_bad_file_stops_nothing_but_its_own_sample(tmp_path):
    root = write_toy(tmp_path)
    silhouettes = root / "data/Fabric 7/silhouettes"
    (silhouettes / "Fabric_7_Sample_1_Capture_2.png").write_bytes(b"junk")
    (root / "data/Fabric 7/meshes/Fabric_7_Sample_2_Capture_1.obj").write_bytes(b"junk")
    dataset = load(root)
    assert len(dataset) == 12
    assert "unreadable-image" in dataset.index.loc[1, "notes"]
    with pytest.raises(BadImage):
        dataset.sample(1)
    sample = dataset.sample(4)
    with pytest.raises(BadMesh):
        _ = sample.mesh
    assert dataset.sample(2).mesh is not None
    with pytest.raises(DataError, match="cannot be decoded"):
        load(root, strict=True)
    kinds = audit(root).kinds
    assert kinds["unreadable-image"] == kinds["unreadable-mesh"] == 1


@pytest.mark.parametrize("kind", BAD_IMAGES)
def test_audit_names_every_bad_image(tmp_path, kind):
    root = write_toy(tmp_path, samples=2, meshes=False)
    write_any(root / "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_2.png", BAD_IMAGES[kind])
    found = [item for item in audit(root).irregularities if item.kind == kind]
    assert [item.path for item in found] == ["data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_2.png"]


def test_missing_and_empty_folders(tmp_path):
    for look in (load, audit):
        with pytest.raises(DataNotFound, match=r"nowhere: no such folder .* give a folder, or one of synthetic"):
            look(tmp_path / "nowhere")
        with pytest.raises(DataNotFound, match="holds no silhouettes; expected"):
            look(tmp_path)
    file = tmp_path / "file"
    file.write_text("x")
    with pytest.raises(DataNotFound, match="is a file, not a folder"):
        load(file)


@pytest.mark.parametrize("suffix", [".webp", ".HEIC"])
def test_a_folder_of_pictures_in_a_format_that_is_not_read(tmp_path, suffix):
    folder = tmp_path / "data" / "Fabric 2" / "silhouettes"
    folder.mkdir(parents=True)
    for capture in (1, 2):
        (folder / f"Fabric_2_Sample_1_Capture_{capture}{suffix}").write_bytes(b"a picture")
    for look in (load, audit):
        with pytest.raises(
            DataNotFound, match=rf"pictures as {suffix.lower()}: .*_Capture_1{suffix}.*save them as PNG"
        ):
            look(tmp_path)


@pytest.mark.parametrize(("suffix", "kind"), [(".png", "unreadable-image"), (".obj", "unreadable-mesh")])
def test_files_of_a_disk_that_fails_do_not_stop_an_audit(tmp_path, monkeypatch, suffix, kind):
    root, opened = write_toy(tmp_path), Path.open

    def fails(path, *words, **options):
        if path.name == f"Fabric_7_Sample_1_Capture_2{suffix}":
            raise OSError(errno.EIO, "Input/output error")
        return opened(path, *words, **options)

    monkeypatch.setattr(Path, "open", fails)
    assert audit(root).kinds[kind] == 1


@pytest.mark.parametrize(("suffix", "error"), [(".png", BadImage), (".obj", BadMesh)])
def test_a_file_that_the_system_refuses_is_told_with_its_mode(tmp_path, monkeypatch, suffix, error):
    """As the next test, which root cannot run, nor a container whose user is root."""
    root, name = write_toy(tmp_path), f"Fabric_7_Sample_1_Capture_2{suffix}"

    def refusing(opened):
        def refuses(path, *words, **options):
            if Path(path).name == name:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return opened(path, *words, **options)

        return refuses

    monkeypatch.setattr(Path, "open", refusing(Path.open))
    monkeypatch.setattr(Image, "open", refusing(Image.open))
    assert audit(root).kinds["no-permission"] == 1
    read = read_silhouette if suffix == ".png" else measure_mesh
    with pytest.raises(error, match="change its mode") as caught:
        read(next(root.rglob(name)))
    assert caught.value.kind == "no-permission"


def test_a_folder_that_the_system_refuses_is_told(tmp_path, monkeypatch):
    root, scanned = write_toy(tmp_path), os.scandir

    def refuses(path="."):
        if Path(path).name == "meshes":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return scanned(path)

    monkeypatch.setattr(os, "scandir", refuses)
    told = [item.path for item in audit(root).irregularities if item.kind == "no-permission"]
    assert told == ["data/Fabric 7/meshes"]
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(DataNotFound, match="may not be read; change its mode") as caught:
        load(root)
    assert caught.value.kind == "no-permission"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_files_that_may_not_be_read(tmp_path):
    root = write_toy(tmp_path)
    path = root / "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_2.png"
    path.chmod(0)
    assert audit(root).kinds["no-permission"] == 1
    with pytest.raises(BadImage, match="change its mode"):
        load(root).sample(1)
    (root / "data").chmod(0)
    assert audit(root).kinds["no-permission"] == 1
    (root / "data").chmod(0o755)


def test_links_and_paths_out_of_the_folder_are_refused(tmp_path):
    outside = write_toy(tmp_path / "outside")
    root = write_toy(tmp_path / "lab")
    silhouettes = root / "data/Fabric 7/silhouettes"
    (silhouettes / "Fabric_7_Sample_9_Capture_1.png").symlink_to(
        outside / "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_1.png"
    )
    (root / "data" / "Fabric 8").symlink_to(outside / "data" / "Fabric 7")
    layout = scan(root)
    assert len(layout.silhouettes) == 12
    assert sorted(problem.kind for problem in layout.problems) == ["outside-link", "outside-link"]
    for path in ("../outside/secret.png", "/etc/passwd", "data/../../outside/x.obj"):
        with pytest.raises(DataError, match="must stay within"):
            inside_root(layout.root, path)


@pytest.mark.parametrize("name", ["data", "data/Fabric 7"])
def test_data_that_are_linked_from_elsewhere_are_not_found(tmp_path, name):
    outside = write_toy(tmp_path / "outside")
    link = tmp_path / "lab" / name
    link.parent.mkdir(parents=True)
    link.symlink_to(outside / name)
    with pytest.raises(DataNotFound, match=f"{name}: linked folder is not followed, .*; copy into the folder"):
        load(tmp_path / "lab")
    assert audit(tmp_path / "lab").kinds["outside-link"] == 1


def test_what_is_left_out_beside_data_is_said(tmp_path, caplog):
    outside, root = write_toy(tmp_path / "outside"), write_toy(tmp_path / "lab")
    (root / "data" / "Fabric 8").symlink_to(outside / "data" / "Fabric 7")
    assert len(load(root)) == 12
    assert "Fabric 8: linked folder is not followed" in caplog.text


@pytest.mark.parametrize(
    "name",
    [
        "data/Fabric 7/silhouettes/Fabric_7_Sample_0_Capture_1.png",
        "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_0.png",
        "data/Fabric 7/meshes/Fabric_7_Sample_1_Capture_00.obj",
        "data/Fabric 0/silhouettes/Fabric_0_Sample_1_Capture_1.png",
        "data/Fabric 7 Observations/Sample_0/silhouettes/Obs_1.png",
        "data/Fabric 7 Observations/Sample_1/silhouettes/Obs_0.png",
    ],
)
def test_numbers_begin_at_1(tmp_path, name):
    root = write_toy(tmp_path / "Sample 0 of test")
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes((root / "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_2.png").read_bytes())
    with pytest.raises(DataError, match=f"{name}: a number is 0, and numbers begin at 1; rename the files") as caught:
        load(root)
    assert caught.value.kind == "number-zero"
    assert audit(root).kinds["number-zero"] == 1
    path.unlink()
    assert len(load(root)) == 12


@pytest.mark.parametrize("name", ["Fabric 0/silhouettes", "Fabric 0"])
def test_numbers_of_a_root_begin_at_1(tmp_path, name):
    write_image(tmp_path / "Fabric 0" / "silhouettes" / "Sample_1_Capture_1.png", DRAPE)
    with pytest.raises(DataError, match="numbers begin at 1"):
        load(tmp_path / name)


@pytest.mark.parametrize("name", ["plots/sample_0.png", "data/Fabric 7/silhouettes/Fabric_7_Sample_010_Capture_01.png"])
def test_zeros_elsewhere_are_no_numbers(tmp_path, name):
    root = write_toy(tmp_path)
    (root / name).parent.mkdir(exist_ok=True)
    write_image(root / name, DRAPE)
    assert len(load(root)) == 12 + name.startswith("data")


def test_errors_travel_between_processes():
    error = BadImage("shows no cloth", where="a.png", remedy="take it again", kind="empty-image")
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error) == "a.png: shows no cloth; take it again"
    assert (copy.kind, copy.where) == ("empty-image", "a.png")


def test_a_cloth_beyond_the_image_ends_at_its_border(tmp_path):
    root = write_toy(tmp_path, samples=1, meshes=False)
    path = root / "data/Fabric 7/silhouettes/Fabric_7_Sample_1_Capture_1.png"
    write_image(path, draw(Profile(toy_profile(7, 1, 1).radii + 0.065)))
    assert audit(root).kinds["touches-border"] == 1
    assert load(root).sample(0).profile.radii.max() <= 181 / 723


@pytest.mark.skipif(sys.platform != "linux", reason="other file systems have names in Unicode only")
@pytest.mark.parametrize("part", ["folder", "image", "mesh"])
def test_a_name_that_is_no_text_is_told(part, tmp_path):
    """Of an archive with names in another encoding; the table of silhouettes could not be made."""
    root = write_toy(tmp_path / "lab", fabrics=(7,))
    named = {
        "folder": root,
        "image": next(root.glob("data/*/silhouettes/*")),
        "mesh": next(root.glob("data/*/meshes/*")),
    }[part]
    odd = named.rename(named.with_name(os.fsdecode(os.fsencode(named.stem) + b"_\xe9" + os.fsencode(named.suffix))))
    with pytest.raises(DataError, match="name must be UTF-8; rename it") as caught:
        load(odd if part == "folder" else root)
    assert caught.value.where.startswith(str(odd))
