"""A package elsewhere, as `tests/example_package` is one: installed, its solver and its effect are used by name."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.runner.numerics import diagnosis_numerics
from cusick_bench.sim.effects.registry import registered

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "tests" / "example_package"
MODULES = {"add-solver.md": "random_search.py", "add-effect.md": "weak_gravity.py"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of installed packages that has the example, and what pip has written about it."""
    copy, folder = tmp_path_factory.mktemp("source") / "example", tmp_path_factory.mktemp("site")
    for path in EXAMPLE.rglob("*"):
        if path.suffix in (".py", ".toml"):
            (copy / path.relative_to(EXAMPLE)).parent.mkdir(parents=True, exist_ok=True)
            (copy / path.relative_to(EXAMPLE)).write_bytes(path.read_bytes())
    options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation", "--no-index"]
    command = [sys.executable, "-m", "pip", "install", *options, "--target", str(folder), str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def installed(site: Path, monkeypatch: pytest.MonkeyPatch):
    """The package is installed for as long as a test lasts."""
    monkeypatch.syspath_prepend(site)
    registered.cache_clear()
    yield
    monkeypatch.undo()
    registered.cache_clear()
    for name in [name for name in sys.modules if name.partition(".")[0] == "cusick_example"]:
        del sys.modules[name]


def _json(*words: str) -> dict:
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.usefixtures("installed")
def test_both_are_listed():
    solvers = {solver["name"]: solver for solver in _json("solvers")["solvers"]}
    effects = {effect["name"]: effect for effect in _json("effects")["effects"]}
    assert solvers["random-search"]["summary"] == "best of prior draws"
    assert effects["weak-gravity"]["class"] == "boundary"


@pytest.mark.usefixtures("installed")
def test_a_diagnosis_that_can_name_the_effect_is_another_one():
    """What was found without the package, which cannot name it, counted as found with it."""
    assert diagnosis_numerics()["effect weak-gravity"] == 1


def test_without_the_package_nobody_knows_them():
    assert "effect weak-gravity" not in diagnosis_numerics()
    assert "random-search" not in {solver["name"] for solver in _json("solvers")["solvers"]}


@pytest.mark.usefixtures("installed", "one_thread")
def test_a_run_fits_with_the_solver_under_the_effect(tmp_path: Path):
    words = ["run", "--cloth", "fabric_1", "--solver", "random-search", "--vertices", "97", "--steps", "5"]
    words += ["--budget", "16", "--out", str(tmp_path / "run")]
    (cell,) = _json(*words, "--with-effect", "weak-gravity:loss=0.3")["cells"]
    assert cell["status"] == "done"
    assert cell["forward_equivalents"] == 16
    record = json.loads((Path(cell["path"]) / "cell.json").read_text())
    assert record["settings"]["causes"] == ["weak-gravity:loss=0.3"]
    (nominal,) = _json(*words)["cells"]
    assert nominal["train_mse"] != cell["train_mse"]


@pytest.mark.parametrize("page", MODULES)
def test_the_pages_show_these_modules(page: str):
    """What the documentation explains is what is installed here, to the letter."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    shown = re.search(r"```python\n(.*?)```", text, re.S)
    assert shown is not None
    module = (EXAMPLE / "cusick_example" / MODULES[page]).read_text(encoding="utf-8")
    assert module.split('"""\n\n', 1)[1] == shown[1]
