"""Environment of a result, for the record only: the code's commit, library versions, hardware."""

import math
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import cusick_bench
from cusick_bench.runner.labels import numerics_text

_LIBRARIES = ("numpy", "scipy", "torch", "numba", "nlopt", "cvxpy", "botorch", "gpytorch", "cma")
_GROUPS, _MEMBERSHIPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
_GIT_SECONDS = 10.0  # after which a checkout on a slow disk counts as none


def cores() -> int:
    """Processor cores that this process may use: at most a container's quota, rounded up."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(count, _quota())))


def _quota() -> float:
    """Cores that Linux's control groups allow this process at once; infinite where there is no limit."""
    quotas = [math.inf]
    for line in _text(_MEMBERSHIPS).splitlines():
        _, controllers, place = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        root = _GROUPS / controllers
        group = root / place.strip("/")
        for folder in (group, *group.parents):  # a group's limit holds for all groups in it
            if not folder.is_relative_to(root):
                break
            files = ("cpu.cfs_quota_us", "cpu.cfs_period_us") if controllers else ("cpu.max",)
            words = " ".join(_text(folder / name) for name in files).split()
            if len(words) == 2 and words[0].isdigit():  # else "max", -1, or the root itself
                quotas.append(int(words[0]) / int(words[1]))
    return min(quotas)


def _text(file: Path) -> str:
    with suppress(OSError):
        return file.read_text()
    return ""


@lru_cache(maxsize=1)  # a running process keeps the code that it has loaded
def code_state() -> dict[str, Any]:
    """Which code runs.

    Returns:
        `package`, the version of the package; `commit` of its checkout, "" where it runs from none; `dirty`, whether
        tracked files of the checkout were changed.
    """
    root = Path(cusick_bench.__file__).resolve().parents[1]
    top = _git(root, "rev-parse", "--show-toplevel")
    commit = _git(root, "rev-parse", "--short=12", "HEAD") if top and Path(top).resolve() == root else ""
    dirty = bool(commit and _git(root, "status", "--porcelain", "--untracked-files=no"))
    return {"package": cusick_bench.__version__, "commit": commit, "dirty": dirty}


def _git(folder: Path, *words: str) -> str:
    """Output of git for a folder; "" outside a checkout, or without git."""
    with suppress(OSError, subprocess.SubprocessError):
        command = ["git", "-C", str(folder), *words]
        done = subprocess.run(command, capture_output=True, timeout=_GIT_SECONDS, check=True)
        return os.fsdecode(done.stdout).strip()  # names as files have them: UTF-8 on Windows, whatever its code page
    return ""


def hardware_text(record: dict[str, Any]) -> str:
    """The machine that a run was made on, in words.

    Args:
        record: Contents of `run.json`.

    Returns:
        Such as "AMD EPYC, Linux-6.1, 2 cores"; "" where nothing is known.
    """
    parts = [str(record[key]) for key in ("processor", "platform") if record.get(key)]
    return ", ".join([*parts, *([f"{record['cores']} cores"] if record.get("cores") else [])])


def code_text(record: Mapping[str, Any], numerics: Mapping[str, int] | None = None) -> str:
    """Which code made a record, in a line.

    Args:
        record: What holds a `code` as `code_state` gives it, such as `run.json`; or, of before the numerics had
            versions, a `code_version`.
        numerics: Versions of the parts that made it, which the text then begins with.

    Returns:
        Text such as `commit 1a2b3c4d5e6f` or `engine 1, metrics 1; commit 1a2b3c4d5e6f (changed)`; "" where the record
        knows nothing of its code.
    """
    code = record.get("code")
    if not isinstance(code, Mapping):
        return str(record.get("code_version") or "")
    state = f"commit {code['commit']}" if code.get("commit") else f"version {code.get('package', '?')}"
    state += " (changed)" if code.get("dirty") else ""
    return f"{numerics_text(numerics)}; {state}" if numerics else state


def version_text(numerics: Mapping[str, int]) -> str:
    """Versions of the numerics and the commit of the code that runs, in a line.

    Args:
        numerics: Version of each part, by name.

    Returns:
        Text such as `diagnosis 1, engine 1; commit 1a2b3c4d5e6f`.
    """
    return code_text({"code": code_state()}, numerics)


def _library_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _processor() -> str:
    """The processor's name, as far as the system tells it."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def environment() -> dict[str, Any]:
    """Code, library versions and hardware, for the record."""
    return {
        "code": code_state(),
        "python": sys.version.split()[0],
        "libraries": {name: _library_version(name) for name in _LIBRARIES},
        "platform": platform.platform(),
        "processor": _processor(),
        "cores": cores(),
    }
