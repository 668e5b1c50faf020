"""Rows of a fabric's feature vector: the blocks, and the rows that a model without effect may get wrong.

    face-even   (up + down)/2 of every statistic, mean over samples [sd]: what both faces share, in the cloth's frame
    face-odd    (down - up)/2 of every statistic, mean over samples [sd]
    spread      entries of `SPREADS`: ln of a standard deviation between samples
    drift       entries of `ORDERS`: last capture minus first, mean over samples and faces [sd]

The even and odd contrasts of a sample are uncorrelated, since its faces are exchangeable, and odd ones scatter less,
since the stiffness of a sample acts on both of its faces.

Any cloth without an effect, whatever its law, is the same on both faces, symmetric about warp and weft, and at rest:
its odd contrasts, its drifts and the locked statistics that this symmetry forbids are 0. A model whose base law is not
that of the cloth can be wrong in the other rows only (`MAY_BE_WRONG`); a shift in the forbidden rows is an effect's.

Where all samples lie on one face, the face-even rows hold that face, whose shift is the even one minus (face up) or
plus (face down) the odd one (`as_seen`), and the face-odd rows are unknown.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS
from cusick_bench.diagnosis.measure.statistics import EVEN, FREE, NAMES

_COUNT = len(NAMES)
FACE_EVEN: Final = slice(0, _COUNT)
FACE_ODD: Final = slice(FACE_EVEN.stop, FACE_EVEN.stop + _COUNT)
MEANS: Final = slice(FACE_EVEN.start, FACE_ODD.stop)
"""Both face blocks, even before odd."""
SPREAD: Final = slice(FACE_ODD.stop, FACE_ODD.stop + len(SPREADS))
DRIFT: Final = slice(SPREAD.stop, SPREAD.stop + len(ORDERS))
ROWS: Final = DRIFT.stop


def _may_be_wrong() -> Bool[ndarray, "rows"]:
    rows = np.zeros(ROWS, dtype=bool)
    rows[[*FREE, *EVEN]] = True  # columns of the statistics are the rows of the first block
    rows[SPREAD] = True
    return rows


MAY_BE_WRONG: Final = _may_be_wrong()
"""Which rows a model without effect may get wrong (see the module): of the even means the phase-free statistics and the
real parts of even order, and the spreads."""


def in_rows(
    up: Float[ndarray, "values statistics"],
    down: Float[ndarray, "values statistics"],
    spread: Float[ndarray, "values spreads"],
    drift: Float[ndarray, "values orders"],
) -> Float[ndarray, "values rows"]:
    """Feature vectors from the statistics of each face.

    Args:
        up, down: Statistics of the faces, or shifts of them.
        spread: Entries of `SPREADS`.
        drift: Entries of `ORDERS`.

    Returns:
        All blocks.
    """
    return np.concatenate([(up + down) / 2, (down - up) / 2, spread, drift], axis=1)


def faces_of(values: Float[ndarray, "*values rows"]) -> Float[ndarray, "*values 2 statistics"]:
    """Statistics of each face, or shifts of them, from vectors.

    Args:
        values: Feature vectors, or shifts of them.

    Returns:
        Those of the upper and of the lower face.
    """
    even, odd = values[..., FACE_EVEN], values[..., FACE_ODD]
    return np.stack([even - odd, even + odd], axis=-2)


def as_seen(values: Float[ndarray, "*values rows"], single: int) -> Float[ndarray, "*values rows"]:
    """Shifts as they appear in data of which only one face may be known.

    Args:
        values: Shifts of all rows.
        single: -1 where only the upper face is known, 1 where only the lower one, 0 where both are.

    Returns:
        The same where both are known; else the even rows hold the shift of that face.
    """
    if not single:
        return values
    seen = values.copy()
    seen[..., FACE_EVEN] += single * values[..., FACE_ODD]
    return seen
