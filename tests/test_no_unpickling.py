"""No file is ever read by what can run code that stands in it: no pickle, no torch.load, no YAML."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("cusick_bench", "sim", "solvers", "datasets", "leaderboards", "docs")
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "yaml", "ruamel", "jsonpickle"}
FUNCTIONS = {("torch", "load"), ("pd", "read_pickle"), ("pandas", "read_pickle"), ("torch.jit", "load")}


def _faults(source: str) -> Iterator[str]:
    """What a source does that it must not, with the line."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            names = []
        yield from (f"line {node.lineno}: import {name}" for name in names if name.partition(".")[0] in MODULES)
        yield from (f"line {node.lineno}: import {name}" for name in names if name == "torch.load")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            called = ast.unparse(node.func.value), node.func.attr
            given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
            if called in FUNCTIONS:
                yield f"line {node.lineno}: {'.'.join(called)}"
            if called in {("np", "load"), ("numpy", "load")} and given.get("allow_pickle") != "False":
                yield f"line {node.lineno}: np.load without allow_pickle=False"


@pytest.mark.parametrize("folder", FOLDERS)
def test_nothing_is_unpickled(folder):
    files = [path for path in (ROOT / folder).rglob("*.py") if not any(part.is_symlink() for part in path.parents)]
    assert files
    found = {str(path): list(_faults(path.read_text(encoding="utf-8"))) for path in files}
    assert {path: faults for path, faults in found.items() if faults} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from yaml import safe_load",
        "from torch import load",
        "import torch\ntorch.load(path)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "pd.read_pickle(path)",
    ],
)
def test_what_must_not_be_is_found(source):
    assert list(_faults(source))
