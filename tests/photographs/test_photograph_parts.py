"""Calibration, board, quantities and confidence, each against what is known."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.registry import REGISTRY
from cusick_bench.photographs.accuracy import Measured, accuracy, measure
from cusick_bench.photographs.board import HEIGHT, LEAST_DISC, WIDTH, board_cells, charuco_board, in_plate_axes
from cusick_bench.photographs.calibration.boards import SeenBoard, find_board, view_from_boards
from cusick_bench.photographs.calibration.plate import view_from_plate
from cusick_bench.photographs.calibration.view import PlateView, Uncertainty
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.calibrate import Named, calibrated
from cusick_bench.photographs.preparation.on_axis import left_by_calibration, left_off_axis, seen_on_axis
from cusick_bench.photographs.preparation.prepare import Setting, fabrics_table, protocol_of
from cusick_bench.photographs.preparation.quantities import LENGTHS, WEIGHTS, quantity
from cusick_bench.photographs.preparation.setting_text import SettingText, setting_of
from cusick_bench.photographs.preparation.silhouette import silhouette
from cusick_bench.photographs.preparation.weights import read_weights, template
from cusick_bench.photographs.reading import Photograph, read_photograph
from cusick_bench.photographs.segmentation.confidence import ACCEPTED, Evidence, confidence, doubts
from cusick_bench.photographs.segmentation.curve import outermost
from cusick_bench.photographs.segmentation.path import closed_path
from cusick_bench.photographs.sheet import write_sheet
from cusick_bench.photographs.studio.scene import bare_plate, make_laboratory
from cusick_bench.photographs.studio.shot import board_photograph, photograph
from cusick_bench.photographs.studio.truth import apparent_radii

SURE = Evidence(
    edge=4.0, weak_edge=0.0, rival=0.1, colour=1.0, undecided=0.0, roughness_mm=0.1, at_limit=0.0, unseen=0.0,
    beyond_plate=0.3, learning_mm=0.25, disagreement_mm=0.5, unfound=0.0, width_mm=1.15, strange=0.01,
)  # fmt: skip


def _view(eye=(0.0, 0.0, 0.8), k1=0.0, focal=1500.0):
    rotation = np.diag([1.0, -1.0, -1.0])
    matrix = np.array([[focal, 0, 640], [0, focal, 480], [0, 0, 1.0]])
    nothing = Uncertainty(0, 0, 0, 0)
    return PlateView((1280, 960), matrix, np.array([k1, 0, 0, 0, 0]), rotation, -rotation @ eye, nothing, "")


@pytest.mark.parametrize(
    ("text", "units", "value"),
    [
        ("180 g/m2", WEIGHTS, 0.18),
        ("180g/m²", WEIGHTS, 0.18),
        ("5.3 oz/yd^2", WEIGHTS, 0.17970),
        ("30 cm", LENGTHS, 0.3),
        ("11.811 in", LENGTHS, 0.3),
        ("11.811 inches", LENGTHS, 0.3),
        ("180\u00a0g/m²", WEIGHTS, 0.18),
        ("180\u202fg/m²", WEIGHTS, 0.18),
    ],
)
def test_quantities_have_units(text, units, value):
    assert quantity(text, units, "it", "300 mm") == pytest.approx(value, rel=1e-4)


@pytest.mark.parametrize("text", ["", "180", "-3 mm", "0 mm", "3 parsec", "nan mm"])
def test_what_is_no_quantity_is_refused(text):
    with pytest.raises(BadPhotograph, match="must be a number > 0 with a unit"):
        quantity(text, LENGTHS, "it", "300 mm")


def test_a_filled_template_is_read(tmp_path):
    table = tmp_path / "weights.csv"
    table.write_text(template([1, 2]).replace("1,,", "1,150 g/m2,0.4 mm"))
    weights, thicknesses = read_weights(table)
    assert weights == {1: pytest.approx(0.15)}
    assert thicknesses == {1: pytest.approx(4e-4)}


@pytest.mark.parametrize("name", ["1", "1.0", "01", "Fabric 1", "fabric_1", "FABRIC-1.00", "fabric1", "Fabric - 1"])
def test_a_fabric_is_named_as_in_the_table_of_densities(tmp_path, name):
    table = tmp_path / "weights.csv"
    table.write_text(f"fabric,weight\n{name},150 g/m2\n")
    assert read_weights(table)[0] == {1: pytest.approx(0.15)}


@pytest.mark.parametrize("name", ["1.5", "-", "blue", "1 observations", "1e3"])
def test_a_fabric_without_a_number_is_refused(tmp_path, name):
    table = tmp_path / "weights.csv"
    table.write_text(f"fabric,weight\n{name},150 g/m2\n")
    with pytest.raises(BadPhotograph, match=r"weights\.csv, line 2: fabric must be a number"):
        read_weights(table)


def test_a_bad_cell_is_named_by_its_line(tmp_path):
    table = tmp_path / "weights.csv"
    table.write_text("fabric,weight\n1,150 g/m2\n2,lots\n")
    with pytest.raises(BadPhotograph, match=r"weights\.csv, line 3: weight must be"):
        read_weights(table)


def test_a_fabric_that_is_given_twice_is_refused(tmp_path):
    table = tmp_path / "weights.csv"
    table.write_text("fabric,weight\n1,150 g/m2\nFabric 1,160 g/m2\n")
    with pytest.raises(BadPhotograph, match=r"weights\.csv, line 3: fabric 1 is given twice"):
        read_weights(table)


@pytest.mark.parametrize(
    ("eye", "plate", "says"),
    [
        ((0.0, 0.0, 0.1), 0.09, "camera_height_m must be from 0.2 to 20 m, got 0.1"),
        ((0.0, 0.0, 0.8), 0.012, "px_per_m must suit images of 512 px: the plate would be"),
    ],
)
def test_values_that_no_drape_meter_has_are_refused(eye, plate, says):
    with pytest.raises(BadPhotograph, match=says):
        protocol_of(_view(eye=eye), Setting(cloth_radius=0.15, plate_radius=plate))


def test_options_are_in_the_setting_and_the_setting_is_in_the_data_set(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("fabric,weight,thickness\n1,180 g/m2,0.4 mm\n")
    text = SettingText(
        weights=table, cloth_diameter="24 cm", plate_diameter="12 cm", captures="1=down,2=up", camera_height="1.2 m",
        printed_ruler="148.5 mm",
    )  # fmt: skip
    setting = setting_of(text, tmp_path, [1])
    lengths = (setting.cloth_radius, setting.plate_radius, setting.camera_height, setting.printed)
    assert lengths == pytest.approx((0.12, 0.06, 1.2, 0.99))
    assert fabrics_table([1], setting).splitlines()[1] == "1,0.18,0.0004"
    protocol = protocol_of(_view(eye=(0.01, 0.0, 1.1)), replace(setting, image_size=256))
    lengths = (protocol.cloth_radius_m, protocol.plate_radius_m, protocol.camera_height_m)
    assert lengths == pytest.approx((0.12, 0.06, 1.1))
    assert protocol.captures == {1: "down", 2: "up"}
    assert protocol.image_size_px == 256
    assert 256 / protocol.px_per_m / 0.24 == pytest.approx(RELEASE.image_size_px / RELEASE.px_per_m / 0.3, rel=5e-3)


def test_a_plate_outside_the_picture_is_refused(monkeypatch):
    calibrate = "cusick_bench.photographs.preparation.calibrate"
    monkeypatch.setattr(f"{calibrate}.find_board", lambda *_: None)
    monkeypatch.setattr(f"{calibrate}.view_from_boards", lambda *_, **__: _view(eye=(2.0, 0.0, 0.8)))
    picture = Photograph(np.zeros((960, 1280, 3), np.uint8), None)
    with pytest.raises(BadPhotograph, match=r"board\.jpg: the plate's middle lies outside the picture"):
        calibrated(("board.jpg", picture), [], None, 0.09)


def test_corners_that_no_camera_can_be_calibrated_from_are_refused_in_a_sentence():
    places = in_plate_axes(np.asarray(charuco_board().getChessboardCorners()))
    one_point = SeenBoard(places, np.full((len(places), 2), 300.0))
    with pytest.raises(BadPhotograph, match=r"board pictures: no camera can be calibrated .* take them again") as found:
        view_from_boards(one_point, [one_point, one_point], (1280, 960))
    assert "3 pictures" in str(found.value)


def _boards_held(lean: float) -> tuple[SeenBoard, list[SeenBoard]]:
    """The board on the plate, and held at a lean [degrees] about two axes, as a camera .8 m above sees it."""
    places = in_plate_axes(np.asarray(charuco_board().getChessboardCorners()))
    generator, seen = np.random.default_rng(0), []
    for x, y, z in ((0.0, 0.0, 0.0), (lean, 0.0, 0.03), (0.0, lean, 0.06)):
        turn, _ = cv2.Rodrigues(np.radians([x, y, 0.0]))
        pixels = _view().project(places @ turn.T + [0, 0, z]) + generator.normal(0, 0.1, (len(places), 2))
        seen.append(SeenBoard(places, pixels))
    return seen[0], seen[1:]


def test_boards_held_at_angles_tell_the_height_and_level_ones_are_refused():
    """From level boards OpenCV finds a height that is off by 10 % and more, and says that it is sure of it."""
    plane, held = _boards_held(20.0)
    assert view_from_boards(plane, held, (1280, 960)).eye[2] == pytest.approx(0.8, rel=0.01)
    plane, held = _boards_held(2.0)
    with pytest.raises(BadPhotograph, match=r"held at 1\.\d degrees to the plate at most.* give --camera-height"):
        view_from_boards(plane, held, (1280, 960))
    assert not view_from_boards(plane, held[:1], (1280, 960)).knows_height


def test_one_board_leaves_the_tilt_as_uncertain_as_the_axes_of_lenses_are_off_the_middle():
    """One level board does not tell the optical axis, and takes an axis beside the picture's middle for a tilt."""
    places = in_plate_axes(np.asarray(charuco_board().getChessboardCorners()))
    generator, level, leans = np.random.default_rng(0), _view(), []
    for off in generator.normal(0, 0.0039 * 1280, (12, 2)):
        shifted = replace(level, matrix=level.matrix + np.array([[0, 0, off[0]], [0, 0, off[1]], [0, 0, 0]]))
        pixels = shifted.project(places) + generator.normal(0, 0.1, (len(places), 2))
        found = view_from_boards(SeenBoard(places, pixels), [], (1280, 960), focal=1500.0)
        leans.append(found.eye[:2] / found.eye[2] / found.uncertainty.tilt_rad)
    assert 0.7 < np.sqrt(np.mean(np.square(leans))) < 1.6
    plane, held = _boards_held(20.0)
    of_one, of_three = (view_from_boards(plane, others, (1280, 960)).uncertainty for others in ([], held))
    assert of_three.tilt_rad < 0.5 * of_one.tilt_rad  # three tell the axis


