"""The vocabulary of silhouette statistics: the numbers that describe a drape's outline, each defined once, by name.

With r(theta) = c_0 + sum_m Re(c_m exp(-i m theta)) a radius profile, c_m = a_m + i b_m, d = r - c_0 its deviation from
the mean radius, and f its folds, the harmonics from m = 3 on:

    drape_coefficient   share of the annulus that the image shows covered, grey levels included (from the image)
    area_dc             the same from the profile: (mean r^2 - plate^2) / (cloth^2 - plate^2)
    mean_radius         c_0 [m]
    radius_quantile_P   P % of the radii are below it [m]
    quantile_P          P % of the deviations d are below it [m]
    amplitude_M         |c_M| [m]
    amplitude_high      root of the sum of |c_m|^2, m = 13 to 24: the finer rest [m]
    folds               number of folds, counted
    fold_centroid       mean order of |c_m|, m = 3 to 16: a number of folds that is continuous
    fold_depth          root mean square of the folds, m = 3 to 24 [m]
    roughness           root mean square of their slope [m/rad]
    skewness            third standardised moment of d: negative where narrow valleys part broad lobes
    harmonic_M_*        a_M (real) and b_M (imaginary) [m]: locked to the frame in which the angles are counted
    envelope_K_*        harmonics 2 mean(f^2 exp(i K theta)) / mean(f^2) of the squared folds, m = 4 to 24: at which
                        angles folds are deep, whatever their phase

and, for the inference of a stiffness, of the size of 1, with the folds m = 3 to 16 and w = 0.06 m the overhang's width:

    area_log_odds       log(area_dc / (1 - area_dc)): stiffness moves it evenly, the coefficient itself less and less at
                        both ends
    fold_depth_log      log of the folds' root mean square over w
    crest_number        a tenth of the expected number of crests of a random profile with the folds' power P_m,
                        sqrt(sum m^4 P / sum m^2 P), by Rice's formula; it follows the number counted where the centroid
                        falls behind
    fold_skewness       skewness of the folds: narrow crests and wide valleys, or the other way round
    grain_M_*           10 a_M / w (real) and -10 b_M / w (imaginary): warp against weft

Statistics are phase-free, since where folds come to lie is chance, or locked: the low harmonics and the envelope, in
which a cloth shows that is stiffer along its warp (m = 2, 4), off centre (m = 1) or weakened at one place.

A `Selection` is the vector that one part of the project uses. `cusick_bench.problem.statistics` computes `INFERRED` as
a differentiable function of an image.

References:
    Rice. Mathematical analysis of random noise. Bell System Technical Journal 23-24, 1944-45, Sec. 3.6.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray

from cusick_bench.datasets.errors import DataError
from cusick_bench.sim.cloth.folds import ring_folds
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

LAST_ORDER = 24  # above lie pixels
FIRST_FOLD, LAST_FOLD = 3, 16  # orders m in which folds are looked for
SOFTENING = 5e-4  # [m], a third of a pixel: ratios of what is shallower, which is noise, go to 0
SHALLOW = 1e-4  # [m] a fold below a tenth of a pixel has no depth that an image could show
LEAST_ODDS = 0.01  # drape coefficient from which on down (or up to 1) the log odds stand still
OVERHANG_WIDTH = 0.06  # w, of the annulus that hangs over the plate [m]
GRAIN_SCALE = 20  # makes c_m / w, whose size is a twentieth, one of the size of 1
CREST_SCALE = 10  # drapes have about ten crests

_FINE_ORDERS = range(13, LAST_ORDER + 1)
_FIRST_ENVELOPE_ORDER = 4  # a cloth's shape in m = 1 to 3 would beat with its own folds


@dataclass(frozen=True, eq=False)
class _Profiles:
    """Radius profiles and what several statistics are computed from."""

    radii: Float[ndarray, "drapes angles"]
    drape_coefficients: Float[ndarray, " drapes"] | None
    cloth_radius: float
    plate_radius: float

    @cached_property
    def mean(self) -> Float[ndarray, " drapes"]:
        return self.radii.mean(1)

    @cached_property
    def deviation(self) -> Float[ndarray, "drapes angles"]:
        return self.radii - self.mean[:, None]

    @cached_property
    def transform(self) -> Complex[ndarray, "drapes orders"]:
        return np.fft.rfft(self.radii, axis=1)

    @cached_property
    def harmonics(self) -> Complex[ndarray, "drapes orders"]:
        return 2 * self.transform.conj() / self.radii.shape[1]

    @cached_property
    def amplitudes(self) -> Float[ndarray, "drapes orders"]:
        return np.abs(self.harmonics)

    @cached_property
    def area_dc(self) -> Float[ndarray, " drapes"]:
        inner, outer = self.plate_radius**2, self.cloth_radius**2
        return ((self.radii**2).mean(1) - inner) / (outer - inner)

    @cached_property
    def fold_power(self) -> Float[ndarray, "drapes folds"]:
        """Mean squares P_m of the folds' harmonics [m2]."""
        return self.amplitudes[:, FIRST_FOLD : LAST_FOLD + 1] ** 2 / 2


