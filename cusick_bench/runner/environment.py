"""What a result depends on beside its problem: code, library versions, hardware."""

import hashlib
import os
import platform
import sys
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import cusick_bench

# Layers whose code decides the numbers of a cell.
_DECISIVE = ("sim", "datasets", "problem", "solvers", "metrics")
_LIBRARIES = ("numpy", "scipy", "torch", "numba", "nlopt", "cvxpy", "botorch", "gpytorch", "cma")


@lru_cache(maxsize=4)
def code_version(*more: str) -> str:
    """Package version and a fingerprint of the source that decides numbers: `0.1.0+1a2b3c4d5e6f`.

    Args:
        more: Layers that decide them beside those of every cell, such as `diagnosis`.
    """
    root = Path(cusick_bench.__file__).parent
    digest = hashlib.sha256()
    for layer in (*_DECISIVE, *more):
        for path in sorted((root / layer).resolve().rglob("*.py")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return f"{cusick_bench.__version__}+{digest.hexdigest()[:12]}"


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    """Versions and hardware, for the record."""
    return {
        "code_version": code_version(),
        "python": sys.version.split()[0],
        "libraries": {name: _library_version(name) for name in _LIBRARIES},
        "platform": platform.platform(),
        "processor": _processor(),
        "cores": cores(),
    }
