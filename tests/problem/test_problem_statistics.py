"""The differentiable statistics are those of the vocabulary, and have its gradients."""

import numpy as np
import pytest
import torch

from cusick_bench.datasets.silhouette_statistics.selections import INFERRED
from cusick_bench.problem.statistics import STATISTICS, drape_statistics, profile_statistics


def rings(count: int = 20) -> np.ndarray:
    """Random profiles from flat to deeply folded, and two discs, one as large as the plate."""
    generator, orders = np.random.default_rng(5), np.arange(1, 30)
    waves = np.outer(orders, np.arange(360) * 2 * np.pi / 360)
    size = 3e-3 * np.linspace(0, 1, count)[:, None] / (1 + ((orders - 7) / 4.0) ** 2)
    cosines, sines = generator.standard_normal((2, count, len(orders))) * size
    radii = np.linspace(0.1, 0.145, count)[:, None] + cosines @ np.cos(waves) + sines @ np.sin(waves)
    return np.concatenate([radii, np.full((1, 360), 0.15), np.full((1, 360), 0.09)])


def test_torch_and_numpy_agree():
    radii = rings()
    found = profile_statistics(torch.as_tensor(radii)).numpy()
    assert INFERRED.names == STATISTICS
    np.testing.assert_allclose(found, INFERRED.measure(radii), rtol=1e-9, atol=1e-12)


def test_gradients_are_those_of_central_differences():
    radii, step = rings()[10], 1e-7
    radius = torch.as_tensor(radii).requires_grad_()
    angle = np.arange(360) * 2 * np.pi / 360
    direction = 0.5 + np.cos(7 * angle) + 0.3 * np.sin(2 * angle + 0.4) + 0.2 * np.cos(4 * angle)
    ahead, behind = (INFERRED.measure((radii + sign * step * direction)[None])[0] for sign in (1, -1))
    for column, value in enumerate(profile_statistics(radius)):
        (gradient,) = torch.autograd.grad(value, radius, retain_graph=True)
        expected = (ahead[column] - behind[column]) / (2 * step)
        assert float(gradient @ torch.as_tensor(direction)) == pytest.approx(expected, rel=1e-5), STATISTICS[column]


def test_no_silhouettes_have_no_statistics():
    """Where no cloth came to rest, an empty batch ended in an error of a library."""
    assert drape_statistics(torch.zeros(0, 256, 256)).shape == (0, 7)


def test_statistics_are_computed_where_the_radii_lie():
    assert profile_statistics(torch.full((2, 360), 0.12, dtype=torch.float64, device="meta")).device.type == "meta"
