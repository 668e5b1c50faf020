"""Statistics of a data set, cloth by cloth: drape coefficient, folds, spectrum, and differences between drapes.

Captures of one drape are not independent: means and spreads are over units, a unit being one face of one sample. Image
differences are mean squared errors (`Protocol.mse_scale`) over all pairs of a kind, and form a ladder: the same drape
captured again, the same sample turned over, another sample, another fabric.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from math import nan, sqrt
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.stats import permutation_test, rankdata

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import BadImage
from cusick_bench.datasets.files.image import fit_plate
from cusick_bench.datasets.files.silhouette import drape_coefficient_of, fold_count_of, profile_of
from cusick_bench.datasets.profile import Profile, amplitude_spectrum
from cusick_bench.datasets.published import CLOTHS

SPECTRUM_MODES = 16
_LEAST_FOR_TREND = 5  # samples; of fewer no order is significant at 1 %
_ORDERS = 99_999  # orders of samples that a trend is compared with: all where there are no more, else random ones
_SEED = 0  # of the random orders


@dataclass(frozen=True)
class Difference:
    """A paired difference with its uncertainty.

    Attributes:
        mean: Mean of the differences.
        error: Standard error of the mean.
        count: Number of pairs.
    """

    mean: float = nan
    error: float = nan
    count: int = 0

    @classmethod
    def of(cls, values: Sequence[float]) -> "Difference":
        """Mean and standard error of differences.

        Args:
            values: Differences of pairs.

        Returns:
            Mean, standard error and number.
        """
        count = len(values)
        if count < 2:
            return cls(float(np.mean(values)) if count else nan, nan, count)
        return cls(float(np.mean(values)), float(np.std(values, ddof=1) / sqrt(count)), count)

    @property
    def t(self) -> float:
        """Student's t against no difference."""
        return self.mean / self.error if self.error > 0 else nan

    def document(self) -> dict[str, float]:
        """Plain numbers."""
        return {"mean": self.mean, "error": self.error, "t": self.t, "count": self.count}


@dataclass(frozen=True)
class Trend:
    """Spearman's rank correlation of a number with the samples' numbers.

    Samples are drawn from one population only if there is none: another piece of cloth, or another day, shows here.

    Attributes:
        correlation: Between -1 and 1; NaN for fewer than five samples, or where the number is constant.
        p: Two-sided p-value against no order: exact up to eight samples, of more to 5 % at p = .005.
        count: Number of samples.
    """

    correlation: float = nan
    p: float = nan
    count: int = 0

    @classmethod
    def of(cls, values: dict[int, float]) -> "Trend":
        """Correlation of values with their keys.

        Args:
            values: Sample's number -> value.

        Returns:
            The trend.
        """
        if len(values) < _LEAST_FOR_TREND or len(set(values.values())) == 1:
            return cls(count=len(values))
        number, value = rankdata(list(values)), rankdata(list(values.values()))
        in_other_orders = permutation_test(
            (value,),
            lambda ranks, axis: (ranks * (number - number.mean())).sum(axis),  # grows with the correlation
            permutation_type="pairings",
            vectorized=True,
            n_resamples=_ORDERS,
            batch=1000,  # orders held in memory at once
            rng=np.random.default_rng(_SEED),
        )
        return cls(float(np.corrcoef(number, value)[0, 1]), float(in_other_orders.pvalue), len(values))

    def document(self) -> dict[str, float]:
        """Plain numbers."""
        return asdict(self)


@dataclass(frozen=True)
class ClothStatistics:
    """One cloth.

    Attributes:
        cloth: Its name.
        silhouettes, samples, units: Number of each; a unit is one face of one sample.
        unusable: Images left out: unreadable, or with a wrong scale.
        drape_coefficient, drape_coefficient_sd: Mean and spread over units.
        folds, folds_sd: Mean number of folds, and its standard deviation.
        spectrum: Mean amplitudes [m] of harmonics 0 to `SPECTRUM_MODES` over units.
        mse_repeat, mse_flip, mse_other_sample, mse_other_fabric: Mean image differences; NaN without such pairs.
        down_minus_up: Difference of the drape coefficient between the faces, paired by sample.
        drift: Observation of a series -> change of the drape coefficient since the first of the same capture, paired by
            sample.
        order: Of the drape coefficient, beside the mean of its face, with the sample's number.
    """

    cloth: str
    silhouettes: int
    samples: int
    units: int
    unusable: int
    drape_coefficient: float
    drape_coefficient_sd: float
    folds: float
    folds_sd: float
    spectrum: tuple[float, ...]
    mse_repeat: float
    mse_flip: float
    mse_other_sample: float
    mse_other_fabric: float
    down_minus_up: Difference
    drift: dict[int, Difference]
    order: Trend

    def document(self) -> dict[str, Any]:
        """Plain numbers, as printed by `data stats --json`."""
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__}
        drift = {str(observation): change.document() for observation, change in self.drift.items()}
        paired = {"down_minus_up": self.down_minus_up.document(), "drift": drift}
        return plain | paired | {"order": self.order.document()}


