"""Checks of what a problem is made of and is asked: images, simulator and parameter vectors."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.problem.errors import ProblemError
from cusick_bench.problem.priors import BENDING_TABLE_FACTOR
from cusick_bench.problem.space import ParameterSpace
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine.settings import DrapeSettings

_SLACK = 1e-3  # by which coverage may leave [0, 1], as sums in short floats do


def check_images(images: Sequence[np.ndarray], protocol: Protocol) -> None:
    """Refuses training images that are no silhouettes of the experiment.

    Args:
        images: The images.
        protocol: Gives their size.

    Raises:
        ProblemError: One has another size, holds integers, or values outside [0, 1].
    """
    size = protocol.image_size_px
    wrong = [np.shape(image) for image in images if np.shape(image) != (size, size)]
    if wrong:
        raise ProblemError(
            f"a training image has {size} x {size} pixels as its protocol says, got {wrong[0]}; "
            "give the protocol that its data have (dataset.protocol)"
        )
    for image in map(np.asarray, images):
        if image.dtype.kind in "iu" or not (image.min() >= -_SLACK and image.max() <= 1 + _SLACK):
            raise ProblemError(
                f"a training image must hold floats in [0, 1] (cloth = 1), got {image.dtype} from {image.min():g} "
                f"to {image.max():g}; divide bytes by 255"
            )


def check_simulator(mesh: Mesh, settings: DrapeSettings, space: ParameterSpace, protocol: Protocol | None) -> None:
    """Refuses a simulator of another experiment, whose drapes would give wrong stiffness without a word.

    Args:
        mesh: Mesh of the simulator.
        settings: Its settings.
        space: The parameter space, with its prior.
        protocol: Gives plate and gravity; None where a simulated cause may change them.

    Raises:
        ProblemError: The mesh is not that of the space, plate or gravity is not that of space and protocol, or the law
            reads bending tables otherwise than the prior means them.
    """
    own = space.mesh
    if mesh is not own and not (np.array_equal(mesh.material, own.material) and np.array_equal(mesh.faces, own.faces)):
        raise ProblemError(
            f"the simulator's mesh must be that of the space, got {mesh.vertices} vertices and {own.vertices}, "
            "or the same number in other places; make both of one mesh"
        )
    given = [("the space", "plate_radius", settings.plate_radius, space.plate_radius, "m")]
    if protocol is not None:
        given += [
            ("the protocol", "plate_radius", settings.plate_radius, protocol.plate_radius_m, "m"),
            ("the protocol", "gravity", settings.gravity, protocol.gravity_m_s2, "m/s2"),
        ]
    for whose, name, used, asked, unit in given:
        if not math.isclose(used, asked):
            raise ProblemError(
                f"{name} of the simulator must be that of {whose}, got {used:g} and {asked:g} {unit}; give both "
                f"those of the data, as in DrapeSettings({name}=...)"
            )
    law = space.prior.law
    if BENDING_TABLE_FACTOR[law] != BENDING_TABLE_FACTOR[settings.law]:
        raise ProblemError(
            f"the prior's bending tables must be for the simulator's law, got {law!r} and {settings.law!r}, which read "
            f"them differently; give StiffnessPrior({settings.law!r}, ...)"
        )


def one_row(tau: np.ndarray, space: ParameterSpace) -> np.ndarray:
    """One parameter vector as a batch (1, dimension).

    Args:
        tau: The vector (dimension).
        space: What it is a vector of.

    Returns:
        The batch, its numbers not checked yet.

    Raises:
        ProblemError: It is no vector.
    """
    tau = np.asarray(tau)
    if tau.ndim != 1:
        raise ProblemError(f"space {space.name!r} takes {space.dimension} numbers, got shape {tau.shape}")
    return tau[None]


def checked_rows(taus: np.ndarray, space: ParameterSpace) -> Float[np.ndarray, "members dimension"]:
    """Parameter vectors, one a row, as contiguous float64.

    Args:
        taus: The vectors.
        space: What they are vectors of.

    Returns:
        The same numbers.

    Raises:
        ProblemError: They are no rows of the space's dimension, or hold NaN or infinity.
    """
    if np.ndim(taus) != 2:
        raise ProblemError(
            f"a batch holds a vector of {space.dimension} numbers in each row, got shape {np.shape(taus)}; give one "
            "vector as vector[None]"
        )
    taus = np.ascontiguousarray(taus, dtype=np.float64)
    if taus.shape[1] != space.dimension:
        raise ProblemError(f"space {space.name!r} takes {space.dimension} numbers, got shape {taus.shape[1:]}")
    bad = np.argwhere(~np.isfinite(taus))
    if len(bad):
        value, index = taus[tuple(bad[0])], bad[0][1]
        raise ProblemError(f"parameters must be finite, got {value} at index {index} ({len(bad)} in all)")
    return taus
