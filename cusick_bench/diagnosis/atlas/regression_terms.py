"""Terms of the atlas' regressions: products of the base parameters, scaled to [-1, 1] over the atlas."""

from itertools import combinations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW
from cusick_bench.diagnosis.atlas.base_model import NAMES as PARAMETERS

LIMPER_THAN = -6.8
"""theta's bending below which the base model's own mesh errs visibly."""


def scaled(theta: Float[ndarray, "*rows parameters"]) -> Float[ndarray, "*rows parameters"]:
    """z: theta in units of the atlas' range, not far beyond it.

    Args:
        theta: Base parameters.

    Returns:
        z, between -1.3 and 1.3.
    """
    return np.clip((2 * theta - HIGH - LOW) / (HIGH - LOW), -1.3, 1.3)


_COUNT = len(LOW)
_OTHERS = range(1, _COUNT)


def _products() -> list[dict[int, int]]:
    """Powers of the z in each product; 0 is the bending level."""
    found: list[dict[int, int]] = [{}, *({i: 1} for i in range(_COUNT)), *({0: power} for power in range(2, 7))]
    found += [{i: 1, 0: power} for i in _OTHERS for power in (1, 2, 3)]
    found += [{i: 2, 0: power} for i in _OTHERS for power in (0, 1, 2)]
    return found + [{i: 1, j: 1, 0: power} for i, j in combinations(_OTHERS, 2) for power in (0, 1)]


_PRODUCTS = _products()


def base_terms(theta: Float[ndarray, "rows parameters"]) -> Float[ndarray, "rows terms"]:
    """Products of up to two z, each also with powers of the bending level, and how limp a cloth is.

    The level decides how a drape answers to everything else, so each answer is a curve in it.

    Args:
        theta: Base parameters.

    Returns:
        Terms of the means without effect, 1 and all z first; `CORRECTED` and `LIMP` are among them.
    """
    z = scaled(theta)
    columns = []
    for powers in _PRODUCTS:
        column = np.ones(len(z))
        for i, power in powers.items():
            column = column * z[:, i] ** power
        columns.append(column)
    limp = np.maximum(LIMPER_THAN - theta[:, 0], 0) / (LIMPER_THAN - LOW[0])
    return np.stack([*columns, limp, limp**2], axis=1)


CORRECTED = np.array(
    [
        place
        for place, powers in enumerate(_PRODUCTS)
        if sum(powers.values()) < 2
        or powers in ({0: 2}, {0: 3})
        or (len(powers) == 2 and sum(powers.values()) == 2 and 0 in powers)
    ]
)
"""Of `base_terms`: 1, z, products of the bending level's z with each z, and its cube; what the cheaper model gets wrong
is a function of these."""
LIMP = len(_PRODUCTS) + np.arange(2)
"""Of `base_terms`: how limp a cloth is, and its square; what the base model's own mesh gets wrong."""


def spread_terms(theta: Float[ndarray, "rows parameters"]) -> Float[ndarray, "rows terms"]:
    """1, z, and the level's square.

    Args:
        theta: Base parameters.

    Returns:
        Terms of scatter between samples, in the order of `SPREAD_CORRECTED`.
    """
    z = scaled(theta)
    return np.column_stack([np.ones(len(z)), z, z[:, 0] ** 2])


SPREAD_CORRECTED = np.array([0, 1, 1 + _COUNT])
"""Of `spread_terms`: 1, the bending level's z and its square."""


_LAYING = PARAMETERS.index("laying")
# Parameters that decide on folds, with bending.
_STRONG = (
    PARAMETERS.index("shear"),
    _LAYING,
    PARAMETERS.index("length"),
)


def gain_terms(
    theta: Float[ndarray, "rows parameters"], severity: Float[ndarray, "rows"], place: Float[ndarray, "rows place"]
) -> Float[ndarray, "rows terms"]:
    """1, z, the level's square, cube and products; the place and its square; a severity that saturates.

    Args:
        theta: Base parameters.
        severity: Severity as a multiple of the typical one.
        place: From `response.scaled_place`.

    Returns:
        Terms of ln of the gain.
    """
    z = scaled(theta)
    level = z[:, :1]
    saturating = np.log1p(np.abs(np.asarray(severity)) / 2)
    return np.column_stack(
        [np.ones(len(z)), z, level**2, level**3, level * z[:, 1:], place, place**2, saturating]
    )  # fmt: skip


def effect_terms(
    theta: Float[ndarray, "rows parameters"], severity: Float[ndarray, "rows"], place: Float[ndarray, "rows place"]
) -> Float[ndarray, "rows terms"]:
    """Powers of the severity times low ones of z and of the place; all vanish with the severity.

    Args:
        theta: Base parameters.
        severity: Severity as a multiple of the typical one.
        place: From `response.scaled_place`.

    Returns:
        Terms of an effect's shifts over its gain.
    """
    z, s = scaled(theta), np.asarray(severity)
    level, one = z[:, 0], np.ones(len(z))
    linear = [one, *z.T, *(level[:, None] * z[:, 1:]).T, level**2, level**3, level**4]
    linear += [z[:, i] ** 2 for i in _STRONG] + [level**2 * z[:, i] for i in _STRONG if i != _LAYING]
    curved = [one, level, level**2, level**3]
    for coordinate in place.T:
        linear += [coordinate, coordinate * level, coordinate * level**2, coordinate**2]
        curved += [coordinate, coordinate * level]
    cubic = [one, level, level**2]
    # Beyond the first order in units of three typical severities, so that all terms are of like size.
    first, second, third = s, s * np.abs(s) / 3, s**2 / 3
    return np.stack(
        [*(first * t for t in linear), *(third * t for t in curved), *(second * t for t in cubic)], axis=1
    )  # fmt: skip
