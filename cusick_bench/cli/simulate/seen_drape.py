"""A simulated drape as a camera sees it: its picture, what is measured on it, and its files.

From a pinhole camera's picture perspective is taken out before anything is measured, as from the pictures of data.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cusick_bench.cli.options import CameraName
from cusick_bench.sim.constants import CLOTH_RADIUS, IMAGE_SIZE, PIXELS_PER_METRE, PLATE_RADIUS

if TYPE_CHECKING:
    import torch

    from cusick_bench.datasets.profile import Profile
    from cusick_bench.sim.drape import Drape
    from cusick_bench.sim.render.camera import Camera

_WRITTEN = re.compile(r"drape_\d{4,}(\.obj|\.png|_profile\.csv)")  # what `write_drape` writes
_MARGIN = 1.05  # half a picture over the flat cloth's reach, at least


@dataclass(frozen=True)
class Sight:
    """How drapes are seen and measured; a cloth too large for the release's pictures gets larger ones.

    Attributes:
        camera: Camera.
        scale: Its scale at the plate's level [px/m].
        centre: Pixel of the plate's axis.
        size: Height and width of a picture [px].
        cloth_radius: Radius of the flat cloth [m].
        eye_height: Height of a pinhole camera's eye above the plate [m]; None of a parallel one.
    """

    camera: Camera
    scale: float
    centre: tuple[float, float]
    size: int
    cloth_radius: float
    eye_height: float | None = None

    @classmethod
    def of(cls, camera: CameraName, cloth_radius: float, reach: float) -> Sight:
        """The sight of a cloth.

        Args:
            camera: Kind of camera.
            cloth_radius: Radius of the flat cloth [m].
            reach: Largest distance of a vertex from the plate's axis [m].

        Returns:
            The sight.
        """
        from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera

        size = max(IMAGE_SIZE, 2 * math.ceil(_MARGIN * PIXELS_PER_METRE * reach))
        centre = (size - 1) / 2, (size - 1) / 2
        if camera is CameraName.parallel:
            return cls(ParallelCamera(centre_px=centre), PIXELS_PER_METRE, centre, size, cloth_radius)
        pinhole = PinholeCamera(centre_px=centre)
        height = pinhole.eye_height_m
        return cls(pinhole, pinhole.focal_px / height, centre, size, cloth_radius, height)

    def outcome(self, drape: Drape, seen: torch.Tensor, faces: np.ndarray) -> Outcome:
        """A drape with its picture.

        Args:
            drape: The drape.
            seen: Where its points seem to be [m].
            faces: Its triangles.

        Returns:
            The drape as it is seen.
        """
        from cusick_bench.datasets.profile import drape_coefficient, profile_from_image
        from cusick_bench.sim.render.silhouette import render

        image = render(seen, faces, self.camera, size=self.size)
        apparent = profile_from_image(image, pixels_per_metre=self.scale, centre=self.centre)
        profile = self._from_afar(apparent)
        hidden = float(np.mean(profile.radii**2 - apparent.radii**2))  # what perspective takes off r^2 [m2]
        share = drape_coefficient(image, pixels_per_metre=self.scale, cloth_radius=self.cloth_radius)
        share += hidden / (self.cloth_radius**2 - PLATE_RADIUS**2)
        return Outcome(drape, image, profile, share, self)

    def _from_afar(self, apparent: Profile) -> Profile:
        """The profile that a camera far away would see."""
        from cusick_bench.datasets.files.hanging_line import Sizes, seen_from_afar
        from cusick_bench.datasets.profile import Profile

        if self.eye_height is None:
            return apparent
        return Profile(seen_from_afar(apparent.radii, Sizes(PLATE_RADIUS, self.cloth_radius), self.eye_height))


@dataclass(frozen=True)
class Outcome:
    """One simulated drape with the numbers that describe it; nobody knows whether one with history is at rest."""

    drape: Drape
    image: torch.Tensor
    profile: Profile
    drape_coefficient: float
    sight: Sight

    def summary(self) -> dict[str, Any]:
        """The drape's part of the JSON document."""
        from cusick_bench.datasets.profile import amplitude_spectrum, fold_count
        from cusick_bench.sim.cloth.folds import FOLD_PROMINENCE

        prominence = FOLD_PROMINENCE * (self.sight.cloth_radius / CLOTH_RADIUS)
        return {
            "drape_coefficient": self.drape_coefficient,
            "folds": fold_count(self.profile, prominence=prominence),
            "converged": None if math.isnan(self.drape.residual) else self.drape.converged,
            "residual": self.drape.residual,
            "halvings": self.drape.halvings,
            "seconds": self.drape.seconds,
            "mean_radius_m": float(self.profile.radii.mean()),
            "amplitudes_m": amplitude_spectrum(self.profile),
        }


def drape_name(number: int) -> str:
    """Name of a draw's files, without what tells them apart."""
    return f"drape_{number:04d}"


def forget_drapes(folder: Path) -> None:
    """Removes the files of an earlier run, which may have made more draws, or some that fail now."""
    for path in folder.iterdir():
        if _WRITTEN.fullmatch(path.name):
            path.unlink()


def write_drape(folder: Path, name: str, outcome: Outcome, faces: np.ndarray) -> None:
    """Mesh, silhouette (dark cloth on white, as the release has it) and profile of one drape."""
    from PIL import Image

    from cusick_bench.sim.cloth.obj import write_obj

    write_obj(folder / f"{name}.obj", outcome.drape.vertices.detach().numpy(), faces)
    grey = np.round(255 * (1 - outcome.image.detach().numpy())).astype(np.uint8)
    Image.fromarray(grey).save(folder / f"{name}.png")
    table = np.column_stack([np.degrees(outcome.profile.angles), outcome.profile.radii])
    np.savetxt(
        folder / f"{name}_profile.csv", table, delimiter=",", header="angle_deg,radius_m", comments="", fmt="%.6g"
    )
