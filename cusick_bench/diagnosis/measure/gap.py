"""The gap between data and model, against its floor, and how far a cause closes it on samples that it has not seen.

G is the unbiased squared energy distance between the statistics of the data's samples and those of simulated samples.
The statistics of a sample are those of its faces side by side, so that contrasts of faces are compared, too. Without a
gap G would be 0 on average; its floor is what chance alone exceeds in one of twenty cases, by the distances of random
halves of the data, scaled to these numbers of samples. The samples are divided into two folds: base model and cause are
fitted to one and scored on the other,

    closure = (G_base - G_cause) / G_base,

where G_base exceeds its floor, with an interval from a bootstrap over the scored and the simulated samples. Both models
share the random numbers of their samples and the bootstrap draws.

References:
    Szekely, Rizzo. Energy statistics: a class of statistics based on distances. Journal of Statistical Planning and
    Inference 143, 2013.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, nan

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.measure.floors import split_half_floor
from cusick_bench.diagnosis.measure.resampling import bootstrap_weights
from cusick_bench.diagnosis.measure.statistics import GROUPS
from cusick_bench.metrics.distributions.energy import ClusterDistances, cluster_distances

_DRAWS = 400
_LEAST = 4  # least number of samples for a floor
_SPLITS = 999  # random halves of the data, for a floor
_CERTAINTY = 0.95  # that a gap which exceeds its floor is one


@dataclass(frozen=True, eq=False)
class Gap:
    """How far a model is from the data.

    Attributes:
        base: Squared energy distance of the base model to held-out samples.
        floor: Energy distance that chance alone exceeds in one of twenty cases; 0 where samples are too few to tell.
        groups: Energy distance of the base model by group of statistics.
        groups_floor: Their floors.
        closure: Share of the gap that the cause closes; NaN where there is no cause or no gap above its floor.
        closure_interval: Its 90 % interval.
        effect: G with the cause; NaN without one.
    """

    base: float
    floor: float
    groups: dict[str, float]
    groups_floor: dict[str, float]
    closure: float = nan
    closure_interval: tuple[float, float] = (nan, nan)
    effect: float = nan


@dataclass(frozen=True, eq=False)
class Fold:
    """Data that were not fitted, and models that were fitted to the others.

    Attributes:
        data: Statistics of the held-out samples and sides.
        base: Those of samples of the base model.
        effect: Those of samples with the cause, or None.
    """

    data: Float[ndarray, "samples 2 statistics"]
    base: Float[ndarray, "simulated 2 statistics"]
    effect: Float[ndarray, "simulated 2 statistics"] | None = None


def side_by_side(
    specimens: Float[ndarray, "samples 2 statistics"], sd: Float[ndarray, "statistics"], faces: Sequence[int]
) -> Float[ndarray, "kept numbers"]:
    """Statistics of the samples that have all of these faces.

    They are in units of sd, divided by the root of the number of columns so that distances of groups are comparable.

    Args:
        specimens: Statistics of every sample and face.
        sd: Unit of the statistics.
        faces: 0 for up, 1 for down.

    Returns:
        The statistics of a sample's faces in one row.
    """
    chosen = specimens[:, list(faces)]
    good = np.isfinite(chosen).all((1, 2))
    columns = len(faces) * specimens.shape[2]
    return (chosen[good] / sd).reshape(int(good.sum()), columns) / np.sqrt(columns)


def faces_of(specimens: Float[ndarray, "samples 2 statistics"]) -> tuple[int, ...]:
    """The faces to compare: both if most samples have both, otherwise the more frequent one.

    Args:
        specimens: Statistics of every sample and face; NaN where there is none.

    Returns:
        0 for up, 1 for down.
    """
    known = np.isfinite(specimens[..., 0])
    if known.all(1).sum() >= max(_LEAST, 0.6 * len(specimens)):
        return (0, 1)
    return (int(np.argmax(known.sum(0))),)


def fit_of(
    data: Float[ndarray, "samples 2 statistics"],
    model: Float[ndarray, "simulated 2 statistics"],
    sd: Float[ndarray, "statistics"],
    faces: Sequence[int],
) -> float:
    """G between samples and a model of them; infinite where either has fewer than two.

    Args:
        data: Statistics of the samples and sides.
        model: Those of simulated samples.
        sd: Unit of the statistics.
        faces: The faces to compare, from `faces_of` all samples of the fabric.

    Returns:
        The squared energy distance.
    """
    real, simulated = side_by_side(data, sd, faces), side_by_side(model, sd, faces)
    return cluster_distances(real, simulated).observed if min(len(real), len(simulated)) >= 2 else inf


def gap(folds: Sequence[Fold], sd: Float[ndarray, "statistics"], generator: np.random.Generator) -> Gap | None:
    """The gap, its floor, and the closure by a cause.

    Args:
        folds: Each held out once.
        sd: Unit of the statistics.
        generator: Random generator of splits and bootstrap.

    Returns:
        The gap, or None where a fold has fewer than two samples.
    """
    everything = np.concatenate([fold.data for fold in folds])
    faces = faces_of(everything)

    def distances(
        pick: Callable[[Fold], ndarray | None], columns: Sequence[int] | None = None
    ) -> list[ClusterDistances]:
        found = []
        for fold in folds:
            model = pick(fold)
            assert model is not None
            data, other = (side_by_side(_cut(one, columns), _cut(sd, columns), faces) for one in (fold.data, model))
            if min(len(data), len(other)) < 2:
                return []
            found.append(cluster_distances(data, other))
        return found

    plain = distances(lambda fold: fold.base)
    if not plain:
        return None
    groups = {name: _observed(distances(lambda fold: fold.base, columns)) for name, columns in GROUPS.items()}

    def floor(columns: Sequence[int] | None = None) -> float:
        return _floor(side_by_side(_cut(everything, columns), _cut(sd, columns), faces), plain, generator)

    floors = {name: floor(columns) for name, columns in GROUPS.items()}
    found = Gap(_observed(plain), floor(), groups, floors)
    if folds[0].effect is None:
        return found
    changed = distances(lambda fold: fold.effect)
    if not changed:
        return found
    closure, interval = _closure(plain, changed, found.floor, generator)
    return Gap(
        found.base, found.floor, groups, floors, closure=closure, closure_interval=interval,
        effect=_observed(changed),
    )  # fmt: skip


def _cut(values: ndarray, columns: Sequence[int] | None) -> ndarray:
    return values if columns is None else values[..., list(columns)]


def _observed(distances: Sequence[ClusterDistances]) -> float:
    return float(np.mean([one.observed for one in distances])) if distances else nan


def _floor(
    values: Float[ndarray, "samples numbers"], compared: Sequence[ClusterDistances], generator: np.random.Generator
) -> float:
    """What the mean distance of as many samples as were compared exceeds by chance in one of twenty cases."""
    if len(values) < _LEAST:
        return 0.0
    folds = [_counts(one) for one in compared]
    by_chance = split_half_floor(values, np.arange(len(values)), generator, _SPLITS, folds=folds)
    return float(np.quantile(by_chance, _CERTAINTY))


def _closure(
    plain: Sequence[ClusterDistances], changed: Sequence[ClusterDistances], floor: float, generator: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """Closure and its interval, over draws of the held-out and the simulated samples, the same for both models."""
    before, after = np.zeros(_DRAWS), np.zeros(_DRAWS)
    for base, effect in zip(plain, changed, strict=True):
        data, simulated = (bootstrap_weights(count, generator, _DRAWS) for count in _counts(base))
        paired = _counts(effect) == _counts(base)  # otherwise a drape failed in one of them
        others = simulated if paired else bootstrap_weights(_counts(effect)[1], generator, _DRAWS)
        before += _weighted(base, data, simulated) / len(plain)
        after += _weighted(effect, data, others) / len(plain)
    total = _observed(plain)
    good = np.isfinite(before) & np.isfinite(after) & (before > 0.1 * max(total, 0))
    if total <= floor or good.sum() < _DRAWS / 2:
        return nan, (nan, nan)
    shares = (before - after)[good] / before[good]
    low, high = np.quantile(shares, [0.05, 0.95])
    return (total - _observed(changed)) / total, (float(low), float(high))


def _counts(distances: ClusterDistances) -> tuple[int, int]:
    """How many samples the data have, and the model."""
    return int(distances.in_first.sum()), int((~distances.in_first).sum())


def _weighted(
    distances: ClusterDistances, data: Float[ndarray, "draws samples"], simulated: Float[ndarray, "draws simulated"]
) -> Float[ndarray, "draws"]:
    weights = np.zeros((2, len(data), len(distances.in_first)))
    weights[0][:, distances.in_first] = data
    weights[1][:, ~distances.in_first] = simulated
    return distances.distance(weights[0], weights[1])
