"""Materials for other programs: conversions by hand, files that run, and errors that say what to do."""

import csv
import json
import math
import runpy
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from finished_cell import CLOTHS, write_cell
from identified import DENSITY, write_identification
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.cli.export.material import ProgramName
from cusick_bench.datasets import load
from cusick_bench.export.errors import ExportError
from cusick_bench.export.material import PROGRAMS, FabricMaterial, read_material, write_material
from cusick_bench.export.material.newton import edge_stiffness, membrane_stiffness
from cusick_bench.metrics.found_stiffness import Quantity
from cusick_bench.sim.errors import CusickError

FABRIC = FabricMaterial(
    "wool",
    "homo",
    "cell a",
    0.2,
    {
        "warp": Quantity(16e-6, (8e-6, 32e-6)),
        "weft": Quantity(1e-6, (0.5e-6, 2e-6)),
        "bias": Quantity(4e-6, (2e-6, 8e-6)),
    },
    {"warp": Quantity(400.0), "weft": Quantity(225.0), "shear": Quantity(60.0)},
)


def test_means_are_geometric_and_count_both_diagonals():
    assert FABRIC.mean_bending.value == pytest.approx(4e-6)  # (16 * 1 * 4 * 4)^(1/4)
    assert FABRIC.mean_bending.ci90 == pytest.approx((2e-6, 8e-6))
    assert FABRIC.mean_stretch == Quantity(pytest.approx(300.0), None)
    assert FABRIC.anisotropy == pytest.approx(16)


