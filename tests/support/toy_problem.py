"""A drape problem of seconds whose answer is known, for examples and for the tests of solvers."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of, profile_of
from cusick_bench.problem.drape_problem import DrapeProblem
from cusick_bench.problem.laying import laid_like
from cusick_bench.problem.metering.budget import Budget, Meter
from cusick_bench.problem.metering.journal import Checkpoint, Journal
from cusick_bench.problem.priors import StiffnessPrior
from cusick_bench.problem.space import HomogeneousSpace
from cusick_bench.problem.spaces import SPACES
from cusick_bench.problem.train_mesh import TrainMesh
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import Clamp, DrapeSettings
from cusick_bench.sim.render.silhouette import render
from cusick_bench.solvers.base import HeldOut

AREAL_DENSITY = 0.2  # [kg/m2]


@lru_cache(maxsize=8)
def _simulator(vertices: int, mode: str, seed: int, clamp: Clamp | None) -> DrapeSimulator:
    settings = DrapeSettings(mode=mode, steps=20, seed=seed, clamp=clamp)  # pyright: ignore[reportArgumentType]
    return DrapeSimulator(disc_mesh(vertices), settings)


@lru_cache(maxsize=8)
def _drape(vertices: int, mode: str, bending: float, seed: int, clamp: Clamp | None) -> np.ndarray:
    simulator = _simulator(vertices, mode, seed, clamp)
    space = HomogeneousSpace(simulator.mesh, StiffnessPrior("paper", AREAL_DENSITY))
    with torch.no_grad():
        specimen = space.specimen(torch.as_tensor(space.bending_level(bending)))
        return simulator.drape(specimen.material).vertices.numpy()


def _image(vertices: int, mode: str, bending: float, seed: int, protocol: Protocol, clamp: Clamp | None) -> np.ndarray:
    drape, faces = _drape(vertices, mode, bending, seed, clamp), _simulator(vertices, mode, seed, clamp).mesh.faces
    with torch.no_grad():
        return render(torch.as_tensor(drape), faces, camera_of(protocol), size=protocol.image_size_px).numpy()


def toy_problem(
    *,
    budget: Budget | None = None,
    bending: float = 3.0,
    space: str = "homo",
    vertices: int = 100,
    mode: str = "drop",
    sample: int = 0,
    laid_as_true: bool = False,
    folder: Path | None = None,
    protocol: Protocol = RELEASE,
    clamp: Clamp | None = None,
) -> DrapeProblem:
    """Poses the problem of finding a cloth again that was draped by the simulator itself.

    Args:
        budget: Most a solver may spend; 20 forward-equivalents by default.
        bending: True factor on all bending stiffnesses of the prior median.
        space: Parameter space.
        vertices: Of the disc mesh.
        mode: "drop" or "equilibrium".
        sample: Sample of the cloth: each is laid down differently.
        laid_as_true: Lay the cloth down as it was, instead of guessing that from its silhouette.
        folder: Where to keep what a resumed solver needs; nowhere by default.
        protocol: How the drape is seen; sizes of cloth and plate are the release's.
        clamp: How hinges on the plate's edge bend, as in `DrapeSettings`.
    """
    image = _image(vertices, mode, bending, sample, protocol, clamp)
    simulator = _simulator(vertices, mode, sample if laid_as_true else 0, clamp)
    mesh = simulator.mesh
    return DrapeProblem(
        train_image=image,
        simulator=simulator,
        space=SPACES[space](simulator.mesh, StiffnessPrior("paper", AREAL_DENSITY)),
        initial=None if laid_as_true else laid_like(profile_of(image, protocol).radii, simulator.mesh),
        protocol=protocol,
        meter=Meter(budget or Budget(20)),
        journal=Journal(folder),
        checkpoint=Checkpoint(folder),
        train_mesh=TrainMesh(_drape(vertices, mode, bending, sample, clamp), mesh.faces, mesh.material),
    )


def toy_image(
    sample: int,
    *,
    bending: float = 3.0,
    vertices: int = 100,
    protocol: Protocol = RELEASE,
    clamp: Clamp | None = None,
) -> np.ndarray:
    """Silhouette of another sample of the toy problem's cloth."""
    return _image(vertices, "drop", bending, sample, protocol, clamp)


def toy_held_out(train: np.ndarray, images: np.ndarray, repeats: Sequence[np.ndarray] | None = None) -> HeldOut:
    """Held-out images of a sample each, as an oracle sees them.

    Args:
        train: The training image.
        images: The held-out images.
        repeats: For each of them, other captures of the same drape; none by default.
    """
    others = tuple(np.concatenate([train[None], np.delete(images, place, axis=0)]) for place in range(len(images)))
    return HeldOut(images, others, tuple(images[:0] for _ in images) if repeats is None else tuple(repeats))
