"""Fabrics whose answer is known: drawn from the statistics of the atlas itself, or simulated on another mesh."""

from dataclasses import replace
from functools import cache

import numpy as np

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN, PRIOR_SD, BaseModel
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.observation import silhouette
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.residuals.feature_rows import faces_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.measure.captures import Captures, captures_from_profiles
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.diagnosis.options import Options
from cusick_bench.sim.effects import effect, registered
from cusick_bench.sim.setup import Simulators, drape_setups

THETA = PRIOR_MEAN + PRIOR_SD * np.array([0.9, 0.2, 0.0, 0.0, 0.2, 0.1, 0.1, 0.0, 0.0])


def drawn_fabric(
    emulator: Emulator, generator: np.random.Generator, samples: int = 12, shift: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Statistics of samples as the atlas says they scatter, and drifts without creep."""
    sd = emulator.sd(THETA)
    root = np.linalg.cholesky(emulator.correlation)
    noise = (generator.standard_normal((samples, len(root))) @ root.T).reshape(samples, 2, -1) * sd
    moved = 0.0 if shift is None else faces_of(shift) * sd
    drift = 0.2 * generator.standard_normal((samples, len(NAMES))) * sd
    return emulator.mean(THETA) + noise + moved, drift


def fabric_of(emulator: Emulator, specimens: np.ndarray, drift: np.ndarray) -> FabricData:
    """A drawn fabric; its spreads are the atlas' own, as what is drawn lacks their uncertainty."""
    found = replace(features(specimens, drift), spread=emulator.spread(THETA))
    return FabricData(emulator, Calibration(), found, None, 0.5)


def residual_of(emulator: Emulator, specimens: np.ndarray, drift: np.ndarray) -> Residual:
    return fabric_of(emulator, specimens, drift).against()


def only(*effects: str) -> Options:
    """Few effects on the list and no simulations, to save time."""
    return Options(samples=0, without=tuple(set(registered()) - set(effects)))


@cache
def simulated_captures(cause: str = "", severity: float = 0.0, *, samples: int = 8, seed: int = 3) -> Captures:
    """Two captures of each face of samples of a simulated fabric on another mesh than the atlas'."""
    setups = BaseModel(600, meshes=40).samples(THETA, samples, (900, seed))
    simulators, rows = Simulators(), []
    labels = [(sample, side) for sample in range(1, samples + 1) for side in ("up", "down")]
    for later in (False, True):
        changed = [
            effect(cause).apply(replace(setup, later=later), {effect(cause).severity.name: severity})
            if cause
            else setup
            for setup in setups
        ]
        rows.append([silhouette(s, x) for s, x in zip(changed, drape_setups(changed, simulators), strict=True)])
    generator = np.random.default_rng(seed)
    radii = np.array([*rows[0], *rows[1]])
    radii += generator.normal(0, 1e-4, (len(radii), 1))
    return captures_from_profiles(
        radii,
        sample=np.array([sample for sample, _ in labels] * 2),
        side=[side for _, side in labels] * 2,
        capture=np.repeat([1, 2], len(labels)),
    )
