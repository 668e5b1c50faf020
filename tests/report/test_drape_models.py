"""Drapes of the page's viewer: what a reader of the JSON gets back, colours, and the room on a page."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from shown_cells import radii, write_cell

from cusick_bench.leaderboard import leaderboards, load_cells
from cusick_bench.metrics import ruled_surface
from cusick_bench.report import write_report
from cusick_bench.report.cell_view import CellView, load_cell_view
from cusick_bench.report.run.drape_models import fitted_model, models_document, real_model, vertex_means
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.solvers.reference.silhouettes import silhouette

FLAT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]])
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


@pytest.fixture(scope="module")
def view(tmp_path_factory) -> CellView:
    return load_cell_view(write_cell(tmp_path_factory.mktemp("run"), "homo"))


def decoded(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=kind)


def test_positions_and_triangles_come_back(view):
    model = fitted_model("cotton_blue", "homo", "fit-0-0", view)
    document = models_document([model], 0.09)
    (drape,) = document["drapes"]
    positions = decoded(drape["vertices"], "<i2").reshape(-1, 3) * drape["scale_m"]
    np.testing.assert_allclose(positions, view.vertices, atol=1e-5)
    faces = decoded(document["meshes"][drape["mesh"]], "<u4").reshape(-1, 3)
    np.testing.assert_array_equal(faces, view.faces)
    assert document["plate_radius_m"] == 0.09


def test_error_has_the_sign_and_size_of_the_outlines_difference(view):
    model = fitted_model("cotton_blue", "homo", "fit-0-0", view)
    assert model is not None
    error = model.colourings["error"]
    x, y, z = view.vertices.T
    angle = np.arctan2(y, x)
    expected = 12 * (np.cos(8 * angle) - np.cos(7 * angle))  # [mm]: eight folds were fitted to seven
    rim = np.hypot(x, y) > 0.1
    np.testing.assert_allclose(error.values[rim], expected[rim], atol=1.5)
    assert np.isnan(error.values[(np.hypot(x, y) < 0.085) & (z > -1e-4)]).all()
    assert error.limits[1] == -error.limits[0] > 10


def test_an_outline_that_lies_outside_all_round_is_not_said_to_lie_inside(view):
    """It was, with its least distance: from 4.9 mm (inside) to 5.1 mm (outside)."""
    model = fitted_model("cotton_blue", "homo", "fit-0-0", replace(view, target=silhouette(radii(8) - 0.005)))
    assert model is not None
    words = model.colourings["error"].words
    low, high = map(float, re.findall(r"[+-]\d+\.\d", words))
    assert 4.5 < low < high < 5.5
    assert "(inside)" not in words


def test_a_vertex_without_a_value_has_the_byte_that_says_so(view):
    (drape,) = models_document([fitted_model("c", "homo", "", view)], 0.09)["drapes"]
    levels = decoded(drape["colourings"]["error"]["values"], "u1")
    assert len(levels) == len(view.vertices)
    assert (levels == 255).any()
    assert levels[levels < 255].max() > 240


def test_means_over_hinges_and_over_faces():
    mesh = Mesh(FLAT, FACES)
    of_hinges = vertex_means(np.arange(4.0), FACES, 5)
    assert of_hinges is not None
    expected = [
        np.mean([place for place, hinge in enumerate(mesh.hinges) if v in hinge[:2]] or [np.nan]) for v in range(5)
    ]
    np.testing.assert_allclose(of_hinges, expected)
    assert vertex_means(np.arange(7.0), FACES, 5) is None
    of_faces = vertex_means(np.array([1.0, 3.0]), FACES[:2], 5)
    np.testing.assert_allclose(of_faces, [1, 2, 3, np.nan, 2])


def test_stiffness_is_that_of_the_elements_near_a_vertex(view):
    sides = np.sort(np.concatenate([view.faces[:, [0, 1]], view.faces[:, [1, 2]], view.faces[:, [2, 0]]]), axis=1)
    edges, counts = np.unique(sides, axis=0, return_counts=True)
    hinges = edges[counts == 2]
    stiff = view.vertices[hinges, 0].mean(1) > 0
    tables = np.where(stiff, 4e-6, 1e-6)[:, None, None] * np.ones((1, 3, 5))
    model = fitted_model("c", "heter", "", replace(view, bending=tables))
    assert model is not None
    shown = model.colourings["stiffness"]
    assert shown.ends == ("1.00 µN m", "4.00 µN m")
    right, left = view.vertices[:, 0] > 0.05, view.vertices[:, 0] < -0.05
    np.testing.assert_allclose(np.exp(shown.values[right]), 4e-6)
    np.testing.assert_allclose(np.exp(shown.values[left]), 1e-6)
    even = fitted_model("c", "homo", "", view)
    assert even is not None
    assert "stiffness" not in even.colourings


def test_stiffness_by_law_published_is_a_quarter_of_its_tables(tmp_path):
    """The page's numbers say so, and its drapes in 3D were four times as stiff."""
    cell = write_cell(tmp_path, "heter")
    with np.load(cell / "prediction.npz") as stored:
        arrays = dict(stored)
    tables = np.full((len(arrays["faces"]), 3, 5), 4e-6)
    np.savez_compressed(cell / "prediction.npz", bending=tables, **arrays)
    for law, shown in (("published", "1.00"), ("paper", "4.00")):
        for name in ("cell.json", "result.json"):
            record = json.loads((cell / name).read_text()) | {"settings": {"drape": {"law": law}}}
            (cell / name).write_text(json.dumps(record))
        cells = load_cells(tmp_path)
        write_report(cells, leaderboards(cells), tmp_path / "report.html")
        assert f"mean of the directions: from {shown} " in (tmp_path / "report.html").read_text()


def test_what_was_not_simulated_is_not_shown(tmp_path):
    assert fitted_model("c", "null:disc", "", load_cell_view(write_cell(tmp_path, "null:disc"))) is None


def test_the_real_drape_has_its_outline_and_a_flat_plate(view):
    model = real_model("c", view)
    surface = ruled_surface(radii(7))
    assert np.hypot(*model.vertices[:, :2].T).max() == pytest.approx(
        np.hypot(*surface.vertices[:, :2].T).max(), abs=1e-3
    )
    plate = model.faces[(np.hypot(*model.vertices[model.faces, :2].transpose(2, 0, 1)) < 0.0901).all(1)]
    others = model.faces[~np.isin(model.faces, plate).any(1)]
    assert np.ptp(model.vertices[plate, 2]) < 1e-9
    assert not set(plate.ravel()) & set(others.ravel())


def test_drapes_of_one_mesh_share_it_and_a_page_has_an_end(view, monkeypatch):
    models = [fitted_model("c", str(place), "", view) for place in range(4)]
    document = models_document(models, 0.09)
    assert (len(document["meshes"]), len(document["drapes"]), document["left_out"]) == (1, 4, 0)
    size = len(document["meshes"][0]) + 2.5 * len(document["drapes"][0]["vertices"])
    monkeypatch.setattr("cusick_bench.report.run.drape_models.MOST_BYTES", size)
    assert models_document(models, 0.09)["left_out"] == 2
