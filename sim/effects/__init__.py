"""Effects that the base model leaves out, one in a file: physics, units, bounds, typical range with source."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.sim.effects.base import Effect, EffectClass, Parameter, Values
    from cusick_bench.sim.effects.registry import Cause, apply_all, effect, parse, registered, require_repeatable

NUMERICS_VERSION = 1  # raised when an effect's numbers change: see runner/numerics.py

__all__ = [
    "Cause",
    "Effect",
    "EffectClass",
    "Parameter",
    "Values",
    "apply_all",
    "effect",
    "parse",
    "registered",
    "require_repeatable",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Cause": "registry",
        "Effect": "base",
        "EffectClass": "base",
        "Parameter": "base",
        "Values": "base",
        "apply_all": "registry",
        "effect": "registry",
        "parse": "registry",
        "registered": "registry",
        "require_repeatable": "registry",
    },
)
