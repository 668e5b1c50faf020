"""What a diagnosis is asked for, and the atlas that it rests on."""

from dataclasses import dataclass
from pathlib import Path

SHIPPED = Path(__file__).parent / "atlas" / "atlas.npz"
"""The fitted atlas of this package."""


@dataclass(frozen=True)
class Options:
    """How to diagnose.

    Attributes:
        samples: Simulated samples of each model and fold; 0 leaves the simulations, and so gap and closure, out.
        always: Simulate also where no effect shows.
        without: Effects that are not to be considered.
        seed: Seed of simulations and tests.
    """

    samples: int = 24
    always: bool = True
    without: tuple[str, ...] = ()
    seed: int = 0
