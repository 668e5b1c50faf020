"""Disc meshes are what they promise at every size and seed; bad meshes and bad files are refused by name."""

from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.obj import mesh_from_obj, read_obj, write_obj
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError

SIZES = [60, 61, 100, 297, 1205, 2699]


def _angles(mesh: Mesh) -> ndarray:
    """Inner angles of the faces [degrees]."""
    corner = mesh.material[mesh.faces]
    angles = []
    for k in range(3):
        a, b = corner[:, (k + 1) % 3] - corner[:, k], corner[:, (k + 2) % 3] - corner[:, k]
        angles.append(np.arccos((a * b).sum(1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)))
    return np.degrees(np.array(angles))


@pytest.mark.parametrize("vertices", SIZES)
def test_disc_has_the_asked_vertices_and_the_topology_of_a_disc(vertices: int):
    mesh = disc_mesh(vertices)
    assert mesh.vertices == vertices
    assert vertices - len(mesh.edges) + len(mesh.faces) == 1  # Euler
    assert len(mesh.hinges) == len(mesh.edges) - len(mesh.boundary)


@pytest.mark.parametrize("vertices", SIZES)
def test_rings_lie_exactly_on_rim_and_plate_edge(vertices: int):
    mesh = disc_mesh(vertices)
    radius = np.hypot(*mesh.material.T)
    rim = np.abs(radius - CLOTH_RADIUS) < 1e-12
    plate = np.abs(radius - PLATE_RADIUS) < 1e-12
    assert set(mesh.boundary) == set(np.flatnonzero(rim))
    assert rim.sum() > plate.sum() > 10
    on_ring = plate[mesh.edges].all(1)
    assert on_ring.sum() == plate.sum()  # the plate's edge is a closed chain of mesh edges
    assert not (
        (radius < PLATE_RADIUS - 1e-12)[mesh.faces].any(1) & (radius > PLATE_RADIUS + 1e-12)[mesh.faces].any(1)
    ).any()


@pytest.mark.parametrize(("vertices", "seed"), [(n, 0) for n in SIZES] + [(n, 1) for n in SIZES[:-1]])
def test_triangles_are_near_equilateral(vertices: int, seed: int):
    mesh = disc_mesh(vertices, seed=seed)
    angles = _angles(mesh)
    assert angles.min() > 20
    assert angles.max() < 125
    assert angles.min(0).mean() > (47 if vertices >= 100 else 40)  # 60 in a lattice, 40 in a random point set
    assert mesh.areas.max() < 4 * mesh.areas.min()
    polygon = 0.5 * len(mesh.boundary) * CLOTH_RADIUS**2 * np.sin(2 * np.pi / len(mesh.boundary))
    assert mesh.areas.sum() == pytest.approx(polygon, rel=1e-9)


def test_seed_decides_the_mesh():
    first, again, other = (
        disc_mesh.__wrapped__(297, seed=seed, radius=CLOTH_RADIUS, plate_radius=PLATE_RADIUS) for seed in (5, 5, 6)
    )
    assert np.array_equal(first.material, again.material)
    assert np.array_equal(first.faces, again.faces)
    assert np.abs(first.material - other.material).max() > 1e-3


def test_other_radii_scale_the_rings():
    mesh = disc_mesh(297, radius=0.12, plate_radius=0.06)
    radius = np.hypot(*mesh.material.T)
    assert radius.max() == pytest.approx(0.12, abs=1e-12)
    assert (np.abs(radius - 0.06) < 1e-12).sum() > 10


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(("vertices", "radius", "plate_radius"), [(60, 0.12, 0.09), (150, 0.15, 0.02)])
def test_disc_without_vertices_between_rings_or_inside_the_plate_is_made_without_a_warning(
    vertices: int, radius: float, plate_radius: float
):
    assert disc_mesh.__wrapped__(vertices, radius=radius, plate_radius=plate_radius).vertices == vertices


def test_disc_says_why_vertices_are_too_few():
    with pytest.raises(SimulationError, match=r"28\.6 mm apart, farther than the rim is from the plate's edge"):
        disc_mesh(100, plate_radius=0.13)


def test_hinges_name_the_edge_and_the_corners_opposite_on_either_side():
    mesh = disc_mesh(100)
    start, end, left, right = (mesh.material[mesh.hinges[:, k]] for k in range(4))

    def side(point: ndarray) -> ndarray:
        along, to = end - start, point - start
        return along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]

    faces = {frozenset(face) for face in mesh.faces.tolist()}
    assert (side(left) > 0).all()
    assert (side(right) < 0).all()
    assert all(frozenset(hinge[[0, 1, k]].tolist()) in faces for hinge in mesh.hinges for k in (2, 3))


