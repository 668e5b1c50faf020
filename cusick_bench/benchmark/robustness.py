"""Does every admissible cloth drape? Random cloths over the whole range of measured fabrics, and beyond it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from cusick_bench.problem.priors import BENDING_TABLE_FACTOR, STRETCH_SIZE, StiffnessPrior
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.constants import Law
from cusick_bench.sim.drape import DrapeSimulator

# Range of 618 measured fabrics (Feng, Huang, Xu, Wang, ACM TOG 41(6), 2022).
DENSITY_RANGE = (0.0153, 0.8703)  # [kg/m2]
BENDING_RANGE = (2.23e-7, 2.657e-4)  # [N m]
ANISOTROPY = 10.0  # largest ratio of bending stiffness between directions; measured: up to 12
CURVATURE_SPREAD = 0.5  # standard deviation of log B between the curvature samples of a direction


@dataclass(frozen=True)
class Specimen:
    """A random cloth and the numbers that describe it."""

    material: Material
    density: float
    bending: float
    anisotropy: float


def specimen(seed: int, law: Law = "paper") -> Specimen:
    """A random admissible cloth: density and bending stiffness log-uniform over their measured ranges, independent.

    Args:
        seed: Seed of the draw.
        law: Material law that its tables are for; the cloth is the same under each.

    Returns:
        The cloth.
    """
    generator = np.random.default_rng([seed, 618])
    density, bending = (float(np.exp(generator.uniform(*np.log(limits)))) for limits in (DENSITY_RANGE, BENDING_RANGE))
    anisotropy = float(np.exp(generator.uniform(-1, 1) * np.log(ANISOTROPY)))
    rows = bending * anisotropy ** np.array([0.5, generator.uniform(-0.5, 0.5), -0.5])
    table = rows[:, None] * np.exp(CURVATURE_SPREAD * generator.normal(size=(3, 5)))
    table *= BENDING_TABLE_FACTOR[law]
    stretch = StiffnessPrior("paper", density).stretch(torch.from_numpy(generator.normal(size=STRETCH_SIZE)))
    material = Material(stretch, torch.from_numpy(table), torch.tensor(density, dtype=torch.float64))
    return Specimen(material, density, bending, anisotropy)


def robustness(
    simulator: DrapeSimulator,
    draws: int,
    *,
    seed: int = 0,
    group: int = 16,
    done: Callable[[int], None] = lambda n: None,
) -> dict[str, Any]:
    """Drapes random cloths and counts those that come to rest.

    Args:
        simulator: Mesh and mode.
        draws: Number of cloths.
        seed: Seed of the first; the others count on.
        group: Cloths draped together.
        done: Called with the number of cloths draped.

    Returns:
        `draws`, `converged`, `fraction`, `diverged` (cloths without a drape, such as those that flew apart), `halved`
        (cloths that took shorter steps of a drop), `iterations` (quantiles) and `failures`, each with its cloth and
        its reason.
    """
    failures, iterations, converged, diverged, halved = [], [], 0, 0, 0
    for first in range(0, draws, group):
        seeds = range(seed + first, seed + min(first + group, draws))
        specimens = [specimen(number, simulator.settings.law) for number in seeds]
        laid = torch.stack([torch.from_numpy(simulator.laid_down(number)) for number in seeds])
        batch = simulator.drape_batch([s.material for s in specimens], initial=laid)
        for number, one, ok, failure, residual in zip(
            seeds, specimens, batch.converged, batch.failures, batch.residual, strict=True
        ):
            converged += int(ok)
            if not ok:
                reason = failure or f"net force {residual:.2g} of the weight"
                cloth = {"density": one.density, "bending": one.bending, "anisotropy": one.anisotropy}
                failures.append({"seed": number, **cloth, "reason": reason})
        diverged += sum(failure is not None for failure in batch.failures)
        halved += int(np.count_nonzero(batch.halvings))
        iterations += [int(n) for n, ok in zip(batch.iterations, batch.converged, strict=True) if ok]
        done(len(specimens))
    quantiles = np.quantile(iterations, [0.5, 0.95, 1]) if iterations else [np.nan] * 3
    return {
        "draws": draws,
        "converged": converged,
        "fraction": converged / draws,
        "diverged": diverged,
        "halved": halved,
        "iterations": dict(zip(("median", "q95", "most"), map(float, quantiles), strict=True)),
        "failures": failures,
    }
