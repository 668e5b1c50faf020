"""A package elsewhere, installed for a test: a module, and the entry points by which its solvers are found."""

from pathlib import Path

import pytest

REPLIES = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cusick_bench.solvers.base import Prediction, Solver


def answer(problem, **further):
    """An answer without a search: the training image itself."""
    return Prediction(train_image=problem.train_image, draws=problem.train_image[None], **further)

'''
"""Beginning of a module with solvers: what it needs, and an answer."""


def install(
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    module: str,
    text: str,
    solvers: dict[str, str],
    *,
    distribution: str = "",
    requires: tuple[str, ...] = (),
) -> None:
    """Puts a package on the path of this process, and of those that it starts, for as long as a test lasts.

    Args:
        monkeypatch: Of the test.
        folder: New folder for the package.
        module: Name of its only module, unlike that of every other test.
        text: Contents of the module.
        solvers: Class of each solver by its name.
        distribution: Name by which the package is installed; the module's by default.
        requires: Packages that it says it needs.
    """
    name = distribution or module
    info = folder / f"{name.replace('-', '_')}-1.5.dist-info"
    info.mkdir(parents=True)
    (folder / f"{module}.py").write_text(text, encoding="utf-8")
    needs = "".join(f"Requires-Dist: {one}\n" for one in requires)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.5\n{needs}", encoding="utf-8")
    entries = "".join(f"{solver} = {module}:{kind}\n" for solver, kind in solvers.items())
    (info / "entry_points.txt").write_text(f"[cusick_bench.solvers]\n{entries}", encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
