"""Definitions of silhouette statistics: the numbers that describe a drape's outline, each defined once, by name.

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
    slope_envelope_K_*  the same of the squared slope f' of these folds: where they are steep
    cubed_K_*           the same of their cube, 2 mean(f^3 exp(i K theta)) / mean(f^2)^(3/2): where crests are narrow

The following describe crests and valleys separately: a camera's scale or place moves both by the same amount, an
off-centre or larger cloth moves the crests more, and another radius of the plate the valleys. With g = r - plate the
gap to the plate, w the overhang's width, s the root mean square of the folds f, m = 3 to 24, and <.>+ and <.>- means
over the angles with the smooth weights exp(+1.5 f / s) of the crests and exp(-1.5 f / s) of the valleys:

    crest_radius        C_0 of the envelope C_0 + sum_K Re(C_K exp(-i K theta)), K = 1, 2, that least squares with the
                        crests' weights put through the radii [m]
    crest_spread        root of <(r - C_0)^2>+ [m]
    valley_gap          smooth minimum of the gap, -u log(mean exp(-g / u)), u = w / 30 [m]
    plate_nearness      share of the plate's edge beside which cloth hangs: mean exp(-g / u), u = w / 15, g >= -2 u
    slope_skewness      mean(f f'^2) / (s mean(f'^2)): above 0 where flanks are steeper near the crests
    curvature_skewness  mean(f''^3) / mean(f''^2)^(3/2): below 0 where crests are narrower than valleys
    valley_curvature    <f''>- / root of mean(f''^2): how sharp the valleys are
    crest_K_*, valley_K_*   C_K of the crests' envelope, and of that with the valleys' weights [m]
    nearness_K_*        harmonics 2 mean(exp(-g / u) exp(i K theta)): on which side cloth hangs beside the plate

The following are for the inference of a stiffness, scaled to the order of 1, with the folds m = 3 to 16 and w the
overhang's width (0.06 m):

    area_log_odds       log(area_dc / (1 - area_dc)): nearly linear in log stiffness, whereas the coefficient itself
                        levels off at both ends
    fold_depth_log      log of the folds' root mean square over w
    crest_number        a tenth of the expected number of crests of a random profile with the folds' power P_m,
                        sqrt(sum m^4 P / sum m^2 P), by Rice's formula; it follows the number counted where the centroid
                        falls behind
    fold_skewness       skewness of the folds with all that is finer, m = 3 on: narrow crests and wide valleys, or the
                        other way round
    grain_M_*           10 a_M / w (real) and -10 b_M / w (imaginary): warp against weft

Statistics are either phase-free, since the places of folds are random, or locked: the low harmonics and the envelopes,
which show cloth that is stiffer along its warp (m = 2, 4), off centre (m = 1) or weakened at one place. Ratios are
softened, and weights are smooth, so that on a profile without folds all are finite and near 0, or near those of the
mean radius.

References:
    Rice. Mathematical analysis of random noise. Bell System Technical Journal 23-24, 1944-45, Sec. 3.6.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray

from cusick_bench.datasets.errors import DataError
from cusick_bench.sim.cloth.folds import FOLD_PROMINENCE, ring_folds
from cusick_bench.sim.constants import CLOTH_RADIUS

LAST_ORDER = 24  # highest order m; higher ones are dominated by pixels
FIRST_FOLD, LAST_FOLD = 3, 16  # orders m in which folds are looked for
SOFTENING = 5e-4  # [m], a third of a pixel: ratios of what is shallower, which is noise, go to 0
SHALLOW = 1e-4  # [m] a fold below a tenth of a pixel has no depth that an image could show
LEAST_ODDS = 0.01  # least drape coefficient, and least distance from 1, in the log odds
GRAIN_SCALE = 20  # makes c_m / w, whose size is a twentieth, one of the size of 1
CREST_SCALE = 10  # drapes have about ten crests

_FINE_ORDERS = range(13, LAST_ORDER + 1)
_FIRST_ENVELOPE_ORDER = 4  # a cloth's shape in m = 1 to 3 would beat with its own folds
_TYPICAL_ORDER = 8  # of folds: what softens slopes and curvatures is `SOFTENING` at this order
_TILT = 1.5  # of the weights of crests and valleys; at 3 few crests decide
_LAST_FITTED = 2  # order of the envelopes of crests and valleys, of which there may be as few as five
_REACH, _GAP_WIDTH = 1 / 15, 1 / 30  # of the overhang: 4 and 2 mm of the standard's


@dataclass(frozen=True, eq=False)
class RadiusProfiles:
    """Radius profiles and what several statistics are computed from.

    Attributes:
        radii: Radii at equidistant angles over the full turn, counter-clockwise from +x [m].
        drape_coefficients: Those of the images; None where they are not known.
        cloth_radius: Radius of the flat cloth [m].
        plate_radius: Radius of the plate [m].

    What a pixel of the release sets, `SOFTENING`, `SHALLOW` and the prominence of a fold, is taken in proportion to the
    cloth: drapes of one shape have the same statistics of the size of 1, whatever their size.
    """

    radii: Float[ndarray, "drapes angles"]
    drape_coefficients: Float[ndarray, " drapes"] | None
    cloth_radius: float
    plate_radius: float

    @property
    def scale(self) -> float:
        """Radius of the cloth, in those of the standard's."""
        return self.cloth_radius / CLOTH_RADIUS

    @property
    def overhang(self) -> float:
        """w, width of the annulus that hangs over the plate [m]."""
        return self.cloth_radius - self.plate_radius

    @cached_property
    def mean(self) -> Float[ndarray, " drapes"]:
        """Mean radius c_0 [m]."""
        return self.radii.mean(1)

    @cached_property
    def deviation(self) -> Float[ndarray, "drapes angles"]:
        """Radii about their mean [m]."""
        return self.radii - self.mean[:, None]

    @cached_property
    def transform(self) -> Complex[ndarray, "drapes orders"]:
        """Fourier transform of the radii."""
        return np.fft.rfft(self.radii, axis=1)

    @cached_property
    def harmonics(self) -> Complex[ndarray, "drapes orders"]:
        """c_m = a_m + i b_m [m]."""
        return 2 * self.transform.conj() / self.radii.shape[1]

    @cached_property
    def amplitudes(self) -> Float[ndarray, "drapes orders"]:
        """|c_m| [m]."""
        return np.abs(self.harmonics)

    @cached_property
    def area_dc(self) -> Float[ndarray, " drapes"]:
        """Drape coefficient of the profile."""
        inner, outer = self.plate_radius**2, self.cloth_radius**2
        return ((self.radii**2).mean(1) - inner) / (outer - inner)

    def kept(self, first: int) -> Complex[ndarray, "drapes orders"]:
        """Fourier transform of the radii without what are no folds.

        Args:
            first: Lowest order that is kept.

        Returns:
            The transform with nothing outside `first` to `LAST_ORDER`.
        """
        kept = self.transform.copy()
        kept[:, :first] = 0
        kept[:, LAST_ORDER + 1 :] = 0
        return kept

    def derivative(self, first: int, degree: int) -> Float[ndarray, "drapes angles"]:
        """Folds or their derivatives by the angle.

        Args:
            first: Lowest order that is kept.
            degree: 0 for the folds f, 1 for their slope, 2 for their curvature.

        Returns:
            The values at all angles [m/rad^degree].
        """
        orders = np.arange(self.transform.shape[1])
        return np.fft.irfft(self.kept(first) * (1j * orders) ** degree, self.radii.shape[1], axis=1)

    @cached_property
    def folds(self) -> Float[ndarray, "drapes angles"]:
        """f, m = 3 to 24 [m]."""
        return self.derivative(FIRST_FOLD, 0)

    @cached_property
    def depth(self) -> Float[ndarray, "drapes 1"]:
        """s, root mean square of `folds`, softened [m]."""
        return np.sqrt((self.folds**2).mean(1, keepdims=True) + self.softening(0) ** 2)

    def softening(self, degree: int) -> float:
        """Root mean square of a derivative of folds that counts as noise.

        Args:
            degree: As in `derivative`.

        Returns:
            The size [m/rad^degree].
        """
        return SOFTENING * self.scale * _TYPICAL_ORDER**degree

    def weights(self, sign: int) -> Float[ndarray, "drapes angles"]:
        """Smooth weights of crests or valleys.

        Args:
            sign: 1 for crests, -1 for valleys.

        Returns:
            The weights, of mean 1.
        """
        weights = np.exp(sign * _TILT * self.folds / self.depth)
        return weights / weights.mean(1, keepdims=True)

    def fitted(self, sign: int) -> Complex[ndarray, "drapes fitted"]:
        """C_0 to C_2 of the crests' or the valleys' envelope (see the module).

        Args:
            sign: 1 for crests, -1 for valleys.

        Returns:
            One column an order [m].
        """
        angles = np.arange(self.radii.shape[1]) * (2 * np.pi / self.radii.shape[1])
        waves = [wave(order * angles) for order in range(1, _LAST_FITTED + 1) for wave in (np.cos, np.sin)]
        terms = np.stack([np.ones_like(angles), *waves], axis=1)
        weights = self.weights(sign)
        products = (terms[:, :, None] * terms[:, None, :]).reshape(len(angles), -1)
        normal = (weights @ products).reshape(len(weights), terms.shape[1], terms.shape[1])
        solved = np.linalg.solve(normal, ((weights * self.radii) @ terms)[..., None])[..., 0]
        return np.column_stack([solved[:, 0], solved[:, 1::2] + 1j * solved[:, 2::2]])

    @cached_property
    def crests(self) -> Complex[ndarray, "drapes fitted"]:
        """Harmonics of the crests' envelope [m]."""
        return self.fitted(1)

    @cached_property
    def valleys(self) -> Complex[ndarray, "drapes fitted"]:
        """Harmonics of the valleys' envelope [m]."""
        return self.fitted(-1)

    @cached_property
    def nearness(self) -> Float[ndarray, "drapes angles"]:
        """exp(-g / u): 1 at the plate's edge, 0 far from it."""
        reach = _REACH * self.overhang
        return np.exp(-np.maximum(self.radii - self.plate_radius, -2 * reach) / reach)

    @cached_property
    def fold_power(self) -> Float[ndarray, "drapes folds"]:
        """Mean squares P_m of the folds' harmonics [m2]."""
        return self.amplitudes[:, FIRST_FOLD : LAST_FOLD + 1] ** 2 / 2


