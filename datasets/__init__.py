"""Drape data: silhouettes, meshes and what is known of the cloths, from the public release or one's own lab."""

from cusick_bench.datasets.dataset import DrapeDataset, DrapeSample
from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.profile import Profile
from cusick_bench.datasets.registry import REGISTRY, load
from cusick_bench.datasets.splits import Split

__all__ = ["REGISTRY", "DataError", "DrapeDataset", "DrapeSample", "Profile", "Split", "load"]
