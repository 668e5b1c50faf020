"""Causes that no silhouette tells apart.

They are listed explicitly, since frozen answers must have the same meaning years later.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Equivalents:
    """Causes that change silhouettes alike.

    Attributes:
        effects: Their names.
        why: What they share.
    """

    effects: frozenset[str]
    why: str


EQUIVALENTS = (
    Equivalents(
        frozenset({"plate-radius", "cut-size", "camera-scale", "threshold"}),
        "each makes the whole outline larger or smaller",
    ),
    Equivalents(
        frozenset({"creep", "bending-friction"}), "each changes how far folds have sunk when the picture is taken"
    ),
)

ABSORBED = Equivalents(
    frozenset({"density-bias"}),
    "a drape depends on stiffness over weight alone: a wrong weight only rescales the stiffness",
)
"""Causes that the base model's own parameters absorb."""
