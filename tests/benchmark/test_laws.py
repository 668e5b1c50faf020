"""Laws side by side: steps on one mesh, and time at equal error."""

import pytest

from cusick_bench.benchmark import laws
from cusick_bench.benchmark.convergence.reference import PlateComparison
from cusick_bench.benchmark.laws import compare_steps, equal_error


class _Row:
    def __init__(self, folds):
        self.folds, self.ln_bending, self.poisson = folds, -6.6, 0.0


def test_steps_of_both_laws_are_timed_on_one_mesh():
    found = compare_steps(97, 2)
    assert set(found["step"]) == set(found["phases"]) == {"plate", "paper"}
    assert found["ratio"]["median"] > 0
    assert found["phases"]["plate"]["factorisation"]["rounds"] == 2
    assert found["factor"]["plate"]["blocks_a_row"] > found["factor"]["paper"]["blocks_a_row"]


def test_a_row_counts_with_the_smallest_mesh_that_is_near_enough(monkeypatch):
    """A law whose error falls as 1 / vertices, a hundred times as slowly for the second law."""

    def compare(drapes, sizes, law):
        error = (100 if law == "plate" else 10_000) / sizes[0]
        values = dict.fromkeys(PlateComparison.__annotations__)
        return [
            PlateComparison(**values | vars(drape) | {"vertices": sizes[0], "error_points": error, "seconds": sizes[0]})
            for drape in drapes
        ]

    monkeypatch.setattr(laws, "compare_with_reference", compare)
    found = equal_error([_Row(0), _Row(8)], [300, 100, 1000])  # pyright: ignore[reportArgumentType]
    assert [row["vertices"] for row in found["plate"]["rows"]] == [300, 300]
    assert all(row["reached"] for row in found["plate"]["rows"])
    assert not any(row["reached"] for row in found["paper"]["rows"])
    assert [row["vertices"] for row in found["paper"]["rows"]] == [1000, 1000]
    assert found["times_faster"] == pytest.approx(1000 / 300)


def test_a_size_that_is_named_twice_is_tried_once(monkeypatch):
    def compare(drapes, sizes, law):
        values = dict.fromkeys(PlateComparison.__annotations__)
        near = [law == "plate" and not drape.folds for drape in drapes]
        return [
            PlateComparison(**values | vars(drape) | {"error_points": 0.1 if ok else 9.0, "seconds": 2.0})
            for drape, ok in zip(drapes, near, strict=True)
        ]

    monkeypatch.setattr(laws, "compare_with_reference", compare)
    once, twice = (equal_error([_Row(0), _Row(8)], sizes) for sizes in ([100], [100, 100]))  # pyright: ignore[reportArgumentType]
    assert twice == once


def test_a_row_that_the_first_law_never_reaches_is_not_compared(monkeypatch):
    def compare(drapes, sizes, law):
        values = dict.fromkeys(PlateComparison.__annotations__)
        return [
            PlateComparison(**values | vars(drape) | {"error_points": 9.0 if drape.folds else 0.1, "seconds": 2.0})
            for drape in drapes
        ]

    monkeypatch.setattr(laws, "compare_with_reference", compare)
    found = equal_error([_Row(8), _Row(0)], [100])  # pyright: ignore[reportArgumentType]
    assert [row["folds"] for row in found["plate"]["rows"]] == [8, 0]
    assert found["plate"]["seconds"] == found["paper"]["seconds"] == 2.0
    assert equal_error([_Row(8)], [100])["times_faster"] is None  # pyright: ignore[reportArgumentType]