def test_the_board_lies_about_its_middle():
    places = in_plate_axes(np.asarray(charuco_board().getChessboardCorners()))
    assert places.mean(axis=0) == pytest.approx(0, abs=1e-6)
    assert np.ptp(places[:, 0]) == pytest.approx(WIDTH - 0.04)
    assert np.ptp(places[:, 1]) == pytest.approx(HEIGHT - 0.04)


def test_the_least_disc_of_the_board_has_enough_corners_and_a_smaller_one_has_not():
    cells = board_cells(48)
    rows, columns = (np.arange(count) - (count - 1) / 2 for count in cells.shape)
    reach = np.hypot(rows[:, None], columns) / 48 * 0.02  # [m]

    def disc(diameter):
        levels = cv2.GaussianBlur(np.where(reach < diameter / 2, cells, 120).astype(np.uint8), (0, 0), 1)
        return Photograph(np.repeat(levels[..., None], 3, axis=2), None)

    assert len(find_board(disc(LEAST_DISC), "board-plane.jpg").places) == 12
    with pytest.raises(BadPhotograph, match="shows 4 corners of the board, at least 12 are needed"):
        find_board(disc(0.09), "board-plane.jpg")


def test_the_sheet_has_its_true_size(tmp_path):
    write_sheet(tmp_path / "board.pdf", "a4", 0.09)
    text = (tmp_path / "board.pdf").read_bytes()
    box = text[text.index(b"/MediaBox") :].partition(b"]")[0].partition(b"[")[2].split()
    assert [float(value) / 72 * 25.4 for value in box[2:]] == pytest.approx([210, 297], abs=0.01)


