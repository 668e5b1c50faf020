"""How the waist moves: a rigid motion in its plane, prescribed, smooth, from rest and back to rest."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.garment.errors import GarmentError


@dataclass(frozen=True)
class WaistMotion:
    """Position x(t) = A sin(2 pi t / T), faded in and out over half a period, and angle turned through likewise.

    Attributes:
        sway: Amplitude A along the weft [m], sideways of the wearer.
        turn: Amplitude of the turn about z [rad].
        period: Period T [s].
        seconds: How long the motion lasts [s]; afterwards the waist is still.

    Raises:
        GarmentError: A value out of range.
    """

    sway: float = 0.0
    turn: float = 0.0
    period: float = 1.2
    seconds: float = 2.4

    def __post_init__(self) -> None:
        if not (np.isfinite([self.sway, self.turn]).all() and 0 < self.period < np.inf and 0 < self.seconds < np.inf):
            raise GarmentError(
                f"a waist moves by finite amounts, with period and duration > 0 s; got sway {self.sway} m, turn "
                f"{self.turn} rad, period {self.period} s, duration {self.seconds} s"
            )

    def _wave(self, time: float) -> float:
        """sin(2 pi t / T) between smooth ends."""
        half = 0.5 * self.period
        fade = np.clip(np.array([time, self.seconds - time]) / min(half, 0.5 * self.seconds), 0, 1).min()
        return float(fade * fade * (3 - 2 * fade) * np.sin(2 * np.pi * time / self.period))

    def pose(self, time: float) -> tuple[Float[ndarray, "3 3"], Float[ndarray, "3"]]:
        """Pose of the waist at a time.

        Args:
            time: Time since the motion began [s].

        Returns:
            Rotation matrix and shift [m].
        """
        wave = self._wave(time)
        cosine, sine = np.cos(self.turn * wave), np.sin(self.turn * wave)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return rotation, np.array([self.sway * wave, 0.0, 0.0])


STILL = WaistMotion()
