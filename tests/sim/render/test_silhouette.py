"""Exact pixel coverage: areas that are known, the union rule, invariances, degenerate cloth, real captures."""

import csv
import inspect

import numpy as np
import pytest
import torch
from PIL import Image

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.obj import read_obj
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.render import silhouette
from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera
from cusick_bench.sim.render.silhouette import render

PIXELS = ParallelCamera(px_per_m=1.0, centre_px=(-0.5, -0.5), image_y="down")
"""Sees (x, y) as pixel coordinates whose pixel (row r, column c) covers [c, c + 1] x [r, r + 1]."""


def _draw(points, faces, size=16, camera=PIXELS, **options):
    points = torch.from_numpy(np.array(points, dtype=np.float64))
    if points.shape[-1] == 2:
        points = torch.nn.functional.pad(points, (0, 1))
    return render(points, np.asarray(faces), camera, size=size, **options).numpy()


def _area(polygon):
    x, y = np.asarray(polygon, dtype=float).T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _supersampled(points, faces, size, k):
    """Share of k x k sample points of every pixel that lie in any triangle."""
    centre = (np.arange(size * k) + 0.5) / k
    x, y = np.meshgrid(centre, centre)
    covered = np.zeros_like(x, dtype=bool)
    for a, b, c in np.asarray(points)[np.asarray(faces)]:
        turns = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        covered |= np.all(np.greater_equal(turns, 0), 0) | np.all(np.less_equal(turns, 0), 0)
    return covered.reshape(size, k, size, k).mean((1, 3))


def _sheet(n):
    """Faces of an n x n grid of vertices, and its vertices at integers."""
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    x, y = np.meshgrid(np.arange(float(n)), np.arange(float(n)))
    return np.column_stack([x.ravel(), y.ravel()]), np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def _crumpled(seed):
    """A disc of cloth with folds that overlap, inside the image of the default camera."""
    mesh = disc_mesh(297)
    crumple = np.random.default_rng(seed).normal(0, 0.012, (mesh.vertices, 3))
    return 0.9 * mesh.flat + crumple, mesh.faces


def test_a_half_plane_edge_gives_each_pixel_its_share():
    """A huge triangle whose side x = y/2 + 3 cuts the image: every pixel's area is known in closed form."""
    image = _draw([[3 - 500, -1000], [3 + 500, 1000], [-9000, 0]], [[0, 1, 2]])
    row, column = np.mgrid[:16, :16]
    # The side changes columns at whole rows only, so the mean of a row's two ends is exact.
    top, bottom = np.clip(3 + row / 2 - column, 0, 1), np.clip(3 + (row + 1) / 2 - column, 0, 1)
    np.testing.assert_allclose(image, (top + bottom) / 2, atol=1e-12)


def test_disc_polygon_has_its_polygon_area():
    mesh = disc_mesh(297)
    camera = ParallelCamera()
    image = _draw(np.pad(mesh.material, ((0, 0), (0, 1))), mesh.faces, size=256, camera=camera)
    expected = _area(camera.px_per_m * mesh.material[mesh.boundary])
    assert image.sum() == pytest.approx(expected, rel=1e-12)
    assert image[100:156, 100:156].min() > 1 - 1e-12
    assert image.min() == 0
    assert image.max() <= 1


def test_overlapping_triangles_count_once():
    """Squares [1, 5]^2 and [3.5, 8.25]^2 overlap in [3.5, 5]^2."""
    corner = lambda a, b: [[a, a], [b, a], [b, b], [a, b]]  # noqa: E731
    image = _draw(corner(1, 5) + corner(3.5, 8.25), [[0, 1, 2], [0, 2, 3], [6, 5, 4], [4, 6, 7]])
    assert image.sum() == pytest.approx(16 + 4.75**2 - 1.5**2, rel=1e-14)
    assert image[4, 4] == pytest.approx(1, abs=1e-15)
    assert image[3, 5] == pytest.approx(0.5, abs=1e-15)
    assert image[8, 8] == pytest.approx(0.25**2, abs=1e-15)


def test_a_hole_stays_open():
    outer = np.array([[1, 1], [13, 2], [12, 12], [2, 14]])
    inner = np.array([[5, 5], [8.5, 5.5], [8, 8], [5.5, 8.25]])
    faces = [face for i in range(4) for face in ([i, (i + 1) % 4, i + 4], [(i + 1) % 4, (i + 1) % 4 + 4, i + 4])]
    image = _draw(np.vstack([outer, inner]), faces)
    assert image.sum() == pytest.approx(_area(outer) - _area(inner), rel=1e-14)
    assert image[6, 6] == 0
    assert image[3, 6] == 1


