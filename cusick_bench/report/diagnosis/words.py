"""A diagnosis' numbers in words: verdict, chance, what a cause would show, what a measurement is worth, the cloth."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from math import exp, log2

from cusick_bench.diagnosis.atlas.base_model import LAYING_HEIGHT, REST_HEIGHT
from cusick_bench.diagnosis.atlas.effect_timing import acts_later, in_lab
from cusick_bench.report.diagnosis.values import measure, percent, plain
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY
from cusick_bench.sim.effects import Effect, registered

VERDICTS: Mapping[str, tuple[str, str]] = {
    "none": ("No unmodelled effect", "The base model explains these drapes within their natural spread."),
    "effect": ("One cause found", "The base model does not explain these drapes; one cause does."),
    "ambiguous": ("Several causes possible", "Something is missing in the base model; these data cannot say which of "
                  "several causes it is."),
    "unknown": ("Unknown cause", "Something is missing in the base model that no effect on the list explains."),
    "": ("No verdict", "The data did not allow a verdict; the notes say why."),
}  # fmt: skip
TWO_CAUSES = ("Two causes found", "The base model does not explain these drapes; two causes together do.")
"""In the place of `effect`, where the cause that is named acts together with another."""

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
}
_LARGEST_LOGARITHM = 50.0  # no ratio of stiffnesses is larger
_CLAIMS = {
    "none": "nothing is missing in the base model",
    "unknown": "something that is not on the list of effects",
}
_LEAST_FLOOR = 1 / 50  # of the gap
_WORTH = ((0.75, "would settle nearly all"), (0.4, "would settle about half"), (0.15, "would settle a part"),
          (0.0, "would settle little"))  # fmt: skip


def percent_or_point(p: float) -> str:
    """A probability of error, to be read as 'p = ...'."""
    return "p < .001" if p < 0.001 else f"p = {plain(p)}".replace("0.", ".", 1)


def chance(p: float | None) -> str:
    """What a probability of the test says."""
    if p is None:
        return "How often chance alone gives such a distance is not known."
    often = "less than once in 1000 times" if p < 0.001 else f"about {plain(1000 * p)} times in 1000"
    if p >= 0.01:
        often = f"about {100 * p:.0f} times in 100"
    return f"If nothing were missing in the base model, data like these would come up {often} ({percent_or_point(p)})."


def times_floor(base: float, floor: float) -> float | None:
    """Gap over floor; None where the floor, 0 but for chance, is too small to be a unit."""
    return base / floor if floor > _LEAST_FLOOR * base else None


def gap_in_words(base: float | None, floor: float | None, effect: float | None, *, causes: int = 1) -> str:
    """How the gap compares with its floor, and with what a cause (or two) leaves of it."""
    if base is None:
        return "The gap was not measured: no drapes were simulated."
    if floor is None:
        return "The gap has no floor to be read against: too few samples."
    if base <= floor:
        return "The gap does not exceed its floor."
    ratio = times_floor(base, floor)
    first = "The gap exceeds its floor" if ratio is None else f"The gap is {plain(ratio)} times its floor"
    if effect is None:
        return first + "."
    if ratio is None:
        return f"{first}; {'both causes leave' if causes > 1 else 'a cause leaves'} less."
    return f"{first}; with {'both causes' if causes > 1 else 'the cause'} {plain(effect / floor)} times."


def worth(bits: float | None, entropy: float) -> str:
    """Bits of a measurement in words, against the doubt that there is."""
    if bits is None:
        return "worth not known"
    if entropy < 0.05:
        return f"little doubt is left to settle ({plain(bits)} bit)"
    share = min(max(bits / entropy, 0.0), 1.0)
    words = next(words for least, words in _WORTH if share >= least)
    return f"{words} of the doubt that is left ({plain(bits)} of {plain(entropy)} bit)"


def entropy_of(probabilities: Sequence[float]) -> float:
    """Entropy of the causes [bit]; what is missing to 1 is one further cause."""
    rest = 1 - sum(probabilities)
    return -sum(p * log2(p) for p in (*probabilities, rest) if p > 0)


def statistic_name(name: str) -> str:
    """A statistic in words; the name itself where it is not known."""
    if name in _STATISTICS:
        return _STATISTICS[name]
    if found := re.fullmatch(r"quantile_(\d+)", name):
        return f"radius with {int(found[1])} % below, from the mean"
    if found := re.fullmatch(r"amplitude_(\d+)", name):
        return f"amplitude of {found[1]} folds"
    if found := re.fullmatch(r"(harmonic|envelope)_(\d+)_(real|imaginary)", name):
        part = "cosine" if found[3] == "real" else "sine"
        what = "shape" if found[1] == "harmonic" else "depth of folds around"
        return f"{what}, m = {found[2]}, {part}"
    return name.replace("_", " ")


def claim(name: str) -> str:
    """What a cause says happened."""
    if name in _CLAIMS:
        return _CLAIMS[name]
    known = registered().get(name)
    return known.summary if known else ""


@cache
def signature(name: str) -> str:
    """What a cause would show if it acts, and by what it can be known; "" where the effect is not registered."""
    known = registered().get(name)
    return "" if known is None else " ".join(_signs(known))


def _signs(effect: Effect) -> list[str]:
    signs = []
    if effect.kind == "imaging":
        signs.append("Changes the picture, not the cloth: other samples on the same camera show it too.")
    if in_lab(effect):
        signs.append("Keeps its direction on the bench when the sample is turned or laid on its other face.")
    elif effect.located == "direction":
        signs.append("Turns with the cloth when the sample is turned on the plate.")
    elif effect.located == "patch":
        signs.append("Stays at its place of the cloth and turns with it.")
    elif effect.located == "ring":
        signs.append("Acts alike all around.")
    if effect.face_odd:
        signs.append("Acts the opposite way when the sample lies on its other face.")
    elif effect.kind == "material":
        signs.append("Acts alike on both faces.")
    if acts_later(effect):
        signs.append("Shows in later pictures of a drape only, not in the first.")
    elif effect.kind == "history":
        signs.append("Depends on how the cloth came to lie: lifted and laid again, it drapes otherwise.")
    if effect.kind == "contact":
        signs.append("Matters only where folds are deep enough to touch.")
    return signs


def physics(name: str) -> str:
    """What a cause does, with its equation; "" where the effect is not registered."""
    known = registered().get(name)
    return known.physics.replace("`", "") if known else ""


def parameter_meaning(name: str, parameter: str) -> str:
    """What a parameter of an effect is."""
    known = registered().get(name)
    found = next((p for p in known.parameters if p.name == parameter), None) if known else None
    return found.summary if found else ""


def place_in_words(angle: tuple[float, float] | None, radius: tuple[float, float] | None) -> str:
    """A place on the cloth."""
    parts = []
    if angle is not None:
        first, last = angle
        all_round = last - first >= 360
        parts.append("all around" if all_round else f"from {first % 360:g}° to {last % 360 or 360.0:g}°")
    if radius is not None:
        inner, outer = (f"{1e3 * edge:.0f}" for edge in radius)
        parts.append(f"{inner} to {outer} mm from the centre")
    return ", ".join(parts)


def cloth_in_words(base: Mapping[str, float | None], density: float | None) -> list[tuple[str, str, str]]:
    """Parameters of the base model that fit best, as (name, value, meaning); logarithms are undone.

    Args:
        base: By name, as the base model names them.
        density: Mass per area [kg/m2], None if unknown; only with it is there a stiffness in N m.
    """
    base = {name: value for name, value in base.items() if value is not None and abs(value) < _LARGEST_LOGARITHM}
    rows = []
    level = base.get("bending")
    if level is not None:
        rows.append(("bending stiffness", f"{plain(exp(level), 3)} ρgR³", "in multiples of weight times radius cubed"))
        if density is not None:
            stiffness = exp(level) * density * GRAVITY * CLOTH_RADIUS**3
            rows.append(("", f"{1e6 * stiffness:.2g} µN m", f"at {1e3 * density:.0f} g/m²"))
    for name, words, meaning in (
        ("anisotropy", "warp to weft", "factor between the bending stiffness of the two"),
        ("bias", "diagonal to mean", "factor on the bending stiffness at 45°"),
        ("growth", "stiffening", "factor from little to sharply bent cloth"),
    ):
        if (value := base.get(name)) is not None:
            rows.append((words, f"× {plain(exp(value), 3)}", meaning))
    if (value := base.get("shear")) is not None:
        rows.append(("shear stiffness", f"{plain(exp(value))} ρgR", "in multiples of weight times radius"))
    for name, words, unit, meaning in (
        ("laying", "laid unevenly", LAYING_HEIGHT, "height of undulations when it is laid down"),
        ("rest", "waves of its own", REST_HEIGHT, "height of undulations of the cloth at rest"),
    ):
        if (value := base.get(name)) is not None:
            rows.append((words, measure(unit * exp(value), "m"), meaning))
    return rows


def data_in_words(data: Mapping[str, float | None]) -> str:
    """How many drapes were looked at."""

    def count(key: str, one: str, several: str) -> str:
        value = data.get(key)
        return "" if value is None else f"{value:.0f} {one if value == 1 else several}"

    faces = " and ".join(filter(None, (count("up", "face up", "face up"), count("down", "face down", "face down"))))
    captures = count("captures", "picture", "pictures") + (f" ({faces})" if faces else "")
    later = data.get("later")
    parts = [count("samples", "sample", "samples"), captures.strip()]
    if later is not None and later > 0:
        parts.append(f"{later:.0f} repeats" if later >= 1 else f"{percent(later)} of the pictures are repeats")
    density = data.get("areal_density_kg_m2")
    parts.append("mass per area not known" if density is None else f"{1e3 * density:.0f} g/m²")
    return ", ".join(part for part in parts if part)
