"""What a camera sees of simulated drapes: their profiles, and the statistics of these in the cloth's frame."""

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.profile import profile_from_mesh
from cusick_bench.diagnosis.measure.statistics import NAMES, capture_statistics, mirrored
from cusick_bench.sim.setup import Setup, Simulators, drape_setups

ANGLES = 360


def drape_and_observe(setups: list[Setup], simulators: Simulators | None = None) -> Float[ndarray, "setups statistics"]:
    """Drapes cloths and takes the statistics of their silhouettes.

    Args:
        setups: The drapes to make.
        simulators: Kept from call to call.

    Returns:
        Statistics in the cloth's frame; NaN where a drape failed.
    """
    with torch.no_grad():
        return observe(setups, drape_setups(setups, simulators))


def observe(setups: list[Setup], positions: list[torch.Tensor | None]) -> Float[ndarray, "setups statistics"]:
    """Statistics of the silhouettes of drapes, as the camera sees them.

    Args:
        setups: How the drapes were made.
        positions: Their vertices [m]; None where a drape failed.

    Returns:
        Statistics in the cloth's frame; NaN where a drape failed.
    """
    statistics = np.full((len(setups), len(NAMES)), np.nan)
    draped = [index for index, where in enumerate(positions) if where is not None]
    if not draped:
        return statistics
    radii = np.stack([silhouette(setups[index], positions[index]) for index in draped])
    good = np.isfinite(radii).all(1) & (radii > 0).all(1)
    values = capture_statistics(radii[good])
    down = np.array([setups[index].side == "down" for index in draped])[good]
    statistics[np.array(draped)[good]] = np.where(down[:, None], mirrored(values), values)
    return statistics


def silhouette(setup: Setup, positions: torch.Tensor | None) -> Float[ndarray, "angles"]:
    """Outline of a drape as the camera sees it.

    Args:
        setup: How the drape was made.
        positions: Its vertices [m].

    Returns:
        Radii at whole degrees, counter-clockwise from the camera's x axis [m].
    """
    assert positions is not None
    return profile_from_mesh(positions.detach().numpy(), setup.faces, angles=ANGLES).radii
