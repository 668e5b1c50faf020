"""Times of several cases taken in turn, so that a busy machine slows all of them alike."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Timing:
    """Wall times of one case [s].

    Attributes:
        seconds: One time a round.
    """

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median [s]."""
        return float(np.median(self.seconds))

    def summary(self) -> dict[str, float]:
        """Median and range [s], for the record."""
        low, high = min(self.seconds), max(self.seconds)
        return {"median_s": self.median, "low_s": low, "high_s": high, "rounds": len(self.seconds)}


def time_in_turn(
    cases: Mapping[str, Callable[[], object]], rounds: int, done: Callable[[str], None] = lambda name: None
) -> dict[str, Timing]:
    """Times every case once a round, after one call to warm it up.

    Args:
        cases: What to time, by name.
        rounds: Times of each.
        done: Called with the name of each case timed.

    Returns:
        Times of every case [s].
    """
    taken: dict[str, list[float]] = {name: [] for name in cases}
    for turn in range(rounds + 1):
        for name, case in cases.items():
            clock = time.perf_counter()
            case()
            if turn:
                taken[name].append(time.perf_counter() - clock)
            done(name)
    return {name: Timing(tuple(seconds)) for name, seconds in taken.items()}


def paired_ratio(first: Timing, second: Timing) -> dict[str, float]:
    """Ratio of two cases timed in turn: median and range over the rounds.

    Args:
        first: Times of one case [s].
        second: Times of the other, taken in turn with it [s].

    Returns:
        The ratio with its bounds, by name.
    """
    ratios = np.array(first.seconds) / np.array(second.seconds)
    return {"median": float(np.median(ratios)), "low": float(ratios.min()), "high": float(ratios.max())}
