"""Number of folds of a closed curve: peaks of its low harmonics that stand out far enough.

2.8 mm are far enough for the standard's cloth of 0.15 m radius; for another cloth, give the prominence in proportion to
its radius, so that drapes of the same shape have the same folds.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

FOLD_PROMINENCE = 0.0028  # [m] by which a fold stands out; about 2 px of the release: below it, pixel noise makes peaks
FOLD_HARMONICS = 30  # highest harmonic that is kept before peaks are counted


def ring_folds(
    radii: Float[ndarray, " angles"], *, prominence: float = FOLD_PROMINENCE, harmonics: int = FOLD_HARMONICS
) -> int:
    """Counts the peaks of a closed curve's low harmonics by their topographic prominence.

    Args:
        radii: Values at equidistant angles over the full turn [any unit].
        prominence: How far a peak stands out at least, in the same unit, > 0.
        harmonics: Highest harmonic that is kept.

    Returns:
        Number of peaks of harmonics 0 to `harmonics` whose prominence is at least `prominence`.
    """
    spectrum = np.fft.rfft(radii)
    spectrum[harmonics + 1 :] = 0
    smooth = np.fft.irfft(spectrum, len(radii))
    lowest = int(np.argmin(smooth))
    closed = np.append(np.roll(smooth, -lowest), smooth[lowest])  # from valley to valley: prominences are the circle's
    levels = closed[np.append(True, np.diff(closed) != 0)]
    peaks = np.flatnonzero((levels[1:-1] > levels[:-2]) & (levels[1:-1] > levels[2:])) + 1
    return sum(_prominence(levels, int(peak)) >= prominence for peak in peaks)


def _prominence(levels: Float[ndarray, " angles"], peak: int) -> float:
    """Height of a peak above the higher of the two lowest points between it and the next higher level on each side.

    As `scipy.signal.find_peaks` has it, which takes a second to import.
    """
    higher = np.flatnonzero(levels > levels[peak])
    before, after = higher[higher < peak], higher[higher > peak]
    left, right = levels[before[-1] if len(before) else 0 : peak], levels[peak + 1 : after[0] if len(after) else None]
    return float(levels[peak] - max(left.min(), right.min()))
