"""One drape under comparison: its silhouette, and what is derived from it where a metric asks for it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.profile import Profile, drape_coefficient, fold_count, profile_from_image
from cusick_bench.metrics.ruled import ruled_surface
from cusick_bench.metrics.surface import Surface

_GENERATOR_STEP = 2  # a generator a degree: surfaces within 0.02 mm of those with two a degree, in half the time

Image = Float[ndarray, "height width"] | Float[torch.Tensor, "height width"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A drape as the metrics see it.

    Attributes:
        image: Silhouette, cloth = 1.
        mesh: Its surface, None where only the silhouette is known.
    """

    image: Image
    mesh: Surface | None = None

    @cached_property
    def pixels(self) -> Float[ndarray, "height width"]:
        """The silhouette as an array."""
        image = self.image
        return image.detach().cpu().numpy() if isinstance(image, torch.Tensor) else np.asarray(image)

    @cached_property
    def profile(self) -> Profile:
        """Radius-angle profile of the silhouette."""
        return profile_from_image(self.pixels)

    @cached_property
    def surface(self) -> Surface:
        """The mesh, or where there is none the ruled surface that has this silhouette."""
        return self.mesh or Surface.of(ruled_surface(self.profile.radii[::_GENERATOR_STEP]))

    @cached_property
    def drape_coefficient(self) -> float:
        """Drape coefficient of the silhouette."""
        return drape_coefficient(self.pixels)

    @cached_property
    def folds(self) -> int:
        """Number of folds of the silhouette."""
        return fold_count(self.profile)
