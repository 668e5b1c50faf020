"""Every statistic of data, base model and base model with the named effects, side by side."""

from math import isfinite

import numpy as np
from numpy import ndarray

from cusick_bench.diagnosis.diagnose import Diagnosis
from cusick_bench.diagnosis.document.model import StatisticRow
from cusick_bench.diagnosis.inference.residuals.feature_rows import FACE_EVEN, as_seen
from cusick_bench.diagnosis.inference.single_effects.hypotheses import shifts
from cusick_bench.diagnosis.measure.statistics import GROUPS, NAMES

_LENGTHS = (
    "mean_radius",
    "quantile",
    "amplitude",
    "fold_depth",
    "harmonic",
    "crest",
    "valley_gap",
    "valley_1",
    "valley_2",
)
"""Beginnings of the names of statistics in metres."""


def statistic_rows(diagnosis: Diagnosis) -> tuple[StatisticRow, ...]:
    """Statistics of data and models, and by how many standard errors data and base model differ.

    Args:
        diagnosis: The diagnosis; where nothing was simulated, its atlas tells the means.

    Returns:
        A row for each statistic.
    """
    sd, features = diagnosis.residual.sd, diagnosis.features
    base, effect, simulated = _means(diagnosis)
    error = sd * np.sqrt(1 / np.maximum(features.samples, 1) + (1 / simulated if simulated else 0))[:, None]
    score = (features.mean - base) / error
    group_of = {column: name for name, columns in GROUPS.items() for column in columns}
    rows = []
    for k, name in enumerate(NAMES):
        known = score[np.isfinite(score[:, k]), k]
        rows.append(
            StatisticRow(
                name=name,
                group=group_of[k],
                unit=_unit(name),
                up=finite(features.mean[0, k]),
                down=finite(features.mean[1, k]),
                base=finite(base[k]),
                effect=finite(effect[k]),
                z=finite(known[np.argmax(np.abs(known))]) if len(known) else None,
            )
        )
    return tuple(rows)


def finite(value: float) -> float | None:
    """A number as a document holds it.

    Args:
        value: The number.

    Returns:
        It, or None where it is not finite.
    """
    return float(value) if isfinite(value) else None


def _means(diagnosis: Diagnosis) -> tuple[ndarray, ndarray, int]:
    """Mean statistics of base model and base with the causes, and of how many drapes; 0 where the atlas tells them.

    They are those of the faces that the data show: an effect of the cloth's faces acts on one as it does not on both.
    """
    drapes, faces = diagnosis.simulated, diagnosis.features.samples > 0
    if drapes is not None and np.isfinite(drapes.base.specimens[:, faces]).any((0, 1)).all():
        base = np.nanmean(drapes.base.specimens[:, faces], (0, 1))
        changed = np.nan * base if drapes.effect is None else np.nanmean(drapes.effect.specimens[:, faces], (0, 1))
        return base, changed, int(np.isfinite(drapes.base.specimens[:, faces, 0]).sum())
    residual, emulator = diagnosis.residual, diagnosis.emulator
    base, moved = emulator.mean(residual.theta), np.zeros(len(NAMES))
    for one in diagnosis.causes:
        point = {name: np.array([value]) for name, value in one.value.items()}
        row = shifts(emulator, one.hypothesis, residual.theta, residual.sd, residual.drift, point).features[0]
        moved += as_seen(row, diagnosis.features.single)[FACE_EVEN] * residual.sd
    return base, base + moved if diagnosis.causes else np.nan * base, 0


def _unit(name: str) -> str:
    if name == "roughness":
        return "m/rad"
    return "m" if name.startswith(_LENGTHS) else "1"
