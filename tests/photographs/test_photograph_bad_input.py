"""What cannot be prepared is refused in one line that says the picture, the rule and the remedy."""

import os
import shutil

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.pictures import find_pictures
from cusick_bench.photographs.preparation.setting_text import SettingText, setting_of
from cusick_bench.photographs.preparation.weights import weights_of_options
from cusick_bench.photographs.reading import read_photograph
from cusick_bench.photographs.studio.scene import bare_plate, make_laboratory
from cusick_bench.photographs.studio.shot import photograph

GREY = np.full((400, 500, 3), 128, np.uint8)


def _folder(tmp_path, *names):
    folder = tmp_path / "photographs"
    folder.mkdir()
    for name in names:
        cv2.imwrite(str(folder / name), GREY)
    return folder


def _contents(folder):
    return sorted(path.name for path in folder.iterdir())


def _refused(folder, tmp_path, *options):
    result = CliRunner().invoke(app, ["data", "prepare", str(folder), "--out", str(tmp_path / "set"), *options])
    assert result.exit_code == 2, result.output
    assert not (tmp_path / "set").exists()
    return " ".join(result.output.split())


DRAPE = "Fabric_1_Sample_1_Capture_1.jpg"


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ([], "holds no photographs of drapes"),
        (["plate.jpg"], "holds no photographs of drapes"),
        ([DRAPE], "holds no ruler"),
        ([DRAPE, "board-1.jpg", "plate.jpg"], "but none of the board on the plate (board-plane.jpg)"),
        (["IMG_2041.jpg", "plate.jpg"], "does not say which fabric and sample"),
        ([DRAPE, "fabric 1 sample 0.jpg", "plate.jpg"], "fabric 1 sample 0.jpg: numbers of fabric, sample and capture"),
        (["Fabric_1_Sample_1_Capture_0.jpg", "plate.jpg"], "begin at 1, got 0; rename the pictures"),
        ([DRAPE, "fabric 1 sample 1.png", "plate.jpg"], "is Fabric_1_Sample_1_Capture_1, as"),
        ([DRAPE, "board-plane.jpg"], "shows 0 corners of the board"),
        ([DRAPE, "plate.jpg"], "the bare plate is not found"),
    ],
)
def test_a_folder_that_lacks_something(tmp_path, names, says):
    assert says in _refused(_folder(tmp_path, *names), tmp_path)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--weight", "180"], "weight must be a number > 0 with a unit"),
        (["--weight", "180"], 'write it as "180 g/m2"'),
        (["--weight", "180 kg/m2"], "cloths have"),
        (["--weight", "7=180 g/m2"], "for a fabric that no picture shows"),
        (["--weight", "180 g/m2", "--weight", "1=1 oz/yd2", "--weight", "2 oz/yd2"], "a second weight of all fabrics"),
        (["--weight", "1=180 g/m2", "--weight", "1=190 g/m2"], "'1=190 g/m2' is a second weight of fabric 1"),
        (["--captures", "1=up,2=up,1=down"], "--captures has 1 twice"),
        (["--cloth-diameter", "30"], "--cloth-diameter must be a number > 0 with a unit"),
        (["--cloth-diameter", "30"], 'write it as "300 mm"'),
        (["--plate-diameter", "400 mm"], "the plate must be smaller than 0.9 of the cloth"),
        (["--captures", "1=left"], "--captures must be"),
        (["--captures", "0=up,1=down"], "numbers of --captures begin at 1, got '0=up'"),
        (["--printed-ruler", "15 mm"], "--printed-ruler must be from"),
        (["--camera-height", "5 cm"], "--camera-height must be from"),
    ],
)
def test_an_option_that_makes_no_sense(tmp_path, options, says):
    assert says in _refused(_folder(tmp_path, DRAPE, "plate.jpg"), tmp_path, *options)


def test_hidden_files_are_no_pictures(tmp_path):
    """macOS puts a file ._NAME beside NAME on foreign disks."""
    found = find_pictures(_folder(tmp_path, DRAPE, f"._{DRAPE}", "plate.jpg", "._plate.jpg"))
    assert [picture.path.name for picture in found.drapes] == [DRAPE]


def test_thumbnails_of_a_network_disk_are_no_pictures(tmp_path):
    """They were taken for a second picture of the same capture."""
    folder = _folder(tmp_path, DRAPE, "plate.jpg")
    (folder / "@eaDir" / DRAPE).mkdir(parents=True)
    shutil.copy(folder / DRAPE, folder / "@eaDir" / DRAPE / "SYNOPHOTO_THUMB_XL.jpg")
    assert [picture.path.name for picture in find_pictures(folder).drapes] == [DRAPE]