def _triangulated_plane(edge: float, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Lattice of equilateral triangles turned by an angle: points (n, 2) and triangles (m, 3)."""
    size = 12
    row, column = (grid.ravel() for grid in np.mgrid[:size, :size])
    points = edge * np.stack([column + row / 2, row * math.sqrt(3) / 2], -1)
    first = (row * size + column)[(row < size - 1) & (column < size - 1)]
    upper, lower = (first, first + 1, first + size), (first + 1, first + size + 1, first + size)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return points @ turn.T, np.concatenate([np.stack(upper, -1), np.stack(lower, -1)])


def _energy_per_area(vertices: np.ndarray, triangles: np.ndarray, edge: float, edge_ke: float) -> float:
    """Energy of VBD over triangles with three neighbours: half of each edge's energy belongs to either side."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sides: dict[frozenset[int], list[int]] = {}
    for number, (a, b, c) in enumerate(triangles.tolist()):
        for pair in ((a, b), (b, c), (c, a)):
            sides.setdefault(frozenset(pair), []).append(number)
    energy, count = np.zeros(len(triangles)), np.zeros(len(triangles), int)
    for pair in (pair for pair in sides.values() if len(pair) == 2):
        theta = math.acos(min(1.0, float(normals[pair[0]] @ normals[pair[1]])))
        energy[pair] += 0.5 * (0.5 * edge_ke * edge * theta**2)
        count[pair] += 1
    return float(energy[count == 3].mean() / (math.sqrt(3) / 4 * edge**2))


@pytest.mark.parametrize("degrees", [0, 11, 30, 47])
def test_newtons_edges_bend_a_triangulated_cylinder_as_the_fabric_does(degrees: int):
    edge, bending, curvature = 0.01, 4e-6, 5.0
    points, triangles = _triangulated_plane(edge, math.radians(degrees))
    turned = curvature * points[:, 0]
    vertices = np.stack([np.sin(turned) / curvature, points[:, 1], np.cos(turned) / curvature], -1)
    found = _energy_per_area(vertices, triangles, edge, edge_stiffness(bending, edge))
    assert found == pytest.approx(0.5 * bending * curvature**2, rel=2e-3)


@pytest.mark.parametrize(("stretch", "shear", "expected"), [(300, 60, (60, 180)), (100, 80, (50, 0))])
def test_newtons_membrane_has_the_stretch_stiffness(stretch: float, shear: float, expected: tuple[float, float]):
    mu, area = membrane_stiffness(stretch, shear)
    assert (mu, area) == pytest.approx(expected)
    assert area + 2 * mu == stretch


def test_newton_gets_keyword_arguments(tmp_path: Path):
    write_material(tmp_path / "out", FABRIC, "newton", edge_length=0.02)
    document = json.loads((tmp_path / "out" / "newton.json").read_text())
    expected = {"density": 0.2, "tri_ke": 60, "tri_ka": 180, "tri_kd": 0, "edge_ke": 2.3094e-4, "edge_kd": 0}
    assert document["add_cloth_mesh"] == pytest.approx(expected, rel=1e-4)
    assert document["edge_ke_ci90"] == pytest.approx([1.1547e-4, 4.6188e-4], rel=1e-4)
    script = runpy.run_path(str(tmp_path / "out" / "newton_cloth.py"))
    points, triangles = _triangulated_plane(0.02, 0.3)
    length = script["mean_edge_length"]([(x, y, 0.0) for x, y in points.tolist()], triangles.ravel().tolist())
    assert length == pytest.approx(0.02)
    assert script["keyword_arguments"](length) == pytest.approx(document["add_cloth_mesh"])


def _blender(folder: Path) -> dict[str, Any]:
    write_material(folder, FABRIC, "blender")
    return runpy.run_path(str(folder / "blender_cloth.py"))


def test_blenders_fields_by_hand(tmp_path: Path):
    script = _blender(tmp_path / "out")
    squares = script["cloth_settings"](script["CLOTH"], 1.0, 10_000, 0.01, 4)
    assert squares.pop("bending_model") == "ANGULAR"
    by_hand = {"mass": 0.02, "bending_stiffness": 0.8, "shear_stiffness": 0.6}
    assert squares == pytest.approx(by_hand | {"tension_stiffness": 2.4, "compression_stiffness": 2.4})
    triangles = script["cloth_settings"](script["CLOTH"], 1.0, 10_000, 0.01, 3)
    assert triangles["bending_stiffness"] == pytest.approx(1.6)
    assert triangles["tension_stiffness"] == pytest.approx(2.3094, rel=1e-4)


@pytest.mark.parametrize("corners", [3, 4])
def test_blenders_springs_and_hinges_are_as_stiff_as_the_fabric(corners: int, tmp_path: Path):
    """Forces of Blender's code on one cell of the mesh, in newtons where masses are in grams."""
    script, edge = _blender(tmp_path / "out"), 0.013
    fields = script["cloth_settings"](script["CLOTH"], 1.0, 1000, edge, corners)
    height, area = (edge, edge**2) if corners == 4 else (math.sqrt(3) / 2 * edge, math.sqrt(3) / 2 * edge**2)
    torque = 0.1 * fields["bending_stiffness"] * edge * (corners - 2) / corners * height  # per radian
    expected = 4e-6 if corners == 4 else edge_stiffness(4e-6, edge) * edge
    assert torque == pytest.approx(expected)
    angles = (0, 90) if corners == 4 else (0, 60, 120)
    springs = [(fields["tension_stiffness"] / edge, edge, angle) for angle in angles]
    if corners == 4:
        springs += [(fields["shear_stiffness"] / edge, math.sqrt(2) * edge, angle) for angle in (45, 135)]
    stretch = sum(k * length**2 * math.cos(math.radians(angle)) ** 4 for k, length, angle in springs) / area
    assert stretch == pytest.approx(300)
    shear = sum(k * (length * math.sin(math.radians(2 * angle)) / 2) ** 2 for k, length, angle in springs) / area
    assert shear == pytest.approx(60 if corners == 4 else 100)


class _Mesh:
    """A mesh of bmesh: one square of a metre."""

    verts = range(4)
    edges = (SimpleNamespace(calc_length=lambda: 1.0),) * 4
    faces = (SimpleNamespace(verts=range(4), calc_area=lambda: 1.0),)

    def from_mesh(self, data: Any) -> None: ...
    def transform(self, matrix: Any) -> None: ...
    def free(self) -> None: ...


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_the_script_for_blender_sets_the_active_object(unit: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_material(tmp_path / "out", FABRIC, "blender")
    cloth = SimpleNamespace(type="CLOTH", settings=SimpleNamespace())
    thing = SimpleNamespace(type="MESH", name="Plane", data=None, matrix_world=None, modifiers=[cloth])
    scene = SimpleNamespace(unit_settings=SimpleNamespace(scale_length=unit))
    blender = SimpleNamespace(context=SimpleNamespace(active_object=thing, scene=scene))
    monkeypatch.setitem(sys.modules, "bpy", blender)
    monkeypatch.setitem(sys.modules, "bmesh", SimpleNamespace(new=_Mesh))
    script = str(tmp_path / "out" / "blender_cloth.py")
    if unit != 1:
        with pytest.raises(ValueError, match="Unit Scale to 1"):
            runpy.run_path(script, run_name="__main__")
        return
    runpy.run_path(script, run_name="__main__")
    assert cloth.settings.mass == pytest.approx(50.0)  # 200 g on four vertices
    assert cloth.settings.bending_stiffness == pytest.approx(8e-5)


@pytest.mark.parametrize("program", ["blender", "newton"])
def test_scripts_hold_the_fabrics_name_as_it_is(program: str, tmp_path: Path):
    files = write_material(tmp_path / "out", replace(FABRIC, name="silk \U0001f9f5"), program)
    (script,) = (path for path in files if path.suffix == ".py")
    assert runpy.run_path(str(script))["FABRIC"] == "silk \U0001f9f5"


@pytest.mark.parametrize("name", ["marvelous", "clo"])
def test_tables_to_type_in_have_their_units(name: str, tmp_path: Path):
    write_material(tmp_path / "out", FABRIC, name)
    with (tmp_path / "out" / f"{name}.csv").open() as file:
        rows = {row["property"]: row for row in csv.DictReader(file)}
    assert rows["Bending - Warp"] == {
        "property": "Bending - Warp", "value": "16000", "low": "8000", "high": "32000", "unit": "g mm2/s2",
    }  # fmt: skip
    assert (rows["Stretch - Weft"]["value"], rows["Stretch - Weft"]["low"]) == ("225000", "")
    assert (rows["Shear"]["value"], rows["Shear"]["unit"]) == ("60000", "g/s2")
    assert (rows["Density"]["value"], rows["Density"]["unit"]) == ("200", "g/m2")
    assert "| Bending - Bias | 4000 | 2000 to 8000 | g mm2/s2 |" in (tmp_path / "out" / f"{name}.md").read_text()
    assert "unverified" in (tmp_path / "out" / "README.md").read_text()


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_readme_says_what_is_lost(name: str, tmp_path: Path):
    fabric = replace(FABRIC, curve={"warp": (1e-5, 2e-5, 3e-5, 4e-5, 5e-5)})
    files = write_material(tmp_path / "out", fabric, name)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {path.name for path in files}
    text = (tmp_path / "out" / "README.md").read_text()
    for words in (PROGRAMS[name].title, "curvature", "8e-06 to 3.2e-05", "- warp: 1e-05, 2e-05", "homo (cell a)"):
        assert words in text
    with pytest.raises(ExportError, match="is there already"):
        write_material(tmp_path / "out", fabric, name)


@pytest.mark.parametrize("posterior", [False, True])
def test_the_readme_says_what_value_and_curve_have_in_common(posterior: bool, tmp_path: Path):
    """The median of means over curvatures is not the mean of the medians that the curve shows."""
    bending = {name: replace(one, ci90=one.ci90 if posterior else None) for name, one in FABRIC.bending.items()}
    fabric = replace(FABRIC, bending=bending, curve={"warp": (1e-5, 2e-5, 3e-5, 4e-5, 5e-5)})
    write_material(tmp_path / "out", fabric, "clo")
    text = (tmp_path / "out" / "README.md").read_text()
    assert ("the values above are its geometric mean:" in text) != posterior
    assert ("all are medians over the draws:\n\n- warp" in text) == posterior


def test_the_command_knows_the_programs():
    assert {name.value for name in ProgramName} == set(PROGRAMS)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"density": 20.0}, "areal density must be"),
        ({"bending": {**FABRIC.bending, "weft": Quantity(0.0)}}, "weft must be > 0"),
        ({"bending": {**FABRIC.bending, "weft": Quantity(1e-6, (2e-6, 1e-6))}}, "ordered interval"),
        ({"stretch": {"warp": Quantity(1.0)}}, "stretch stiffness of weft is missing"),
    ],
)
def test_no_material_without_sound_values(changes: dict[str, Any], words: str):
    with pytest.raises(ExportError, match=words):
        replace(FABRIC, **changes)


