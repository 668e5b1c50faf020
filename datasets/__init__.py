"""Drape data: silhouettes, meshes and properties of the cloths, from the public release or your own laboratory.

Names are imported when they are first used, so that measuring a profile does not import pandas.
"""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.datasets.dataset import DrapeDataset, DrapeSample
    from cusick_bench.datasets.errors import DataError
    from cusick_bench.datasets.loading import load
    from cusick_bench.datasets.profile import Profile
    from cusick_bench.datasets.registry import REGISTRY
    from cusick_bench.datasets.splits import Split

_MODULES = {
    "REGISTRY": "registry",
    "DataError": "errors",
    "DrapeDataset": "dataset",
    "DrapeSample": "dataset",
    "Profile": "profile",
    "Split": "splits",
    "load": "loading",
}

NUMERICS_VERSION = 1  # raised when an image's or a profile's numbers change: see runner/numerics.py

__all__ = ["REGISTRY", "DataError", "DrapeDataset", "DrapeSample", "Profile", "Split", "load"]

__getattr__ = lazy_names(__name__, _MODULES)
