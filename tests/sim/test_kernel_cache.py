"""A kernel on disk must not outlive a change of a function that was compiled into it from another file."""

import ast
from pathlib import Path

import pytest
from numba.core import config

import cusick_bench
from cusick_bench.sim import kernel_cache

ROOT = Path(cusick_bench.__file__).parent


def _compiled(tree: ast.Module) -> set[str]:
    """Functions of a file that numba compiles."""
    found = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    return {
        f.name for f in found if any("njit" in ast.unparse(d) or "kernel" in ast.unparse(d) for d in f.decorator_list)
    }


def test_kernels_lie_where_the_content_of_called_files_says(monkeypatch, tmp_path):
    def folder() -> str:
        monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
        kernel_cache.keep_by_content()
        return config.CACHE_DIR

    called = tmp_path / "sim" / "laws" / "paper.py"
    called.parent.mkdir(parents=True)
    called.write_text("stiffness = 1")
    monkeypatch.setattr(kernel_cache, "__file__", str(tmp_path / "sim" / "kernel_cache.py"))
    before = folder()
    assert folder() == before
    called.write_text("stiffness = 2")
    others = tmp_path / "kernels-of-mine"  # in a folder that the user has named
    others.mkdir()
    assert folder() != before
    assert not Path(before).exists()  # nobody reads it any more
    assert others.exists()


@pytest.mark.parametrize("asked", [True, False], ids=["NUMBA_CACHE_DIR", "nothing"])
def test_where_nothing_can_be_kept_a_warning_says_so(monkeypatch, tmp_path, caplog, asked):
    occupied = tmp_path / "file"
    occupied.write_text("")
    monkeypatch.setattr(kernel_cache, "__file__", str(occupied / "kernel_cache.py"))
    monkeypatch.setattr(config, "CACHE_DIR", str(occupied) if asked else "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(occupied))
    kernel_cache.keep_by_content()
    assert Path(config.CACHE_DIR).is_dir()
    assert str(occupied) in caplog.text
    assert "set NUMBA_CACHE_DIR" in caplog.text


def test_kernels_beside_a_package_that_cannot_be_written_lie_in_the_users_cache(monkeypatch, tmp_path, caplog):
    occupied = tmp_path / "file"
    occupied.write_text("")
    monkeypatch.setattr(kernel_cache, "__file__", str(occupied / "kernel_cache.py"))
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setattr(kernel_cache.platformdirs, "user_cache_path", lambda name: tmp_path / name)
    kernel_cache.keep_by_content()
    assert Path(config.CACHE_DIR).parent == tmp_path / "cusick-bench"
    assert not caplog.text


def test_every_file_with_kernels_knows_the_folder_before_it_defines_them():
    for folder in (folder for folder in ROOT.iterdir() if folder.is_dir()):
        for path in folder.rglob("*.py"):
            tree = ast.parse(path.read_text())
            if any("numba.njit" in ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.expr)):
                imported = [node.module for node in tree.body if isinstance(node, ast.ImportFrom)]
                assert "cusick_bench.sim.kernel_cache" in imported, path


def test_every_file_whose_kernels_others_call_is_watched():
    folders = [folder for folder in ROOT.iterdir() if folder.is_dir()]  # some are links, which rglob would not enter
    trees = {path: ast.parse(path.read_text()) for folder in folders for path in folder.rglob("*.py")}
    compiled = {path: _compiled(tree) for path, tree in trees.items()}
    assert ROOT / "sim" / "laws" / "paper.py" in trees
    watched = {path for pattern in kernel_cache.CALLED for path in ROOT.glob(pattern)}
    for path, tree in trees.items():
        for node in ast.walk(tree) if compiled[path] else ():
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("cusick_bench."):
                source = ROOT / (str(node.module).removeprefix("cusick_bench.").replace(".", "/") + ".py")
                names = {alias.name for alias in node.names}
                assert not names & compiled.get(source, set()) or source in watched, f"{path} calls kernels of {source}"


def test_no_kernel_of_the_simulator_may_be_rounded_as_the_compiler_likes():
    """With `fastmath` the rounding depends on what was inlined: on which process compiled the kernel."""
    for path in sorted((ROOT / "sim").rglob("*.py")):
        words = {
            word.arg for word in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(word, ast.keyword)
        }
        assert "fastmath" not in words, path
