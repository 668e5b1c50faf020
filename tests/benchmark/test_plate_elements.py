"""Discretisations of a plate side by side: each is what its name says, and the chosen one is right."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cusick_bench.benchmark.convergence.order import observed_order
from cusick_bench.benchmark.convergence.plate_elements import ELEMENTS, compare_plate_elements
from cusick_bench.cli import app
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh

PAGE = Path(__file__).resolve().parents[2] / "docs" / "physics.md"


@pytest.fixture(scope="module")
def rows():
    return compare_plate_elements([disc_mesh(297), disc_mesh(700)], (0.0, 0.3))


def ratios(rows, element):
    return [row.ratio for row in rows if row.element == element]


def test_every_discretisation_is_there_with_and_without_poissons_ratio(rows):
    for name in ELEMENTS:
        own = [row for row in rows if row.element == name]
        assert {row.vertices for row in own} == {297, 700}
        assert {row.poisson for row in own} == ({-1 / 3} if name == "hinges" else {0.0, 0.3})


@pytest.mark.parametrize("element", ["edge unknowns", "fitted slopes"])
def test_converging_ones_halve_their_error_and_are_soft(rows, element):
    coarse, fine = (max(row.ratio for row in rows if row.element == element and row.vertices == n) for n in (297, 700))
    assert 1 < fine < coarse < 1.15
    assert fine - 1 < 0.6 * (coarse - 1)


def test_averaged_normals_keep_their_error(rows):
    assert all(0.94 < ratio < 0.99 for ratio in ratios(rows, "averaged normals"))


def test_correction_takes_most_of_the_loop_surfaces_error(rows):
    plain = max(abs(ratio - 1) for ratio in ratios(rows, "Loop surface"))
    mended = max(abs(ratio - 1) for ratio in ratios(rows, "corrected Loop surface"))
    assert mended < 0.01 < plain


def test_on_rings_the_error_falls_as_the_page_says():
    meshes = [ring_mesh(size) for size in (297, 480, 1205, 2699)]
    found = compare_plate_elements(meshes, elements=["corrected Loop surface"])
    order = observed_order([row.vertices for row in found], [row.ratio - 1 for row in found])
    assert order is not None
    assert order.order > 2
    said = ", ".join(f"{row.ratio:.3f}" for row in found)
    assert f"on meshes in rings the error falls at least with the square of the spacing: {said}." in " ".join(
        PAGE.read_text().lower().split()
    )


def test_the_command_lists_them_as_json():
    result = CliRunner().invoke(app, ["plate-elements", "--vertices", "150", "--rings", "--json"])
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert found["meshes"] == "rings"
    assert {row["element"] for row in found["plates"]} == set(ELEMENTS)