def test_a_phone_s_format_is_refused_unless_the_picture_is_there_in_another(tmp_path):
    folder = _folder(tmp_path, DRAPE, "plate.jpg")
    (folder / DRAPE.replace("jpg", "DNG")).write_bytes(b"raw")  # as cameras write beside it
    assert len(find_pictures(folder).drapes) == 1
    (folder / "Fabric_1_Sample_2_Capture_1.HEIC").write_bytes(b"heic")
    assert "Fabric_1_Sample_2_Capture_1.HEIC: is a picture in the format HEIC" in _refused(folder, tmp_path)
    (folder / "Fabric_1_Sample_2_Capture_1.HEIC").rename(folder / "Fabric_1_Sample_2_Capture_1.jfif")
    assert "Fabric_1_Sample_2_Capture_1.jfif: is a picture in the format JFIF" in _refused(folder, tmp_path)
    only = tmp_path / "only"
    only.mkdir()
    (only / "Fabric_1_Sample_1_Capture_1.heic").write_bytes(b"heic")
    done = CliRunner().invoke(app, ["identify", str(only), "--out", str(tmp_path / "found")])
    assert "export it as JPEG" in " ".join(done.output.split())


def test_photographs_in_a_linked_folder_do_not_go_missing(tmp_path):
    """Nothing was said of a fabric whose pictures lie on another disk."""
    folder, elsewhere = _folder(tmp_path, DRAPE, "plate.jpg"), tmp_path / "elsewhere"
    elsewhere.mkdir()
    (folder / "Fabric 2").symlink_to(elsewhere)
    assert "Fabric 2: is a link to a folder, which is not followed; copy the folder" in _refused(folder, tmp_path)
    (folder / "Fabric 2").rename(folder / ".Fabric 2")
    assert len(find_pictures(folder).drapes) == 1


@pytest.mark.parametrize("part", [".", "Fabric 2"])
def test_a_folder_of_photographs_that_cannot_be_read_is_named(tmp_path, monkeypatch, part):
    folder = _folder(tmp_path, DRAPE, "plate.jpg")
    (folder / "Fabric 2").mkdir()
    plain = os.scandir

    def scandir(place):
        if place == str(folder / part):
            raise PermissionError(13, "Permission denied", place)
        return plain(place)

    monkeypatch.setattr(os, "scandir", scandir)
    with pytest.raises(BadPhotograph, match=r"folder cannot be read \(Permission denied\); change its mode") as caught:
        find_pictures(folder)
    assert caught.value.where == str(folder / part)
    assert caught.value.kind == "no-permission"


def test_samples_may_be_numbered_by_their_date(tmp_path):
    names = [f"Fabric_1_Sample_{date}_Capture_1.jpg" for date in (20261126, 20261127)]
    found = find_pictures(_folder(tmp_path, *names, "plate.jpg"))
    assert [picture.sample for picture in found.drapes] == [20261126, 20261127]


def test_a_picture_without_a_number_of_a_capture_is_capture_1(tmp_path):
    found = find_pictures(_folder(tmp_path, "Fabric_1_Sample_1.jpg", "Fabric_1_Sample_1_Capture_2.jpg", "plate.jpg"))
    assert [picture.name[-9:] for picture in found.drapes] == ["Capture_1", "Capture_2"]


@pytest.mark.parametrize(
    ("place", "says"),
    [
        ("Fabric 2/Fabric_1_Sample_1.jpg", "lies in the folder of fabric 2, and its name says fabric 1"),
        ("Fabric 1/Sample 3/Sample_1.jpg", "lies in the folder of sample 3, and its name says sample 1"),
    ],
)
def test_a_picture_in_the_folder_of_another_one_is_refused(tmp_path, place, says):
    folder = _folder(tmp_path, "plate.jpg")
    (folder / place).parent.mkdir(parents=True)
    cv2.imwrite(str(folder / place), GREY)
    assert says in _refused(folder, tmp_path)
    (folder / place).rename(folder / "Fabric_1_Sample_1.jpg")
    assert len(find_pictures(folder).drapes) == 1


@pytest.mark.parametrize(
    ("cloth", "plate", "told"),
    [
        ("30 cm", "180 mm", False),
        ("9.45 in", "7.09 in", False),
        ("36 cm", "18 cm", False),
        ("15 cm", "9 cm", True),  # radii: the drape coefficient would be right, and all lengths half of what they are
        ("30 cm", "9 cm", True),
    ],
)
def test_diameters_that_could_be_radii_are_told(tmp_path, caplog, cloth, plate, told):
    setting_of(SettingText(cloth_diameter=cloth, plate_diameter=plate), tmp_path, [1])
    assert ("no sizes of the standard" in caplog.text) == told
    assert ("not radii" in caplog.text) == told