@pytest.mark.parametrize(
    ("program", "edge_length", "words"),
    [("clo", 0.01, "of no use"), ("newton", 8.0, "in metres"), ("maya", None, "are written for blender")],
)
def test_what_cannot_be_asked_for_is_refused(program: str, edge_length: float | None, words: str, tmp_path: Path):
    with pytest.raises(ExportError, match=words):
        write_material(tmp_path / "out", FABRIC, program, edge_length=edge_length)
    assert not (tmp_path / "out").exists()


def test_an_interruption_leaves_nothing_in_the_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "out").mkdir()  # an empty folder stays
    write = Path.write_bytes

    def interrupted(path: Path, content: bytes) -> int:
        if path.name == "README.md":
            raise KeyboardInterrupt
        return write(path, content)

    with monkeypatch.context() as stopped:
        stopped.setattr(Path, "write_bytes", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_material(tmp_path / "out", FABRIC, "newton")
    assert list((tmp_path / "out").iterdir()) == []
    assert len(write_material(tmp_path / "out", FABRIC, "newton")) == 3


@pytest.fixture
def cell(toy_data: Path, tmp_path: Path) -> Path:
    tables = {"stretch": np.tile([150.0, 1.0, 150.0, 60.0], (6, 1)), "bending": np.full((3, 5), 2e-5)}
    folder = write_cell(
        tmp_path / "run", load(toy_data), "homo", CLOTHS[0], np.zeros((1, 8, 8)),
        arrays={**tables, "density": np.array(0.2)},
    )  # fmt: skip
    _change(folder, stiffness=_plain(FABRIC.bending), stretch=_plain(FABRIC.stretch))
    return folder


def _plain(values: Any) -> dict[str, Any]:
    return {name: {"value": one.value, "ci90": one.ci90} for name, one in values.items()}


def _change(folder: Path, **changes: Any) -> None:
    path = folder / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_a_cell_is_read(cell: Path):
    found = read_material(cell)
    assert (found.name, found.solver, found.density) == (CLOTHS[0], "homo", 0.2)
    assert (found.bending, found.stretch) == (FABRIC.bending, FABRIC.stretch)


def test_another_weight_leaves_what_a_drape_tells(cell: Path, tmp_path: Path):
    _change(cell, stiffness_curve={name: [1e-6, 2e-6, 3e-6, 4e-6, 5e-6] for name in FABRIC.bending})
    fitted, heavier = read_material(cell), read_material(cell, density=0.3)
    assert heavier.density == 0.3
    for name, one in fitted.bending.items():
        other = heavier.bending[name]
        assert other.value / 0.3 == pytest.approx(one.value / 0.2)
        assert np.divide(other.ci90, 0.3) == pytest.approx(np.divide(one.ci90, 0.2))
        assert np.divide(heavier.curve[name], 0.3) == pytest.approx(np.divide(fitted.curve[name], 0.2))
    for name, one in fitted.stretch.items():
        assert heavier.stretch[name].value / 0.3 == pytest.approx(one.value / 0.2)
    write_material(tmp_path / "out", heavier, "newton")
    readme = " ".join((tmp_path / "out" / "README.md").read_text().split())
    assert "The result is of a cloth of 0.2 kg/m2." in readme
    assert "times 1.5, the ratio of the weights" in readme
    write_material(tmp_path / "as-fitted", read_material(cell, density=0.2), "newton")
    assert "The result is of a cloth" not in (tmp_path / "as-fitted" / "README.md").read_text()


def test_a_fit_of_a_heavier_cloth_than_stated_keeps_that_weight(cell: Path):
    """Its stiffness is that of the cloth that was draped."""
    causes = ["off-centre:shift=0.002,direction=0", "density-bias:bias=0.5"]
    for name in ("cell.json", "result.json"):
        record = json.loads((cell / name).read_text())
        record["settings"] = record["settings"] | {"causes": causes}
        (cell / name).write_text(json.dumps(record))
    found = read_material(cell)
    assert found.density == pytest.approx(0.3)  # the table says 0.2
    assert found.bending == FABRIC.bending
    assert found.solver == "homo + off-centre:shift=0.002,direction=0 + density-bias:bias=0.5"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiffness": None}, "predicts drapes without simulating"),
        ({"stiffness": {"warp": 3}}, "damaged: stiffness.warp must be an object"),
        ({"status": "failed", "failure": "out of memory"}, r"failed on .*\(out of memory\)"),
    ],
)
def test_a_cell_without_sound_stiffness_is_refused(changes: dict[str, Any], words: str, cell: Path):
    _change(cell, **changes)
    with pytest.raises(ExportError, match=words):
        read_material(cell)