@dataclass(frozen=True, eq=False)
class _Cloth:
    """What is measured on the usable images of a cloth, which are not kept: those of many cloths fill the memory.

    Attributes:
        mse: Mean squared difference of every pair of images; empty where pairs are not asked for.
        mean: Mean image, and mean square of all pixels; None without images.
    """

    mse: Float[ndarray, "compared compared"]
    mean: tuple[ndarray, float] | None
    sample: ndarray
    capture: ndarray
    side: ndarray
    observation: ndarray
    coefficient: Float[ndarray, " images"]
    folds: Float[ndarray, " images"]
    spectrum: Float[ndarray, "images modes"]
    unusable: int

    def unit_means(self, values: Float[ndarray, " images"]) -> dict[tuple[int, str], float]:
        """Means over the images of each unit, a face of a sample."""
        groups: dict[tuple[int, str], list[float]] = defaultdict(list)
        for sample, side, value in zip(self.sample, self.side, values, strict=True):
            groups[int(sample), str(side)].append(float(value))
        return {unit: float(np.mean(group)) for unit, group in groups.items()}


def statistics(
    dataset: DrapeDataset,
    cloths: str | Sequence[str] | None = None,
    *,
    progress: Callable[[str], None] = lambda cloth: None,
) -> list[ClothStatistics]:
    """Measures every cloth, or the given ones (against all others).

    Args:
        dataset: The data set.
        cloths: Name or names; all by default.
        progress: Called with each cloth's name when it is read.

    Returns:
        One a cloth, in the order asked for.

    Raises:
        DataError: A name that is not there.
    """
    wanted = dataset.cloths if cloths is None else [cloths] if isinstance(cloths, str) else list(cloths)
    for cloth in wanted:
        dataset.select(cloth=cloth)  # raises for a name that is not there
    fabric = dataset.fabrics
    compared = [cloth for cloth in dataset.cloths if _is_plain(dataset, cloth)] or dataset.cloths
    means: dict[str, tuple[ndarray, float]] = {}
    found: dict[str, _Cloth] = {}
    for cloth in dict.fromkeys([*wanted, *compared]):
        read = _read(dataset, cloth, pairs=cloth in wanted)
        if read.mean is not None:
            means[cloth] = read.mean
        if cloth in wanted:
            found[cloth] = read
        progress(cloth)
    others = {cloth: [other for other in compared if fabric[other] != fabric[cloth]] for cloth in wanted}
    return [_describe(dataset, cloth, found[cloth], _mse_between(means, cloth, others[cloth])) for cloth in wanted]


def _is_plain(dataset: DrapeDataset, cloth: str) -> bool:
    """Whether a set is a fabric's captures: no copies of others, no series over time."""
    rows = zip(dataset.table["cloth"], dataset.table["observation"], strict=True)
    return cloth not in CLOTHS and not any(observation for owner, observation in rows if owner == cloth)


def _read(dataset: DrapeDataset, cloth: str, *, pairs: bool) -> _Cloth:
    protocol = dataset.protocol
    own = [row for row, owner in enumerate(dataset.table["cloth"]) if owner == cloth]
    images = np.empty((len(own), protocol.image_size_px**2), dtype=np.float32)
    rows, profiles, coefficients = list[int](), list[Profile](), list[float]()
    for row in own:
        if (image := _usable(dataset, row)) is None:
            continue
        images[len(rows)] = image.ravel()
        rows.append(row)
        profiles.append(profile_of(image, protocol))
        coefficients.append(drape_coefficient_of(image, protocol))
    images = images[: len(rows)]
    spectra = [amplitude_spectrum(profile, modes=SPECTRUM_MODES) for profile in profiles]
    table = dataset.table.iloc[rows]
    return _Cloth(
        _mse_within(images) if pairs else np.zeros((0, 0)),
        (images.mean(0), float((images**2).mean())) if rows else None,
        np.asarray(table["sample"]),
        np.asarray(table["capture"]),
        np.asarray(table["side"], dtype=str),
        np.asarray(table["observation"]),
        np.array(coefficients),
        np.array([float(fold_count_of(profile, protocol)) for profile in profiles]),
        np.array(spectra).reshape(-1, SPECTRUM_MODES + 1),
        len(own) - len(rows),
    )


def _usable(dataset: DrapeDataset, row: int) -> ndarray | None:
    """An image that can be read and has the right scale."""
    try:
        image = dataset.image(row).numpy()
    except BadImage:
        return None
    return None if fit_plate(image, dataset.protocol).fault == "shrunken-image" else image


