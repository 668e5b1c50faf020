"""Lets every worker of pytest-xdist compute on one thread; to be imported before numba, numpy and torch.

Workers share the cores: where each has a thread for every core, threads of one wait for those of another, and tests of
small meshes take twice as long. Tests that are about several threads are marked `threads` and run without workers.
"""

import os

_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.update(dict.fromkeys(_THREADS, "1"))
