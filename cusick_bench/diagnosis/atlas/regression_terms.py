"""Terms of the atlas' regressions: products of the base parameters, scaled to [-1, 1] over the atlas."""

from itertools import combinations_with_replacement

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW

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


def base_terms(theta: Float[ndarray, "rows parameters"]) -> Float[ndarray, "rows terms"]:
    """All products of up to two z, up to four of the bending level's with one other, and how limp a cloth is.

    Args:
        theta: Base parameters.

    Returns:
        Terms of the means without effect, in the order of `CORRECTED` and `LIMP`.
    """
    z = scaled(theta)
    pairs = [z[:, i] * z[:, j] for i, j in combinations_with_replacement(range(z.shape[1]), 2)]
    level = z[:, 0]
    more = [level**3, level**4, *(level**2 * z[:, i] for i in range(1, z.shape[1]))]
    limp = np.maximum(LIMPER_THAN - theta[:, 0], 0) / (LIMPER_THAN - LOW[0])
    return np.stack([np.ones(len(z)), *z.T, *pairs, *more, limp, limp**2], axis=1)


_COUNT = len(LOW)
_PAIRS = _COUNT * (_COUNT + 1) // 2
CORRECTED = np.array([*range(1 + _COUNT), *range(1 + _COUNT, 1 + 2 * _COUNT), 1 + _COUNT + _PAIRS])
"""Of `base_terms`: 1, z, products of the bending level's z with each z, and its cube; what the cheaper model gets wrong
is a function of these."""
LIMP = 1 + _COUNT + _PAIRS + 2 + _COUNT - 1 + np.arange(2)
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
    level = z[:, 0]
    linear = [np.ones(len(z)), *z.T, level**2]
    curved = [np.ones(len(z)), level, level**2]
    for coordinate in place.T:
        linear += [coordinate, coordinate * level, coordinate**2]
        curved += [coordinate]
    cubic = [np.ones(len(z)), level]
    # Beyond the first order in units of three typical severities, so that all terms are of like size.
    first, second, third = s, s * np.abs(s) / 3, s**2 / 3
    return np.stack(
        [*(first * t for t in linear), *(third * t for t in curved), *(second * t for t in cubic)], axis=1
    )  # fmt: skip
