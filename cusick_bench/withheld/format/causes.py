"""Possible causes of a gap: names, classes, and groups that silhouettes do not tell apart.

Names and classes are written out, because answers and labels that were frozen years ago must mean the same today; a
package's further effects are known by their registration.
"""

from collections.abc import Collection

from cusick_bench.diagnosis.inference.single_effects.equivalents import ABSORBED, EQUIVALENTS
from cusick_bench.sim.effects import registered

NONE, UNKNOWN = "none", "unknown"
STIFFNESS = "B/rho"  # the base model's own ratio of bending stiffness to weight, as a member of a set
CLASSES = ("material", "history", "boundary", "contact", "imaging")

EFFECTS: dict[str, str] = {
    **dict.fromkeys(
        (
            "rest-curvature",
            "face-asymmetry",
            "grain-skew",
            "density-bias",
            "stiffness-field",
            "local-stiff-patch",
            "local-mass-patch",
            "rim-stiffening",
        ),
        "material",
    ),
    **dict.fromkeys(("creep", "bending-friction", "shear-friction"), "history"),
    **dict.fromkeys(("off-centre", "plate-tilt", "plate-radius", "plate-slip", "cut-size"), "boundary"),
    "self-contact": "contact",
    **dict.fromkeys(("camera-scale", "camera-offset", "camera-tilt", "perspective", "threshold"), "imaging"),
}
"""Class of each effect."""


LARGEST_SET = max(len(group.effects) for group in EQUIVALENTS)  # a set of more names than any group says nothing


def effect_classes() -> dict[str, str]:
    """Class of each effect that an answer or a label may name.

    Returns:
        The class by name.
    """
    return {name: effect.kind for name, effect in registered().items()} | EFFECTS


def outcomes() -> tuple[str, ...]:
    """Everything that probability may be given to.

    Returns:
        `none`, each effect, and `unknown` for an effect outside the list.
    """
    return (NONE, *effect_classes(), UNKNOWN)


def class_of(name: str) -> str:
    """Class of an effect; `none` and `unknown` are classes of their own.

    Args:
        name: Name of the effect.

    Returns:
        Its class.
    """
    if name in EFFECTS:
        return EFFECTS[name]
    effect = registered().get(name)
    return effect.kind if effect else name


def is_equivalent_set(effect: str, named: Collection[str]) -> bool:
    """Whether silhouettes cannot tell the causes of a set from an effect, so that naming the set is all they allow.

    That is so if the set lies within the effect's group of equivalents. The partners of an absorbed effect are
    parameters, not effects: there the set must hold it, among few others.

    Args:
        effect: The true effect.
        named: The set of causes.

    Returns:
        True for such a set.
    """
    members = frozenset(named)
    if not members or len(members) > LARGEST_SET:
        return False
    if effect in ABSORBED.effects:
        return effect in members
    return any(effect in group.effects and members <= group.effects for group in EQUIVALENTS)


def typical_severity(effect: str) -> float:
    """Severity that is met in practice.

    Args:
        effect: Name of the effect.

    Returns:
        The severity in the effect's own unit; NaN for an effect that is not registered.
    """
    known = registered().get(effect)
    return abs(known.severity.typical) if known else float("nan")
