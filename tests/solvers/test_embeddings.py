"""Embeddings of the Bayesian searches, and what a collision of a hash costs."""

import math
from itertools import count

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from search_losses import losses_of_search

from cusick_bench.benchmark.optimisers.functions import (
    FUNCTIONS,
    HiddenFunction,
    branin,
)
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.bayesian_optimisation.embedding import (
    balanced_embedding,
    gaussian_embedding,
    hash_embedding,
    split,
)
from cusick_bench.solvers.bayesian_optimisation.hesbo import Hesbo
from cusick_bench.solvers.bayesian_optimisation.rembo import in_turn
from cusick_bench.solvers.black_box.box import run_search

# Least values of Branin's function where one number moves both of its coordinates, the same way or opposite ways.
COLLISION = {1: 17.17809, -1: 0.92482}


class TestEmbeddings:
    def test_rembo_clips_random_directions(self):
        generator = np.random.default_rng(0)
        embedding = gaussian_embedding(4000, 4, generator)
        assert embedding.matrix.mean(0) == pytest.approx(np.zeros(4), abs=0.06)
        assert np.cov(embedding.matrix.T) == pytest.approx(np.eye(4), abs=0.1)
        corner = np.array([1.0, -1.0, 1.0, 1.0])
        raw = embedding.matrix @ (2 * corner)  # y reaches to sqrt(d) = 2
        lifted = embedding.lift(corner)
        inside = np.abs(raw) <= 1
        assert 0 < inside.sum() < 4000
        assert (lifted[inside] == raw[inside]).all()
        assert (lifted[~inside] == np.sign(raw[~inside])).all()

    def test_hesbo_hashes_evenly_with_random_signs(self):
        embedding = hash_embedding(6000, 6, np.random.default_rng(1))
        point = np.linspace(-1, 1, 6)
        assert (embedding.lift(point) == embedding.signs * point[embedding.bins]).all()
        assert set(embedding.signs) == {-1.0, 1.0}
        assert embedding.signs.mean() == pytest.approx(0, abs=0.05)
        sizes = np.bincount(embedding.bins, minlength=6)
        assert np.square(sizes - 1000).sum() / 1000 < 20.5, "chi-square of 5 degrees of freedom at 0.001"
        assert np.ptp(sizes) > 1, "bins are independent, not balanced"

    def test_split_subspaces_contain_the_coarser_ones(self):
        generator = np.random.default_rng(2)
        embedding = balanced_embedding(103, 3, generator)
        assert np.ptp(np.bincount(embedding.bins)) <= 1
        for _ in range(4):
            finer, parents = split(embedding, 4, generator)
            point = generator.uniform(-1, 1, embedding.embedded)
            assert len(parents) == finer.embedded > embedding.embedded
            assert (finer.lift(point[parents]) == embedding.lift(point)).all()
            sizes = np.bincount(finer.bins)
            assert sizes.min() >= 1
            assert sizes.max() <= math.ceil(np.bincount(embedding.bins).max() / 4)
            embedding = finer
            if embedding.embedded == 103:
                break
        assert embedding.embedded == 103

    def test_too_many_dimensions_are_refused(self):
        for draw in (gaussian_embedding, hash_embedding, balanced_embedding):
            with pytest.raises(SolverError, match="1 to 5 of its own, got 6"):
                draw(5, 6, np.random.default_rng(0))

    def test_searches_take_turns_and_learn_their_own_losses(self):
        told: dict[str, list[float]] = {"a": [], "b": []}

        def search(name):
            while True:
                told[name].append((yield np.array([ord(name)])))

        asked: list[str] = []
        run_search(in_turn([search("a"), search("b")]), lambda p: asked.append(chr(int(p[0]))) or float(len(asked)), 5)
        assert asked == ["a", "b", "a", "b", "a"]
        assert told == {"a": [1.0, 3.0], "b": [2.0]}


class TestCollision:
    """Where a hash puts both coordinates of Branin's function into one bin, one number t is all that is left."""

    @pytest.mark.parametrize("sign", COLLISION)
    def test_best_reachable_value(self, sign):
        def along(t):
            return branin((np.array([t, sign * t]) + 1) / 2)

        grid = np.linspace(-1, 1, 401)
        start = grid[int(np.argmin([along(t) for t in grid]))]
        best = minimize_scalar(along, bounds=(start - 0.01, start + 0.01), method="bounded", options={"xatol": 1e-10})
        assert best.fun == pytest.approx(COLLISION[sign], abs=5e-6)

    @pytest.mark.parametrize("sign", COLLISION)
    def test_hesbo_reaches_it_and_no_more(self, sign):
        """Searches a 100-dimensional box through an embedding whose active coordinates collide."""
        for seed in count():
            embedding = hash_embedding(100, 2, np.random.default_rng(seed))
            if embedding.bins[3] == embedding.bins[7] and embedding.signs[3] * embedding.signs[7] == sign:
                break
        hidden = HiddenFunction(FUNCTIONS["branin"], np.array([3, 7]))
        values = losses_of_search(Hesbo(embedded=2, initial=5), hidden, 100, 16, seed=seed)
        assert min(values) >= COLLISION[sign] - 5e-6
        assert min(values) <= COLLISION[sign] + 0.1
