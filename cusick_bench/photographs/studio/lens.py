"""The camera of a drawn photograph: place, direction, lens; where it sees a point, and where a pixel looks."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_INVERSIONS = 6  # fixed-point steps that take a lens' distortion off


@dataclass(frozen=True)
class StudioCamera:
    """A camera that looks down at the plate; x right, y up in the picture, z up, the plate's top at z = 0.

    Attributes:
        width, height: Size of the picture [px].
        focal: Focal length [px].
        middle: Column and row of the optical axis [px].
        distortion: Radial coefficients k1, k2 of the Brown-Conrady model.
        eye: Place of the pupil [m].
        turn: Rotations about the picture's x, y and z axes [rad].
    """

    width: int
    height: int
    focal: float
    middle: tuple[float, float]
    distortion: tuple[float, float]
    eye: tuple[float, float, float]
    turn: tuple[float, float, float]

    def finer(self, times: int) -> "StudioCamera":
        """The same camera with more pixels.

        Args:
            times: Pixels along each side of an old one.

        Returns:
            The camera of the finer picture.
        """
        column, row = ((value + 0.5) * times - 0.5 for value in self.middle)
        size = (self.width * times, self.height * times)
        return StudioCamera(*size, self.focal * times, (column, row), self.distortion, self.eye, self.turn)

    def rotation(self) -> Float[ndarray, "3 3"]:
        """From the world into the camera, whose y points down the picture and whose z looks at the plate."""
        about_x, about_y, about_z = self.turn
        cosine, sine = np.cos, np.sin
        x = np.array(
            [[1, 0, 0], [0, cosine(about_x), -sine(about_x)], [0, sine(about_x), cosine(about_x)]], dtype=float
        )
        y = np.array(
            [[cosine(about_y), 0, sine(about_y)], [0, 1, 0], [-sine(about_y), 0, cosine(about_y)]], dtype=float
        )
        z = np.array(
            [[cosine(about_z), -sine(about_z), 0], [sine(about_z), cosine(about_z), 0], [0, 0, 1]], dtype=float
        )
        return x @ y @ z @ np.diag([1.0, -1.0, -1.0])

    def project(self, points: Float[ndarray, "points 3"]) -> Float[ndarray, "points 2"]:
        """Pixels at which points are seen.

        Args:
            points: Positions [m].

        Returns:
            Columns and rows [px].
        """
        seen = (np.asarray(points) - np.array(self.eye)) @ self.rotation().T
        plane = seen[:, :2] / seen[:, 2:]
        square = (plane**2).sum(axis=1, keepdims=True)
        bent = plane * (1 + self.distortion[0] * square + self.distortion[1] * square**2)
        return self.focal * bent + np.array(self.middle)

    def rays(self) -> Float[ndarray, "height width 3"]:
        """Directions in which the pixels look, in the world's axes; not of unit length."""
        return _rays(self)

    def axis(self) -> Float[ndarray, " 3"]:
        """Direction of the optical axis."""
        return self.rotation()[2]


@lru_cache(maxsize=2)
def _rays(camera: StudioCamera) -> Float[ndarray, "height width 3"]:
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    bent = (np.stack([columns - camera.middle[0], rows - camera.middle[1]], axis=-1) / camera.focal).astype(np.float32)
    plane = bent.copy()
    for _ in range(_INVERSIONS if any(camera.distortion) else 0):
        square = plane[..., :1] ** 2 + plane[..., 1:] ** 2
        plane = bent / (1 + square * (camera.distortion[0] + camera.distortion[1] * square))
    rotation = camera.rotation().astype(np.float32)
    return plane[..., :1] * rotation[0] + plane[..., 1:] * rotation[1] + rotation[2]
