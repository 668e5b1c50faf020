"""What `import cusick_bench` offers: every name of a first script, without waiting for what is not used."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import cusick_bench

IMPORT_SECONDS = 0.05


PACKAGES = [
    "cusick_bench",
    *(f"cusick_bench.{name}" for name in ("datasets", "garment", "leaderboard", "metrics", "problem", "report")),
    "cusick_bench.runner",
    "cusick_bench.sim.effects",
]


def test_every_offered_name_is_the_one_of_its_module():
    for name in cusick_bench.__all__:
        value = getattr(cusick_bench, name)
        assert getattr(import_module(value.__module__), name) is value


@pytest.mark.parametrize("package", PACKAGES)
def test_names_are_listed_once_and_for_type_checkers_too(package):
    offering = import_module(package)
    tree = ast.parse(Path(str(offering.__file__)).read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {
        alias.name: f"{node.module}"
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(imported) == sorted(offering.__all__)
    for name, module in imported.items():
        assert getattr(import_module(module), name) is getattr(offering, name)
        assert not Path(str(offering.__file__)).with_name(f"{name}.py").exists(), f"the module {name} would hide it"


def test_dir_shows_names_that_are_not_imported_yet():
    code = (
        "import cusick_bench; assert set(cusick_bench.__all__) <= set(dir(cusick_bench));print(len(vars(cusick_bench)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(shown.stdout) < len(cusick_bench.__all__)


def test_names_it_does_not_offer_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'drap_coefficient'"):
        cusick_bench.drap_coefficient  # noqa: B018
    with pytest.raises(ImportError):
        from cusick_bench import drap_coefficient  # noqa: F401


def test_import_waits_for_no_library():
    code = (
        "import sys, time; start = time.perf_counter(); import cusick_bench; took = time.perf_counter() - start;"
        "heavy = {'torch', 'numpy', 'pandas', 'numba', 'scipy'} & set(sys.modules);"
        "assert not heavy, heavy; print(took)"
    )
    took = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
        for _ in range(3)
    ]
    assert min(took) < IMPORT_SECONDS
