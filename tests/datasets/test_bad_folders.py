"""Folders with damaged, missing or forbidden files: an error says what and where, and nothing else is lost."""

import errno
import os
import pickle
import sys
from pathlib import Path

import pytest
from bad_images import BAD_IMAGES, DRAPE, write_any
from PIL import Image
from toy_cloths import draw, toy_profile, write_image, write_toy

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.errors import BadImage, BadMesh, DataNotFound
from cusick_bench.datasets.files.image import read_silhouette
from cusick_bench.datasets.files.layout import inside_root, scan
from cusick_bench.datasets.files.measure import measure_mesh
from cusick_bench.datasets.profile import Profile


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


@pytest.mark.parametrize(
    "name", ["Denim_a.png", "Fabric Denim/silhouettes/Sample_1.png", "Fabric 1/photos/Sample_1.jpg"]
)
def test_pictures_whose_names_say_no_fabric_are_named(tmp_path, name):
    """A folder full of pictures was said to hold none."""
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_bytes(b"a picture")
    for look in (load, audit):
        with pytest.raises(DataNotFound, match=f"but pictures whose names and folders do not say so: {name}; expected"):
            look(tmp_path)


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
