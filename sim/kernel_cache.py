"""Where compiled kernels are kept, so that none outlives a change of the code that was compiled into it.

Numba keeps a kernel on disk until the file that it is written in changes. The functions that it calls are compiled into
it, and those of another file (a material law) may change unnoticed: the old law would go on being simulated. So kernels
lie in a folder named after the content of the files whose functions others call.

Files with kernels import numba from here (`from cusick_bench.sim.kernel_cache import numba`): the folder has to be
known before a kernel is defined, and who defines none does not wait for numba.
"""

import hashlib
import shutil
from pathlib import Path
from typing import Any

import numba
from numba.core import config

CALLED = ("sim/laws/*.py", "sim/linear/dense.py", "metrics/surface.py")
"""Files whose compiled functions those of other files call."""


def keep_by_content() -> None:
    """Sets the folder of the kernels; to be called before any kernel is defined.

    Where it cannot be written, numba chooses one itself.
    """
    here, digest = Path(__file__).parent, hashlib.sha256()
    for path in sorted(path for name in CALLED for path in here.parent.glob(name)):
        digest.update(path.read_bytes())
    configuration: Any = config
    parent = Path(configuration.CACHE_DIR or here / "__pycache__")
    folder = parent / f"kernels-{digest.hexdigest()[:12]}"
    if not folder.exists():
        for old in parent.glob("kernels-*"):
            shutil.rmtree(old, ignore_errors=True)
    configuration.CACHE_DIR = str(folder)


keep_by_content()

__all__ = ["CALLED", "keep_by_content", "numba"]
