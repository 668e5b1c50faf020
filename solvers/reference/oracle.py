"""Reference rows that see the held-out images; no method is expected to be better.

"Others" of a held-out image are the remaining samples of its cloth that lie alike, those that train among them (11 of
12), or all remaining ones where none lies alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cusick_bench.solvers.base import HeldOut, Images, Oracle, Prediction, Progress, SolverError

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


def _others(seen: HeldOut) -> tuple[Images, ...]:
    if not all(len(images) for images in seen.others):
        raise SolverError("the oracle needs another sample of the cloth, got none")
    return seen.others


def _nearest(candidates: Images, image: np.ndarray) -> np.ndarray:
    return candidates[np.square(candidates - image).mean((1, 2)).argmin()]


@dataclass(frozen=True)
class OracleMean(Oracle):
    """Mean of the other samples' images."""

    name: ClassVar[str] = "oracle:mean"
    version: ClassVar[int] = 2
    summary: ClassVar[str] = "mean image of the cloth's other samples"

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        means = np.stack([others.mean(0) for others in _others(self.seen)])
        return Prediction(self.seen.images.mean(0), means, paired=True)


@dataclass(frozen=True)
class OracleBestOther(Oracle):
    """For every held-out image the nearest of the other samples' images."""

    name: ClassVar[str] = "oracle:best-other"
    version: ClassVar[int] = 2
    summary: ClassVar[str] = "nearest image among the cloth's other samples"

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        images = self.seen.images
        nearest = [_nearest(others, image) for others, image in zip(_others(self.seen), images, strict=True)]
        return Prediction(_nearest(images, problem.train_image), np.stack(nearest), paired=True)


@dataclass(frozen=True)
class OracleRepeat(Oracle):
    """A repeated capture of the same drape: the floor that measurement sets."""

    name: ClassVar[str] = "oracle:repeat"
    summary: ClassVar[str] = "another capture of the very same drape: the measurement floor"

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        repeats = self.seen.repeats
        if len(repeats) != len(self.seen.images) or not all(len(images) for images in repeats):
            raise SolverError(
                "oracle:repeat needs a repeated capture of every held-out drape, and this split has none; "
                "run it on a fabric with several captures a side"
            )
        return Prediction(problem.train_image, np.stack([images[0] for images in repeats]), paired=True)