def test_a_view_looks_where_it_projects():
    view = _view(eye=(0.03, -0.02, 0.8), k1=-0.1)
    places = np.random.default_rng(0).uniform(-0.15, 0.15, (20, 2))
    pixels = view.project(np.column_stack([places, np.zeros(20)]))
    assert view.on_plane(pixels) == pytest.approx(places, abs=1e-6)
    level = replace(view, distortion=np.zeros(5))
    pixels = level.project(np.column_stack([places, np.zeros(20)]))
    assert level.centred(np.array([0.01, 0.0])).on_plane(pixels) == pytest.approx(places - [0.01, 0], abs=1e-6)


def _plate() -> Photograph:
    laboratory = make_laboratory(3)
    assert laboratory.calibration == "plate"
    return Photograph(photograph(laboratory, bare_plate(laboratory, 0.09), 0), laboratory.camera.focal)


def test_the_bare_plate_is_a_ruler():
    laboratory = make_laboratory(3)
    view = view_from_plate(_plate(), "plate", 0.09)
    turn = np.arange(12) * np.pi / 6
    ring = 0.12 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(12)])
    found = view.on_plane(laboratory.camera.project(ring))
    assert np.hypot(*found.T) == pytest.approx(0.12, abs=5e-4)
    assert 0 < view.uncertainty.tilt_rad < 0.05
    assert not view.knows_lens


