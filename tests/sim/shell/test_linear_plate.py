import pytest
from shells import jittered, relative_tip_deflection

from cusick_bench.sim.cloth.mesh import disc_mesh


@pytest.mark.parametrize("poisson", [-1 / 3, 0.0, 0.3])
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_clamped_annulus_under_its_weight_deflects_as_the_exact_solution(poisson, share):
    mesh = jittered(disc_mesh(480), share) if share else disc_mesh(480)
    assert relative_tip_deflection(mesh, poisson) == pytest.approx(1, abs=0.01)