Numbers = Sequence[int]  # which quantiles or orders of a family
Family = Callable[[_Profiles, Numbers], ndarray]  # gives the statistics of these numbers, one a column


def _image_coefficient(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    if profiles.drape_coefficients is None:
        raise DataError("drape_coefficient is measured on images; pass drape_coefficients, or ask for area_dc")
    return profiles.drape_coefficients


def _norm(amplitudes: Float[ndarray, "drapes orders"]) -> Float[ndarray, " drapes"]:
    return np.sqrt((amplitudes**2).sum(1))


def _folds(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    return np.array([ring_folds(ring) for ring in profiles.radii], dtype=np.float64)


def _centroid(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    """Goes to the middle order where there are no folds."""
    orders = np.arange(FIRST_FOLD, LAST_FOLD + 1)
    weights = profiles.amplitudes[:, orders] + SOFTENING / len(orders)
    return (weights @ orders.astype(np.float64)) / weights.sum(1)


def _depth(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    orders = np.arange(FIRST_FOLD, LAST_ORDER + 1)
    return _norm(profiles.amplitudes[:, orders]) / np.sqrt(2)


def _roughness(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    orders = np.arange(FIRST_FOLD, LAST_ORDER + 1)
    return _norm(profiles.amplitudes[:, orders] * orders) / np.sqrt(2)


def _skewness(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    deviation = profiles.deviation
    return (deviation**3).mean(1) / ((deviation**2).mean(1) + SOFTENING**2) ** 1.5


def _envelope(profiles: _Profiles, orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    """Harmonics of the squared folds over their mean."""
    count, kept = profiles.radii.shape[1], profiles.transform.copy()
    kept[:, :_FIRST_ENVELOPE_ORDER] = 0
    kept[:, LAST_ORDER + 1 :] = 0
    squared = np.fft.rfft(np.fft.irfft(kept, count, axis=1) ** 2, axis=1).conj() / count
    return 2 * squared[:, list(orders)] / (np.real(squared[:, :1]) + SOFTENING**2)


def _area_log_odds(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    share = np.clip(profiles.area_dc, LEAST_ODDS, 1 - LEAST_ODDS)
    return np.log(share / (1 - share))


def _fold_depth_log(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    return 0.5 * np.log((profiles.fold_power.sum(1) + SHALLOW**2) / OVERHANG_WIDTH**2)


def _crest_number(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    """A flat profile counts as one of the first order of folds."""
    orders = np.arange(FIRST_FOLD, LAST_FOLD + 1)
    fourth, second = (profiles.fold_power @ orders**k + SHALLOW**2 * FIRST_FOLD**k for k in (4, 2))
    return np.sqrt(fourth / second) / CREST_SCALE


def _fold_skewness(profiles: _Profiles) -> Float[ndarray, " drapes"]:
    kept = profiles.transform.copy()
    kept[:, :FIRST_FOLD] = 0
    folds = np.fft.irfft(kept, profiles.radii.shape[1], axis=1)
    return (folds**3).mean(1) / ((folds**2).mean(1) + SHALLOW**2) ** 1.5


def _grain(profiles: _Profiles, orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    return profiles.harmonics[:, list(orders)].conj() / 2 / OVERHANG_WIDTH * GRAIN_SCALE


_SINGLE: dict[str, Callable[[_Profiles], ndarray]] = {
    "drape_coefficient": _image_coefficient,
    "area_dc": lambda profiles: profiles.area_dc,
    "mean_radius": lambda profiles: profiles.mean,
    "amplitude_high": lambda profiles: _norm(profiles.amplitudes[:, list(_FINE_ORDERS)]),
    "folds": _folds,
    "fold_centroid": _centroid,
    "fold_depth": _depth,
    "roughness": _roughness,
    "skewness": _skewness,
    "area_log_odds": _area_log_odds,
    "fold_depth_log": _fold_depth_log,
    "crest_number": _crest_number,
    "fold_skewness": _fold_skewness,
}
_NUMBERED: dict[str, Family] = {
    "radius_quantile": lambda profiles, levels: np.percentile(profiles.radii, levels, axis=1).T,
    "quantile": lambda profiles, levels: np.percentile(profiles.deviation, levels, axis=1).T,
    "amplitude": lambda profiles, orders: profiles.amplitudes[:, list(orders)],
}
_LOCKED: dict[str, Family] = {  # of complex numbers: a turn by phi multiplies those of order m by exp(i m phi)
    "harmonic": lambda profiles, orders: profiles.harmonics[:, list(orders)],
    "envelope": _envelope,
    "grain": _grain,
}
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
        family: "harmonic", "envelope" or "grain".
        orders: Orders m.

    Returns:
        For example `harmonic_1_real`, `harmonic_1_imaginary`, `harmonic_2_real`, ...
    """
    return tuple(f"{family}_{order}_{part}" for order in orders for part in ("real", "imaginary"))


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
        profiles = _Profiles(radii, drape_coefficients, cloth_radius, plate_radius)
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


def _parsed(name: str) -> tuple[str, int, str]:
    """Family, number and part of a statistic; a single one is its own family."""
    if name in _SINGLE:
        return name, 0, "real"
    family, _, last = name.rpartition("_")
    if family in _NUMBERED and last.isdecimal():
        return family, int(last), "real"
    family, _, order = family.rpartition("_")
    if family in _LOCKED and order.isdecimal() and last in _PARTS:
        return family, int(order), last
    known = [*_SINGLE, *(f"{family}_N" for family in _NUMBERED), *(f"{family}_N_real" for family in _LOCKED)]
    raise DataError(f"unknown statistic {name!r}; use one of {', '.join(known)}")


def _values(profiles: _Profiles, family: str, numbers: Numbers) -> ndarray:
    """Statistics of one family, one column a number."""
    if family in _SINGLE:
        return _SINGLE[family](profiles)[:, None]
    return (_NUMBERED | _LOCKED)[family](profiles, numbers)


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
    ),
    real_and_imaginary("harmonic", (1, 2, 3, 4)) + real_and_imaginary("envelope", (1, 2, 4)),
)
"""What real and simulated drapes are compared by (`cusick_bench.diagnosis`)."""

INFERRED = Selection(
    ("area_log_odds", "fold_depth_log", "crest_number", "fold_skewness"),
    ("grain_2_real", "grain_2_imaginary", "grain_4_real"),
)
"""What a stiffness is inferred from (`cusick_bench.problem.statistics`, `bdp-field`)."""
