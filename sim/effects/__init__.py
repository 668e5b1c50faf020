"""What the base model leaves out, one effect a file: physics, units, bounds, typical range with source."""

from cusick_bench.sim.effects.base import Effect, EffectClass, Parameter, Values
from cusick_bench.sim.effects.registry import Cause, apply_all, effect, parse, registered

__all__ = ["Cause", "Effect", "EffectClass", "Parameter", "Values", "apply_all", "effect", "parse", "registered"]

NUMERICS_VERSION = 1  # raised when an effect's numbers change: see runner/numerics.py
