"""Number of folds of a closed curve: peaks of its low harmonics with enough prominence.

For the standard's cloth of 0.15 m radius the least prominence is 2.8 mm; for another cloth, give one in proportion to
its radius, so that drapes of the same shape have the same number of folds.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

FOLD_PROMINENCE = 0.0028  # [m] least prominence of a fold, about 2 px of the release; pixel noise makes smaller peaks
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
    if not len(peaks):
        return 0
    valleys = np.minimum.reduceat(levels, np.append(0, peaks))
    return sum(height >= prominence for height in _prominences(levels[peaks].tolist(), valleys.tolist()))


def _prominences(peaks: list[float], valleys: list[float]) -> list[float]:
    """Height of each peak above the higher of the two lowest points between it and the next higher level on each side.

    As `scipy.signal.find_peaks` has it, which takes a second to import. `valleys` are the lowest points before, between
    and after the peaks.
    """
    found = []
    for place, height in enumerate(peaks):
        before = after = place
        while before > 0 and peaks[before - 1] <= height:
            before -= 1
        while after + 1 < len(peaks) and peaks[after + 1] <= height:
            after += 1
        found.append(height - max(min(valleys[before : place + 1]), min(valleys[place + 1 : after + 2])))
    return found