Numbers = Sequence[int]  # which quantiles or orders of a family
Family = Callable[[RadiusProfiles, Numbers], ndarray]  # gives the statistics of these numbers, one a column


def _image_coefficient(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    if profiles.drape_coefficients is None:
        raise DataError("drape_coefficient is measured on images; pass drape_coefficients, or ask for area_dc")
    return profiles.drape_coefficients


def _norm(amplitudes: Float[ndarray, "drapes orders"]) -> Float[ndarray, " drapes"]:
    return np.sqrt((amplitudes**2).sum(1))


def _folds(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    return np.array(
        [ring_folds(ring, prominence=FOLD_PROMINENCE * profiles.scale) for ring in profiles.radii], dtype=np.float64
    )


def _centroid(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    """Goes to the middle order where there are no folds."""
    orders = np.arange(FIRST_FOLD, LAST_FOLD + 1)
    weights = profiles.amplitudes[:, orders] + SOFTENING * profiles.scale / len(orders)
    return (weights @ orders.astype(np.float64)) / weights.sum(1)


def _depth(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    orders = np.arange(FIRST_FOLD, LAST_ORDER + 1)
    return _norm(profiles.amplitudes[:, orders]) / np.sqrt(2)


def _roughness(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    orders = np.arange(FIRST_FOLD, LAST_ORDER + 1)
    return _norm(profiles.amplitudes[:, orders] * orders) / np.sqrt(2)


def _skewness(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    deviation = profiles.deviation
    return (deviation**3).mean(1) / ((deviation**2).mean(1) + (SOFTENING * profiles.scale) ** 2) ** 1.5


def _harmonics(
    values: Float[ndarray, "drapes angles"], orders: Numbers, size: Float[ndarray, "drapes"] | float
) -> Complex[ndarray, "drapes chosen"]:
    """2 mean(values exp(i K theta)) / size."""
    means = np.fft.rfft(values, axis=1).conj()[:, list(orders)] / values.shape[1]
    return 2 * means / np.reshape(size, (-1, 1))


def _envelope(profiles: RadiusProfiles, orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    """Harmonics of the squared folds over their mean."""
    count, kept = profiles.radii.shape[1], profiles.kept(_FIRST_ENVELOPE_ORDER)
    squared = np.fft.rfft(np.fft.irfft(kept, count, axis=1) ** 2, axis=1).conj() / count
    return 2 * squared[:, list(orders)] / (np.real(squared[:, :1]) + (SOFTENING * profiles.scale) ** 2)


def _slope_envelope(profiles: RadiusProfiles, orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    squared = profiles.derivative(_FIRST_ENVELOPE_ORDER, 1) ** 2
    return _harmonics(squared, orders, squared.mean(1) + profiles.softening(1) ** 2)


def _cubed(profiles: RadiusProfiles, orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    folds = profiles.derivative(_FIRST_ENVELOPE_ORDER, 0)
    return _harmonics(folds**3, orders, ((folds**2).mean(1) + profiles.softening(0) ** 2) ** 1.5)


def _fitted(harmonics: Complex[ndarray, "drapes fitted"], orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    if max(orders) > _LAST_FITTED:
        raise DataError(f"envelopes of crests and valleys have orders 1 to {_LAST_FITTED}, got {max(orders)}")
    return harmonics[:, list(orders)]


def _crest_spread(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    apart = profiles.radii - np.real(profiles.crests[:, :1])
    return np.sqrt((profiles.weights(1) * apart**2).mean(1))


def _valley_gap(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    width = _GAP_WIDTH * profiles.overhang
    return -width * np.log(np.exp(-(profiles.radii - profiles.plate_radius) / width).mean(1))


def _slope_skewness(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    squared = profiles.derivative(FIRST_FOLD, 1) ** 2
    return (profiles.folds * squared).mean(1) / (profiles.depth[:, 0] * (squared.mean(1) + profiles.softening(1) ** 2))


def _curvature(profiles: RadiusProfiles) -> tuple[Float[ndarray, "drapes angles"], Float[ndarray, " drapes"]]:
    """Curvature of the folds, and its root mean square, softened [m/rad2]."""
    curvature = profiles.derivative(FIRST_FOLD, 2)
    return curvature, np.sqrt((curvature**2).mean(1) + profiles.softening(2) ** 2)


def _curvature_skewness(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    curvature, size = _curvature(profiles)
    return (curvature**3).mean(1) / size**3


def _valley_curvature(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    curvature, size = _curvature(profiles)
    return (profiles.weights(-1) * curvature).mean(1) / size


def _area_log_odds(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    share = np.clip(profiles.area_dc, LEAST_ODDS, 1 - LEAST_ODDS)
    return np.log(share / (1 - share))


def _fold_depth_log(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    return 0.5 * np.log((profiles.fold_power.sum(1) + (SHALLOW * profiles.scale) ** 2) / profiles.overhang**2)


def _crest_number(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    """A flat profile counts as one of the first order of folds."""
    orders = np.arange(FIRST_FOLD, LAST_FOLD + 1)
    fourth, second = (profiles.fold_power @ orders**k + (SHALLOW * profiles.scale) ** 2 * FIRST_FOLD**k for k in (4, 2))
    return np.sqrt(fourth / second) / CREST_SCALE


def _fold_skewness(profiles: RadiusProfiles) -> Float[ndarray, " drapes"]:
    kept = profiles.transform.copy()
    kept[:, :FIRST_FOLD] = 0
    folds = np.fft.irfft(kept, profiles.radii.shape[1], axis=1)
    return (folds**3).mean(1) / ((folds**2).mean(1) + (SHALLOW * profiles.scale) ** 2) ** 1.5


def _grain(profiles: RadiusProfiles, orders: Numbers) -> Complex[ndarray, "drapes chosen"]:
    return profiles.harmonics[:, list(orders)].conj() / 2 / profiles.overhang * GRAIN_SCALE


# The families of statistics, by name: single ones, ones with a number, and complex ones with an order.
SINGLE: dict[str, Callable[[RadiusProfiles], ndarray]] = {
    "drape_coefficient": _image_coefficient,
    "area_dc": lambda profiles: profiles.area_dc,
    "mean_radius": lambda profiles: profiles.mean,
    "amplitude_high": lambda profiles: _norm(profiles.amplitudes[:, list(_FINE_ORDERS)]),
    "folds": _folds,
    "fold_centroid": _centroid,
    "fold_depth": _depth,
    "roughness": _roughness,
    "skewness": _skewness,
    "crest_radius": lambda profiles: np.real(profiles.crests[:, 0]),
    "crest_spread": _crest_spread,
    "valley_gap": _valley_gap,
    "plate_nearness": lambda profiles: profiles.nearness.mean(1),
    "slope_skewness": _slope_skewness,
    "curvature_skewness": _curvature_skewness,
    "valley_curvature": _valley_curvature,
    "area_log_odds": _area_log_odds,
    "fold_depth_log": _fold_depth_log,
    "crest_number": _crest_number,
    "fold_skewness": _fold_skewness,
}
NUMBERED: dict[str, Family] = {
    "radius_quantile": lambda profiles, levels: np.percentile(profiles.radii, levels, axis=1).T,
    "quantile": lambda profiles, levels: np.percentile(profiles.deviation, levels, axis=1).T,
    "amplitude": lambda profiles, orders: profiles.amplitudes[:, list(orders)],
}
# A turn of the drape by phi multiplies the complex numbers of order m by exp(i m phi), the grain by exp(-i m phi).
LOCKED: dict[str, Family] = {
    "harmonic": lambda profiles, orders: profiles.harmonics[:, list(orders)],
    "envelope": _envelope,
    "slope_envelope": _slope_envelope,
    "cubed": _cubed,
    "crest": lambda profiles, orders: _fitted(profiles.crests, orders),
    "valley": lambda profiles, orders: _fitted(profiles.valleys, orders),
    "nearness": lambda profiles, orders: _harmonics(profiles.nearness, orders, 1.0),
    "grain": _grain,
}