def test_a_pin_in_the_middle_of_the_plate_is_no_matter():
    plain, pinned = _plate(), _plate()
    cv2.circle(pinned.levels, (pinned.size[0] // 2, pinned.size[1] // 2), 8, (230, 230, 230), -1, cv2.LINE_AA)
    assert view_from_plate(pinned, "plate", 0.09).scale == pytest.approx(view_from_plate(plain, "plate", 0.09).scale)


@pytest.fixture(scope="module")
def board_and_plate() -> tuple[Named, Named]:
    """Pictures of a board of true size on the plate, and of the bare plate."""
    laboratory = make_laboratory(3043)
    board, plate = board_photograph(laboratory, 0), photograph(laboratory, bare_plate(laboratory, 0.09), 0)
    return ("board-plane.jpg", Photograph(board, None)), ("plate.jpg", Photograph(plate, None))


@pytest.mark.parametrize(("ruler", "told"), [(150.0, False), (150.5, True), (149.3, True)])
def test_the_plate_checks_the_scale_of_the_board(board_and_plate, ruler, told, caplog):
    board, plate = board_and_plate
    view = calibrated(board, [], plate, 0.09, printed=ruler / 150)
    alone = calibrated(board, [], None, 0.09, printed=ruler / 150).uncertainty.scale
    assert view.uncertainty.scale == pytest.approx(np.hypot(alone, ruler / 150 - 1), abs=2e-4)
    assert ("mm by the board, but 90.0 mm are told, so the scale is taken to be uncertain" in caplog.text) == told


@pytest.mark.parametrize("ruler", ["board", "plate"])
def test_a_height_that_was_measured_is_the_cameras(board_and_plate, ruler):
    board, plate = (one if one[0].startswith(ruler) else None for one in board_and_plate)
    view = calibrated(board, [], plate, 0.09, height=1.3)
    assert view.eye[2] == pytest.approx(1.3, rel=0.01)
    assert view.uncertainty.height_m == pytest.approx(0.013, rel=0.01)
    assert not calibrated(board, [], plate, 0.09).knows_height


def _with_header(picture: Named) -> Named:
    """The picture of laboratory 3043 with its focal length in the header."""
    return picture[0], replace(picture[1], focal=make_laboratory(3043).camera.focal)


@pytest.mark.parametrize("ruler", ["board", "plate"])
def test_the_focal_length_in_a_header_tells_the_height(board_and_plate, ruler):
    board, plate = (_with_header(one) if one[0].startswith(ruler) else None for one in board_and_plate)
    view = calibrated(board, [], plate, 0.09)
    assert view.knows_height
    assert view.eye[2] == pytest.approx(make_laboratory(3043).camera.eye[2], rel=0.01)
    assert view.uncertainty.height_m == pytest.approx(0.03 * view.eye[2], rel=0.01)


@pytest.mark.parametrize(("factor", "told"), [(0.85, True), (0.93, False), (1.07, False), (1.18, True)])
@pytest.mark.parametrize("ruler", ["board", "plate"])
def test_a_measured_height_that_the_header_contradicts_is_told(board_and_plate, ruler, factor, told, caplog):
    """Measured from the table, 1 m instead of .85 m, it moves drape coefficients by 1.2 to 1.5 points."""
    board, plate = (_with_header(one) if one[0].startswith(ruler) else None for one in board_and_plate)
    true = make_laboratory(3043).camera.eye[2]
    view = calibrated(board, [], plate, 0.09, height=factor * true)
    assert view.eye[2] == pytest.approx(factor * true, rel=0.01)
    what = f"by the focal length in the pictures' header, but {factor * true:.2f} m by --camera-height"
    assert (what in caplog.text) == told
    assert ("the latter is used; measure from the plate's top to the lens" in caplog.text) == told


def test_a_measured_height_that_held_boards_contradict_is_told(photographs, caplog):
    """It was not used, and nothing said so."""
    held = [(path.name, read_photograph(path)) for path in sorted(photographs.glob("board-[1-9].jpg"))]
    board = ("board-plane.jpg", read_photograph(photographs / "board-plane.jpg"))
    true = json.loads((photographs / "truth.json").read_text())["camera_height_m"]
    assert calibrated(board, held, None, 0.09, height=1.05 * true).eye[2] == pytest.approx(true, abs=3e-3)
    assert not caplog.messages
    assert calibrated(board, held, None, 0.09, height=1.2 * true).eye[2] == pytest.approx(true, abs=3e-3)
    assert "m above the plate by the pictures of the board held at angles, but" in caplog.text
    assert f"but {1.2 * true:.2f} m by --camera-height; the former is used" in caplog.text


@pytest.mark.parametrize("blurred", [False, True])
def test_a_single_held_board_is_told_to_be_of_no_use(photographs, caplog, blurred):
    board, held = ((f"{name}.jpg", read_photograph(photographs / f"{name}.jpg")) for name in ("board-plane", "board-1"))
    if blurred:  # which matters to nobody
        held = (held[0], replace(held[1], levels=np.full_like(held[1].levels, 128)))
    assert calibrated(board, [held], None, 0.09).source == "one picture of the board"
    assert caplog.messages == [
        "board-1.jpg is not used: one picture of the board held at an angle does not tell the camera's height, 2 do"
    ]


def test_a_board_that_is_printed_larger_shows_more_of_the_plane(board_and_plate):
    board, _ = board_and_plate
    true, larger = (calibrated(board, [], None, 0.09, printed=printed) for printed in (1.0, 1.004))
    assert larger.scale == pytest.approx(true.scale / 1.004, rel=1e-4)


@pytest.mark.parametrize("size", [0.97, 1.015])
def test_a_board_that_the_printer_scaled_is_refused_by_the_plate(board_and_plate, size):
    """Printed to fit the page at 97 % and taken for true, it would move drape coefficients by 7 points."""
    board, plate = board_and_plate
    with pytest.raises(BadPhotograph, match=r"plate\.jpg: .* mm by the board.*may differ by 1%.*--printed-ruler"):
        calibrated(board, [], plate, 0.09, printed=1 / size)


@pytest.mark.parametrize(("radius", "told"), [(0.09, False), (0.1, False), (0.12, True), (0.045, True)])
def test_a_plate_that_no_disc_of_the_board_fits_needs_a_picture_of_its_own(board_and_plate, radius, told, caplog):
    """Its middle was taken to be that of a board that lies anywhere on it, and to be known to .3 mm."""
    board, plate = board_and_plate
    calibrated(board, [], None, radius)
    assert (f"a plate of {2e3 * radius:g} mm, so its middle" in caplog.text) == told
    assert ("add plate.jpg" in caplog.text) == told
    caplog.clear()
    calibrated(board, [], plate, 0.09)
    assert "plate.jpg" not in caplog.text


def _rimmed_plate(width: float) -> Photograph:
    """A bare, dark plate of 90 mm radius with a white rim."""
    camera, taken = make_laboratory(3).camera, _plate()
    turn = np.arange(720) * np.pi / 360
    places = camera.project((0.09 - width / 2) * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(720)]))
    thick = round(width * camera.focal / camera.eye[2])
    cv2.polylines(taken.levels, [np.round(16 * places).astype(np.int32)], True, (230, 230, 230), thick, cv2.LINE_AA, 4)
    return taken


