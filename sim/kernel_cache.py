"""Folder of the cache of compiled kernels, which changes with the code that is compiled into them.

Numba keeps a kernel on disk until the file in which it is defined changes. The functions that it calls are compiled
into it, and a change of those in another file (a material law) would go unnoticed: the old law would still be
simulated. So kernels are kept in a folder named by a hash of all files whose functions are called from other files.

Files with kernels import numba from here (`from cusick_bench.sim.kernel_cache import numba`), since the folder must be
known before a kernel is defined; modules without kernels do not import numba.
"""

import atexit
import hashlib
import logging
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core import config

_log = logging.getLogger(__name__)
_OWN = re.compile(r"kernels-[0-9a-f]{12}")  # names of the folders that are made here

CALLED = (
    "sim/laws/*.py", "sim/engine/plate/block_sums.py", "sim/engine/plate/points.py", "sim/linear/dense.py",
    "sim/linear/lanes.py", "metrics/distances/surface.py",
)  # fmt: skip
"""Files whose compiled functions those of other files call."""


def keep_by_content() -> None:
    """Sets the folder of the kernels; to be called before any kernel is defined.

    It lies in NUMBA_CACHE_DIR where that is set, else beside the package, or in the user's cache where the package
    cannot be written. Where none can be, the kernels of this process go with it, and a warning says so.
    """
    here, digest = Path(__file__).parent, hashlib.sha256()
    for path in sorted(path for name in CALLED for path in here.parent.glob(name)):
        digest.update(path.read_bytes())
    configuration: Any = config
    asked = configuration.CACHE_DIR
    parents = [Path(asked)] if asked else [here / "__pycache__", platformdirs.user_cache_path("cusick-bench")]
    folders = [parent / f"kernels-{digest.hexdigest()[:12]}" for parent in parents]
    configuration.CACHE_DIR = str(next(filter(_writable, folders), None) or _lost(parents))


def _writable(folder: Path) -> bool:
    """Whether kernels can be kept there; those of other versions go when the first of this one is."""
    try:
        if not folder.exists():
            for old in folder.parent.glob("kernels-*"):
                if _OWN.fullmatch(old.name):  # the user's own folder may hold others
                    shutil.rmtree(old, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _lost(parents: list[Path]) -> str:
    """A folder that is gone when this process ends."""
    folder = tempfile.mkdtemp(prefix="cusick-bench-kernels-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _log.warning(
        "no kernel can be kept in %s, so every process compiles its own, which takes a minute; set NUMBA_CACHE_DIR to "
        "a folder that can be written",
        " or ".join(map(str, parents)),
    )
    return folder


keep_by_content()

__all__ = ["CALLED", "keep_by_content", "numba"]
