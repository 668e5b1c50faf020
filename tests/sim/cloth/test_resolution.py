"""The one place that names mesh and resolution: every law gets its own mesh, and meshes from elsewhere are fitted."""

from pathlib import Path

import numpy as np
import pytest

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh, fitted_to
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import VERTICES_TO_FIT
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError

MAKEFILE = Path(__file__).resolve().parents[3] / "Makefile"
RADII = {"radius": 0.12, "plate_radius": 0.07}


@pytest.mark.parametrize(("law", "made"), [("plate", ring_mesh), ("paper", disc_mesh), ("published", disc_mesh)])
def test_every_law_gets_its_own_mesh_of_the_size_that_is_asked_for(law, made):
    mesh = cloth_mesh(law, 150, seed=3, **RADII)
    assert mesh is made(150, seed=3, **RADII)
    assert mesh.vertices == 150
    assert np.hypot(*mesh.material.T).max() == pytest.approx(RADII["radius"])


def test_another_law_has_no_mesh():
    """It would get one of the laws of hinges, and err as they do."""
    with pytest.raises(SimulationError, match="law must be one of plate, paper, published, got 'plates'"):
        cloth_mesh("plates", 150)


def test_a_mesh_without_a_ring_on_the_plates_edge_is_fitted_to_law_plate_alone():
    turned = disc_mesh(300, plate_radius=0.086)
    with pytest.raises(SimulationError, match="ring of vertices on the plate's edge"):
        DrapeSimulator(turned, DrapeSettings(law="plate"))
    assert fitted_to("paper", turned) is turned
    fitted = fitted_to("plate", turned)
    np.testing.assert_array_equal(fitted.faces, turned.faces)
    drape = DrapeSimulator(fitted, DrapeSettings(law="plate", steps=2)).drape(
        uniform_material(density=0.2, bending=1e-5)
    )
    assert float(drape.vertices[fitted.boundary, 2].mean()) < -1e-3


def test_make_bench_fits_on_the_mesh_that_is_named():
    bench = MAKEFILE.read_text().split("\nbench:")[1].split("\n\n")[0]
    assert f"--vertices {VERTICES_TO_FIT} " in bench


def test_a_mesh_that_cannot_be_fitted_says_so():
    coarse = Mesh(np.array([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]]), np.array([[0, 1, 2]]))
    with pytest.raises(SimulationError, match="plate's edge"):
        fitted_to("plate", coarse)
