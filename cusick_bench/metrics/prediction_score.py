"""All metrics of one prediction: against its training sample, and against samples it has not seen.

A prediction has one or many silhouettes (draws) for the unseen samples. Every draw is compared with every unseen
sample, with two exceptions: a `paired` prediction (of an oracle) has draw i for sample i only, and a prediction of both
faces has some draws for samples with the same face up as the training sample, and as many for the other face. Scores of
many draws are given twice: as mean over draws and samples, and as best-of-N, the mean over samples of the draw that
fits each best. Best-of-N improves with N whatever the draws are, so it must be compared with the same number of random
draws: `test_mse_best_of_<n>` is the expected score of n draws that are picked at random from all draws, and
`test_hausdorff_best_of_<n>_m` the same from fewer trials, since it costs more: n of 20 draws, or ten sets of n. The
scores of `distribution.py` tell whether draws are distributed as the samples are, whatever their number.

Draws are scored as they are stored, in 256 levels, like the samples. So scoring a stored answer again gives exactly the
same numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import nan

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray
from scipy.special import gammaln

from cusick_bench.datasets import DrapeSample
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.index import OTHER_FACE
from cusick_bench.metrics.distances.hausdorff_distance import hausdorff
from cusick_bench.metrics.distances.image import iou, iou_pairs, mse, mse_pairs
from cusick_bench.metrics.distances.profile import (
    profile_rms,
    profile_rms_rotated,
    quantile_distance,
    spectrum_distance,
)
from cusick_bench.metrics.distances.shape import Image, Shape
from cusick_bench.metrics.distances.surface import Surface
from cusick_bench.metrics.distributions.distribution import DISTRIBUTION_METRICS, distribution_scores
from cusick_bench.metrics.errors import MetricError
from cusick_bench.solvers.base import Prediction

SUBSETS = (10, 100, 1000)  # numbers of draws for which best-of-n is recorded
DRAW_LEVELS = 255  # level of full coverage in stored draws
_MEAN_DRAWS = 20  # draws, evenly spaced, that enter means of costly distances; the best is searched among all

_SETS = 10  # of n draws, whose best Hausdorff distances are averaged

Matrix = Float[ndarray, "draws samples"]
Distance = Callable[[Shape, Shape], float]

TEST_METRICS = (
    "test_mse",
    "test_mse_best",
    "test_iou",
    "test_hausdorff_m",
    "test_hausdorff_best_m",
    "test_profile_rms_m",
    "test_profile_rms_rotated_m",
    "test_quantile_m",
    "test_spectrum_m",
    "test_dc_error",
    "test_folds_error",
    *DISTRIBUTION_METRICS,
)


def score(
    prediction: Prediction,
    train_sample: DrapeSample,
    test_samples: Sequence[DrapeSample],
    *,
    repeat_pairs: Sequence[tuple[Image, Image]] = (),
    protocol: Protocol = RELEASE,
) -> dict[str, float]:
    """Scores a prediction.

    Args:
        prediction: A solver's answer.
        train_sample: The sample that the solver has seen.
        test_samples: Other samples of the same cloth.
        repeat_pairs: Pairs of silhouettes of one and the same drape: the floor below which no score means anything.
        protocol: How all these silhouettes were taken: the data's.

    Returns:
        Metrics by name; lengths in metres; NaN where there is nothing to compare with. `train_*` compare the fit
        with the training sample, `test_*` the draws with the unseen samples. `*_best` is best-of-`draws`,
        `*_error` the difference of the means over draws and over samples, `*_target` the sample's value. See
        `distribution_scores` for the others.

    Raises:
        MetricError: Images of different sizes, values that are not finite, or a paired prediction with more or
            fewer draws than there are samples.
    """
    prediction = replace(prediction, draws=from_levels(to_levels(prediction.draws)))
    repeats = [mse(Shape(first).pixels, Shape(second).pixels, protocol) for first, second in repeat_pairs]
    return {
        **_train_scores(prediction, train_sample, protocol),
        **_test_scores(prediction, train_sample, test_samples, protocol),
        "floor_mse": float(np.mean(repeats)) if repeats else nan,
    }


def to_levels(images: Float[ndarray, "*shape"]) -> UInt8[ndarray, "*shape"]:
    """Rounds silhouettes to the levels in which draws are stored.

    Args:
        images: Silhouettes in [0, 1]; values beyond are clipped.

    Returns:
        Levels 0 to 255.
    """
    levels = np.empty(np.shape(images), dtype=np.uint8)
    for place, image in enumerate(images):  # one at a time: a thousand in float64 would take half a gigabyte
        levels[place] = np.round(DRAW_LEVELS * np.clip(image, 0, 1))
    return levels


def from_levels(levels: UInt8[ndarray, "*shape"]) -> Float[ndarray, "*shape"]:
    """Silhouettes of stored levels; inverse of `to_levels` up to rounding.

    Args:
        levels: Levels 0 to 255.

    Returns:
        Silhouettes in [0, 1], float32.
    """
    return levels.astype(np.float32) / DRAW_LEVELS


def expected_best(values: Matrix, count: int) -> float:
    """Mean over samples of the expected minimum over `count` draws, picked without replacement from all.

    The i-th smallest of N values is the minimum of n picked ones with probability C(N - i, n - 1) / C(N, n).

    Args:
        values: Distance of every draw from every sample.
        count: Number n of draws that are picked.

    Returns:
        The mean, in the unit of the values.

    Raises:
        MetricError: `count` is not within 1 .. N, or a distance is NaN.
    """
    draws = len(values)
    if not 1 <= count <= draws:
        raise MetricError(f"best of {count} needs 1 to {draws} draws; make the solver offer more draws")
    if np.isnan(values).any():  # sorted behind the largest, it would count as a bad draw, or not at all
        raise MetricError("a distance of a draw from a sample is NaN; leave out draws that have none")
    rank = np.arange(1, draws - count + 2)
    log_weight = _log_binomial(draws - rank, count - 1) - _log_binomial(np.array(draws), count)
    return float((np.exp(log_weight) @ np.sort(values, axis=0)[: len(rank)]).mean())


def _log_binomial(n: ndarray, k: int) -> ndarray | float:
    return gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)


def _train_scores(prediction: Prediction, sample: DrapeSample, protocol: Protocol) -> dict[str, float]:
    target = _sample_shape(sample, protocol)
    fit = Shape(prediction.train_image, _mesh(prediction.vertices, prediction.faces), protocol)
    return {
        "train_mse": mse(fit.pixels, target.pixels, protocol),
        "train_iou": iou(fit.pixels, target.pixels),
        "train_hausdorff_m": _hausdorff(fit, target),
        "train_profile_rms_m": _radial(profile_rms)(fit, target),
        "train_dc": fit.drape_coefficient,
        "train_dc_target": target.drape_coefficient,
        "train_folds": float(fit.folds),
        "train_folds_target": float(target.folds),
    }


def _test_scores(
    prediction: Prediction, train_sample: DrapeSample, samples: Sequence[DrapeSample], protocol: Protocol
) -> dict[str, float]:
    turned = prediction.draw_turned
    if not samples:
        count = len(prediction.draws) if turned is None else np.count_nonzero(turned)
        return dict.fromkeys(TEST_METRICS, nan) | {"draws": float(count)}
    draws, tests = _draw_shapes(prediction, protocol), [_sample_shape(sample, protocol) for sample in samples]
    images, of = np.asarray(prediction.draws), _places(samples)
    if prediction.paired:
        if len(draws) != len(tests):
            raise MetricError(f"a paired prediction needs a draw for each of {len(tests)} samples, got {len(draws)}")
        groups = [(np.array([i]), np.array([i])) for i in range(len(tests))]
        scores = _distances(images, draws, tests, paired=True) | distribution_scores(draws, tests, groups=groups, of=of)
    elif turned is None:
        scores = _distances(images, draws, tests) | distribution_scores(draws, tests, of=of)
    else:
        other = OTHER_FACE.get(str(train_sample.row["side"]))
        lying = np.array([sample.row["side"] == other for sample in samples])
        faces = [(np.flatnonzero(turned == face), np.flatnonzero(lying == face)) for face in np.unique(lying)]
        parts = [_distances(images[own], [draws[i] for i in own], [tests[i] for i in at]) for own, at in faces]
        sizes = [len(at) for _, at in faces]
        scores = {name: np.average([part[name] for part in parts], weights=sizes) for name in parts[0]}
        offered = np.sort(np.concatenate([own for own, _ in faces]))  # without a face that none of the samples shows
        groups = [(np.searchsorted(offered, own), at) for own, at in faces]
        scores |= distribution_scores([draws[i] for i in offered], tests, groups=groups, of=of)
    return {name: float(value) for name, value in scores.items()}


def _distances(
    images: ndarray, draws: Sequence[Shape], tests: Sequence[Shape], *, paired: bool = False
) -> dict[str, float]:
    """Scores that compare each draw, of which an image is given, with each sample, or draw i with sample i."""
    targets = np.stack([test.pixels for test in tests])
    squared = _paired(mse_pairs(images, targets, tests[0].protocol), paired)
    few = draws if paired else _thinned(draws)

    def mean(distance: Distance) -> float:
        return float(_table(few, tests, distance, paired).mean())

    return {
        "draws": len(squared),
        "test_mse": squared.mean(),
        "test_mse_best": squared.min(0).mean(),
        **{f"test_mse_best_of_{n}": expected_best(squared, n) for n in SUBSETS if n <= len(squared)},
        "test_iou": _paired(iou_pairs(images, targets), paired).mean(),
        **_hausdorff_scores(draws, few, tests, paired),
        "test_profile_rms_m": mean(_radial(profile_rms)),
        "test_profile_rms_rotated_m": mean(_radial(profile_rms_rotated)),
        "test_quantile_m": mean(_radial(quantile_distance)),
        "test_spectrum_m": mean(_radial(spectrum_distance)),
        "test_dc_error": _mean_difference(draws, tests, lambda shape: shape.drape_coefficient),
        "test_folds_error": _mean_difference(draws, tests, lambda shape: shape.folds),
    }


def _places(samples: Sequence[DrapeSample]) -> Int[ndarray, " captures"] | None:
    """Which captures show one sample; None where samples have no numbers."""
    if not all("sample" in sample.row for sample in samples):
        return None
    return np.unique(np.array([sample.row["sample"] for sample in samples]), return_inverse=True)[1]


def _sample_shape(sample: DrapeSample, protocol: Protocol) -> Shape:
    return Shape(sample.image, None if sample.mesh is None else Surface.of(sample.mesh), protocol)


def _mesh(vertices: ndarray | None, faces: ndarray | None) -> Surface | None:
    return None if vertices is None or faces is None else Surface(vertices, faces)


def _draw_shapes(prediction: Prediction, protocol: Protocol) -> list[Shape]:
    meshes = [None] * len(prediction.draws) if prediction.draw_vertices is None else prediction.draw_vertices
    return [
        Shape(image, _mesh(mesh, prediction.faces), protocol)
        for image, mesh in zip(prediction.draws, meshes, strict=True)
    ]


def _thinned(draws: Sequence[Shape]) -> Sequence[Shape]:
    """At most `_MEAN_DRAWS` of the draws, evenly spaced: draws may be in order, as rotations are."""
    return [draws[i] for i in np.unique(np.linspace(0, len(draws) - 1, _MEAN_DRAWS).astype(int))]


def _hausdorff(draw: Shape, sample: Shape) -> float:
    return hausdorff(draw.surface, sample.surface)


def _radial(distance: Callable[[ndarray, ndarray], float]) -> Distance:
    return lambda draw, sample: distance(draw.profile.radii, sample.profile.radii)


def _paired(table: ndarray, paired: bool) -> ndarray:
    """All draws against all samples, or one row with draw i against sample i."""
    return np.diag(table)[None] if paired else table


def _table(draws: Sequence[Shape], tests: Sequence[Shape], distance: Distance, paired: bool) -> Matrix:
    if paired:
        return np.array([[distance(draw, test) for draw, test in zip(draws, tests, strict=True)]])
    return np.array([[distance(draw, test) for test in tests] for draw in draws])


def _hausdorff_scores(
    draws: Sequence[Shape], few: Sequence[Shape], tests: Sequence[Shape], paired: bool
) -> dict[str, float]:
    """Mean distance of a few draws, the smallest of all, and the smallest of n, picked from the few or in sets."""
    table = _table(few, tests, _hausdorff, paired)
    scores = {"test_hausdorff_m": float(table.mean()), "test_hausdorff_best_m": float(table.min(0).mean())}
    if len(draws) == len(few):
        counts = [] if paired else [count for count in SUBSETS if count <= len(few)]
        return scores | {f"test_hausdorff_best_of_{count}_m": expected_best(table, count) for count in counts}
    best, rest = table.min(0), set(range(len(draws)))
    for count in (count for count in SUBSETS if count < len(draws)):
        name = f"test_hausdorff_best_of_{count}_m"
        if count <= len(few):
            scores[name] = expected_best(table, count)
            continue
        stride = len(draws) // count
        sets = [range(start, stride * count, stride) for start in range(min(stride, _SETS))]
        smallest = np.array([[_least([draws[i] for i in chosen], test) for test in tests] for chosen in sets])
        scores[name], best = float(smallest.mean()), np.minimum(best, smallest.min(0))
        rest.difference_update(*sets)
    least = [_least([draws[i] for i in sorted(rest)], test, bound) for test, bound in zip(tests, best, strict=True)]
    scores["test_hausdorff_best_m"] = float(np.mean(least))
    if len(draws) in SUBSETS:
        scores[f"test_hausdorff_best_of_{len(draws)}_m"] = float(np.mean(least))
    return scores


def _least(draws: Sequence[Shape], test: Shape, bound: float = np.inf) -> float:
    """Smallest distance, or the bound; the likeliest draw goes first, others are dropped once known no better."""
    gaps = [_radial(profile_rms)(draw, test) for draw in draws]
    for index in np.argsort(gaps):
        bound = min(bound, hausdorff(draws[index].surface, test.surface, stop_above=bound))
    return bound


def _mean_difference(draws: Sequence[Shape], tests: Sequence[Shape], of: Callable[[Shape], float]) -> float:
    return abs(float(np.mean([of(draw) for draw in draws]) - np.mean([of(test) for test in tests])))
