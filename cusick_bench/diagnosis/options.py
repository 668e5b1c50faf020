"""Options of a diagnosis, and the path of the shipped atlas."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

SHIPPED = Path(__file__).parent / "atlas" / "atlas.npz"
"""The fitted atlas of this package."""

LEAST_SAMPLES = 3
"""Least number of samples, with usable pictures, of a fabric that is diagnosed without being asked for by name: how
they scatter must be known."""

ONE_SAMPLE = "one simulated sample has no scatter, and so no gap to the data; take 2 or more, or 0 to simulate nothing"


@dataclass(frozen=True)
class Options:
    """How to diagnose.

    Attributes:
        samples: Simulated samples of each model and fold, two or more; 0 for no simulations, and so no gap and closure.
        always: Whether to simulate also where no effect is found.
        without: Effects that are not to be considered.
        seed: Seed of simulations and tests.
    """

    samples: int = 24
    always: bool = True
    without: tuple[str, ...] = ()
    seed: int = 0

    def command(self, data: str, fabrics: Sequence[str], atlas: Path = SHIPPED, *, force: bool = False) -> str:
        """The command that makes a document again.

        Args:
            data: Data set: name or folder.
            fabrics: Its fabrics.
            atlas: The atlas.
            force: Whether silhouettes that no cloth can show are used all the same.

        Returns:
            The command as one types it.
        """
        words = [
            "cusick-bench",
            "diagnose",
            data,
            *repeated_option("--fabric", fabrics),
            "--samples",
            str(self.samples),
        ]
        words += repeated_option("--without-effect", self.without)
        words += [] if atlas == SHIPPED else ["--atlas", str(atlas)]
        words += ["--seed", str(self.seed)]
        return shlex.join([*words, "--force"] if force else words)


def repeated_option(name: str, values: Iterable[str]) -> list[str]:
    """Words of a command that give an option several times.

    Args:
        name: The option, such as `--fabric`.
        values: Its values.

    Returns:
        The words, unquoted.
    """
    return [word for value in values for word in (name, value)]
