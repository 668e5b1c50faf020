"""Reference rows without physics, with which all other numbers should be compared.

A pixel MSE depends most of all on the places of folds, so a featureless disc is hard to beat, and a best-of-N score
improves with N. `null:rotation` and `null:random-phase` make many draws; like any other best-of-N score, theirs is
assisted by an oracle (the best draw is chosen by looking at the held-out image).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets.files.silhouette import drape_coefficient_of, profile_of
from cusick_bench.datasets.profile import PROFILE_ANGLES
from cusick_bench.solvers.base import Images, Prediction, Progress, Solver, SolverError
from cusick_bench.solvers.reference.silhouettes import Canvas, silhouette

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


Image = Float[np.ndarray, "size size"]


@dataclass(frozen=True)
class Null(Solver):
    """A predictor without simulation. If a training sample shows the other face, that face is predicted from it."""

    kind: ClassVar[str] = "null"
    learns_both_faces: ClassVar[bool] = True

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        faces = [problem.train_image, *problem.other_face_images[:1]]
        offered = [self._silhouettes(problem, image, generator, progress) for image in faces]
        fit = self._fit(problem, offered[0])
        if len(offered) == 1:
            return Prediction(fit, offered[0])
        draws = np.stack(offered, 1).reshape(-1, *fit.shape)  # the faces in turn
        return Prediction(fit, draws, draw_turned=np.arange(len(draws)) % 2 == 1)

    @abstractmethod
    def _silhouettes(
        self, problem: DrapeProblem, image: Image, generator: np.random.Generator, progress: Progress
    ) -> Images:
        """Predictions for unseen samples with the same face up as a training image; as many for either face."""

    def _fit(self, problem: DrapeProblem, offered: Images) -> Image:
        """Its fit of the training image."""
        return problem.train_image


@dataclass(frozen=True)
class NullDisc(Null):
    """A disc with the training silhouette's area."""

    name: ClassVar[str] = "null:disc"
    summary: ClassVar[str] = "disc with the training image's area"

    def _silhouettes(
        self, problem: DrapeProblem, image: Image, generator: np.random.Generator, progress: Progress
    ) -> Images:
        protocol = problem.protocol
        if protocol.projection == "parallel":
            radius = np.sqrt(image.sum() / np.pi) / protocol.px_per_m
        else:
            inner, outer = protocol.plate_radius_m**2, protocol.cloth_radius_m**2
            radius = np.sqrt(inner + drape_coefficient_of(image, protocol) * (outer - inner))
        return silhouette(np.full(4, radius), protocol)[None]

    def _fit(self, problem: DrapeProblem, offered: Images) -> Image:
        return offered[0]


@dataclass(frozen=True)
class NullCopy(Null):
    """The training silhouette, copied."""

    name: ClassVar[str] = "null:copy"
    summary: ClassVar[str] = "the training image, copied"

    def _silhouettes(
        self, problem: DrapeProblem, image: Image, generator: np.random.Generator, progress: Progress
    ) -> Images:
        return image[None]


@dataclass(frozen=True)
class NullRotation(Null):
    """The training silhouette in every rotation.

    Attributes:
        draws: Number of rotations over the full turn, each to the nearest of a profile's `PROFILE_ANGLES` angles.
    """

    draws: int = 360
    name: ClassVar[str] = "null:rotation"
    summary: ClassVar[str] = "the training image turned through 360 degrees; its best draw is oracle-assisted"

    def __post_init__(self) -> None:
        _require_draws(self.draws)

    @property
    def remark(self) -> str:
        if self.draws <= PROFILE_ANGLES:
            return ""
        return (
            f"a profile has {PROFILE_ANGLES} angles, so that draws={self.draws} holds some rotations several times; "
            f"give draws={PROFILE_ANGLES} or fewer"
        )

    def _silhouettes(
        self, problem: DrapeProblem, image: Image, generator: np.random.Generator, progress: Progress
    ) -> Images:
        profile = profile_of(image, problem.protocol)
        angles = np.arange(self.draws) * (360 / self.draws)
        canvas = Canvas.of(len(profile.radii), problem.protocol)
        turned = (canvas.silhouette(profile.rotated(angle).radii) for angle in angles)
        return _stack(turned, self.draws, problem, progress)


@dataclass(frozen=True)
class NullRandomPhase(Null):
    """Profiles with the training profile's Fourier amplitudes and random phases.

    Attributes:
        draws: Number of profiles. Compare with a method's best of as many draws only.
    """

    draws: int = 1000
    name: ClassVar[str] = "null:random-phase"
    summary: ClassVar[str] = "the training profile's Fourier amplitudes with random phases"

    def __post_init__(self) -> None:
        _require_draws(self.draws)

    def _silhouettes(
        self, problem: DrapeProblem, image: Image, generator: np.random.Generator, progress: Progress
    ) -> Images:
        radii = profile_of(image, problem.protocol).radii
        amplitude = np.abs(np.fft.rfft(radii))
        phase = generator.uniform(0, 2 * np.pi, (self.draws, len(amplitude)))
        phase[:, 0] = 0  # the mean radius stays
        profiles = np.fft.irfft(amplitude * np.exp(1j * phase), len(radii))
        canvas = Canvas.of(len(radii), problem.protocol)
        images = (canvas.silhouette(profile) for profile in profiles)
        return _stack(images, self.draws, problem, progress)


_MOST_DRAWS = 100_000
"""Largest number of draws: so many pictures take 26 GB, and a larger number is probably a typing error."""


def _require_draws(draws: int) -> None:
    if not 1 <= draws <= _MOST_DRAWS:
        raise SolverError(f"draws must be from 1 to {_MOST_DRAWS}, got {draws}")


def _stack(images, count: int, problem: DrapeProblem, progress: Progress) -> np.ndarray:
    stack = np.empty((count, *problem.train_image.shape), dtype=np.float32)
    for index, image in enumerate(images):
        stack[index] = image
        progress("drawing silhouettes", (index + 1) / count)
    return stack
