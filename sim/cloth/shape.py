"""Random smooth shapes: the laid-down shape of a cloth and its rest shape, which decide where folds form.

A field is a sum of plane waves with random direction, length and phase (random Fourier features), whose covariance
tends to amplitude^2 exp(-d^2 / (2 length^2)). It is a function of material coordinates, so the same seed gives the
same shape on every mesh.

References:
    Rahimi, Recht. Random features for large-scale kernel machines. NeurIPS 2007.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError

_WAVES = 256


@dataclass(frozen=True)
class SmoothField:
    """A realisation of a zero-mean Gaussian random field over the material plane.

    Attributes:
        amplitude: Standard deviation, in the unit of the field.
        wave_vectors: [rad/m].
        phases: [rad].
    """

    amplitude: float
    wave_vectors: Float[ndarray, "waves 2"]
    phases: Float[ndarray, "waves"]

    def __call__(self, points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
        """Values at material points [m]."""
        if self.amplitude == 0:
            return np.zeros(len(points))
        # No BLAS: its results depend on the number of threads, and folds amplify any difference.
        along_x, along_y = points[:, :1] * self.wave_vectors[:, 0], points[:, 1:] * self.wave_vectors[:, 1]
        waves = np.cos(along_x + along_y + self.phases)
        return self.amplitude * np.sqrt(2 / len(self.phases)) * waves.sum(1)


def smooth_field(amplitude: float, length: float, generator: np.random.Generator) -> SmoothField:
    """Draws a field.

    Args:
        amplitude: Standard deviation, >= 0.
        length: Correlation length [m], > 0.
        generator: Source of randomness.

    Returns:
        The field, a function of material points (points, 2) [m].

    Raises:
        SimulationError: Amplitude or length out of range.
    """
    if not (np.isfinite(amplitude) and amplitude >= 0 and np.isfinite(length) and length > 0):
        raise SimulationError(f"a field needs amplitude >= 0 and length > 0, got {amplitude:g} and {length:g} m")
    waves = generator.normal(0, 1 / length, (_WAVES, 2))
    return SmoothField(amplitude, waves, generator.uniform(0, 2 * np.pi, _WAVES))


def laid_down(mesh: Mesh, height: SmoothField, held_radius: float) -> Float[ndarray, "vertices 3"]:
    """The cloth as laid on the plate: flat inside, undulating by `height` outside, where it fades in over 1 cm.

    Args:
        mesh: The cloth.
        height: Undulation [m].
        held_radius: Radius of the plate [m].

    Returns:
        Positions [m].
    """
    shape = mesh.flat.copy()
    shape[:, 2] = height(mesh.material) * fade_in(mesh, held_radius)
    return shape


def fade_in(mesh: Mesh, held_radius: float) -> Float[ndarray, "vertices"]:
    """0 on the plate, 1 from 1 cm beyond its edge, smooth between.

    Args:
        mesh: The cloth.
        held_radius: Radius of the plate [m].

    Returns:
        Factor of every vertex.
    """
    ramp = np.clip((np.hypot(*mesh.material.T) - held_radius) / 0.01, 0, 1)
    return ramp * ramp * (3 - 2 * ramp)


def dihedral_angles(vertices: Float[Tensor, "vertices 3"], hinges: Int[ndarray, "hinges 4"]) -> Float[Tensor, "hinges"]:
    """Signed dihedral angle of every hinge [rad], positive where the cloth is convex seen from its face.

    Differentiable. Of a rest shape these are the stress-free angles; its metric stays flat (a cloth with natural
    curvature, not a cloth cut to that shape).

    Args:
        vertices: Positions [m].
        hinges: As in `Mesh.hinges`.

    Returns:
        Angles, in the order of the hinges.
    """
    start, end, left, right = (vertices[torch.from_numpy(hinges[:, k]).to(vertices.device)] for k in range(4))
    edge, p, r = end - start, left - start, right - start
    normal0, normal1 = torch.linalg.cross(edge, p), torch.linalg.cross(r, edge)
    sine = -torch.linalg.norm(edge, dim=1) * (p * normal1).sum(1)
    return torch.atan2(sine, (normal0 * normal1).sum(1))
