"""The data set that `load` gives: the same table, and a `torch.utils.data.Dataset` by its type too."""

from typing import Any

from torch.utils.data import Dataset

from cusick_bench.datasets.dataset import DrapeDataset


class TorchDrapeDataset(DrapeDataset, Dataset[dict[str, Any]]):
    """A `DrapeDataset` that is a torch data set too; a class of its own, so that tables are read without torch."""
