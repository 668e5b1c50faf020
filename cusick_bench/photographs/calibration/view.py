"""How a camera sees the plate: its lens, and the place of its pupil above the plate's plane."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

HEADER_FOCAL = 0.03  # assumed relative uncertainty of a height from the focal length in a picture's header
MEASURED_HEIGHT = 0.01  # assumed relative uncertainty of a height that was measured with a ruler


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of what a calibration found.

    Attributes:
        scale: Relative standard deviation of lengths in the plate's plane.
        centre_m: Standard deviation of the plate's axis, along x and along y [m].
        tilt_rad: Standard deviation of the camera's tilt [rad].
        height_m: Standard deviation of the pupil's height [m]; infinite where it is not known.
    """

    scale: float
    centre_m: float
    tilt_rad: float
    height_m: float


@dataclass(frozen=True, eq=False)
class PlateView:
    """A calibrated camera over the plate: origin on the plate's axis, z up, x to the right of the picture.

    Attributes:
        size: Width and height of its pictures [px].
        matrix: Focal lengths and optical axis [px], as OpenCV has them.
        distortion: k1, k2 of the Brown-Conrady model, and zeros for p1, p2, k3, in OpenCV's order.
        rotation: From the plate's axes into the camera's.
        translation: Place of the plate's middle in the camera's axes [m].
        uncertainty: Standard deviations.
        source: What it was found from, in words.
    """

    size: tuple[int, int]
    matrix: Float[ndarray, "3 3"]
    distortion: Float[ndarray, " 5"]
    rotation: Float[ndarray, "3 3"]
    translation: Float[ndarray, " 3"]
    uncertainty: Uncertainty
    source: str

    @property
    def eye(self) -> Float[ndarray, " 3"]:
        """Place of the pupil [m]."""
        return -self.rotation.T @ self.translation

    @property
    def knows_height(self) -> bool:
        """Whether the pupil's height was found."""
        return bool(np.isfinite(self.uncertainty.height_m))

    @property
    def knows_lens(self) -> bool:
        """Whether the lens was looked at: a bare plate, a circle about the middle, says nothing of its distortion."""
        return bool(np.any(self.distortion))

    @property
    def tilt(self) -> float:
        """Angle between the optical axis and the plate's axis [rad]."""
        return float(np.arccos(np.clip(-self.rotation[2, 2], -1, 1)))

    @property
    def scale(self) -> float:
        """Pixels per metre in the plate's plane, at its middle."""
        ends = self.project(np.array([[-0.01, 0, 0], [0.01, 0, 0], [0, -0.01, 0], [0, 0.01, 0]]))
        return float(np.hypot(*(ends[1] - ends[0])) + np.hypot(*(ends[3] - ends[2]))) / 0.04

    def project(self, points: Float[ndarray, "points 3"]) -> Float[ndarray, "points 2"]:
        """Pixels at which points are seen.

        Args:
            points: Positions [m].

        Returns:
            Columns and rows [px].
        """
        seen = points @ self.rotation.T + self.translation
        x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
        square = x * x + y * y
        bent = 1 + square * (self.distortion[0] + square * self.distortion[1])
        column = self.matrix[0, 0] * x * bent + self.matrix[0, 2]
        return np.column_stack([column, self.matrix[1, 1] * y * bent + self.matrix[1, 2]])

    def on_plane(self, pixels: Float[ndarray, "points 2"]) -> Float[ndarray, "points 2"]:
        """Which points of the plate's plane pixels look at.

        Args:
            pixels: Columns and rows.

        Returns:
            x and y [m].
        """
        plane = cv2.undistortPoints(pixels.reshape(-1, 1, 2).astype(np.float64), self.matrix, self.distortion)
        rays = np.column_stack([plane.reshape(-1, 2), np.ones(len(pixels))]) @ self.rotation
        eye = self.eye
        return eye[:2] - (eye[2] / rays[:, 2])[:, None] * rays[:, :2]

    def centred(self, place: Float[ndarray, " 2"]) -> "PlateView":
        """The same camera with the origin moved, and x turned to the right of the picture.

        Args:
            place: New origin in the old axes [m].

        Returns:
            The view.
        """
        translation = self.translation + self.rotation @ np.array([*place, 0.0])
        moved = replace(self, translation=translation)
        ahead = moved.project(np.array([[0, 0, 0], [1e-3, 0, 0], [0, 1e-3, 0]], float))
        change = np.stack([ahead[1] - ahead[0], ahead[2] - ahead[0]], axis=1)  # pixels by plane
        right = np.linalg.solve(change, [1.0, 0.0])
        angle = np.arctan2(right[1], right[0])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        return replace(moved, rotation=moved.rotation @ turn)
