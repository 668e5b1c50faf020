"""Selections of silhouette statistics: the vectors that scores, diagnosis and inference use.

A selection names statistics of `cusick_bench.datasets.silhouette_statistics.definitions`, and measures them on radius
profiles. `cusick_bench.problem.statistics` computes `INFERRED` as a differentiable function of an image.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.silhouette_statistics.definitions import (
    LAST_ORDER,
    LOCKED,
    NUMBERED,
    SINGLE,
    Numbers,
    RadiusProfiles,
)
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_PARTS = {"real": np.real, "imaginary": np.imag}


def numbered(family: str, numbers: Iterable[int]) -> tuple[str, ...]:
    """Names of several phase-free statistics of one family.

    Args:
        family: "radius_quantile", "quantile" or "amplitude".
        numbers: Per cent of the quantiles, or orders of the amplitudes.

    Returns:
        For example `quantile_05`, `quantile_25`; `amplitude_3`, `amplitude_4`.
    """
    return tuple(f"{family}_{number:02d}" if "quantile" in family else f"{family}_{number}" for number in numbers)


def real_and_imaginary(family: str, orders: Iterable[int]) -> tuple[str, ...]:
    """Names of the parts of several locked statistics of one family.

    Args:
        family: "harmonic", "envelope", "crest" or another name of `definitions.LOCKED`.
        orders: Orders m.

    Returns:
        For example `harmonic_1_real`, `harmonic_1_imaginary`, `harmonic_2_real`, ...
    """
    return tuple(f"{family}_{order}_{part}" for order in orders for part in ("real", "imaginary"))


def _parsed(name: str) -> tuple[str, int, str]:
    """Family, number and part of a statistic; a single one is its own family."""
    if name in SINGLE:
        return name, 0, "real"
    family, _, last = name.rpartition("_")
    if family in NUMBERED and last.isdecimal():
        return family, int(last), "real"
    family, _, order = family.rpartition("_")
    if family in LOCKED and order.isdecimal() and last in _PARTS:
        return family, int(order), last
    known = [*SINGLE, *(f"{family}_N" for family in NUMBERED), *(f"{family}_N_real" for family in LOCKED)]
    raise DataError(f"unknown statistic {name!r}; use one of {', '.join(known)}")


def _values(profiles: RadiusProfiles, family: str, numbers: Numbers) -> ndarray:
    """Statistics of one family, one column a number."""
    if family in SINGLE:
        return SINGLE[family](profiles)[:, None]
    return (NUMBERED | LOCKED)[family](profiles, numbers)


@dataclass(frozen=True)
class Selection:
    """The statistics of one vector, in order.

    Attributes:
        phase_free: Names of those that do not depend on where the folds lie; they come first.
        locked: Names of those that belong to a frame.
    """

    phase_free: tuple[str, ...]
    locked: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in the order of the vector."""
        return self.phase_free + self.locked

    def columns(self, *names: str) -> tuple[int, ...]:
        """Places of statistics in the vector.

        Args:
            *names: Their names.

        Returns:
            One place a name.
        """
        return tuple(self.names.index(name) for name in names)

    def measure(
        self,
        radii: Float[ndarray, "drapes angles"],
        *,
        drape_coefficients: Float[ndarray, " drapes"] | None = None,
        cloth_radius: float = CLOTH_RADIUS,
        plate_radius: float = PLATE_RADIUS,
    ) -> Float[ndarray, "drapes statistics"]:
        """Vectors of radius profiles.

        Args:
            radii: Radii at equidistant angles over the full turn, counter-clockwise from +x [m]; from the cloth's warp
                if the locked statistics are to be the cloth's.
            drape_coefficients: Those of the images, which only the statistic `drape_coefficient` needs.
            cloth_radius: Radius of the flat cloth [m].
            plate_radius: Radius of the plate [m].

        Returns:
            One row a drape, in the order of `names`.

        Raises:
            DataError: Radii that are not finite or at too few angles for order 24, or no drape coefficients where they
                are needed.
        """
        least = 2 * LAST_ORDER + 1
        if radii.ndim != 2 or radii.shape[1] < least or not np.isfinite(radii).all():
            raise DataError(
                f"profiles must be finite, (drapes, angles) with at least {least} angles, got {radii.shape}"
            )
        profiles = RadiusProfiles(radii, drape_coefficients, cloth_radius, plate_radius)
        result = np.empty((len(radii), len(self.names)))
        for family, members in self._members.items():
            numbers = list(dict.fromkeys(number for _, number, _ in members))
            values = _values(profiles, family, numbers)
            for column, number, part in members:
                result[:, column] = _PARTS[part](values[:, numbers.index(number)])
        return result

    @cached_property
    def _members(self) -> dict[str, list[tuple[int, int, str]]]:
        """Family -> column, number and part of each of its members."""
        members: dict[str, list[tuple[int, int, str]]] = {}
        for column, name in enumerate(self.names):
            family, number, part = _parsed(name)
            members.setdefault(family, []).append((column, number, part))
        return members


SCORED = Selection(
    (
        "drape_coefficient",
        "mean_radius",
        *numbered("radius_quantile", (5, 10, 25, 50, 75, 90, 95)),
        *numbered("amplitude", range(1, 13)),  # of 4 to 14 folds; the spread between samples above is half noise
        "skewness",
        "folds",
    ),
    real_and_imaginary("harmonic", (1, 2, 4)),
)
"""What a prediction's draws are compared with unseen samples by (`cusick_bench.metrics`)."""

DIAGNOSED = Selection(
    (
        "mean_radius",
        "area_dc",
        *numbered("quantile", (5, 25, 50, 75, 95)),
        *numbered("amplitude", range(3, 13)),
        "amplitude_high",
        "folds",
        "fold_centroid",
        "fold_depth",
        "roughness",
        "skewness",
        "crest_radius",
        "crest_spread",
        "valley_gap",
        "plate_nearness",
        "slope_skewness",
        "curvature_skewness",
        "valley_curvature",
    ),
    real_and_imaginary("harmonic", (1, 2, 3, 4))
    + real_and_imaginary("envelope", (1, 2, 4))
    + real_and_imaginary("slope_envelope", (1, 2, 3))
    + real_and_imaginary("cubed", (1,))  # of 2 and more nothing is gained
    + real_and_imaginary("crest", (1, 2))
    + real_and_imaginary("valley", (1, 2))
    + real_and_imaginary("nearness", (1,)),
)
"""What real and simulated drapes are compared by (`cusick_bench.diagnosis`)."""

INFERRED = Selection(
    ("area_log_odds", "fold_depth_log", "crest_number", "fold_skewness"),
    ("grain_2_real", "grain_2_imaginary", "grain_4_real"),
)
"""What a stiffness is inferred from (`cusick_bench.problem.statistics`, `bdp-field`)."""
