"""Number of folds of a closed curve: peaks of its low harmonics that stand out far enough."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray


def ring_folds(radii: Float[ndarray, " angles"], *, prominence: float, modes: int) -> int:
    """Counts peaks, of harmonics 0 to `modes`, whose topographic prominence is at least `prominence`.

    A walk round the circle alternates between valleys and peaks and takes note of a turn once the curve has come
    back by the prominence; that counts just these peaks (and needs no scipy.signal, half a second to import).

    Args:
        radii: Values at equidistant angles over the full turn [any unit].
        prominence: How far a peak stands out, in the same unit, > 0.
        modes: Highest harmonic.
    """
    harmonics = np.fft.rfft(radii)
    harmonics[modes + 1 :] = 0
    smooth = np.fft.irfft(harmonics, len(radii))
    lowest = int(np.argmin(smooth))
    folds, climbing, extreme = 0, False, smooth[lowest]
    for value in [*smooth[lowest:].tolist(), *smooth[: lowest + 1].tolist()]:
        if climbing:
            extreme = max(extreme, value)
            if extreme - value >= prominence:
                folds, climbing, extreme = folds + 1, False, value
        else:
            extreme = min(extreme, value)
            if value - extreme >= prominence:
                climbing, extreme = True, value
    return folds