@pytest.mark.parametrize("width", [0.003, 0.006])
def test_a_plate_whose_rim_has_another_colour_is_no_ruler(width):
    """The scale would be that of one of two circles: the drape coefficient off by 6 to 12 points."""
    with pytest.raises(BadPhotograph, match=r"two edges, whose radii differ by \d\.\d%.* one colour"):
        view_from_plate(_rimmed_plate(width), "plate", 0.09)


def test_an_eye_beside_the_axis_is_corrected():
    """Of a cone of straight generators to what real cloth is taken to hang less deep than that."""
    height, plate, cloth, rim = 0.8, 0.09, 0.15, 0.12
    depth = np.sqrt((cloth - plate) ** 2 - (rim - plate) ** 2)
    turn = np.arange(2000) * 2 * np.pi / 2000
    foot = np.array([0.04, -0.02])
    seen = foot + (rim * np.column_stack([np.cos(turn), np.sin(turn)]) - foot) * height / (height + depth)
    view = _view(eye=(*foot, height))
    corrected = seen_on_axis(outermost(seen), view, plate, cloth)
    assert corrected == pytest.approx(rim * height / (height + depth), abs=1e-4)
    unknown = replace(view, uncertainty=Uncertainty(0, 0, 0, np.inf))
    assert np.ptp(seen_on_axis(outermost(seen), unknown, plate, cloth)) > 2e-3


