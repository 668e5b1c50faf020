"""Changes of a silhouette that a camera, or somebody who handles the pictures, may cause.

Pictures are moved, scaled and turned with cubic splines, which place an outline correctly to a few hundredths of a
pixel. The origin is the plate's axis; x points to the right, y up as the protocol defines it.
"""

from dataclasses import dataclass
from typing import Any
from typing import Protocol as Interface

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol

Picture = Float[ndarray, "size size"]
_LEAST_SHARE = 1e-9  # least grey of a blurred edge, so that the distance to the edge stays finite


@dataclass(frozen=True)
class View:
    """How a picture was taken.

    Attributes:
        sample: Number of the sample.
        side: Face that lies up: `up`, `down` or "".
        protocol: Nominal values of the experiment.
    """

    sample: int
    side: str
    protocol: Protocol


class PictureChange(Interface):
    """A function that changes a picture."""

    def __call__(self, picture: Picture, view: View) -> Picture:
        """The changed picture.

        Args:
            picture: Coverage in [0, 1], cloth = 1.
            view: How it was taken.

        Returns:
            The changed coverage, of the same size.
        """
        ...


def mapped(
    picture: Picture, protocol: Protocol, matrix: Float[ndarray, "2 2"], shift: tuple[float, float] = (0.0, 0.0)
) -> Picture:
    """The picture of points p that are seen at `matrix` p + `shift` instead.

    Args:
        picture: Coverage, cloth = 1.
        protocol: Gives centre and orientation.
        matrix: Linear part of the map.
        shift: Shift along x and y [px].

    Returns:
        Coverage in [0, 1].
    """
    from scipy.ndimage import affine_transform

    up = 1.0 if protocol.image_y == "up" else -1.0
    to_rows = np.array([[0.0, -up], [1.0, 0.0]])  # (x, y) -> (row, column)
    middle = np.array(protocol.centre_px)[::-1]
    back = np.linalg.inv(to_rows @ matrix @ np.linalg.inv(to_rows))
    offset: Any = middle - back @ (middle + to_rows @ np.array(shift))  # Any: SciPy's stubs allow one number only
    seen = affine_transform(picture, back, offset, order=3)
    return np.clip(seen, 0.0, 1.0)


@dataclass(frozen=True)
class Shift:
    """The whole picture is shifted.

    Attributes:
        distance: Length of the shift [px].
        direction: Counter-clockwise from x in the picture [deg].
    """

    distance: float
    direction: float

    def __call__(self, picture: Picture, view: View) -> Picture:
        """The shifted picture."""
        angle = np.deg2rad(self.direction)
        shift = (self.distance * float(np.cos(angle)), self.distance * float(np.sin(angle)))
        return mapped(picture, view.protocol, np.eye(2), shift)


@dataclass(frozen=True)
class Magnification:
    """The picture has another scale than the protocol says.

    Attributes:
        error: Relative error of the scale.
    """

    error: float

    def __call__(self, picture: Picture, view: View) -> Picture:
        """The magnified picture."""
        return mapped(picture, view.protocol, (1 + self.error) * np.eye(2))


@dataclass(frozen=True)
class GrainTurn:
    """The cloth was laid down with its warp turned from the mark: counter-clockwise face up, clockwise face down.

    Attributes:
        angle: Angle of the turn, seen face up [deg].
    """

    angle: float

    def __call__(self, picture: Picture, view: View) -> Picture:
        """The turned picture."""
        angle = np.deg2rad(-self.angle if view.side == "down" else self.angle)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return mapped(picture, view.protocol, turn)


@dataclass(frozen=True)
class OtherCut:
    """The picture is blurred, and cut into cloth and background at another grey level.

    A straight edge that a Gaussian of width s blurs has the grey Phi(d / s) at the distance d inside it; the level at
    which it is cut moves the edge by `outwards`. Where an outline bends, blur moves it too, as it does in a camera.

    Attributes:
        outwards: How far a straight edge moves outwards [px].
        blur: Standard deviation of the blur [px].
    """

    outwards: float
    blur: float = 2.0

    def __call__(self, picture: Picture, view: View) -> Picture:
        """The picture cut anew; its edge is one pixel wide."""
        from scipy.ndimage import gaussian_filter
        from scipy.special import ndtri

        share = np.clip(gaussian_filter(picture, self.blur), _LEAST_SHARE, 1 - _LEAST_SHARE)
        return np.clip(0.5 + self.blur * ndtri(share) + self.outwards, 0.0, 1.0)


@dataclass(frozen=True)
class MirroredFace:
    """Pictures of the lower face are mirror images, right for left.

    Attributes:
        every: 1 for every sample, 2 for every second one.
        counted: Numbers of the samples in the order in which they are counted; by default they count as numbered.
    """

    every: int = 1
    counted: tuple[int, ...] = ()

    def __call__(self, picture: Picture, view: View) -> Picture:
        """The mirror image, or the picture as it is."""
        place = self.counted.index(view.sample) + 1 if self.counted else view.sample
        if view.side != "down" or place % self.every:
            return picture
        return mapped(picture, view.protocol, np.diag([-1.0, 1.0]))
