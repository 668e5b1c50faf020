"""Nothing in the package unpickles, evaluates or loads what could run code: looked for in the source itself."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted(
    path
    for folder in ("cusick_bench", "sim", "solvers", "datasets")
    for path in (ROOT / folder).rglob("*.py")
    if not any(part.is_symlink() for part in [path, *path.parents] if part.is_relative_to(ROOT))
)
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal", "yaml", "joblib"}
CALLS = {"eval", "exec", "compile", "torch.load", "np.fromregex", "pd.read_pickle", "os.system", "os.popen"}


def name_of(node: ast.expr) -> str:
    """`torch.load` of such an expression."""
    if isinstance(node, ast.Attribute):
        return f"{name_of(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def unsafe(tree: ast.AST) -> list[str]:
    """What a module imports or calls that could run what it reads."""
    found: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name.split(".")[0] in MODULES]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in MODULES:
            found.append(node.module or "")
        elif isinstance(node, ast.Call):
            name = name_of(node.func)
            pickled = any(k.arg == "allow_pickle" and getattr(k.value, "value", True) for k in node.keywords)
            shell = any(k.arg == "shell" and getattr(k.value, "value", True) for k in node.keywords)
            loads = name == "np.load" and not any(k.arg == "allow_pickle" for k in node.keywords)
            if name in CALLS or pickled or shell or loads:
                found.append(name)
    return found


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from yaml import load",
        "torch.load(path)",
        "np.load(p)",
        "np.load(p, allow_pickle=True)",
        "eval(x)",
    ],
)
def test_unsafe_calls_are_found(source):
    assert unsafe(ast.parse(source))


def test_no_module_can_run_what_it_reads():
    assert len(SOURCES) > 200
    found = {str(path.relative_to(ROOT)): unsafe(ast.parse(path.read_text(encoding="utf-8"))) for path in SOURCES}
    assert {path: calls for path, calls in found.items() if calls} == {}


def test_files_of_others_have_one_reader_each():
    """JSON, arrays and tables are read in `cusick_bench.files`; elsewhere only what the program wrote itself."""
    own = {
        "json.loads": {"cusick_bench/cli/data/synthetic.py", "cusick_bench/leaderboard/cells/variants.py"}
        | {"cusick_bench/leaderboard/verification/submit.py", "cusick_bench/files/json_file.py"}
        | {"cusick_bench/problem/metering/journal.py", "cusick_bench/runner/grid.py"}
        | {"cusick_bench/leaderboard/verification/tracks.py"},
        "json.load": set(),
        "np.load": {"datasets/files/measure.py", "cusick_bench/problem/metering/journal.py"},
        "csv.reader": {"cusick_bench/files/csv_file.py"},
    }
    for call, places in own.items():
        found = {
            str(path.relative_to(ROOT))
            for path in SOURCES
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call) and name_of(node.func) == call
        }
        assert found <= places, f"{call} outside of cusick_bench.files: {sorted(found - places)}"
