"""A small suite of withheld cases and the answers to it, made once for all tests."""

from pathlib import Path

import numba
import pytest

from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.diagnose import Options
from cusick_bench.withheld.answers.blind import answer_suite
from cusick_bench.withheld.suite.generate import Suite, generate


@pytest.fixture(scope="session")
def small_suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `cases` and `labels`: a null, a listed effect and one that is on no list."""
    folder = tmp_path_factory.mktemp("suite")
    counts = {"null": 1, "single": 1, "pair": 0, "unknown": 1}
    generate(Suite(3, counts, 250, 4, None), folder / "cases", folder / "labels")  # pyright: ignore[reportArgumentType]
    return folder


@pytest.fixture(scope="session")
def small_answers(small_suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Answers to the small suite, without simulations; copy the file before changing it."""
    out = tmp_path_factory.mktemp("answers") / "answers.json"
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    answer_suite(small_suite / "cases", out, SHIPPED, Options(samples=0, always=False))  # as the command
    numba.set_num_threads(before)
    return out