@pytest.mark.parametrize(("taken", "known"), [((4000, 3200), True), ((4000, 3000), False), ((0, 0), True)])
def test_a_cropped_picture_tells_no_focal_length(tmp_path, taken, known):
    """Its header has that of the whole picture, from which the camera's height would come out too low."""
    header = Image.Exif()
    tags = {
        ExifTags.Base.FocalLengthIn35mmFilm: 26,
        ExifTags.Base.ExifImageWidth: taken[0],
        ExifTags.Base.ExifImageHeight: taken[1],
    }
    header.get_ifd(ExifTags.IFD.Exif).update(tags)
    Image.fromarray(GREY).save(tmp_path / "plate.jpg", exif=header)
    focal = read_photograph(tmp_path / "plate.jpg").focal
    assert focal == (pytest.approx(26 / np.hypot(36, 24) * np.hypot(500, 400)) if known else None)


@pytest.mark.parametrize(("turn", "corner"), [(1, (0, 0)), (3, (-1, -1)), (6, (0, -1)), (8, (-1, 0))])
def test_a_photograph_is_turned_upright_as_its_header_says(tmp_path, turn, corner):
    """The warp lies to the right of the picture as people see it."""
    levels, header = np.zeros((400, 500, 3), np.uint8), Image.Exif()
    levels[:100, :100] = 255  # where the first row of what is stored begins
    header[ExifTags.Base.Orientation] = turn
    Image.fromarray(levels).save(tmp_path / "plate.png", exif=header)
    taken = read_photograph(tmp_path / "plate.png")
    assert taken.turn == turn
    assert taken.size == ((500, 400) if turn in (1, 3) else (400, 500))
    assert taken.levels[corner].tolist() == [255, 255, 255]
    assert int((taken.levels[[0, 0, -1, -1], [0, -1, 0, -1]] == 255).all(axis=1).sum()) == 1


@pytest.mark.parametrize("texts", [["180 g/m2", "2=200 g/m2"], ["2=200 g/m2", "180 g/m2"]])
def test_the_weight_of_one_fabric_goes_before_that_of_all(texts):
    assert weights_of_options(texts, [1, 2]) == pytest.approx({1: 0.18, 2: 0.2})


@pytest.mark.parametrize(
    ("options", "weights"),
    [
        (["180 g/m2"], {1: 0.15, 2: 0.18}),
        (["1=200 g/m2"], {1: 0.2}),
        (["180 g/m2", "1=200 g/m2"], {1: 0.2, 2: 0.18}),
    ],
)
def test_a_table_goes_before_the_weight_of_all_and_after_that_of_one_fabric(tmp_path, options, weights):
    (tmp_path / "weights.csv").write_text("fabric,weight,thickness\n1,150 g/m2,\n2,,\n")
    assert setting_of(SettingText(weight=tuple(options)), tmp_path, [1, 2]).weights == pytest.approx(weights)


def test_height_and_check_ruler_that_are_told_reach_the_calibration(tmp_path, monkeypatch):
    told = {}

    def calibrated(*rulers, **numbers):
        told.update(numbers)
        raise BadPhotograph("is enough", remedy="")

    monkeypatch.setattr("cusick_bench.photographs.preparation.prepare.calibrated", calibrated)
    words = ["--out", str(tmp_path / "set"), "--camera-height", "1.2 m", "--printed-ruler", "148.5 mm"]
    result = CliRunner().invoke(app, ["data", "prepare", str(_folder(tmp_path, DRAPE, "board-plane.jpg")), *words])
    assert "is enough" in result.output
    assert told == pytest.approx({"height": 1.2, "printed": 0.99})


def test_a_filled_template_is_not_overwritten_and_its_folder_can_be_prepared_into(tmp_path):
    folder, out = _folder(tmp_path, DRAPE, "plate.jpg"), tmp_path / "set"
    words = ["data", "prepare", str(folder), "--out", str(out)]
    assert CliRunner().invoke(app, [*words, "--template"]).exit_code == 0
    (out / "weights.csv").write_text("fabric,weight,thickness\n1,180 g/m2,\n")
    again = CliRunner().invoke(app, [*words, "--template"])
    assert again.exit_code == 2
    assert "weights.csv: exists" in " ".join(again.output.split())
    assert "180 g/m2" in (out / "weights.csv").read_text()
    prepared = CliRunner().invoke(app, [*words, "--weights", str(out / "weights.csv")])
    assert "the bare plate is not found" in " ".join(prepared.output.split())  # not that the folder is not empty


