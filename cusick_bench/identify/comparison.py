"""Comparison of a fabric's stiffness with measured fabrics: ranks with intervals, and words."""

from math import isinf

from cusick_bench.identify.document import Compared, Comparison, Fit, Rank, Stiffness
from cusick_bench.identify.measured_fabrics import DIRECTIONS, QUANTITIES, FabricRange, Quantity, compared_ranges
from cusick_bench.metrics.stiffness import bending_length

_WORDS = ((10, "very limp"), (30, "limp"), (70, "middling"), (90, "stiff"), (100, "very stiff"))
"""Share of fabrics that have less [%], up to which a word holds."""


def compare(areal_density: float | None, fit: Fit | None, all_samples: float | None) -> Comparison | None:
    """A fabric among measured ones.

    Args:
        areal_density: Its mass per area [kg/m2]; None if unknown.
        fit: Stiffness of one drape; None without one.
        all_samples: Mean stiffness of warp and weft of all samples, by the diagnosis [N m]; None without one.

    Returns:
        The comparison; None where the weight or any stiffness is not known.
    """
    found = {} if fit is None else dict(fit.stiffness)
    if all_samples is not None:
        found["mean"] = Stiffness(value=all_samples)
    if areal_density is None or not found:
        return None
    numbers = tuple(
        _compared(quantity, direction, found[direction], areal_density)
        for quantity in QUANTITIES
        for direction in DIRECTIONS
        if direction in found
    )
    every, similar = compared_ranges("bending", "warp", areal_density)
    return Comparison(
        fabrics=every.fabrics,
        similar_fabrics=similar.fabrics,
        similar_kg_m2=(similar.least, None if isinf(similar.most) else similar.most),
        numbers=numbers,
        summary=_summary(numbers, similar),
    )


def weight_words(least: float, most: float | None) -> str:
    """A range of weight in words.

    Args:
        least: Weight from which it goes [kg/m2].
        most: Weight to which it goes [kg/m2]; None without end.

    Returns:
        Such as `140 to 200 g/m²`.
    """
    if most is None:
        return f"{1e3 * least:.0f} g/m² and more"
    return f"less than {1e3 * most:.0f} g/m²" if least == 0 else f"{1e3 * least:.0f} to {1e3 * most:.0f} g/m²"


def _compared(quantity: Quantity, direction: str, one: Stiffness, areal_density: float) -> Compared:
    every, similar = compared_ranges(quantity, direction, areal_density)

    def converted(stiffness: float) -> float:
        return stiffness if quantity == "bending" else bending_length(stiffness, areal_density)

    value = converted(one.value)
    ci90 = None if one.ci90 is None else (converted(one.ci90[0]), converted(one.ci90[1]))
    return Compared.model_validate(
        {
            "quantity": quantity,
            "direction": direction,
            "value": value,
            "ci90": ci90,
            "among_all": _rank(every, value, ci90),
            "among_similar": _rank(similar, value, ci90),
        }
    )


def _rank(among: FabricRange, value: float, ci90: tuple[float, float] | None) -> Rank:
    bounds = None if ci90 is None else (among.percent_below(ci90[0]), among.percent_below(ci90[1]))
    return Rank(percent=among.percent_below(value), ci90=bounds)


def _summary(numbers: tuple[Compared, ...], similar: FabricRange) -> str:
    """The fabric's stiffness for its weight, in a sentence that says no more than the intervals allow."""
    ranks = {one.direction: one.among_similar for one in numbers if one.quantity == "bending"}
    chosen = [ranks[name] for name in ("warp", "weft") if name in ranks] or [ranks["mean"]]
    percent = sum(rank.percent for rank in chosen) / len(chosen)
    bounds = [rank.ci90 for rank in chosen if rank.ci90 is not None]
    weight = weight_words(similar.least, None if isinf(similar.most) else similar.most)
    text = f"Among {similar.fabrics} measured fabrics of {weight} this one is {_word(percent)}"
    if not bounds:
        return f"{text}. Its stiffness has no interval, so how sure that is is not known."
    low, high = (sum(ends) / len(bounds) for ends in zip(*bounds, strict=True))
    if _word(low) == _word(high):
        return f"{text}, all over the 90 % interval of its stiffness."
    return f"{text}; the 90 % interval of its stiffness allows anything from {_word(low)} to {_word(high)}."


def _word(percent: float) -> str:
    return next(word for most, word in _WORDS if percent <= most)
