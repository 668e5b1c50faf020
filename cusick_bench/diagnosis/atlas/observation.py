"""What a camera sees of simulated drapes: their profiles in the cloth's frame, and the statistics of these."""

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.profile import profile_from_mesh
from cusick_bench.diagnosis.measure.statistics import NAMES, capture_statistics
from cusick_bench.sim.setup import Setup, Simulators, drape_setups

ANGLES = 360
_TURNED_OVER = (ANGLES // 2 - np.arange(ANGLES)) % ANGLES  # about y, material x to -x


def drape_and_observe(setups: list[Setup], simulators: Simulators | None = None) -> Float[ndarray, "setups angles"]:
    """Drapes cloths and takes their silhouettes.

    Args:
        setups: The drapes to make.
        simulators: Simulators that are reused from call to call.

    Returns:
        Radii in the cloth's frame [m]; NaN where a drape failed.
    """
    with torch.no_grad():
        return observe(setups, drape_setups(setups, simulators))


def observe(setups: list[Setup], positions: list[torch.Tensor | None]) -> Float[ndarray, "setups angles"]:
    """Silhouettes of drapes, as the camera sees them.

    Args:
        setups: How the drapes were made.
        positions: Their vertices [m]; None where a drape failed.

    Returns:
        Radii at whole degrees from the cloth's warp, face up [m]; NaN where a drape failed.
    """
    radii = np.full((len(setups), ANGLES), np.nan)
    for index, (setup, where) in enumerate(zip(setups, positions, strict=True)):
        if where is None:
            continue
        seen = silhouette(setup, where)
        if np.isfinite(seen).all() and (seen > 0).all():
            radii[index] = seen[_TURNED_OVER] if setup.side == "down" else seen
    return radii


def statistics_of(radii: Float[ndarray, "*rows angles"]) -> Float[ndarray, "*rows statistics"]:
    """Statistics of silhouettes in the cloth's frame.

    Args:
        radii: Radii from the cloth's warp [m]; NaN where a drape failed.

    Returns:
        The statistics; NaN where a drape failed.
    """
    rows = radii.reshape(-1, radii.shape[-1])
    good = np.isfinite(rows).all(1)
    values = np.full((len(rows), len(NAMES)), np.nan)
    if good.any():
        values[good] = capture_statistics(rows[good])
    return values.reshape(*radii.shape[:-1], -1)


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
