"""What differs between cloths, between specimens of one cloth, and between real and simulated cloth: the priors.

Traits are numbers in which cloths differ beside the 39 numbers of the homogeneous space. Fields vary over the cloth,
and from specimen to specimen; their amplitudes and correlation lengths belong to the cloth. The vector that holds them
all is described in `cusick_bench.problem.field_space`.
"""

from dataclasses import dataclass

from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE

MODES = 300  # of each field: waves of 3.5 cm and longer
MOST_POISSON = 0.3  # largest Poisson's ratio of bending; woven cloth has less
HOMOGENEOUS = STRETCH_SIZE + BENDING_SIZE


@dataclass(frozen=True)
class FieldPrior:
    """Log-normal prior of one field's amplitude and correlation length.

    Attributes:
        amplitude: Median, in the field's unit.
        length: Median [m].
        amplitude_sd: Standard deviation of the logarithm of the amplitude.
        length_sd: Standard deviation of the log of the correlation length.
        level: Standard deviation between specimens of what is uniform over the cloth, in the field's unit.
    """

    amplitude: float
    length: float
    amplitude_sd: float = 0.3
    length_sd: float = 0.3
    level: float = 0.0


@dataclass(frozen=True)
class Trait:
    """Normal prior of a trait, a number in which cloths differ.

    Attributes:
        mean: Mean over all cloths.
        sd: Standard deviation between cloths.
    """

    mean: float
    sd: float


# Found by `cusick_bench.problem.population` with law `plate` at 480 vertices, from fabrics of the release that are not
# used in any table of results, neither themselves nor as a named set. It finds a standard deviation of the curl of
# 4.1 /m where this prior has 4, of 8.4 where it has 8, and of 6.2 where it has 6.
TRAITS = {
    "bending": Trait(-0.7, 1.5),  # [log] level of all bending stiffnesses, relative to the homogeneous space's prior
    "stretch": Trait(0.9, 1.2),  # [log] level of all stretch stiffnesses, relative to that prior
    "hardening": Trait(0.45, 0.25),  # [log] rise of bending stiffness per curvature sample, that is per 10 /m
    "bias": Trait(-0.1, 0.5),  # [log] bending stiffness at 45 degrees, relative to that prior
    "grain": Trait(-0.7, 0.5),  # [log] bending stiffness of the warp over that of the weft, relative to that prior
    "poisson": Trait(0.0, 1.5),  # log odds of Poisson's ratio within 0 to `MOST_POISSON`, for law `plate`; assumed
    "curl": Trait(0.0, 6.0),  # [1/m] curvature of the rest shape, the same all over; > 0 where it rises to its face
}

# The correlation length of the laid shape, and how much samples of one cloth differ in stiffness, were found in the
# same way. The others are assumed: undulations of 1 mm in the laid shape (from .3 to 3 mm no statistic used for
# inference changes by more than a fifth of a specimen's scatter), of a third of that in the rest shape, and 15 % of
# unevenness of the stiffness.
FIELDS = {
    "stiffness": FieldPrior(0.15, 0.02, level=0.12),  # [log]
    "laying": FieldPrior(1.0e-3, 0.0135, length_sd=0.5),  # [m]
    "rest": FieldPrior(0.3e-3, 0.03),  # [m]
}
CLOTH = HOMOGENEOUS + len(TRAITS) + 2 * len(FIELDS)

# Found in the same way: distance of a fabric's mean statistics (`cusick_bench.problem.statistics`) from those of the
# nearest simulated cloth, root mean square over fabrics. All fabrics share a tendency towards 45 degrees, which no
# symmetric cloth has; hence the large value of `grain_2_imaginary`.
DISCREPANCY = {
    "area_log_odds": 0.04,
    "fold_depth_log": 0.06,
    "crest_number": 0.03,
    "fold_skewness": 0.12,
    "grain_2_real": 0.15,
    "grain_2_imaginary": 0.42,
    "grain_4_real": 0.32,
}


def trait_entry(name: str) -> int:
    """Entry of a cloth's parameters that is a trait's deviation from its mean, in its standard deviations.

    Args:
        name: Name of the trait, among `TRAITS`.

    Returns:
        Its index.
    """
    return HOMOGENEOUS + list(TRAITS).index(name)


def amplitude_entry(name: str) -> int:
    """Entry of a cloth's parameters that is the logarithm of a field's amplitude.

    Args:
        name: Name of the field, among `FIELDS`.

    Returns:
        Its index.
    """
    return HOMOGENEOUS + len(TRAITS) + 2 * list(FIELDS).index(name)


def length_entry(name: str) -> int:
    """Entry of a cloth's parameters that is the logarithm of a field's correlation length.

    Args:
        name: Name of the field, among `FIELDS`.

    Returns:
        Its index.
    """
    return amplitude_entry(name) + 1
