"""A diagnosis' numbers in words: verdict, chance, gap, what a measurement is worth, statistics, places, the cloth."""

import re
from collections.abc import Mapping, Sequence
from math import exp, log2

from cusick_bench.diagnosis.atlas.base_model import LAYING_HEIGHT, LAYING_LENGTH, REST_HEIGHT
from cusick_bench.diagnosis.document.model import BaseParameters, DataCounts
from cusick_bench.report.diagnosis.wording.number_format import measure, plain

VERDICTS: Mapping[str, tuple[str, str]] = {
    "none": ("No unmodelled effect", "The base model explains these drapes within their natural spread."),
    "effect": ("One cause found", "The base model does not explain these drapes; one cause does."),
    "several": ("Several causes found", "The base model does not explain these drapes; several causes together do."),
    "ambiguous": ("Several causes possible", "Something is missing in the base model; these data cannot say which of "
                  "several causes it is."),
    "unknown": ("Unknown cause", "Something is missing in the base model that no effect on the list explains."),
    "refused": ("Not diagnosed", "Nothing can be said about these data."),
}  # fmt: skip

STAGES: Mapping[str, str] = {
    "material": "material",
    "boundary": "plate and sample",
    "contact": "contact",
    "history": "history",
    "imaging": "camera, picture",
    "none": "nothing missing",
    "unknown": "not on the list",
}
"""Stages of the pipeline, and the two claims that name none of them."""

GROUPS: Mapping[str, str] = {
    "size": "size of the drape",
    "radii": "spread of the radii",
    "depth": "depth of folds",
    "number": "number of folds",
    "spectrum": "spectrum of folds",
    "harmonics": "shape in cloth's frame",
    "envelope": "where folds are deep",
    "slopes": "where folds are steep",
    "asymmetry": "crests against valleys",
    "outline": "outline beside the plate",
    "sides": "sides of crests and valleys",
}

_LOCKED_STATISTICS = {
    "harmonic": "shape",
    "envelope": "depth of folds around",
    "slope_envelope": "steepness of folds around",
    "cubed": "narrowness of crests around",
    "crest": "radius of crests around",
    "valley": "radius of valleys around",
    "nearness": "cloth beside the plate around",
}

_STATISTICS = {
    "mean_radius": "mean radius",
    "area_dc": "drape coefficient",
    "amplitude_high": "ripples finer than 12 folds",
    "folds": "number of folds",
    "fold_centroid": "mean fold order",
    "fold_depth": "depth of folds",
    "roughness": "steepness of folds",
    "skewness": "skewness of the radii",
    "crest_radius": "radius of the crests",
    "crest_spread": "spread of the crests' radii",
    "valley_gap": "gap from plate to valleys",
    "plate_nearness": "share of the plate's edge with cloth beside it",
    "slope_skewness": "steepness of crests against valleys",
    "curvature_skewness": "curvature of crests against valleys",
    "valley_curvature": "sharpness of valleys",
}
_LARGEST_LOGARITHM = 50.0  # no ratio of stiffnesses is larger
_LEAST_FLOOR = 1 / 50  # of the gap
_WORTH = ((0.75, "would settle nearly all"), (0.4, "would settle about half"), (0.15, "would settle a part"),
          (0.0, "would settle little"))  # fmt: skip


def percent_or_point(p: float) -> str:
    """A probability of error.

    Args:
        p: The probability.

    Returns:
        Such as "p = .02" or "p < .001".
    """
    return "p < .001" if p < 0.001 else f"p = {plain(p)}".replace("0.", ".", 1)


def chance(p: float | None) -> str:
    """What the p-value of the base model says.

    Args:
        p: The p-value, None if unknown.

    Returns:
        A sentence.
    """
    if p is None:
        return "How often chance alone gives such a distance is not known."
    often = "less than once in 1000 times" if p < 0.001 else f"about {plain(1000 * p)} times in 1000"
    if p >= 0.01:
        often = f"about {100 * p:.0f} times in 100"
    return f"If nothing were missing in the base model, data like these would come up {often} ({percent_or_point(p)})."


def times_floor(base: float, floor: float) -> float | None:
    """Gap over floor.

    Args:
        base: The gap.
        floor: Its floor.

    Returns:
        The ratio; None where the floor is too small to be a unit.
    """
    return base / floor if floor > _LEAST_FLOOR * base else None


def gap_in_words(base: float | None, floor: float | None, effect: float | None, *, several: bool) -> str:
    """How the gap compares with its floor, and with what the named cause leaves of it.

    Args:
        base: Gap of the base model, None if unknown.
        floor: Its floor, None if unknown.
        effect: Gap of the base model with the cause, None if unknown.
        several: Whether several causes act together.

    Returns:
        A sentence.
    """
    if base is None:
        return "The gap was not measured: no drapes were simulated, or there are too few samples to leave some unseen."
    if floor is None:
        return "The gap has no floor to be read against: too few samples."
    if base <= floor:
        return "The gap does not exceed its floor."
    ratio = times_floor(base, floor)
    first = "The gap exceeds its floor" if ratio is None else f"The gap is {plain(ratio)} times its floor"
    if effect is None:
        return first + "."
    if ratio is None:
        left = "less" if effect < base else "no less"
        return f"{first}; {'all causes together leave' if several else 'a cause leaves'} {left}."
    return f"{first}; with {'all causes' if several else 'the cause'} {plain(effect / floor)} times."


