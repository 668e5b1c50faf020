"""What a run says of its surroundings: cores, also where a container has a quota of them, and the code."""

import os
import shutil
import subprocess
import sys

import pytest

from cusick_bench.runner import environment
from cusick_bench.runner.environment import cores


@pytest.mark.parametrize(
    ("memberships", "quotas", "expected"),
    [
        ("0::/\n", {"cpu.max": "200000 100000"}, 2),
        ("0::/job/step\n", {"job/cpu.max": "150000 100000", "job/step/cpu.max": "max 100000"}, 2),
        ("0::/job/step\n", {"job/cpu.max": "800000 100000", "job/step/cpu.max": "30000 100000"}, 1),
        ("3:cpuset:/\n2:cpu,cpuacct:/\n0::/\n", {"cpu,cpuacct/cpu.cfs_quota_us": "300000"}, 3),
        ("1:cpu:/pod\n", {"cpu/pod/cpu.cfs_quota_us": "-1"}, 8),
        ("0::/\n", {"cpu.max": "900000 100000"}, 8),
        ("0::/../outside\n", {}, 8),
        ("", {}, 8),
    ],
)
def test_a_containers_quota_counts(tmp_path, monkeypatch, memberships, quotas, expected):
    for name, quota in quotas.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(quota + "\n")
        file.with_name("cpu.cfs_period_us").write_text("100000\n")
    (tmp_path / "memberships").write_text(memberships)
    monkeypatch.setattr(environment, "_GROUPS", tmp_path)
    monkeypatch.setattr(environment, "_MEMBERSHIPS", tmp_path / "memberships")
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert cores() == expected


_FOUND = """
import sys
from pathlib import Path
from cusick_bench.runner.environment import _git
folder = Path(sys.argv[1])
assert Path(_git(folder, "rev-parse", "--show-toplevel")).resolve() == folder.resolve()
"""


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_a_checkout_is_known_by_a_name_that_the_locale_has_no_characters_for(tmp_path):
    """Runs ended in a traceback, as under Windows, whose code pages are not what git writes."""
    folder = tmp_path / "Иван"
    subprocess.run(["git", "init", "--quiet", str(folder)], check=True)
    ascii_only = os.environ | {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    command = [sys.executable, "-c", _FOUND, os.fsencode(folder)]
    done = subprocess.run(command, env=ascii_only, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