@pytest.mark.parametrize("crease", [5.0, 5.37])
def test_a_folded_sheet_shows_its_layers_once(crease):
    """Folded at the crease, half of the faces are turned over; only the longer half [crease - 5, crease] is seen."""
    points, faces = _sheet(11)
    points[:, 0] = np.abs(points[:, 0] - crease)
    image = _draw(points + np.array([2.25, 3.5]), faces)
    assert image.sum() == pytest.approx(5 * 10, rel=1e-13)
    assert image[5:12, 4:6].min() == pytest.approx(1, abs=1e-14)


def test_cloth_seen_edge_on_is_invisible_and_harmless():
    points, faces = _sheet(8)
    edge_on = np.column_stack([points[:, 0] * 0.6 + 2, points[:, 0] * 0.8 + 3])
    assert _draw(edge_on, faces).max() < 1e-12
    upright = np.column_stack([np.full(64, 4.5), points[:, 1] + 2])
    assert _draw(upright, faces).max() < 1e-12
    flag = np.vstack([edge_on, [[3, 9], [9, 9], [9, 13]]])
    image = _draw(flag, np.vstack([faces, [[64, 65, 66]]]))
    assert image.sum() == pytest.approx(12, rel=1e-12)


def test_collapsed_triangles_leave_no_gap():
    """Vertex 4 lies on the diagonal that two triangles share: the third, between them, has no area."""
    points = [[2, 2], [10, 2], [10, 10], [2, 10], [6, 6]]
    image = _draw(points, [[0, 1, 2], [0, 2, 4], [0, 4, 3], [4, 2, 3]])
    assert image[2:10, 2:10].min() == pytest.approx(1, abs=1e-15)
    assert image.sum() == pytest.approx(64, rel=1e-15)


def test_a_cloth_larger_than_the_image_is_clipped():
    image = _draw([[-40, -30], [60, -30], [60, 80], [-40, 80]], [[0, 1, 2], [0, 2, 3]])
    assert (image == 1).all()
    image = _draw([[-5.5, 3], [4.25, 3], [4.25, 40], [-5.5, 40]], [[0, 1, 2], [0, 2, 3]])
    assert image.sum() == pytest.approx(4.25 * 13, rel=1e-14)
    assert not _draw([[20, 2], [30, 3], [25, 9]], [[0, 1, 2]]).any()
    assert not _draw([[2, -9], [3, -2], [9, -3]], [[0, 1, 2]]).any()


