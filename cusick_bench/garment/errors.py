"""Errors of garments."""

from cusick_bench.sim.errors import CusickError


class GarmentError(CusickError, ValueError):
    """A garment cannot be made as asked (size, cloth, number of draws)."""
