"""What one face of a cloth learns from drapes, and how its samples count, where the answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from cusick_bench.problem import FieldSpace, StiffnessPrior
from cusick_bench.problem.cloth_prior import CLOTH, DISCREPANCY
from cusick_bench.problem.leading import LEADING
from cusick_bench.problem.population.expected_statistics import shipped
from cusick_bench.problem.statistics import STATISTICS
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.solvers.variational.cloth_inference import mean_covariance
from cusick_bench.solvers.variational.face import KNOWN, UNSEEN, Drapes, Face, Scatter
from cusick_bench.solvers.variational.linear_correction import nearness

SIZE = len(STATISTICS)
DRAPES = 600


@pytest.fixture(scope="module")
def leading():
    return FieldSpace(disc_mesh(80), StiffnessPrior("plate", 0.2)).leading


def _root(generator):
    return 0.3 * generator.standard_normal((SIZE, SIZE)) + np.eye(SIZE)


def _drapes(leading, slope, constant):
    """Drapes without scatter that differ from what is expected by a linear function of the leading directions."""
    generator = np.random.default_rng(1)
    cloths, levels = 0.5 * generator.standard_normal((DRAPES, CLOTH)), generator.standard_normal(DRAPES)
    beyond = constant + leading.scaled(cloths, levels) @ slope
    return Drapes(leading, cloths, levels, shipped().of(leading, cloths, levels) + beyond)


class TestLearning:
    def test_level_moves_statistics_as_expected_and_as_the_drapes_do_beyond_that(self, leading):
        slope = 0.3 * np.random.default_rng(2).standard_normal((len(LEADING), SIZE))
        middle = np.zeros(CLOTH)
        face = Face(shipped().of(leading, middle[None]))
        found = face.learn(_drapes(leading, slope, 0.0), middle)
        beyond = leading.scaled_level @ slope
        expected = shipped().slope(leading(middle[None]))[0]
        assert found.slope - expected == pytest.approx(beyond, abs=0.25 * np.abs(beyond).max())  # slopes shrink

    def test_scatter_known_beforehand_counts_as_so_many_drapes(self, leading):
        """Drapes that do not scatter at all leave of it the share that they do not outweigh, and that is specimens'."""
        middle = np.zeros(CLOTH)
        found = Face(shipped().of(leading, middle[None])).learn(
            _drapes(leading, np.zeros((len(LEADING), SIZE)), 0.0), middle
        )
        known = shipped().scatter(leading(middle[None]))[0]
        share = np.diag(found.covariance) / np.diag(known)
        assert np.ptp(share) < 1e-6
        assert KNOWN / (KNOWN + DRAPES) < share[0] < KNOWN / (KNOWN + 4 * len(LEADING))
        assert found.of_specimens == pytest.approx(1.0)

    def test_without_enough_drapes_nothing_is_corrected(self, leading):
        middle, whole = np.zeros(CLOTH), _drapes(leading, np.zeros((len(LEADING), SIZE)), 1.0)
        few = Drapes(leading, *(one[: 4 * len(LEADING) - 1] for one in (whole.cloths, whole.levels, whole.statistics)))
        face = Face(shipped().of(leading, middle[None]))
        assert face.learn(few, middle).covariance == pytest.approx(shipped().scatter(leading(middle[None]))[0])
        gap, doubt = face.gap(leading, middle[None])
        assert gap == pytest.approx(0, abs=1e-12)
        assert doubt == pytest.approx(UNSEEN)

    def test_once_corrected_it_looks_at_drapes_near_the_corrected_ones(self, leading):
        """Drapes and samples have as much beyond what is expected: as well known as if they had nothing beyond it."""
        middle, doubts = np.zeros(CLOTH), []
        known = shipped().scatter(leading(middle[None]))[0]
        scatter = np.random.default_rng(5).multivariate_normal(np.zeros(SIZE), known, DRAPES)
        for times in (0.0, 2.0):
            beyond = times * np.sqrt(np.diag(known))
            drapes = _drapes(leading, np.zeros((len(LEADING), SIZE)), beyond)
            drapes = replace(drapes, statistics=drapes.statistics + scatter)
            face = Face(shipped().of(leading, middle[None]) + beyond)
            for _ in range(2):
                face.learn(drapes, middle)
            gap, doubt = face.gap(leading, middle[None])
            assert np.abs(gap[0] / np.sqrt(np.diag(known))).max() < 0.5
            doubts.append(doubt[0])
        assert doubts[1] == pytest.approx(doubts[0], rel=0.3)


class TestSamples:
    def test_what_is_of_specimens_averages_out_and_nothing_else_does(self):
        """Two samples show one face, these and three more the other: levels are shared by sample."""
        generator, level = np.random.default_rng(3), 0.3
        roots, slopes = [_root(generator) for _ in range(2)], generator.standard_normal((2, SIZE))
        shares, counts = (0.6, 0.25), [2, 5]
        scatters = [Scatter(r @ r.T, share, slope) for r, share, slope in zip(roots, shares, slopes, strict=True)]
        weights = np.array([[0.5, 0.5, 0, 0, 0], [0.2] * 5])  # of the samples in the mean of either face
        expected = level**2 * np.kron(weights @ weights.T, np.ones((SIZE, SIZE))) * np.outer(slopes, slopes)
        for place, (root, share, count) in enumerate(zip(roots, shares, counts, strict=True)):
            own = slice(place * SIZE, (place + 1) * SIZE)
            expected[own, own] += (share / count + 1 - share) * root @ root.T
            expected[own, own] += np.diag([DISCREPANCY[name] ** 2 for name in STATISTICS])
        assert mean_covariance(scatters, counts, level) == pytest.approx(expected)

    def test_weights_of_drapes_fall_with_the_mean_square_gap_in_units_of_the_scatter(self):
        generator, sizes = np.random.default_rng(4), np.linspace(0, 1.5, 40)
        root, unit = _root(generator), generator.standard_normal((40, SIZE))
        unit *= np.sqrt(SIZE) / np.linalg.norm(unit, axis=1, keepdims=True)
        weights = nearness(sizes[:, None] * unit @ root.T, root @ root.T, 2)
        assert weights / weights[0] == pytest.approx(np.exp(-(sizes**2)))