def _describe(dataset: DrapeDataset, cloth: str, read: _Cloth, other_fabric: float) -> ClothStatistics:
    coefficients, folds = read.unit_means(read.coefficient), read.unit_means(read.folds)
    same_sample = read.sample[:, None] == read.sample[None, :]
    same_side = read.side[:, None] == read.side[None, :]
    known = (read.side[:, None] != "") & (read.side[None, :] != "")
    scale, mse = dataset.protocol.mse_scale, read.mse
    return ClothStatistics(
        cloth=cloth,
        silhouettes=len(read.sample) + read.unusable,
        samples=len(set(read.sample.tolist())),
        units=len(coefficients),
        unusable=read.unusable,
        drape_coefficient=_centre(coefficients.values()),
        drape_coefficient_sd=_spread(coefficients.values()),
        folds=_centre(folds.values()),
        folds_sd=_spread(folds.values()),
        spectrum=tuple(_centre(read.unit_means(amplitudes).values()) for amplitudes in read.spectrum.T),
        mse_repeat=scale * _mse_of_pairs(dataset, dataset.repeat_pairs(cloth)),
        mse_flip=scale * _mean(mse, same_sample & ~same_side & known),
        mse_other_sample=scale * _mean(mse, ~same_sample & same_side),
        mse_other_fabric=scale * other_fabric,
        down_minus_up=_down_minus_up(coefficients),
        drift=_drift(read),
        order=Trend.of(_beside_faces(coefficients)),
    )


def _centre(values: Iterable[float]) -> float:
    numbers = list(values)
    return float(np.mean(numbers)) if numbers else nan


def _spread(values: Iterable[float]) -> float:
    numbers = list(values)
    return float(np.std(numbers, ddof=1)) if len(numbers) > 1 else nan


def _mse_within(images: Float[ndarray, "images pixels"]) -> Float[ndarray, "images images"]:
    """Mean squared difference of every pair, from the Gram matrix."""
    gram = (images @ images.T).astype(np.float64) / max(images.shape[1], 1)
    square = np.diag(gram)
    return np.maximum(square[:, None] + square[None, :] - 2 * gram, 0.0)


def _mse_between(means: dict[str, tuple[ndarray, float]], cloth: str, others: Sequence[str]) -> float:
    """Mean over other fabrics of the mean squared difference of all pairs, from mean images and mean squares."""
    if cloth not in means:
        return nan
    image, square = means[cloth]
    known = [means[other] for other in others if other in means]
    values = [square + other_square - 2 * float((image * other).mean()) for other, other_square in known]
    return float(np.mean(values)) if values else nan


def _mse_of_pairs(dataset: DrapeDataset, pairs: Sequence[tuple[int, int]]) -> float:
    values = []
    for first, second in pairs:
        one, other = _usable(dataset, first), _usable(dataset, second)
        if one is not None and other is not None:
            values.append(float(((one - other) ** 2).mean()))
    return float(np.mean(values)) if values else nan


def _mean(values: ndarray, where: Bool[ndarray, "images images"]) -> float:
    return float(values[where].mean()) if where.any() else nan


def _down_minus_up(coefficients: dict[tuple[int, str], float]) -> Difference:
    samples = dict.fromkeys(sample for sample, _ in coefficients)
    both = [sample for sample in samples if {(sample, "up"), (sample, "down")} <= coefficients.keys()]
    return Difference.of([coefficients[sample, "down"] - coefficients[sample, "up"] for sample in both])


def _beside_faces(coefficients: dict[tuple[int, str], float]) -> dict[int, float]:
    """Mean of each sample's values, each less the mean of its face, so that an unpaired face makes no order."""
    faces, beside = defaultdict(list), defaultdict(list)
    for (_, side), value in coefficients.items():
        faces[side].append(value)
    means = {side: _centre(values) for side, values in faces.items() if len(values) > 1}  # else nothing to compare with
    for (sample, side), value in coefficients.items():
        if side in means:
            beside[sample].append(value - means[side])
    return {sample: _centre(values) for sample, values in beside.items()}


def _drift(read: _Cloth) -> dict[int, Difference]:
    """Change of every sample since the first observation, the mean over its captures."""
    keys = zip(read.sample.tolist(), read.capture.tolist(), read.observation.tolist(), strict=True)
    series = dict(zip(keys, read.coefficient.tolist(), strict=True))
    changes: dict[int, dict[int, list[float]]] = {number: defaultdict(list) for *_, number in series if number > 1}
    for (sample, capture, number), value in series.items():
        if number > 1 and (sample, capture, 1) in series:
            changes[number][sample].append(value - series[sample, capture, 1])
    return {number: Difference.of(list(map(_centre, of.values()))) for number, of in sorted(changes.items())}
