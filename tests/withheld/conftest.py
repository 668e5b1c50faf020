"""A small suite of withheld cases and the answers to it, made once for all tests and by one of their processes."""

import os
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.diagnose import Options
from cusick_bench.files.folder_lock import locked
from cusick_bench.withheld.answers.blind import answer_suite
from cusick_bench.withheld.suite.generate import Suite, generate


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that is filled by the process that asks for it first; the others wait."""
    root = factory.getbasetemp()
    root = root.parent if os.environ.get("PYTEST_XDIST_WORKER") else root
    with locked(root):
        folder = root / name
        if not folder.exists():
            unfinished = factory.mktemp(name)
            make(unfinished)
            unfinished.rename(folder)
    return folder


@pytest.fixture(scope="session")
def small_suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `cases` and `labels`: a null, a listed effect and one that is on no list."""
    counts = {"null": 1, "single": 1, "pair": 0, "unknown": 1}
    suite = Suite(3, counts, 250, 4, None)  # pyright: ignore[reportArgumentType]
    return made_once(
        tmp_path_factory, "small-suite", lambda folder: generate(suite, folder / "cases", folder / "labels")
    )


@pytest.fixture(scope="session")
def small_answers(small_suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Answers to the small suite, without simulations; copy the file before changing it."""

    def answer(folder: Path) -> None:
        options = Options(samples=0, always=False)  # as the command
        before = numba.get_num_threads()
        numba.set_num_threads(1)
        answer_suite(small_suite / "cases", folder / "answers.json", SHIPPED, options)
        numba.set_num_threads(before)

    return made_once(tmp_path_factory, "small-answers", answer) / "answers.json"
