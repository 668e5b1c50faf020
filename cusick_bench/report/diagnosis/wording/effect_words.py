"""Words about a registered effect: its claim, how it would show, and the meaning of its parameters."""

from functools import cache

from cusick_bench.sim.effects import Effect, registered
from cusick_bench.sim.effects.effect_timing import acts_later, in_lab

_CLAIMS = {
    "none": "nothing is missing in the base model",
    "unknown": "something that is not on the list of effects",
}


def claim(name: str) -> str:
    """What would have happened if a cause acts.

    Args:
        name: An effect, `none` or `unknown`.

    Returns:
        A clause; "" where the effect is not registered.
    """
    known = registered().get(name)
    return _CLAIMS.get(name, known.summary if known else "")


def physics(name: str) -> str:
    """What an effect does, with its equation.

    Args:
        name: The effect.

    Returns:
        Sentences; "" where the effect is not registered.
    """
    known = registered().get(name)
    return known.physics.replace("`", "") if known else ""


def parameter_meaning(name: str, parameter: str) -> str:
    """What a parameter of an effect is.

    Args:
        name: The effect.
        parameter: Its parameter.

    Returns:
        A clause; "" where either is not registered.
    """
    known = registered().get(name)
    return next((p.summary for p in known.parameters if p.name == parameter), "") if known else ""


@cache
def signature(name: str, turns_with_cloth: bool = False) -> str:
    """What an effect would show if it acts, and by what it can be known.

    Args:
        name: The effect.
        turns_with_cloth: Whether the direction of an effect of plate or camera was found to turn with the cloth.

    Returns:
        Sentences; "" where the effect is not registered.
    """
    known = registered().get(name)
    return "" if known is None else " ".join(_signs(known, turns_with_cloth))


def _signs(effect: Effect, turns_with_cloth: bool) -> list[str]:
    signs = []
    if effect.kind == "imaging":
        signs.append("Changes the picture, not the cloth: other samples on the same camera show it too.")
    if in_lab(effect) and turns_with_cloth:
        signs.append("Turns over with the cloth here, though it would keep its direction on the bench by its nature.")
    elif in_lab(effect):
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
