"""Runs a search on a function whose values are known."""

import numpy as np

from cusick_bench.solvers.black_box.box import run_search


def losses_of_search(solver, function, dimension: int, evaluations: int, seed: int = 0) -> list[float]:
    """Losses of a run."""
    seen: list[float] = []

    def value(point):
        assert point.shape == (dimension,)
        assert np.abs(point).max() <= 1, "left the box"
        seen.append(function(point))
        return seen[-1]

    run_search(solver.search(dimension, evaluations, np.random.default_rng(seed)), value, evaluations)
    return seen