def test_boundary_runs_counter_clockwise_once_around():
    mesh = disc_mesh(100)
    angle = np.unwrap(np.arctan2(*mesh.material[mesh.boundary].T[::-1]))
    assert mesh.boundary[0] == mesh.boundary.min()
    assert (np.diff(angle) > 0).all()
    assert angle[-1] - angle[0] < 2 * np.pi


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"vertices": 59}, "at least 60"),
        ({"plate_radius": 0.15}, "plate < cloth"),
        ({"plate_radius": 0.0}, "plate < cloth"),
        ({"radius": float("inf")}, "plate < cloth"),
        ({"radius": float("nan")}, "plate < cloth"),
    ],
)
def test_impossible_discs_are_refused(arguments: dict, message: str):
    with pytest.raises(SimulationError, match=message):
        disc_mesh(**arguments)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("material", "faces", "message"),
    [
        (SQUARE, [[0, 2, 1], [0, 2, 3]], "counter-clockwise"),
        (SQUARE[[0, 1, 1, 3]], [[0, 1, 2], [0, 2, 3]], "degenerate"),
        (SQUARE, [[0, 1, 2], [0, 2, 4]], r"\[0, 3\]"),
        (SQUARE, [[0, 1, 2], [0, 2, -1]], r"\[0, 3\]"),
        (SQUARE, [[0, 1, 2]], "no face"),
        (SQUARE, [[0, 1, 2, 3]], "triangles"),
        (SQUARE, np.zeros((0, 3), int), "triangles"),
        (SQUARE * [1, np.nan], [[0, 1, 2], [0, 2, 3]], "finite"),
        (np.array([[0, 0], [1, 0], [0, 1], [0.2, 0.9], [0.1, 2]]), [[0, 1, 2], [0, 1, 3], [0, 1, 4]], "manifold"),
    ],
    ids=["clockwise", "degenerate", "index too large", "negative index", "unused", "quad", "empty", "nan", "fan"],
)  # fmt: skip
@pytest.mark.unchecked_arrays
def test_bad_meshes_are_refused(material: ndarray, faces, message: str):
    with pytest.raises(SimulationError, match=message):
        Mesh(material, np.array(faces))


def test_rim_of_a_mesh_with_a_hole_is_refused():
    angle = np.arange(12) * np.pi / 6
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    i, following = np.arange(12), (np.arange(12) + 1) % 12
    faces = np.concatenate([
        np.column_stack([i, 12 + i, 12 + following]), np.column_stack([i, 12 + following, following])
    ])  # fmt: skip
    with pytest.raises(SimulationError, match="boundary loop"):
        _ = Mesh(np.concatenate([ring, 2 * ring]), faces).boundary


def test_obj_round_trip(tmp_path: Path):
    mesh = disc_mesh(60)
    write_obj(tmp_path / "disc.obj", mesh.flat, mesh.faces)
    read = mesh_from_obj(tmp_path / "disc.obj")
    assert np.abs(read.material - mesh.material).max() < 1e-9
    assert np.array_equal(read.faces, mesh.faces)


def test_obj_may_hold_texture_indices_comments_and_other_elements(tmp_path: Path):
    path = tmp_path / "cloth.obj"
    path.write_text("# cloth\nmtllib a.mtl\nv 0 0 0\nv 1 0 0 1.0\nvn 0 0 1\nvt 0 0\nv 0 1 0\ns off\nf 1/1/1 2//1 3\n")
    points, faces = read_obj(path)
    assert np.array_equal(points, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert np.array_equal(faces, [[0, 1, 2]])


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "0 vertices"),
        (TRIANGLE, "0 faces"),
        (TRIANGLE + "f 1 2\n", "line 4"),
        (TRIANGLE + "f 1 2 4\n", "not there"),
        (TRIANGLE + "f 0 1 2\n", "not there"),
        (TRIANGLE + "f 1 2 three\n", "line 4.*three"),
        ("v 0 0\n", "line 1"),
        ("v 0 zero 0\n", "line 1.*zero"),
        ("v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
    ],
)
def test_malformed_obj_is_refused_with_file_and_line(tmp_path: Path, text: str, message: str):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(SimulationError, match=message) as refused:
        read_obj(path)
    assert "bad.obj" in str(refused.value)


def test_obj_polygons_are_fans_and_negative_indices_count_back(tmp_path: Path):
    path = tmp_path / "square.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf -3 -2 -1\nv 5 5 5\nf -1 -2 -3\n")
    assert read_obj(path)[1].tolist() == [[0, 1, 2], [0, 2, 3], [1, 2, 3], [4, 3, 2]]


def test_gzipped_obj_is_the_same_mesh_and_the_same_bytes_every_time(tmp_path: Path):
    mesh = disc_mesh(60)
    for name in ("plain.obj", "packed.obj.gz", "again.obj.gz"):
        write_obj(tmp_path / name, mesh.flat, mesh.faces)
    for mine, other in zip(read_obj(tmp_path / "packed.obj.gz"), read_obj(tmp_path / "plain.obj"), strict=True):
        assert np.array_equal(mine, other)
    assert (tmp_path / "packed.obj.gz").read_bytes() == (tmp_path / "again.obj.gz").read_bytes()


def test_a_shape_made_from_the_flat_cloth_changes_no_other_cloth():
    """Meshes are kept: later cloths of the same mesh had this shape as their shape at rest."""
    shape = disc_mesh(60).flat
    shape[:, 2] += 0.01
    assert (disc_mesh(60).flat[:, 2] == 0).all()


def test_missing_binary_and_draped_files_are_refused(tmp_path: Path):
    with pytest.raises(SimulationError, match="no mesh file"):
        read_obj(tmp_path / "absent.obj")
    with pytest.raises(SimulationError, match="no mesh file"):
        read_obj(tmp_path)
    (tmp_path / "image.obj").write_bytes(bytes(range(256)) * 10)
    with pytest.raises(SimulationError, match=r"image\.obj"):
        read_obj(tmp_path / "image.obj")
    (tmp_path / "draped.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 -0.02\nf 1 2 3\n")
    with pytest.raises(SimulationError, match="not flat"):
        mesh_from_obj(tmp_path / "draped.obj")