@pytest.mark.parametrize(("fabric", "most", "least"), [("1", 5e-4, 1.5e-3), ("4", 1.5e-4, 8e-4)])
def test_shoulders_of_limp_cloth_are_not_taken_for_its_rim(fabric, most, least):
    """Between deep folds an outline is where the cloth bends down over the plate, and hangs at no depth."""
    height, plate, cloth, foot = 0.75, 0.09, 0.15, np.array([0.035, -0.025])
    turn, view = np.arange(720) * 2 * np.pi / 720, _view(eye=(*foot, height))
    left, before, foretold = [], [], []
    for path in sorted((REGISTRY["synthetic"].folder() / "data" / f"Fabric {fabric}" / "meshes").glob("*"))[::12]:
        mesh = read_mesh(path)
        away = (height / (height - mesh.vertices[:, 2]))[:, None] * (mesh.vertices[:, :2] - foot)
        flat = np.column_stack([foot + away, np.zeros(len(away))])
        seen, wanted = (
            apparent_radii(vertices, mesh.faces, eye, turn) for vertices, eye in ((flat, 1e6), (mesh.vertices, height))
        )
        left.append(np.sqrt(np.mean((seen_on_axis(seen, view, plate, cloth) - wanted) ** 2)))
        before.append(np.sqrt(np.mean((seen - wanted) ** 2)))
        foretold.append(left_off_axis(seen, view, plate, cloth))
    assert np.mean(left) < most
    assert 0.5 < np.mean(foretold) / np.mean(left) < 5
    assert np.mean(before) > least


def test_uncertain_calibration_foretells_what_it_leaves():
    """A tilt shifts the rim by its depth times the tilt; a scale and a centre shift everything."""
    radii = np.full(720, 0.13)
    exact = _view()
    tilted, scaled, moved = (
        replace(exact, uncertainty=Uncertainty(*spread, 0)) for spread in ((0, 0, 0.01), (0.002, 0, 0), (0, 2e-4, 0))
    )
    depth = np.sqrt(0.06**2 - 0.04**2)  # of cloth that hangs straight
    assert left_by_calibration(radii, exact, 0.09, 0.15) == 0
    assert left_by_calibration(radii, tilted, 0.09, 0.15) == pytest.approx(0.01 * depth, rel=0.05)
    assert left_by_calibration(radii, scaled, 0.09, 0.15) == pytest.approx(2.6e-4)
    assert left_by_calibration(radii, moved, 0.09, 0.15) == pytest.approx(2e-4)


def test_the_truth_of_a_cone():
    turn = np.arange(360) * np.pi / 180
    rim = np.column_stack([0.12 * np.cos(turn), 0.12 * np.sin(turn), np.full(360, -0.05)])
    vertices = np.concatenate([rim, [[0, 0, 0.0]]])
    faces = np.column_stack([np.arange(360), (np.arange(360) + 1) % 360, np.full(360, 360)])
    radii = apparent_radii(vertices, faces, 0.8, turn)
    assert radii == pytest.approx(0.12 * 0.8 / 0.85, rel=1e-4)


def test_the_cheapest_closed_path_is_found():
    cost = np.ones((72, 60))
    wanted = np.round(30 + 8 * np.cos(np.arange(72) * 2 * np.pi / 72)).astype(int)
    cost[np.arange(72), wanted] = 0
    assert closed_path(cost, 0.01) == pytest.approx(wanted)


def test_confidence_is_high_where_nothing_speaks_against():
    assert confidence(SURE) > 0.7
    assert doubts(SURE)


