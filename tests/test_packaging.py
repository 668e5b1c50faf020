"""What `pip install cusick-bench` brings: every package that the code imports is declared, and pinned for CI."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("cusick_bench", "sim", "solvers", "datasets")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def normalised(requirement: str) -> str:
    """Name of a distribution as indices compare it (PEP 503), without version or extras."""
    name = re.match(r"[\w.-]+", requirement)
    assert name, requirement
    return re.sub(r"[-_.]+", "-", name[0]).lower()


def imported(path: Path) -> Iterator[str]:
    """Top-level names of all import statements of a file, also of those inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0]


def third_party() -> dict[str, Path]:
    """Every top-level name of another package that the product imports, with one file that does."""
    ours = {"cusick_bench", *sys.stdlib_module_names}
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    return {name: path for path in files for name in imported(path) if name not in ours}


DECLARED = {normalised(requirement) for requirement in PROJECT["dependencies"]}
ASKED_FOR = {normalised(one) for extra in ("slurm", "parquet") for one in PROJECT["optional-dependencies"][extra]}
"""Packages that one command needs, which names the extra where they are missing."""
DISTRIBUTIONS = packages_distributions()


@pytest.mark.parametrize(("name", "path"), third_party().items(), ids=third_party())
def test_an_imported_package_is_a_plain_dependency(name, path):
    found = {normalised(distribution) for distribution in DISTRIBUTIONS.get(name, [name])}
    assert found & (DECLARED | ASKED_FOR), f"{path.relative_to(ROOT)} imports {name}, not declared in pyproject.toml"


def test_every_dependency_is_pinned():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = {normalised(line): line for line in lines if line and not line.startswith("#")}
    assert set(pins) >= DECLARED, DECLARED - set(pins)
    loose = [line for line in pins.values() if "==" not in line]
    assert not loose


def test_the_packages_that_the_project_is_named_for_come_with_it():
    named = {"torch", "botorch", "gpytorch", "nlopt", "cvxpy", "cma", "trimesh", "pandas"}
    assert named <= DECLARED


def test_optional_packages_are_those_that_are_looked_for_only():
    """A package of an extra is found by name while running; an import statement would break without it."""
    extras = {
        normalised(requirement)
        for extra, requirements in PROJECT["optional-dependencies"].items()
        if extra not in ("dev", "docs", "browser", "croissant", "audit")
        for requirement in requirements
    }
    assert extras - ASKED_FOR == {"pypardiso", "cvxopt", "ipctk"}
    assert not extras & DECLARED
