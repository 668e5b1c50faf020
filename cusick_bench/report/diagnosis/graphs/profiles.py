"""Radius-angle profiles of a diagnosis: of the data, the base model and the base model with the cause.

Profiles come as the camera sees them. Here they are shown in the cloth's frame: of a cloth that lies face down and was
turned over about y, what is seen at theta belongs to 180 deg - theta of the cloth seen face up.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.diagnosis.document.model import Profile, Profiles

ANGLES = 360
SOURCES = ("data", "base", "effect")
SIDES = ("up", "down")
_FEWEST_RADII = 16  # of an outline
_LARGEST = 1.0  # [m]; no sample is larger
SHAPE_MODES = 4  # waves around an outline that no fold makes


@dataclass(frozen=True, eq=False)
class Drapes:
    """Profiles of one source on one side.

    Attributes:
        radii: In the cloth's frame [m].
        samples: Number of each one's sample; those of one number repeat each other's drape.
        damaged: How many had no usable outline.
    """

    radii: Float[ndarray, "drapes 360"]
    samples: Int[ndarray, " drapes"]
    damaged: int = 0

    def __len__(self) -> int:
        return len(self.radii)

    @property
    def shapes(self) -> Float[ndarray, "drapes 360"]:
        """The profiles without their folds [m]."""
        harmonics = np.fft.rfft(self.radii, axis=1)
        harmonics[:, SHAPE_MODES + 1 :] = 0
        return np.fft.irfft(harmonics, ANGLES, axis=1)

    @property
    def typical(self) -> Float[ndarray, "360"]:
        """The drape whose mean radius is the median."""
        return self.radii[np.argsort(self.radii.mean(1), kind="stable")[len(self) // 2]]


Sided = Mapping[str, Mapping[str, Drapes]]
"""Source -> side -> drapes; what there is none of is left out."""


def sided_profiles(profiles: Profiles) -> Sided:
    """Profiles by source and side, in the cloth's frame; an unknown side counts as up.

    Args:
        profiles: As the camera sees them.

    Returns:
        The drapes.
    """
    sided: dict[str, dict[str, Drapes]] = {}
    for source in SOURCES:
        entries: tuple[Profile, ...] = getattr(profiles, source)
        for side in SIDES:
            own = [one for one in entries if (one.side or "up") == side]
            rings = [
                (_sample(one, place), _ring(np.array(one.radii_m, dtype=np.float64))) for place, one in enumerate(own)
            ]
            usable = [(sample, ring) for sample, ring in rings if ring is not None]
            if usable:
                radii = np.stack([_cloth_frame(ring) if side == "down" else ring for _, ring in usable])
                samples = np.array([sample for sample, _ in usable])
                sided.setdefault(source, {})[side] = Drapes(radii, samples, len(own) - len(usable))
    return sided


def _sample(one: Profile, place: int) -> int:
    """Number of a profile's sample; where it is not known, one that no other has."""
    return -1 - place if one.sample is None else one.sample


def _ring(radii: Float[ndarray, " angles"]) -> Float[ndarray, "360"] | None:
    """Radii at whole degrees [m], None where they are no outline."""
    if len(radii) < _FEWEST_RADII or not ((radii > 0) & (radii < _LARGEST)).all():
        return None
    places = np.arange(len(radii) + 1) * ANGLES / len(radii)
    return np.interp(np.arange(ANGLES), places, np.append(radii, radii[0]))


def _cloth_frame(ring: Float[ndarray, "360"]) -> Float[ndarray, "360"]:
    return ring[(ANGLES // 2 - np.arange(ANGLES)) % ANGLES]


def mean_difference(sided: Sided, source: str) -> tuple[float, float] | None:
    """How far a model's mean shape is from that of the data, root mean square over angles and sides.

    Args:
        sided: The drapes.
        source: The model: "base" or "effect".

    Returns:
        The difference, and what chance alone would make of it, from the spread between drapes [m]; None where there
        is nothing to compare.
    """
    shared = [side for side in SIDES if side in sided.get("data", {}) and side in sided.get(source, {})]
    pairs = [(sided["data"][side], sided[source][side]) for side in shared]
    if not pairs:
        return None
    squares = [(model.shapes.mean(0) - data.shapes.mean(0)) ** 2 for data, model in pairs]
    errors = [_error(data) + _error(model) for data, model in pairs]
    return float(np.sqrt(np.mean(squares))), float(np.sqrt(np.mean(errors)))


def _error(drapes: Drapes) -> Float[ndarray, "360"]:
    """Variance of the mean shape over samples, whose own pictures repeat each other; 0 for a single sample [m2]."""
    shapes = drapes.shapes
    means = np.stack([shapes[drapes.samples == number].mean(0) for number in np.unique(drapes.samples)])
    return means.var(0, ddof=min(1, len(means) - 1)) / len(means)