@pytest.mark.parametrize("lattice", [None, 1, 2])
@pytest.mark.parametrize("seed", range(8))
def test_triangle_soup_agrees_with_supersampling(seed, lattice):
    """Random triangles; on a lattice, sides coincide and vertices lie on sides and pixel borders."""
    rng, k = np.random.default_rng(seed), 24
    points = rng.uniform(-3, 15, (20, 2)) if lattice is None else rng.integers(0, 12 * lattice, (20, 2)) / lattice
    faces = np.array([rng.choice(20, 3, replace=False) for _ in range(rng.integers(1, 25))])
    image = _draw(points, faces, size=12)
    assert np.abs(image - _supersampled(points, faces, 12, k)).max() < 2 / k
    transposed = _draw(points[:, ::-1], faces, size=12).T
    np.testing.assert_allclose(image, transposed, atol=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_a_crumpled_sheet_agrees_with_supersampling(seed):
    rng, (points, faces) = np.random.default_rng(seed), _sheet(12)
    points = points + rng.normal(0, 1.2, points.shape)
    image, reference = _draw(points, faces, size=12), _supersampled(points, faces, 12, 24)
    assert np.abs(image - reference).max() < 2 / 24
    assert image.sum() == pytest.approx(reference.sum(), rel=1e-3)


@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_numbering_orientation_and_order_do_not_matter(method):
    points, faces = _crumpled(1)
    rng = np.random.default_rng(0)
    rename = rng.permutation(len(points))
    shuffled = rename[rng.permuted(faces, axis=1)][rng.permutation(len(faces))]  # turns faces over, too
    renumbered = np.empty_like(points)
    renumbered[rename] = points
    image = _draw(points, faces, size=256, camera=ParallelCamera(), method=method)
    again = _draw(renumbered, shuffled, size=256, camera=ParallelCamera(), method=method)
    np.testing.assert_allclose(image, again, atol=1e-11)


@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_a_pixel_to_the_right_and_up_shifts_the_image(method):
    points, faces = _crumpled(2)
    image = _draw(points, faces, size=256, camera=ParallelCamera(), method=method)
    step = np.array([1 / 723, 1 / 723, 0])
    moved = _draw(points + step, faces, size=256, camera=ParallelCamera(), method=method)
    np.testing.assert_allclose(moved[:-1, 1:], image[1:, :-1], atol=1e-9)


def test_upwards_on_the_cloth_is_upwards_in_the_image():
    image = _draw([[-0.01, 0.05, 0], [0.01, 0.05, 0], [0, 0.1, 0]], [[0, 1, 2]], size=256, camera=ParallelCamera())
    assert image[:128].sum() == pytest.approx(723**2 * 0.0005, rel=1e-9)
    assert not image[128:].any()


@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_batches_are_drawn_one_by_one(method):
    faces = _crumpled(0)[1]
    batch = torch.tensor(np.array([[_crumpled(2 * i + k)[0] for k in range(2)] for i in range(2)]))
    images = render(batch, faces, PinholeCamera(), method=method, size=256)
    assert images.shape == (2, 2, 256, 256)
    assert images.dtype == torch.float64
    assert torch.equal(images[1, 0], render(batch[1, 0], torch.as_tensor(faces), PinholeCamera(), method=method))
    assert render(batch[:0], faces, PinholeCamera(), method=method).shape == (0, 2, 256, 256)


@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_nothing_to_draw_gives_an_empty_image(method):
    nothing = np.empty((0, 3), dtype=np.int64)
    assert not _draw(np.zeros((3, 3)), nothing, method=method).any()


def test_bad_input_is_refused_with_its_value():
    render = inspect.unwrap(silhouette.render)  # a type checker installed for the tests would complain first
    points, faces, camera = torch.zeros(4, 3, dtype=torch.float64), np.array([[0, 1, 2]]), ParallelCamera()
    for match, call in {
        "method.*'hard'": lambda: render(points, faces, camera, method="hard"),
        "size 0": lambda: render(points, faces, camera, size=0),
        r"\(4, 2\)": lambda: render(points[:, :2], faces, camera),
        r"\(1, 2\)": lambda: render(points, faces[:, :2], camera),
        "float64": lambda: render(points, faces.astype(float), camera),
        r"\[0, 3\], got 0 to 7": lambda: render(points, np.array([[0, 1, 7]]), camera),
        "finite and within": lambda: render(points.log(), faces, camera),
        "finite.*1e[+]09 pixels": lambda: render(points + 1e200, faces, camera),
    }.items():
        with pytest.raises(SimulationError, match=match):
            call()


def test_positions_may_be_an_array_and_sizes_are_whole():
    mesh = disc_mesh(60)
    image = render(torch.from_numpy(mesh.flat), mesh.faces, ParallelCamera())
    assert torch.equal(render(mesh.flat, mesh.faces, ParallelCamera()), image)
    with pytest.raises(SimulationError, match=r"whole number of pixels a side, at least one, got size 256\.5"):
        render(mesh.flat, mesh.faces, ParallelCamera(), size=256.5)  # pyright: ignore[reportArgumentType]


def test_the_releases_mesh_lies_on_its_silhouette_in_parallel_projection_only(real_data):
    with (real_data / "audit.csv").open(encoding="utf-8") as table:
        row = next(r for r in csv.DictReader(table) if r["image"].endswith("Fabric_1_Sample_1_Capture_1.jpg"))
    grey = np.asarray(Image.open(real_data / row["image"]).convert("L"), dtype=np.float64)
    vertices, faces = read_obj(real_data / row["mesh"])
    error = {
        name: np.mean((_draw(vertices, faces, size=256, camera=camera) - (1 - grey / 255)) ** 2)
        for name, camera in {"mse_asis": ParallelCamera(), "mse_asis_scriptcam": PinholeCamera()}.items()
    }
    assert error["mse_asis"] == pytest.approx(float(row["mse_asis"]), abs=5e-4)
    # The audit drew the perspective image with another rasteriser, which covers border pixels differently.
    assert error["mse_asis_scriptcam"] == pytest.approx(float(row["mse_asis_scriptcam"]), abs=2e-3)