def test_other_results_are_refused(cell: Path, tmp_path: Path):
    with pytest.raises(ExportError, match="leave out --fabric"):
        read_material(cell, fabric="another")
    with pytest.raises(ExportError, match="neither a cell nor"):
        read_material(tmp_path)
    with pytest.raises(ExportError, match="no result at"):
        read_material(tmp_path / "nowhere")
    for name in ("cell.json", "result.json", "prediction.npz"):
        with pytest.raises(ExportError, match="is a file of a cell; give the cell's folder, ") as refusal:
            read_material(cell / name)
        assert str(refusal.value).endswith(str(cell))
    (cell / "prediction.npz").write_bytes(b"PK")
    with pytest.raises(CusickError, match="run the cell again"):
        read_material(cell)
    (cell / "result.json").unlink()
    with pytest.raises(ExportError, match="has not finished"):
        read_material(cell)


def test_an_identification_is_read(toy_data: Path, tmp_path: Path):
    document = write_identification(load(toy_data), tmp_path / "lab")
    first, second = document.fabrics
    found = read_material(tmp_path / "lab")
    assert (found.name, found.density) == (first.fabric, DENSITY)
    assert found.bending["weft"] == Quantity(7e-6, (3e-6, 15.5e-6))
    heavier = read_material(tmp_path / "lab", density=2 * DENSITY)
    assert heavier.bending["weft"].value == pytest.approx(14e-6)
    path = tmp_path / "lab" / "identify.json"
    for density in (None, 0.2):  # without a weight nothing was fitted
        with pytest.raises(ExportError, match=r"its weight is not known.*; repeat `cusick-bench identify` with its"):
            read_material(path, fabric=second.fabric, density=density)
    with pytest.raises(ExportError, match=f"one of {first.fabric}, {second.fabric}"):
        read_material(path, fabric="silk")
    both = document.model_copy(
        update={"fabrics": tuple(one.model_copy(update={"fit": first.fit}) for one in document.fabrics)}
    )
    both.write(path)
    with pytest.raises(ExportError, match="choose one with --fabric"):
        read_material(path)
    with pytest.raises(ExportError, match="give it by --density"):
        read_material(path, fabric=second.fabric)
    unweighed = read_material(path, fabric=second.fabric, density=0.1)
    assert (unweighed.density, unweighed.bending) == (0.1, found.bending)


def test_the_command_writes_and_refuses(cell: Path, tmp_path: Path):
    out = tmp_path / "out"
    arguments = ["export", "material", str(cell), "--for", "newton", "--out", str(out), "--json"]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    assert document["areal_density"] == 0.2
    assert {Path(path).name for path in document["files"]} == {"newton.json", "newton_cloth.py", "README.md"}
    refused = CliRunner().invoke(app, [*arguments[:-1], "--edge-length", "12"])
    assert refused.exit_code == 2
    assert "in metres" in refused.stderr
