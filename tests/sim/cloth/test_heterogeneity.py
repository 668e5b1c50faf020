"""Cloth whose stiffness varies over it."""

import numpy as np
import pytest

from cusick_bench.sim.cloth.heterogeneity import random_heterogeneity
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.resolution import cloth_mesh


def test_only_stiffness_varies():
    cloth, mesh = uniform_material(density=0.2, bending=1e-5, poisson=0.3), cloth_mesh("plate", 97)
    uneven = random_heterogeneity(cloth, mesh, 0.2, np.random.default_rng(0))
    assert (float(uneven.poisson), float(uneven.density)) == (pytest.approx(0.3), pytest.approx(0.2))
    for varied, table in ((uneven.bending, cloth.bending), (uneven.stretch, cloth.stretch)):
        factors = (varied / table).nan_to_num(1.0)[:, 0, 0].log()
        assert 0.1 < float(factors.std()) < 0.3
