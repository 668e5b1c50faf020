"""How an effect acts: whether only later captures show it, and whether its direction is the cloth's or the camera's."""

from functools import lru_cache

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.effects.base import Effect
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.setup import Setup

_STANDARD = DrapeSettings()


@lru_cache(maxsize=64)
def acts_later(effect: Effect, settings: DrapeSettings = _STANDARD) -> bool:
    """Whether an effect is seen in later captures only.

    Args:
        effect: The effect.
        settings: How drapes are simulated, which an effect may go by.

    Returns:
        True if it leaves the first capture as it is; False of one that refuses the cloth that it is tried on.
    """
    first = Setup(disc_mesh(60), settings, uniform_material(density=0.15, bending=1e-5))
    try:
        return effect.apply(first, {}) is first
    except SimulationError:
        return False


def in_lab(effect: Effect) -> bool:
    """Whether an effect's direction is the laboratory's rather than the cloth's.

    Args:
        effect: The effect.

    Returns:
        True for directions of boundary and camera.
    """
    return effect.located == "direction" and effect.kind in ("boundary", "imaging")
