"""Stiffness that varies over the cloth: a homogeneous cloth times the exponential of smooth random fields."""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import SmoothField, smooth_field
from cusick_bench.sim.constants import FIELD_LENGTH


def face_centres(mesh: Mesh) -> Float[ndarray, "faces 2"]:
    """Material centroid of every face [m].

    Args:
        mesh: The cloth.

    Returns:
        Centroids, in the order of `mesh.faces`.
    """
    return mesh.material[mesh.faces].mean(1)


def hinge_centres(mesh: Mesh) -> Float[ndarray, "hinges 2"]:
    """Material midpoint of every hinge's edge [m].

    Args:
        mesh: The cloth.

    Returns:
        Midpoints, in the order of `mesh.hinges`.
    """
    return mesh.material[mesh.hinges[:, :2]].mean(1)


def modulated(material: Material, mesh: Mesh, stretch: SmoothField, bending: SmoothField) -> Material:
    """The cloth with its tables multiplied, element by element, by exp(field).

    Args:
        material: Homogeneous or per-element cloth.
        mesh: Its mesh.
        stretch: Logarithm of the factor on C over the material plane.
        bending: Logarithm of the factor on B.

    Returns:
        The cloth with a table for every face and every hinge.
    """
    on_faces = torch.from_numpy(np.exp(stretch(face_centres(mesh))))
    on_hinges = torch.from_numpy(np.exp(bending(hinge_centres(mesh))))
    return replace(
        material,
        stretch=material.stretch * on_faces[:, None, None],
        bending=material.bending * on_hinges[:, None, None],
    )


def random_heterogeneity(
    material: Material, mesh: Mesh, spread: float, generator: np.random.Generator, *, length: float = FIELD_LENGTH
) -> Material:
    """Draws independent smooth fields for stretch and bending stiffness.

    Args:
        material: The mean cloth.
        mesh: Its mesh.
        spread: Standard deviation of the log stiffness (0.2 is about 20 %).
        generator: Source of randomness.
        length: Correlation length [m].

    Returns:
        The cloth with a table for every face and every hinge.
    """
    return modulated(material, mesh, smooth_field(spread, length, generator), smooth_field(spread, length, generator))
