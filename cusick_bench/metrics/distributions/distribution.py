"""How well the distribution of a prediction's draws matches unseen samples, whatever the number of draws.

The energy distance is taken between vectors of statistics, each in its unit (see `statistics.py`): 0 for draws from the
cloth's own distribution, about 0.1 for one shifted by a third of the spread between its samples. Energy score and
variogram score are those of the radius profile as it lies; the CRPS and the scores of calibration are those of the
drape coefficient. Draws made for some samples only (an oracle's for one each, those of one face for samples with the
same face up) are scored against these; the comparisons of whole sets, energy distance and fold test, use all together.

Held-out samples are independent of each other, captures of one are not: where a sample was captured several times, its
captures are not compared with each other, and the fold test takes the first.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.metrics.distances.shape import Shape
from cusick_bench.metrics.distributions.calibration import coverage, fold_test, ranks
from cusick_bench.metrics.distributions.proper_scores import (
    crps,
    energy_distance_of_draws,
    energy_score,
    variogram_score,
)
from cusick_bench.metrics.distributions.statistics import LOCKED, PHASE_FREE, STATISTICS, drape_statistics, standardised

Groups = Sequence[tuple[Int[ndarray, " draws"], Int[ndarray, " samples"]]]
"""Draws, and the samples that they were made for: places in both lists; each sample is in one group."""

LEVELS = (50, 90)  # levels of the intervals [%]
_SCORE_STRIDE = 4  # profile samples between two angles of the energy score: 2 deg
_VARIOGRAM_STRIDE = 10  # the same of the variogram score: 5 deg, seven angles for the narrowest fold
_SEED = 0  # seed of the permutations, fixed so that a score can be repeated

DISTRIBUTION_METRICS = (
    "test_energy_distance",
    "test_energy_distance_phase_free",
    "test_energy_distance_locked",
    "test_energy_score",
    "test_variogram_score",
    "test_dc_crps",
    *(f"test_dc_cover_{level}" for level in LEVELS),
    "test_dc_rank_bias",
    "test_fold_p",
)


def distribution_scores(
    draws: Sequence[Shape],
    tests: Sequence[Shape],
    *,
    groups: Groups | None = None,
    of: Int[ndarray, " tests"] | None = None,
) -> dict[str, float]:
    """Scores the distribution of draws against unseen samples.

    Args:
        draws: Drapes offered, at least one.
        tests: Unseen samples, at least one.
        groups: Which draws were made for which samples; all for all by default.
        of: Number of the sample that each of `tests` shows; each another one by default.

    Returns:
        Smaller is better, but for `test_dc_cover_*` and `test_fold_p`:
        `test_energy_distance`: of all statistics; `_phase_free`, `_locked`: of a part of them. NaN for one sample.
        `test_energy_score`, `test_variogram_score`: of the radius profile [m].
        `test_dc_crps`: of the drape coefficient, in its unit (1 = 100 points).
        `test_dc_cover_50`, `test_dc_cover_90`: share of samples within the 50 % and 90 % interval of the drape
        coefficient; 0 for a single draw, whose interval has no width.
        `test_dc_rank_bias`: how far the mean rank of samples among draws lies from the middle, 0 to 1/2.
        `test_fold_p`: p-value of equal distributions of the number of folds, of all draws and of the first of each
        sample's `tests`; below 0.05 they are rejected. Of draws of two faces and several samples it is too small where
        the faces differ, since the first pictures show one face.
    """
    drawn, seen = drape_statistics(draws), drape_statistics(tests)
    dc, folds = STATISTICS.index("drape_coefficient"), STATISTICS.index("folds")
    radii = np.stack([drape.profile.radii for drape in draws])
    targets = np.stack([drape.profile.radii for drape in tests])
    first = np.arange(len(tests)) if of is None else np.sort(np.unique(of, return_index=True)[1])
    scores = {
        "test_energy_distance": _distance(drawn, seen, STATISTICS, tests[0].protocol, of),
        "test_energy_distance_phase_free": _distance(drawn, seen, PHASE_FREE, tests[0].protocol, of),
        "test_energy_distance_locked": _distance(drawn, seen, LOCKED, tests[0].protocol, of),
        "test_fold_p": fold_test(drawn[:, folds], seen[first, folds], np.random.default_rng(_SEED)),
    }
    groups = [(np.arange(len(draws)), np.arange(len(tests)))] if groups is None else groups
    parts = [_sample_scores(radii[own], targets[at], drawn[own, dc], seen[at, dc]) for own, at in groups]
    ranked = np.concatenate([ranks(drawn[own, dc], seen[at, dc]) for own, at in groups])
    sizes = [len(at) for _, at in groups]
    scores |= {name: float(np.average([part[name] for part in parts], weights=sizes)) for name in parts[0]}
    scores["test_dc_rank_bias"] = float(abs(ranked.mean() - 0.5))
    return {name: scores[name] for name in DISTRIBUTION_METRICS}


def _distance(drawn: ndarray, seen: ndarray, names: Sequence[str], protocol: Protocol, of: ndarray | None) -> float:
    return energy_distance_of_draws(standardised(drawn, names, protocol), standardised(seen, names, protocol), of)


def _sample_scores(radii: ndarray, targets: ndarray, drawn: ndarray, seen: ndarray) -> dict[str, float]:
    """Scores that are means over samples; `drawn` and `seen` are drape coefficients."""
    return {
        "test_energy_score": energy_score(radii[:, ::_SCORE_STRIDE], targets[:, ::_SCORE_STRIDE]),
        "test_variogram_score": variogram_score(radii[:, ::_VARIOGRAM_STRIDE], targets[:, ::_VARIOGRAM_STRIDE]),
        "test_dc_crps": crps(drawn, seen),
        **{f"test_dc_cover_{level}": coverage(drawn, seen, level / 100) for level in LEVELS},
    }
