"""Inference of a cloth from drapes: the correction of what is expected, slices, several samples."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.problem.cloth_prior import trait_entry
from cusick_bench.problem.leading import LEADING
from cusick_bench.problem.population.expected_statistics import shipped
from cusick_bench.problem.scene import Scene
from cusick_bench.problem.statistics import STATISTICS, drape_statistics
from cusick_bench.solvers.variational.cloth_inference import ClothInference, mean_covariance
from cusick_bench.solvers.variational.face import Scatter, share_of_specimens
from cusick_bench.solvers.variational.linear_correction import linear_correction, nearness
from cusick_bench.solvers.variational.slice_sampling import slice_sample

pytestmark = pytest.mark.usefixtures("one_thread")


class TestCorrection:
    """Pairs from a linear model with noise: its slopes and its scatter are known."""

    def _pairs(self, count, leading=8, seed=0, size=1.0):
        generator = np.random.default_rng(seed)
        slope = np.zeros((leading, 2))
        slope[0, 0], slope[1, 1] = 2.0 * size, -1.0 * size
        root = np.array([[0.5, 0.0], [0.3, 0.4]])
        directions = generator.standard_normal((count, leading))
        beyond = directions @ slope + [1.0, 2.0] + generator.standard_normal((count, 2)) @ root.T
        return directions, beyond, slope, root @ root.T

    def test_finds_the_model(self):
        directions, beyond, slope, scatter = self._pairs(400)
        found = linear_correction(directions, beyond, np.ones(len(directions)))
        assert found.slope == pytest.approx(slope, abs=0.12)
        assert found(np.zeros((1, 8)))[0][0] == pytest.approx([1.0, 2.0], abs=0.1)
        assert found.scatter == pytest.approx(scatter, rel=0.25)

    def test_scatter_is_not_too_small_for_what_slopes_have_taken(self):
        generator = np.random.default_rng(3)
        slope = 5.0 * generator.standard_normal((4, 3))
        scatters = []
        for _ in range(100):
            leading = generator.standard_normal((16, 4))
            beyond = leading @ slope + generator.standard_normal((16, 3))
            found = linear_correction(leading, beyond, np.ones(16))
            scatters.append(np.diag(found.scatter))
            assert found(found.centre[None])[1][0] == pytest.approx(1 / 16)  # where no slope counts: that of a mean
        assert np.mean(scatters) == pytest.approx(1.0, abs=0.08)  # over 16 - 1 - 4 degrees of freedom; 0.7 over 16

    def test_where_there_is_nothing_to_correct_slopes_shrink(self):
        errors = {"shrunk": [], "least squares": []}
        for seed in range(10):
            directions, beyond, _, _ = self._pairs(30, seed=seed, size=0.0)
            found = linear_correction(directions, beyond, np.ones(len(directions)))
            plain = np.linalg.lstsq(directions - directions.mean(0), beyond - beyond.mean(0), rcond=None)[0]
            errors["shrunk"].append(np.abs(found.slope).mean())
            errors["least squares"].append(np.abs(plain).mean())
        assert np.mean(errors["shrunk"]) < 0.5 * np.mean(errors["least squares"])

    def test_pairs_that_hardly_count_change_nothing(self):
        """A hundred more that weigh next to nothing: slopes shrink as they do without them."""
        directions, beyond, *_ = self._pairs(30, size=0.15)
        alone = linear_correction(directions, beyond, np.ones(30))
        far, other, *_ = self._pairs(100, seed=1)
        both = linear_correction(
            np.vstack([directions, far]), np.vstack([beyond, other]), np.repeat([1.0, 1e-9], [30, 100])
        )
        assert both.slope == pytest.approx(alone.slope, abs=1e-4)
        assert both.scatter == pytest.approx(alone.scatter, rel=1e-3)

    def test_doubt_is_the_variance_of_what_is_corrected(self):
        """Over repeated sets of pairs, at a cloth far from them, in units of the scatter."""
        far, found = np.full((1, 8), 1.5), []
        for seed in range(60):
            directions, beyond, *_ = self._pairs(60, seed=seed)
            correction = linear_correction(directions, beyond, np.ones(60))
            value, doubt = correction(far)
            found.append((value[0, 0], doubt[0]))
        values, doubts = np.array(found).T
        scatter = self._pairs(3)[3]
        assert values.var() == pytest.approx(doubts.mean() * scatter[0, 0], rel=0.5)

    def test_pairs_far_from_the_observation_count_less_but_not_nearly_all_of_them(self):
        _, beyond, _, scatter = self._pairs(100)
        for observed in (np.array([1.0, 2.0]), np.array([40.0, 2.0])):
            weights = nearness(beyond - observed, scatter, 40)
            gaps = np.abs((beyond - observed)[:, 0])
            assert np.corrcoef(gaps, np.log(weights))[0, 1] < -0.6
            assert weights.sum() ** 2 / (weights**2).sum() >= 40


class TestSlices:
    def test_sample_a_gaussian_posterior(self):
        """Likelihood N(y; theta, 0.5^2), prior N(0, I): the posterior is N(0.8 y, 0.2 I)."""
        observed, generator = np.array([1.0, -2.0]), np.random.default_rng(1)
        start = generator.standard_normal((2000, 2))
        points = slice_sample(lambda x: -2 * ((observed - x) ** 2).sum(1), start, 30, generator)
        assert points.mean(0) == pytest.approx(0.8 * observed, abs=0.05)
        assert points.std(0) == pytest.approx(np.sqrt(0.2), rel=0.06)
        assert np.corrcoef(points.T)[0, 1] == pytest.approx(0, abs=0.08)

    def test_follow_a_curved_ridge(self):
        """x y = 1 within 0.05: draws stay on it, where a Gaussian about a point of it would not."""
        generator = np.random.default_rng(2)
        start = generator.standard_normal((500, 2))
        points = slice_sample(lambda x: -((x[:, 0] * x[:, 1] - 1) ** 2) / 0.005, start, 200, generator)
        product = points[:, 0] * points[:, 1]
        assert product.mean() == pytest.approx(1, abs=0.03)
        assert product.std() == pytest.approx(0.05, rel=0.3)
        assert np.abs(points[:, 0]).std() > 0.2


class TestInference:
    def _inference(self, further=(), **options):
        problem = toy_problem(space="field", vertices=97)
        return ClothInference(replace(problem, further_images=tuple(further)), seed=0, **options)

    def _spread_of_area(self, inference):
        for _ in range(3):
            inference.drape(0)
        expected = shipped().of(inference.problem.space.leading, inference.cloths)
        return expected[:, STATISTICS.index("area_log_odds")].std()

    def test_more_samples_tell_more(self):
        image = toy_problem(space="field", vertices=97).train_image
        one, eight = (self._spread_of_area(self._inference([image] * count)) for count in (0, 7))
        assert eight < 0.97 * one  # much of what is not known of another law's drapes stays unknown

    def test_no_more_samples_are_used_than_allowed(self):
        blank = np.zeros((256, 256))
        images = [blank, np.ones((256, 256))]
        assert len(self._inference(images).faces[0].observed) == 3
        assert len(self._inference(images, samples=1).faces[0].observed) == 1
        trained = self._inference(images, samples=1)
        first = drape_statistics(torch.as_tensor(trained.problem.train_image)).numpy()
        assert trained.faces[0].observed[0] == pytest.approx(first)

    def test_as_many_are_used_of_either_face(self):
        problem = toy_problem(space="field", vertices=97)
        images = (problem.train_image,) * 3
        both = replace(problem, further_images=images, other_face_images=images)
        assert [len(face.observed) for face in ClothInference(both, seed=0, samples=2).faces] == [2, 2]

    def _of_both_faces(self, curl, monkeypatch):
        """From exact statistics of a cloth that curls, of either face, and drapes that are as expected."""
        problem = toy_problem(space="field", vertices=97)
        space, leading = problem.space, problem.space.leading
        cloth = np.zeros(space.specimen_level.start)
        cloth[trait_entry("curl")] = curl
        faces = [shipped().of(leading, one[None]) for one in (cloth, space.turned(cloth))]
        inference = ClothInference(replace(problem, other_face_images=(problem.train_image,)), seed=0)
        assert len(inference.faces) == 2
        for face, statistics in zip(inference.faces, faces, strict=True):
            face.observed = np.repeat(statistics, 12, 0)
        drapes = []
        monkeypatch.setattr(inference.seen, "observe_batch", lambda taus: drapes.extend(taus) or [None] * len(taus))
        inference.begin(0.0)
        inference.drape(16)
        specimens = np.random.default_rng(4).standard_normal((300, problem.dimension))
        cloths, levels = specimens[:, : len(cloth)], space.levels(specimens)
        noise = 0.05 * np.random.default_rng(5).standard_normal((300, len(STATISTICS)))
        inference.take(list(specimens), list(shipped().of(leading, cloths, levels) + noise))
        return inference, np.stack(drapes)

    @pytest.mark.slow
    def test_what_faces_differ_by_tells_how_the_cloth_curls(self, monkeypatch):
        found = {}
        for curl in (-1.0, 1.0):
            inference, _ = self._of_both_faces(curl, monkeypatch)
            found[curl] = inference.cloths[:, trait_entry("curl")]
        assert found[1.0].mean() == pytest.approx(1.0, abs=0.35)
        assert found[-1.0].mean() == pytest.approx(-1.0, abs=0.35)

    def test_a_face_that_lies_down_curls_the_other_way(self):
        """Statistics of a cloth of large curl: the cloth has that curl, or the opposite if its face lies down."""
        problem, found = toy_problem(space="field", vertices=97), []
        leading, numbers = problem.space.leading, problem.space.specimen_level.start
        cloth = np.zeros(numbers)
        cloth[trait_entry("curl")] = 2.0
        for side in ("up", "down"):
            scene = Scene((), problem.simulator.mesh, problem.simulator.settings, side)
            inference = ClothInference(replace(problem, scene=scene), seed=0)
            inference.faces[0].observed = np.repeat(shipped().of(leading, cloth[None]), 12, 0)
            specimens = np.random.default_rng(4).standard_normal((300, problem.dimension))
            lying = specimens if side == "up" else problem.space.turned(specimens)
            noise = 0.05 * np.random.default_rng(5).standard_normal((300, len(STATISTICS)))
            statistics = shipped().of(leading, lying[:, :numbers], problem.space.levels(specimens)) + noise
            inference.take(list(specimens), list(statistics))
            found.append(inference.cloths[:, trait_entry("curl")].mean())
        assert found[0] > 0.3
        assert found[1] < -0.3

    @pytest.mark.slow
    def test_every_other_drape_lies_the_other_way_up(self, monkeypatch):
        _, drapes = self._of_both_faces(1.5, monkeypatch)
        curls = drapes[:, trait_entry("curl")]
        assert curls[::2].mean() > 0.4 > -0.4 > curls[1::2].mean()

    def test_samples_of_both_faces_share_their_level(self):
        """One sample of one face and one of the other have no more to say of the level than one sample."""
        size = len(STATISTICS)
        scatter = Scatter(1e-6 * np.eye(size), 1.0, np.ones(size))
        covariance = mean_covariance([scatter, scatter], [4, 4], level_sd=0.2)
        assert covariance[:size, size:] == pytest.approx(np.full((size, size), 0.04 / 4))
        alone = mean_covariance([scatter], [4], level_sd=0.2)
        assert covariance[:size, :size] == pytest.approx(alone)
        assert covariance[size:, size:] == pytest.approx(alone)

    def test_corrects_what_the_drapes_of_the_problem_have_beyond_what_is_expected(self):
        """Drapes that all have as much more area as the photograph: the cloth is what it would be without."""
        found, axis = {}, np.eye(len(STATISTICS))[STATISTICS.index("area_log_odds")]
        for beyond in (0.0, 0.8):
            inference = self._inference()
            leading = inference.problem.space.leading
            generator = np.random.default_rng(4)
            specimens = generator.standard_normal((300, inference.problem.dimension))
            cloths, levels = specimens[:, : inference.cloths.shape[1]], inference.problem.space.levels(specimens)
            noise = 0.05 * generator.standard_normal((300, len(STATISTICS)))
            statistics = shipped().of(leading, cloths, levels) + beyond * axis + noise
            inference.faces[0].observed = shipped()(leading.origin[None]) + beyond * axis
            inference.take(list(specimens), list(statistics))
            found[beyond] = leading(inference.cloths)[:, LEADING.index("bending")].mean()
        assert found[0.8] == pytest.approx(found[0.0], abs=0.2)


def test_what_a_regression_misses_is_no_scatter_of_specimens():
    """One statistic scatters twice as far about it as specimens do, the other half as far."""
    found, known = np.array([[4.0, 0.5], [0.5, 0.25]]), np.diag([1.0, 1.0])
    assert share_of_specimens(found, known) == pytest.approx((0.25 + 1) / 2)
    assert share_of_specimens(found, found) == 1


def test_what_one_chain_accepts_changes_no_other_chain():
    """Likelihoods differ in their last digits between machines; a chain that turns there must not turn all others."""
    start = np.random.default_rng(0).standard_normal((20, 3))

    def likelihood(points: np.ndarray, worse: float = 0.0) -> np.ndarray:
        return -0.5 * ((points - 1.0) ** 2).sum(1) - worse * (points[:, 0] > 2.0)

    first, second = (
        slice_sample(lambda points, worse=worse: likelihood(points, worse), start, 8, np.random.default_rng(1))
        for worse in (0.0, 0.5)
    )
    same = (first == second).all(1)
    assert not same.all()
    assert same.sum() >= 10