def test_a_filled_template_is_read_where_it_was_written(tmp_path):
    """Without --weights it was not, and all outlines were found before the weights were missed."""
    folder, out = _folder(tmp_path, DRAPE, "plate.jpg"), tmp_path / "set"
    words = ["data", "prepare", str(folder), "--out", str(out)]
    assert CliRunner().invoke(app, [*words, "--template"]).exit_code == 0
    (out / "weights.csv").write_text("fabric,weight,thickness\n1,180,\n")
    told = " ".join(CliRunner().invoke(app, words).output.split())
    assert "weights.csv, line 2: weight must be a number > 0 with a unit" in told
    (folder / "weights.csv").write_text("fabric,weight,thickness\n1,180 g/m2,\n")
    told = " ".join(CliRunner().invoke(app, words).output.split())
    assert "the bare plate is not found" in told  # the photographs' own table goes before it


def test_no_folder(tmp_path):
    assert "is no folder" in _refused(tmp_path / "nowhere", tmp_path)


def test_a_file_that_is_no_picture(tmp_path):
    folder = _folder(tmp_path, DRAPE)
    (folder / "plate.jpg").write_bytes(b"no picture")
    assert "cannot be read as a picture" in _refused(folder, tmp_path)


def test_a_picture_of_sixteen_bits(tmp_path):
    """It would be cut off at level 255, and be white all over."""
    folder = _folder(tmp_path, DRAPE)
    cv2.imwrite(str(folder / "plate.png"), GREY[..., 0].astype(np.uint16) * 257)
    assert "plate.png: has more than 8 bits a pixel; save it with 8 bits a channel" in _refused(folder, tmp_path)


def test_a_picture_of_another_size(tmp_path, photographs):
    folder = tmp_path / "photographs"
    shutil.copytree(photographs, folder, ignore=shutil.ignore_patterns("board-[1-9]*", "*Sample_2*"))
    levels = cv2.imread(str(folder / DRAPE))
    cv2.imwrite(str(folder / "Fabric_1_Sample_9_Capture_1.jpg"), levels[:900])  # it comes after a good one
    assert "has 1280 x 900 px, the calibration's pictures 1280 x 960" in _refused(folder, tmp_path)
    assert _contents(tmp_path) == ["photographs"]
    (folder / "Fabric_1_Sample_9_Capture_1.jpg").unlink()
    words = ["data", "prepare", str(folder), "--out", str(tmp_path / "set")]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert _contents(tmp_path / "set") == ["check", "data", "fabrics.csv", "protocol.json"]


def test_a_picture_that_its_header_turns_otherwise(tmp_path, photographs):
    """Turned by half a circle it has the same size, and its plate nearly the same place."""
    folder = tmp_path / "photographs"
    shutil.copytree(photographs, folder, ignore=shutil.ignore_patterns("board-[1-9]*", "*Sample_2*"))
    with Image.open(folder / DRAPE) as image:
        header = image.getexif()
        header[ExifTags.Base.Orientation] = 3
        image.save(folder / DRAPE, exif=header)
    said = _refused(folder, tmp_path)
    assert "has the orientation 3 in its header, the calibration's pictures 1" in said


def test_the_output_folder_must_be_new(tmp_path):
    folder = _folder(tmp_path, DRAPE, "plate.jpg")
    for out, says in ((folder, "is not empty"), (folder / "set", "lies in the folder of the photographs")):
        result = CliRunner().invoke(app, ["data", "prepare", str(folder), "--out", str(out)])
        assert result.exit_code == 2
        assert says in " ".join(result.output.split())


def test_a_bare_plate_as_the_only_ruler_leaves_the_lens_unknown_and_says_so(tmp_path):
    laboratory = make_laboratory(3)
    folder = _folder(tmp_path)
    for name in ("plate.jpg", DRAPE):  # a picture without cloth, which is not written
        cv2.imwrite(str(folder / name), photograph(laboratory, bare_plate(laboratory, 0.09), 0))
    result = CliRunner().invoke(app, ["data", "prepare", str(folder), "--out", str(tmp_path / "set")])
    assert result.exit_code == 1
    told = " ".join(result.stderr.split())
    assert "the lens is not known from the bare plate, and its distortion stays in the silhouettes" in told
    assert "add board-plane.jpg" in told


@pytest.mark.parametrize("suffix", ["ppm", "pgm", "pbm", "tga", "jpe", "psd"])
def test_pictures_in_formats_that_are_not_read_do_not_go_missing(tmp_path, suffix):
    folder = _folder(tmp_path, DRAPE, "plate.jpg")
    (folder / f"Fabric_1_Sample_2_Capture_1.{suffix}").write_bytes(b"picture")
    assert f"is a picture in the format {suffix.upper()}" in _refused(folder, tmp_path)
