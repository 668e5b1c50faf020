"""Law `plate`'s bending: the tables in cylinders, derivatives against differences, a positive definite D."""

import numpy as np
import pytest

from cusick_bench.sim.laws.paper import paper_bending
from cusick_bench.sim.laws.plate import (
    curvature_shares,
    plate_bending,
    plate_secant_slope,
    plate_stiffness,
    plate_table_adjoint,
    plate_tangent,
    squared_curvature,
)

POISSON = 0.2


def read(k, table, poisson=POISSON):
    shares, stiffness = np.zeros((3, 5)), np.zeros((3, 4))
    curvature_shares(squared_curvature(k), shares)
    plate_stiffness(table, poisson, shares, stiffness)
    return shares, stiffness


def energy(k, table, poisson=POISSON):
    return plate_bending(k, read(k, table, poisson)[1])[0]


def moments(k, table, poisson=POISSON):
    return np.array(plate_bending(k, read(k, table, poisson)[1])[1])


def matrix(entries):
    a, b, c, ab, ac, bc = entries
    return np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])


def differences(f, at, step):
    found = []
    for index in np.ndindex(at.shape):
        change = np.zeros_like(at)
        change[index] = step
        found.append((f(at + change) - f(at - change)) / (2 * step))
    return np.array(found)


@pytest.fixture(params=[(2.0, 1.0), (9.0, 0.3), (25.0, 1.0), (25.0, 0.3), (70.0, 1.0)], ids=str)
def cloth(request):
    """Curvatures of a size and a table whose bias row is soft or not."""
    size, soft = request.param
    generator = np.random.default_rng(3)
    table = 1e-5 * generator.uniform(0.5, 2.0, (3, 5))
    table[1] *= soft
    return generator.normal(0.0, size, 3), table


def test_a_cylinder_has_the_tables_moment_at_every_curvature():
    table = 1e-5 * np.random.default_rng(0).uniform(0.5, 2.0, (3, 5))
    for curvature in (0.5, 3.0, 17.0, 38.0, 44.9, 70.0, -23.0):
        for axis, row in ((0, 2), (1, 0)):
            k = np.zeros(3)
            k[axis] = curvature
            expected = paper_bending(curvature, 1.0, 0.0, table[row], table[row])[0] * curvature
            assert moments(k, table, 0.0)[axis] == pytest.approx(expected, rel=1e-12)


def test_a_cylinder_along_the_bias_has_the_bias_rows_moment():
    table = np.repeat([[1.1e-5], [1.4e-5], [0.9e-5]], 5, axis=1)
    curvature = 12.0
    k = np.array([0.5, 0.5, 1.0]) * curvature
    assert energy(k, table) == pytest.approx(0.5 * 1.4e-5 * curvature**2, rel=1e-12)


def test_one_stiffness_for_all_directions_is_an_isotropic_plate():
    _, stiffness = read(np.array([3.0, -8.0, 5.0]), np.full((3, 5), 1e-5))
    np.testing.assert_allclose(stiffness[0], 1e-5 * np.array([1.0, 1.0, POISSON, 0.5 * (1 - POISSON)]), rtol=1e-12)
    np.testing.assert_allclose(stiffness[1:], 0.0, atol=1e-20)


def test_moments_and_hessian_are_derivatives(cloth):
    k, table = cloth
    found = moments(k, table)
    np.testing.assert_allclose(differences(lambda at: energy(at, table), k, 1e-4), found, rtol=1e-7, atol=1e-12)
    hessian = matrix(plate_tangent(k, read(k, table)[1], True))
    expected = differences(lambda at: moments(at, table), k, 1e-4)
    np.testing.assert_allclose(hessian, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


def test_adjoint_by_tables_poisson_and_curvatures(cloth):
    k, table = cloth
    generator = np.random.default_rng(1)
    along, across = generator.normal(size=(2, 3))

    def scalar(at, values, poisson):
        _, stiffness = read(at, values, poisson)
        secant = matrix(plate_tangent(at, stiffness, False))
        return 0.7 * along @ plate_bending(at, stiffness)[1] + 0.3 * along @ secant @ across

    shares, stiffness = read(k, table)
    by_table = np.zeros((3, 5))
    by_poisson = plate_table_adjoint(
        k, along, across, 0.7, 0.3, table, POISSON, shares, stiffness, 1.0, by_table
    )  # fmt: skip
    expected = differences(lambda values: scalar(k, values, POISSON), table, 1e-10).reshape(3, 5)
    np.testing.assert_allclose(by_table, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    change = (scalar(k, table, POISSON + 1e-6) - scalar(k, table, POISSON - 1e-6)) / 2e-6
    assert by_poisson == pytest.approx(change, rel=1e-6)
    slope = np.array(plate_secant_slope(k, along, across, stiffness))
    expected = differences(
        lambda at: along @ matrix(plate_tangent(at, read(at, table)[1], False)) @ across, k, 1e-4
    )  # fmt: skip
    np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-7 * max(np.abs(expected).max(), 1e-12))


def test_a_table_too_soft_along_the_bias_still_has_a_definite_stiffness():
    table = np.full((3, 5), 1e-5)
    for soft in (0.0, 0.1, 0.4, 0.5, 0.6):
        table[1] = soft * 1e-5
        secant = matrix(plate_tangent(np.ones(3), read(np.ones(3), table)[1], False))
        assert np.linalg.eigvalsh(secant).min() >= 0.049e-5
