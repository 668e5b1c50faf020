"""One drape under comparison: its silhouette, and what is derived from it where a metric asks for it."""

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import drape_coefficient_of, fold_count_of, profile_of
from cusick_bench.datasets.profile import Profile
from cusick_bench.metrics.distances.image import image_array
from cusick_bench.metrics.distances.ruled import ruled_surface
from cusick_bench.metrics.distances.surface import Surface

_GENERATOR_STEP = 2  # a generator a degree: surfaces within 0.02 mm of those with two a degree, in half the time

Image = Float[ndarray, "height width"] | Float[torch.Tensor, "height width"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A drape as the metrics see it.

    Attributes:
        image: Silhouette, cloth = 1.
        mesh: Its surface, None where only the silhouette is known.
        protocol: How the silhouette was taken.
    """

    image: Image
    mesh: Surface | None = None
    protocol: Protocol = RELEASE

    @cached_property
    def pixels(self) -> Float[ndarray, "height width"]:
        """The silhouette as an array."""
        return image_array(self.image)

    @cached_property
    def profile(self) -> Profile:
        """Radius-angle profile of the silhouette."""
        return profile_of(self.pixels, self.protocol)

    @cached_property
    def surface(self) -> Surface:
        """The mesh, or where there is none the ruled surface that has this silhouette."""
        if self.mesh is not None:
            return self.mesh
        radii, protocol = self.profile.radii[::_GENERATOR_STEP], self.protocol
        return Surface.of(ruled_surface(radii, slant=protocol.overhang_m, plate_radius=protocol.plate_radius_m))

    @cached_property
    def drape_coefficient(self) -> float:
        """Drape coefficient of the silhouette."""
        return drape_coefficient_of(self.pixels, self.protocol)

    @cached_property
    def folds(self) -> int:
        """Number of folds of the silhouette."""
        return fold_count_of(self.profile, self.protocol)
