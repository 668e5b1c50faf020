"""Samples that are kept for the cells that follow: bounded in bytes, and at least one."""

import pytest
from toy_cloths import image_path, write_toy

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.runner.samples import SampleCache, read_repeats, read_sample, readable_rows


@pytest.fixture(scope="module")
def dataset(make_lab) -> DrapeDataset:
    return load(make_lab((2.0, 4.0), samples=2))


def test_what_was_read_last_is_kept_within_the_bound(dataset):
    size = dataset.sample(0).image.nbytes
    cache = SampleCache(dataset, most_bytes=int(2.5 * size))
    first, second = cache.read(0), cache.read(1)
    assert (cache.read(0), cache.read(1), cache.read(0)) == (first, second, first)
    cache.read(2)  # the one that was read longest ago, 1, has to go
    assert cache.read(0) is first
    assert cache.read(1) is not second


def test_a_sample_larger_than_the_bound_is_kept_alone(dataset):
    cache = SampleCache(dataset, most_bytes=1)
    first = cache.read(0)
    assert cache.read(0) is first
    cache.read(1)
    assert cache.read(0) is not first


def test_cells_of_a_process_share_what_is_kept(dataset):
    assert read_sample(dataset, 0) is read_sample(dataset, 0)


def test_a_repeat_that_cannot_be_read_is_left_out(tmp_path):
    """A damaged second capture, which nothing else uses, failed every fit of its cloth when it was scored."""
    root = write_toy(tmp_path, captures=2, meshes=False)
    assert len(read_repeats(load(root), "fabric_7")) == 3
    image_path(root, 3, 2).write_bytes(b"no picture")
    dataset = load(root)
    assert len(read_repeats(dataset, "fabric_7")) == 2
    assert readable_rows(dataset, [5, 4, 3]) == [4, 3]