def worth(bits: float | None, entropy: float) -> str:
    """How much of the doubt a measurement would settle.

    Args:
        bits: Expected drop of the entropy of the causes [bit], None if unknown.
        entropy: Entropy of the causes now [bit].

    Returns:
        A clause.
    """
    if bits is None:
        return "worth not known"
    if entropy < 0.05:
        return f"little doubt is left to settle ({plain(bits)} bit)"
    share = min(max(bits / entropy, 0.0), 1.0)
    words = next(words for least, words in _WORTH if share >= least)
    return f"{words} of the doubt that is left ({plain(bits)} of {plain(entropy)} bit)"


def entropy_of(probabilities: Sequence[float]) -> float:
    """Entropy of the causes.

    Args:
        probabilities: Probabilities of the causes; what is missing to 1 is that of one further cause.

    Returns:
        The entropy [bit].
    """
    rest = 1 - sum(probabilities)
    return -sum(p * log2(p) for p in (*probabilities, rest) if p > 0)


def statistic_name(name: str) -> str:
    """A statistic in words.

    Args:
        name: As in `diagnosis.measure.statistics`.

    Returns:
        Its name in words; the name itself where it is not known.
    """
    if name in _STATISTICS:
        return _STATISTICS[name]
    if found := re.fullmatch(r"quantile_(\d+)", name):
        return f"radius with {int(found[1])} % below, from the mean"
    if found := re.fullmatch(r"amplitude_(\d+)", name):
        return f"amplitude of {found[1]} folds"
    if (found := re.fullmatch(r"(\w+?)_(\d+)_(real|imaginary)", name)) and found[1] in _LOCKED_STATISTICS:
        part = "cosine" if found[3] == "real" else "sine"
        return f"{_LOCKED_STATISTICS[found[1]]}, m = {found[2]}, {part}"
    return name.replace("_", " ")


def place_in_words(angle: tuple[float, float] | None, radius: tuple[float, float] | None) -> str:
    """A place on the cloth.

    Args:
        angle: First and last angle, counter-clockwise from warp [deg]; None for all around.
        radius: Inner and outer radius [m]; None for all of them.

    Returns:
        Such as "from 45° to 90°, 120 to 150 mm from the centre".
    """
    parts = []
    if angle is not None:
        first, last = angle
        all_round = last - first >= 360
        parts.append("all around" if all_round else f"from {first % 360:g}° to {last % 360 or 360.0:g}°")
    if radius is not None:
        inner, outer = (f"{1e3 * edge:.0f}" for edge in radius)
        parts.append(f"{inner} to {outer} mm from the centre")
    return ", ".join(parts)


def cloth_in_words(base: BaseParameters, data: DataCounts) -> list[tuple[str, str, str]]:
    """Parameters of the base model that fit best; logarithms are undone.

    Args:
        base: The parameters.
        data: Gives density, radius and gravity; only with a density is there a stiffness in N m.

    Returns:
        Name, value, meaning.
    """
    rows = []
    if (bending := _exponential(base.bending)) is not None:
        rows.append(("bending stiffness", f"{plain(bending, 3)} ρgR³", "in multiples of weight times radius cubed"))
        if (density := data.areal_density_kg_m2) is not None:
            stiffness = bending * density * data.gravity_m_s2 * data.cloth_radius_m**3
            rows.append(("", f"{plain(1e6 * stiffness)} µN m", f"at {1e3 * density:.0f} g/m²"))
    for level, words, meaning in (
        (base.anisotropy, "weft to warp", "factor between the bending stiffness of the two"),
        (base.bias, "diagonal to mean", "factor on the bending stiffness at 45°"),
        (base.growth, "stiffening", "factor from little to sharply bent cloth"),
    ):
        if (value := _exponential(level)) is not None:
            rows.append((words, f"× {plain(value, 3)}", meaning))
    if (value := _exponential(base.shear)) is not None:
        rows.append(("shear stiffness", f"{plain(value)} ρgR", "in multiples of weight times radius"))
    for level, words, unit, meaning in (
        (base.laying, "laid unevenly", LAYING_HEIGHT, "height of undulations when it is laid down"),
        (base.length, "", LAYING_LENGTH, "their length"),
        (base.rest, "waves of its own", REST_HEIGHT, "height of undulations of the cloth at rest"),
    ):
        if (value := _exponential(level)) is not None:
            rows.append((words, measure(unit * value, "m"), meaning))
    return rows


def _exponential(logarithm: float | None) -> float | None:
    """The number behind a logarithm; None where it is not known or out of all reason."""
    return None if logarithm is None or abs(logarithm) > _LARGEST_LOGARITHM else exp(logarithm)


def data_in_words(data: DataCounts) -> str:
    """How many drapes were looked at.

    Args:
        data: Their numbers.

    Returns:
        Such as "12 samples, 48 pictures (24 face up and 24 face down), 24 repeats, 192 g/m²".
    """
    faces = " and ".join(_faces_in_words(data))
    pictures = _counted(data.captures, "picture", "pictures") + (f" ({faces})" if faces else "")
    density = data.areal_density_kg_m2
    weight = "mass per area not known" if density is None else f"{1e3 * density:.0f} g/m²"
    repeats = _counted(data.later or None, "repeat", "repeats")
    parts = (_counted(data.samples, "sample", "samples"), pictures.strip(), repeats, weight)
    return ", ".join(part for part in parts if part)


def _faces_in_words(data: DataCounts) -> list[str]:
    """How many pictures show each face; where the face of some is not known, no face that none shows."""
    known = [(data.up, "face up"), (data.down, "face down")]
    if data.captures is not None and data.up is not None and data.down is not None:
        unknown = data.captures - data.up - data.down
        if unknown > 0:
            known = [one for one in (*known, (unknown, "whose face is not known")) if one[0]]
    return [words for count, face in known if (words := _counted(count, face))]


def _counted(count: int | None, one: str, several: str | None = None) -> str:
    return "" if count is None else f"{count} {one if count == 1 else several or one}"
