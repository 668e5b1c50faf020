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
    from scipy.signal import find_peaks  # here: it takes half a second to import

    spectrum = np.fft.rfft(radii)
    spectrum[harmonics + 1 :] = 0
    smooth = np.fft.irfft(spectrum, len(radii))
    lowest = int(np.argmin(smooth))
    closed = np.append(np.roll(smooth, -lowest), smooth[lowest])  # from valley to valley: prominences are the circle's
    return len(find_peaks(closed, prominence=prominence)[0])
