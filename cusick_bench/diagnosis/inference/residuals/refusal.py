"""Data that are refused, and notes on data that can be diagnosed only in part."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, NAMES
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.residuals.feature_rows import FACE_EVEN, as_seen
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.statistics import NAMES as STATISTICS

LEAST_SAMPLES = 2
_FEW = 4
_WORDS = {"bending": "bending stiffness", "shear": "shear stiffness"}
_BEYOND = 4.0  # least miss of the mean drape coefficient beyond the atlas' range [sd between samples]


def require_enough(captures: Captures) -> None:
    """Makes sure that there is more than one sample.

    Args:
        captures: Silhouettes of a fabric.

    Raises:
        Refused: One sample only, or one picture under several names.
    """
    count = len(np.unique(captures.sample))
    if count < LEAST_SAMPLES:
        raise Refused(
            f"a diagnosis needs at least {LEAST_SAMPLES} samples, {captures.fabric} has {count}: how folds vary from "
            "sample to sample cannot be told from an effect; drape more samples of it"
        )
    if _repeated(captures) == len(captures) - 1:
        raise Refused(
            f"all {len(captures)} pictures of {captures.fabric} are the same one, which no two drapes are; give the "
            "pictures of each sample"
        )


def doubts(captures: Captures, features: Features) -> list[str]:
    """Notes on what the data cannot show.

    Args:
        captures: Silhouettes of a fabric.
        features: Their features.

    Returns:
        A note for each reason why the answer is only partial.
    """
    notes = []
    number = int(features.samples.max())
    if number < _FEW:
        of_face = "" if number == len(np.unique(captures.sample)) else " of a face"
        notes.append(
            f"only {number} sample{'s' * (number != 1)}{of_face}: natural variability is mostly the model's, and only "
            "strong effects show"
        )
    if features.single:
        notes.append(
            "answered in part: one face only, so what belongs to the cloth and what to the laboratory cannot be told "
            "apart"
        )
    elif features.both == 0:
        notes.append(
            f"answered in part: no sample shows both faces ({features.samples[0]} face up, {features.samples[1]} face "
            "down), so faces are compared between samples"
        )
    elif features.samples.min() < features.samples.max():
        notes.append(f"answered in part: {features.samples[0]} samples face up, {features.samples[1]} face down")
    known_up = np.isin(captures.sample, captures.sample[captures.side == "up"])
    if left_out := int(((captures.side == "") & known_up).sum()):
        notes.append(
            f"pictures of unknown face are taken for face up only in samples without others that are; {left_out} of "
            "them count for nothing but drift: state their faces under `captures` in protocol.json"
        )
    if repeated := _repeated(captures):
        notes.append(
            f"{repeated} picture{'s' * (repeated != 1)} of this fabric repeat others, which no two drapes do: samples "
            "that are counted twice make effects look surer than they are; see `data audit`"
        )
    counts = _capture_counts(captures)
    if not np.isfinite(features.order).any():
        notes.append(
            "answered in part: fewer than 3 samples have repeated captures, so their drift is not known, and creep "
            "cannot be told from bending-friction"
        )
    if counts.min() != counts.max():
        notes.append(
            f"answered in part: captures are unequal, {counts.min()} to {counts.max()} of a sample and face; drift "
            "is that of samples with several"
        )
    return notes


def domain_doubts(emulator: Emulator, features: Features, at: Residual, shift: Float[ndarray, "rows"]) -> list[str]:
    """Whether the cloth lies within the atlas.

    Args:
        emulator: The atlas.
        features: Features of the fabric.
        at: Residual at its best base parameters, with the effects that act.
        shift: Shift of the features by these, in the rows of `feature_rows` [sd].

    Returns:
        A note for each parameter at the end of its range.

    Raises:
        Refused: A cloth limper or stiffer than any of the atlas, or unlike all of them.
    """
    theta, notes = at.theta, []
    for name, words in _WORDS.items():
        place = NAMES.index(name)
        low, high = theta[place] <= LOW[place] + 1e-6, theta[place] >= HIGH[place] - 1e-6
        if not (low or high):
            continue
        end = LOW[place] if low else HIGH[place]
        missed = _missed(emulator, features, at, shift) if name == "bending" else 0.0
        if abs(missed) > _BEYOND and (missed > 0) == low:
            raise Refused(
                f"no cloth of the atlas drapes like this one: to hang so it would have to be "
                f"{'limper' if low else 'stiffer'} than any, but its drape coefficient is that of a "
                f"{'stiffer' if low else 'limper'} one; look at its silhouettes, or use another sample size"
            )
        if abs(missed) > _BEYOND:
            raise Refused(
                f"this cloth is {'limper' if low else 'stiffer'} than any of the atlas, whose ln B/(rho g R^3) "
                f"{'begins' if low else 'ends'} at {end:g}: what it differs by is no effect; use another sample size"
            )
        notes.append(
            f"answered in part: the {words} lies at the {'lower' if low else 'upper'} end of the atlas ({end:g}), and "
            "what the cloth needs beyond it may show as an effect"
        )
    return notes


def _missed(emulator: Emulator, features: Features, at: Residual, shift: Float[ndarray, "rows"]) -> float:
    """How far the drape coefficient lies above that of the base model, with the effects that act or without them,
    whichever is nearer [sd between samples]."""
    area = STATISTICS.index("area_dc")
    missed = (np.nanmean(features.mean[:, area]) - emulator.mean(at.theta)[area]) / at.sd[area]
    explained = as_seen(shift, features.single)[FACE_EVEN][area]
    return float(min(missed, missed - explained, key=abs))


def _repeated(captures: Captures) -> int:
    """How many pictures show exactly what another one shows."""
    return len(captures) - len({radii.tobytes() for radii in captures.radii})


def _capture_counts(captures: Captures) -> ndarray:
    """Number of captures of every sample and face."""
    drapes = list(zip(captures.sample.tolist(), captures.side.tolist(), strict=True))
    return np.array([drapes.count(one) for one in sorted(set(drapes))])
