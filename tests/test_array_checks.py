"""Arrays are checked against their annotations, in tests alone and in the first calls of every function."""

from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import array_checks
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from cusick_bench.metrics.distributions.proper_scores import crps

MODULE = """
from dataclasses import dataclass
from functools import cached_property
from jaxtyping import Float
from numpy import ndarray

@dataclass
class Pair:
    first: Float[ndarray, "n"]
    second: Float[ndarray, "n"]
    label: int = 0

class Sums:
    @property
    def none(self) -> Float[ndarray, ""]:
        return 0.0

    @cached_property
    def all(self) -> Float[ndarray, "n"]:
        return 0.0

    @staticmethod
    def of(values: Float[ndarray, "n"]) -> Float[ndarray, "n"]:
        return values

    @classmethod
    def made(cls, values: Float[ndarray, "n"]) -> float:
        return 0.0

    def __call__(self, values: Float[ndarray, "n"], weights: Float[ndarray, "n"] | None = None) -> float:
        return 0.0

def with_inner(values: Float[ndarray, "n"]) -> int:
    def inner(values: Float[ndarray, "n n"]) -> None: ...
    inner(values)
    return "no int, which is not looked at"

def named(text: int) -> int:
    return text
"""
THREE, FOUR, SQUARE = np.zeros(3), np.zeros(4), np.zeros((3, 3))


@pytest.fixture
def module(tmp_path: Path):
    path = tmp_path / "arrays_to_check.py"
    path.write_text(MODULE)
    loader = array_checks.CheckingLoader("arrays_to_check", str(path))
    made = module_from_spec(spec_from_loader("arrays_to_check", loader))
    loader.exec_module(made)
    return made


def test_right_arrays_pass(module):
    sums = module.Sums()
    assert module.Pair(THREE, THREE, "no int").first is THREE
    assert sums.of(THREE) is THREE
    assert module.Sums.made(THREE) == sums(THREE) == sums(THREE, THREE) == 0
    assert module.with_inner(THREE)
    assert module.named("text") == "text"


@pytest.mark.parametrize(
    "call",
    [
        lambda module: module.Pair(THREE, FOUR),
        lambda module: module.Sums().none,
        lambda module: module.Sums().all,
        lambda module: module.Sums.of(SQUARE),
        lambda module: module.Sums.made(SQUARE),
        lambda module: module.Sums()(THREE, FOUR),
        lambda module: module.with_inner(SQUARE),
        lambda module: module.with_inner(THREE.astype(int)),
    ],
)
def test_wrong_arrays_are_told(module, call):
    with pytest.raises(TypeCheckError):
        call(module)


def test_first_calls_are_checked(module):
    for _ in range(array_checks.CALLS):
        with pytest.raises(TypeCheckError):
            module.Sums.of(SQUARE)
    assert module.Sums.of(SQUARE) is SQUARE
    array_checks.calls_left.clear()
    with pytest.raises(TypeCheckError):
        module.Sums.of(SQUARE)


def test_the_packages_arrays_are_checked():
    assert crps(THREE, FOUR) == 0
    with pytest.raises(TypeCheckError):
        crps(SQUARE, FOUR)


@pytest.mark.unchecked_arrays
def test_not_in_tests_of_what_users_are_told(module):
    assert module.Sums.of(SQUARE) is SQUARE
