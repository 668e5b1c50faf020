"""Skirts from a digitised cloth: cut, sewn, hung on a waist, let fall and moved."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.garment.body import Body
    from cusick_bench.garment.cloth import Cloth, cloth_of_cell, cloth_of_numbers
    from cusick_bench.garment.errors import GarmentError
    from cusick_bench.garment.fitting import Fitting, hang, walk
    from cusick_bench.garment.measurement import SkirtMeasures, measure, spread
    from cusick_bench.garment.motion import STILL, WaistMotion
    from cusick_bench.garment.skirt import KINDS, Skirt, SkirtSize, a_line_skirt, circular_skirt

__all__ = [
    "KINDS",
    "STILL",
    "Body",
    "Cloth",
    "Fitting",
    "GarmentError",
    "Skirt",
    "SkirtMeasures",
    "SkirtSize",
    "WaistMotion",
    "a_line_skirt",
    "circular_skirt",
    "cloth_of_cell",
    "cloth_of_numbers",
    "hang",
    "measure",
    "spread",
    "walk",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Body": "body",
        "Cloth": "cloth",
        "Fitting": "fitting",
        "GarmentError": "errors",
        "KINDS": "skirt",
        "STILL": "motion",
        "Skirt": "skirt",
        "SkirtMeasures": "measurement",
        "SkirtSize": "skirt",
        "WaistMotion": "motion",
        "a_line_skirt": "skirt",
        "circular_skirt": "skirt",
        "cloth_of_cell": "cloth",
        "cloth_of_numbers": "cloth",
        "hang": "fitting",
        "measure": "measurement",
        "spread": "measurement",
        "walk": "fitting",
    },
)