@pytest.mark.parametrize(
    ("measure_", "value", "says"),
    [
        ("weak_edge", 0.2, "no edge along 20% of it"),
        ("colour", 0.9, "fit only 90%"),
        ("undecided", 0.2, "20% of the places beside it could be cloth as well as ground"),
        ("disagreement_mm", 12.0, "disagree by 12.0 mm"),
        ("learning_mm", 5.0, "depends by 5.0 mm on which colours are learnt"),
        ("weak_fine", 0.2, "no sharp edge along 20%"),
        ("unsettled_mm", 2.0, "moves by 2.0 mm"),
        ("roughness_mm", 0.6, "ragged, by 0.60 mm"),
        ("unfound", 0.1, "no crossing from cloth to ground along 10% of it"),
        ("width_mm", 2.2, "blurred over 2.2 mm"),
        ("strange", 0.4, "something lies on it"),
        ("at_limit", 0.05, "no cloth can end"),
        ("unseen", 0.01, "leaves the picture"),
        ("expected_mm", 0.5, "make 0.7 mm likely"),
        ("beyond_plate", 0.0, "is there a cloth?"),
        ("reread_mm", 0.7, "differ by 0.7 mm all along it: too coarse, or not sharp"),
        ("burnt", 0.5, "the cloth is overexposed along 50% of it"),
        ("off_circle_mm", 0.1, "a circle within 0.10 mm: a paper ring"),
    ],
)
def test_each_doubt_counts_alone(measure_, value, says):
    doubtful = replace(SURE, **{measure_: value})
    assert confidence(doubtful) < ACCEPTED
    (reason,) = doubts(doubtful)
    assert says in reason


@pytest.mark.parametrize(
    ("measure_", "value", "says"),
    [("off_axis_mm", 1.0, "beside the axis"), ("calibration_mm", 2.0, "calibrate with the board")],
)
def test_a_large_error_has_its_cause_beside_it(measure_, value, says):
    doubtful = replace(SURE, **{measure_: value})
    assert confidence(doubtful) < ACCEPTED
    assert says in "; ".join(doubts(doubtful))


def test_errors_that_are_small_each_add_up():
    small = {"expected_mm": 0.2, "off_axis_mm": 0.4, "calibration_mm": 0.9}
    assert all(confidence(replace(SURE, **{name: value})) > ACCEPTED for name, value in small.items())
    assert confidence(replace(SURE, **small)) < ACCEPTED


def test_accuracy_counts_wrong_ones_and_those_that_are_known():
    rows = [
        Measured(0, n, "", "", beside, rms, 0, 0, sure, {})
        for n, (beside, rms, sure) in enumerate([(2.9, 0.1, 0.9), (3.1, 2, 0.1), (0, 3, 0.9)])
    ]
    found = accuracy(rows)
    assert (found.photographs, found.wrong) == (3, 2)
    assert found.within == pytest.approx(1 / 3)
    assert (found.level, found.level_within) == (2, 0.5)
    assert found.recognised == pytest.approx(0.5)
    assert found.accepted_within == pytest.approx(0.5)


@pytest.mark.parametrize("size", [256, 512])
def test_a_silhouette_shows_the_outline_it_was_drawn_from(size: int):
    protocol = Protocol(image_size_px=size, px_per_m=size / 0.354, centre_px=((size - 1) / 2,) * 2)
    radii = 0.12 + 0.012 * np.cos(7 * np.arange(720) * np.pi / 360)
    image = 1 - silhouette(radii, protocol) / 255
    assert abs((profile_of(image, protocol).radii - radii).mean()) < 5e-6  # [m]
    area = np.sin(np.pi / 360) / 2 * (radii * np.roll(radii, -1)).sum()  # of the triangles around the axis
    assert image.sum() / protocol.px_per_m**2 == pytest.approx(area, rel=1e-4)


def test_figures_of_no_photographs_are_none():
    nothing = accuracy([])
    assert (nothing.photographs, nothing.level, nothing.wrong) == (0, 0, 0)
    assert np.isnan([nothing.within, nothing.median_mm, nothing.most_mm, nothing.accepted, nothing.recognised]).all()


@pytest.mark.slow
def test_outlines_of_photographs_are_as_near_as_the_docs_say():
    found = accuracy(list(measure(60, 5000)))
    assert found.within >= 0.6
    assert found.median_mm <= 0.4


@pytest.mark.slow
def test_wrong_outlines_are_recognised():
    assert accuracy(list(measure(30, 2000, troubles=True))).recognised >= 0.8
